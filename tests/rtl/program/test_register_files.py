"""rtl/program/register_files.py: header and SystemRDL say the same of every register."""

import re
import subprocess

from systemrdl import RDLCompiler
from systemrdl.node import FieldNode, RegNode

from eskin.golden.core import PRESETS
from eskin.rtl.fpga.generate import c_header
from eskin.rtl.program.memory_map import interface_registers, mapped
from eskin.rtl.program.register_files import entries, markdown, system_rdl
from tests.golden.model.test_prototypes import taught_model
from tests.support.table import each_row

THESIS = PRESETS["thesis"]
LARGE = THESIS.replace(
    taxels=32, feature_shift=(), masked_taxels=(0, 17), fault_frames=16, position=True, rows=4, columns=8
)
PINS = THESIS.replace(converter="ads7953", position=True, stimulator="decisions")
DESIGNS = [(THESIS, False), (LARGE, True), (PINS, True)]


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


def test_reads_that_change_something_are_marked(tmp_path):
    """A debugger or a cache must not read these by itself."""
    config = taught_model("gru").config
    path = tmp_path / "eskin.rdl"
    path.write_text(system_rdl(entries(config, True)))
    compiler = RDLCompiler()
    compiler.compile_file(str(path))
    nodes = list(compiler.elaborate().top.children(unroll=False))
    marked = {
        node.inst_name for node in nodes if any(field.get_property("onread") for field in node.fields())
    }
    assert marked == {"DECISION", "PLACES", "NEXT_TAXEL"}
    assert {node.inst_name for node in nodes if node.external} == marked


@each_row("config, shell", DESIGNS)
def test_every_file_says_the_same(config, shell, tmp_path):
    registers = entries(config, shell)
    view = rdl_view(config, shell, tmp_path)
    assert view == {
        register.name: (
            4 * register.address,
            register.count,
            {field.name: (field.low, field.high, register.access, field.reset) for field in register.fields},
        )
        for register in registers
    }
    addresses = {register.address + k for register in registers for k in range(register.count)}
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
    command = "gcc -std=c11 -Wall -Werror -fsyntax-only -x c -".split()
    done = subprocess.run(command, input=text, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr[:2000]
    assert {name for name in view if f"| {name} |" not in markdown()} == set()
