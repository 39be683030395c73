"""rtl/program/register_files.py: header, SystemRDL, SVD and IP-XACT say the same of every register."""

import re
import subprocess
from xml.etree import ElementTree

import pytest
from systemrdl import RDLCompiler
from systemrdl.node import FieldNode, RegNode

from eskin.golden.core import PRESETS
from eskin.rtl.fpga.generate import c_header, ports_of
from eskin.rtl.program.memory_map import interface_registers, mapped
from eskin.rtl.program.register_files import IPXACT, entries, ip_xact, markdown, svd, system_rdl

THESIS = PRESETS["thesis"]
LARGE = THESIS.replace(
    taxels=32, feature_shift=(), masked_taxels=(0, 17), fault_frames=16, position=True, rows=4, columns=8
)
PINS = THESIS.replace(converter="ads7953", position=True, stimulator="decisions")
DESIGNS = [(THESIS, False), (LARGE, True), (PINS, True)]
PORTS = {"clk": ("in", 1), "wb_adr": ("in", 10), "wb_ack": ("out", 1)}

SVD_ORDER = {
    "device": "name version description addressUnitBits width size peripherals",
    "peripheral": "name description baseAddress addressBlock registers",
    "register": "dim dimIncrement name description addressOffset access resetValue resetMask readAction fields",
    "field": "name description bitRange",
}
"""Order of the elements that we use, as in the schema CMSIS-SVD 1.3."""
IPXACT_ORDER = {
    "component": "vendor library name version busInterfaces memoryMaps model fileSets",
    "busInterface": "name busType abstractionTypes slave",
    "addressBlock": "name baseAddress range width usage register",
    "register": "name description dim addressOffset size field",
    "field": "name description bitOffset resets bitWidth volatile access readAction",
    "memoryMap": "name addressBlock addressUnitBits",
}
"""The same of IEEE 1685-2014."""
REQUIRED = {
    "device": "name version description addressUnitBits width peripherals",
    "peripheral": "name baseAddress",
    "register": "name addressOffset",
    "field": "name",
    "component": "vendor library name version",
    "addressBlock": "name baseAddress range width",
}


def rdl_view(config, shell, tmp_path):
    """{name: (byte address, count, {field: (low, high, access, reset)})} as the compiler understands it."""
    path = tmp_path / "eskin.rdl"
    path.write_text(system_rdl(entries(config, shell)))
    compiler = RDLCompiler()
    compiler.compile_file(str(path))
    view = {}
    for node in compiler.elaborate().top.children(unroll=False):
        assert isinstance(node, RegNode)
        fields = {}
        for field in node.fields():
            assert isinstance(field, FieldNode)
            access = {"r": "ro", "w": "wo", "rw": "rw"}[field.get_property("sw").name]
            fields[field.inst_name] = (field.low, field.high, access, field.get_property("reset"))
        view[node.inst_name] = (node.raw_absolute_address, (node.array_dimensions or [1])[0], fields)
    return view


def ordered(root, orders, required):
    """Elements that are out of order or missing, by their path."""
    for element in root.iter():
        tag = element.tag.split("}")[-1]
        names = [child.tag.split("}")[-1] for child in element]
        if tag in orders and element.find("*") is not None:
            places = [orders[tag].split().index(name) for name in names]
            assert places == sorted(places), (tag, names)
            assert set(required.get(tag, "").split()) <= set(names), (tag, names)


@pytest.mark.parametrize(("config", "shell"), DESIGNS)
def test_every_file_says_the_same(config, shell, tmp_path):
    registers = entries(config, shell)
    view = rdl_view(config, shell, tmp_path)
    assert view == {
        one.name: (
            4 * one.address,
            one.count,
            {field.name: (field.low, field.high, one.access, field.reset) for field in one.fields},
        )
        for one in registers
    }
    addresses = {one.address + k for one in registers for k in range(one.count)}
    assert {address for address in addresses if address < 0x40} == {
        *mapped(config),
        *interface_registers(config),
    }

    # ---- the header, as a compiler reads it
    header = c_header(config, registers)
    names = re.findall(r"#define (\w+) ", header)
    assert len(names) == len(set(names))
    checks = []
    for name, (address, _, fields) in view.items():
        checks += [f"ESKIN_{name}_OFFSET == {address}", f"ESKIN_{name} * 4 == {address}"]
        for field, (low, high, access, reset) in fields.items():
            checks.append(f"ESKIN_{name}_{field}_MASK == {(2 << high) - (1 << low)}u")
            checks.append(f"ESKIN_{name}_{field}_SHIFT == {low}")
            checks.append(f"ESKIN_{name}_ACCESS == {('ro', 'wo', 'rw').index(access) + 1}")
            if reset is not None:
                checks.append(f"(ESKIN_{name}_RESET & ESKIN_{name}_{field}_MASK) >> {low} == {reset}u")
    text = header + "".join(f'_Static_assert({check}, "{check}");\n' for check in checks)
    command = ["gcc", "-std=c11", "-Wall", "-Werror", "-fsyntax-only", "-x", "c", "-"]
    done = subprocess.run(command, input=text, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr[:2000]

    # ---- SVD
    root = ElementTree.fromstring(svd(registers, "1.2.3"))
    ordered(root, SVD_ORDER, REQUIRED)
    long = {"read-only": "ro", "write-only": "wo", "read-write": "rw"}
    got = {}
    for register in root.iter("register"):
        known, reset = (int(register.findtext(tag), 16) for tag in ("resetMask", "resetValue"))
        fields = {}
        for field in register.iter("field"):
            high, low = map(int, re.findall(r"\d+", field.findtext("bitRange")))
            begin = reset >> low & (2 << high - low) - 1 if known >> low & 1 else None
            fields[field.findtext("name")] = (low, high, long[register.findtext("access")], begin)
        count = int(register.findtext("dim") or 1)
        name = register.findtext("name").removesuffix("[%s]")
        got[name] = (int(register.findtext("addressOffset"), 16), count, fields)
    assert got == view
    assert max(4 * address for address in addresses) < int(root.find(".//addressBlock/size").text, 16)

    # ---- IP-XACT
    bus = "wishbone" if shell else None
    root = ElementTree.fromstring(ip_xact(registers, "1.2.3", top="top", ports=PORTS, bus=bus))
    ordered(root, IPXACT_ORDER, REQUIRED)
    got = {}
    for register in root.iter(f"{{{IPXACT}}}register"):
        find = lambda element, tag: element.findtext(f"{{{IPXACT}}}{tag}")
        fields = {}
        for field in register.iter(f"{{{IPXACT}}}field"):
            low, reset = int(find(field, "bitOffset")), field.find(f".//{{{IPXACT}}}value")
            high = low + int(find(field, "bitWidth")) - 1
            begin = None if reset is None else int(reset.text.removeprefix("'h"), 16)
            fields[find(field, "name")] = (low, high, long[find(field, "access")], begin)
        address = int(find(register, "addressOffset").removeprefix("'h"), 16)
        got[find(register, "name")] = (address, int(find(register, "dim") or 1), fields)
    assert got == view
    assert len(list(root.iter(f"{{{IPXACT}}}portMap"))) == 2 * shell
    assert {name for name in view if f"| {name} |" not in markdown()} == set()


def test_ports_are_those_of_the_module():
    text = "module top(clk, a);\n  input clk;\n  wire clk;\n  output [7:0] a;\nendmodule\nmodule b(c);\n  input c;\n"
    assert ports_of(text, "top") == {"clk": ("in", 1), "a": ("out", 8)}
