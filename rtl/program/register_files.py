"""The registers of a design as files for other tools: C header, SystemRDL 2.0, CMSIS-SVD, IP-XACT 1685-2014,
a table for documents. All are written from `eskin.rtl.program.memory_map`."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.program.memory_map import (
    Bits,
    Described,
    InterfaceRegister,
    Register,
    ShellRegister,
    TeachRegister,
    interface_registers,
    mapped,
    mask_words,
    teach_registers,
)

ACCESS = {"ro": "read-only", "wo": "write-only", "rw": "read-write"}
RANGE = 512
"""Bytes behind a bus: 7 bits of word addresses."""
DEVICE_WIDTH = 32


@dataclass(frozen=True)
class Field:
    """Bits ``low`` to ``high`` of a register."""

    name: str
    low: int
    high: int
    text: str
    reset: int | None

    @property
    def width(self) -> int:
        """Bits."""
        return self.high - self.low + 1


@dataclass(frozen=True)
class Entry:
    """A register of a design; ``count`` of them lie side by side. ``reset`` None: depends on the design."""

    name: str
    address: int
    count: int
    bits: int
    access: str
    text: str
    effect: str
    reset: int | None
    fields: tuple[Field, ...]

    @property
    def sentence(self) -> str:
        """What it holds, and what an access does."""
        verb = "reading" if self.access == "ro" else "writing"
        return f"{self.text}. On {verb}: {self.effect}." if self.effect else f"{self.text}."


def entry(register: Described, count: int = 1, reset: int | None = None) -> Entry:
    """``register`` as the files have it; ``reset`` in place of its own where that depends on the design."""
    bits = DEVICE_WIDTH if isinstance(register, ShellRegister) else 16
    begin = reset if register.reset is None else register.reset
    places: Iterable[tuple[str, int, int, str]]
    if isinstance(register.fields, Mapping):
        places = [(name, low, high, "") for name, (low, high) in register.fields.items()]
    else:
        flags: type[Bits] = register.fields
        places = [(bit.name or "", bit.bit_length() - 1, bit.bit_length() - 1, bit.text) for bit in flags]
    fields = tuple(
        Field(name, low, high, text, None if begin is None else begin >> low & (2 << high - low) - 1)
        for name, low, high, text in places or [("VALUE", 0, bits - 1, "")]
    )
    return Entry(
        register.name,
        int(register),
        count,
        bits,
        register.access,
        register.text,
        register.effect,
        begin,
        fields,
    )


def entries(config: AcceleratorConfig, shell: bool = False, samples: bool = True) -> list[Entry]:
    """The registers of a design, by address; behind a bus (``shell``) those of its shell too, ``samples``
    those that take samples."""
    words = len(mask_words(config))
    present = [register for register in Register if register in mapped(config)]
    begin: dict[int, int] = {
        InterfaceRegister[f"STIM_{name}"]: getattr(config.interface, f"stim_{name.lower()}")
        for name in ("AMPLITUDE", "DELAY", "FREQUENCY", "WIDTH")
    }
    if not any(mask_words(config)):
        begin[Register.MASK] = 0
    several: dict[int, int] = {Register.MASK: words, Register.TAXEL_FAULTS: words}
    fed = (ShellRegister.SAMPLE, ShellRegister.SAMPLE_PAIR, ShellRegister.NEXT_TAXEL)
    behind = [register for register in ShellRegister if shell and (samples or register not in fed)]
    return [
        entry(register, several.get(int(register), 1), begin.get(int(register)))
        for register in (*present, *interface_registers(config), *behind, *teach_registers(config))
    ]


# -------------------------------------------------------------------- C
def c_lines(registers: Iterable[Entry]) -> list[str]:
    """Word address, byte offset behind a bus, access and reset value of each register; mask and shift of its
    fields."""
    lines = ["/* ACCESS: 1 read, 2 write. OFFSET: bytes, behind a bus. */"]
    for register in registers:
        name = f"ESKIN_{register.name}"
        values = {
            "": f"0x{register.address:02X}u",
            "_OFFSET": f"0x{4 * register.address:03X}u",
            "_ACCESS": f"{('ro', 'wo', 'rw').index(register.access) + 1}u",
        } | ({} if register.reset is None else {"_RESET": f"0x{register.reset:X}u"})
        for field in register.fields:
            values |= {
                f"_{field.name}_MASK": f"0x{(2 << field.high) - (1 << field.low):X}u",
                f"_{field.name}_SHIFT": f"{field.low}u",
            }
        lines += ["", f"/* {register.sentence} */"]
        lines += [f"#define {name}{suffix} {value}" for suffix, value in values.items()]
    return lines


# -------------------------------------------------------------------- SystemRDL
def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def system_rdl(registers: Iterable[Entry]) -> str:
    """SystemRDL 2.0, byte addresses behind a bus."""
    software = {"ro": "sw = r; hw = w;", "wo": "sw = w; hw = r;", "rw": "sw = rw; hw = r;"}
    lines = ["addrmap eskin {", "  default regwidth = 32;", "  default accesswidth = 32;"]
    for register in registers:
        extra = "onread = ruser;" if register.access == "ro" and register.effect else ""
        if register.name == Register.CONTROL.name:
            extra = "singlepulse;"
        outside = "external " if "ruser" in extra else ""
        lines += [f"  {outside}reg {{", f"    desc = {_quoted(register.sentence)};"]
        for field in register.fields:
            reset = "" if field.reset is None else f" = {field.width}'h{field.reset:X}"
            text = f"desc = {_quoted(field.text)}; " if field.text else ""
            words = f"{text}{software[register.access]} {extra}".rstrip()
            lines.append(f"    field {{ {words} }} {field.name}[{field.high}:{field.low}]{reset};")
        array = f"[{register.count}]" if register.count > 1 else ""
        stride = " += 4" if register.count > 1 else ""
        lines.append(f"  }} {register.name}{array} @ 0x{4 * register.address:X}{stride};")
    return "\n".join([*lines, "};", ""])


# -------------------------------------------------------------------- XML
Content = str | int | list[tuple[str, Any]]
"""Of an element: text, or elements by tag; a tag may carry attributes as ``tag attribute=value``."""


def _element(tag: str, content: Content) -> ElementTree.Element:
    name, *attributes = tag.split()
    element = ElementTree.Element(name, dict(word.split("=", 1) for word in attributes))
    if isinstance(content, list):
        element.extend(_element(*child) for child in content)
    else:
        element.text = str(content)
    return element


def _document(root: ElementTree.Element) -> str:
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'


def svd(registers: Iterable[Entry], version: str) -> str:
    """CMSIS-SVD 1.3: one peripheral at address 0, registers of 32 bits."""

    def field(bits: Field) -> Content:
        return [
            ("name", bits.name),
            *_texts("description", bits.text),
            ("bitRange", f"[{bits.high}:{bits.low}]"),
        ]

    def register(row: Entry) -> Content:
        array = [("dim", row.count), ("dimIncrement", 4)] if row.count > 1 else []
        mask = sum((2 << bits.high) - (1 << bits.low) for bits in row.fields) if row.reset is not None else 0
        return [
            *array,
            ("name", row.name + ("[%s]" if array else "")),
            ("description", row.sentence),
            ("addressOffset", f"0x{4 * row.address:X}"),
            ("access", ACCESS[row.access]),
            ("resetValue", f"0x{row.reset or 0:X}"),
            ("resetMask", f"0x{mask:X}"),
            *([("readAction", "modify")] if row.access == "ro" and row.effect else []),
            ("fields", [("field", field(bits)) for bits in row.fields]),
        ]

    block = [("offset", 0), ("size", f"0x{RANGE:X}"), ("usage", "registers")]
    peripheral = [
        ("name", "ESKIN"),
        ("description", "Accelerator for touches of a tactile array"),
        ("baseAddress", "0x0"),
        ("addressBlock", block),
        ("registers", [("register", register(row)) for row in registers]),
    ]
    device = [
        ("name", "eskin"),
        ("version", version),
        ("description", "Registers of the eskin accelerator behind a bus"),
        ("addressUnitBits", 8),
        ("width", DEVICE_WIDTH),
        ("size", DEVICE_WIDTH),
        ("peripherals", [("peripheral", peripheral)]),
    ]
    return _document(_element("device schemaVersion=1.3", device))


def _texts(tag: str, text: str) -> list[tuple[str, str]]:
    return [(tag, text)] if text else []


IPXACT = "http://www.accellera.org/XMLSchema/IPXACT/1685-2014"
BUS_TYPES = {
    "apb": ("amba.com", "AMBA4", "APB4", "r0p0_0", "s_apb_"),
    "axi4lite": ("amba.com", "AMBA4", "AXI4-Lite", "r0p0_0", "s_axi_"),
    "wishbone": ("opencores.org", "wishbone", "wishbone", "b4", "wb_"),
}
"""Vendor, library, name and version of each bus in IP-XACT, and how its ports begin."""


def ip_xact(
    registers: Iterable[Entry],
    version: str,
    *,
    top: str,
    ports: Mapping[str, tuple[str, int]],
    bus: str | None,
) -> str:
    """IP-XACT 1685-2014: one memory map, the ports (``in`` or ``out``, bits) of the module ``top`` in
    ``top``.sv, and its ``bus``."""

    def named(vendor: str, library: str, name: str, release: str) -> str:
        return f"vendor={vendor} library={library} name={name} version={release}"

    def field(bits: Field, access: str, volatile: bool, action: str) -> Content:
        reset = [] if bits.reset is None else [("resets", [("reset", [("value", f"'h{bits.reset:X}")])])]
        return [
            ("name", bits.name),
            *_texts("description", bits.text),
            ("bitOffset", bits.low),
            *reset,
            ("bitWidth", bits.width),
            *([("volatile", "true")] if volatile else []),
            ("access", ACCESS[access]),
            *_texts("readAction", action),
        ]

    def register(row: Entry) -> Content:
        action = "modify" if row.access == "ro" and row.effect else ""
        return [
            ("name", row.name),
            ("description", row.sentence),
            *([("dim", row.count)] if row.count > 1 else []),
            ("addressOffset", f"'h{4 * row.address:X}"),
            ("size", DEVICE_WIDTH),
            *[("field", field(bits, row.access, row.access == "ro", action)) for bits in row.fields],
        ]

    block = [
        ("name", "registers"),
        ("baseAddress", "'h0"),
        ("range", RANGE),
        ("width", DEVICE_WIDTH),
        ("usage", "register"),
        *[("register", register(row)) for row in registers],
    ]

    def port(name: str, way: str, bits: int) -> Content:
        vectors = [("vectors", [("vector", [("left", bits - 1), ("right", 0)])])] if bits > 1 else []
        return [("name", name), ("wire", [("direction", way), *vectors])]

    interfaces = []
    if bus:
        vendor, library, name, release, prefix = BUS_TYPES[bus]
        maps = [
            (
                "portMap",
                [
                    ("logicalPort", [("name", name[len(prefix) :].upper())]),
                    ("physicalPort", [("name", name)]),
                ],
            )
            for name in ports
            if name.startswith(prefix)
        ]
        kind, abstraction = (
            named(vendor, library, name, release),
            named(vendor, library, f"{name}_rtl", release),
        )
        interface = [
            ("name", prefix.rstrip("_")),
            (f"busType {kind}", []),
            (
                "abstractionTypes",
                [("abstractionType", [(f"abstractionRef {abstraction}", []), ("portMaps", maps)])],
            ),
            ("slave", [("memoryMapRef memoryMapRef=eskin", [])]),
        ]
        interfaces = [("busInterfaces", [("busInterface", interface)])]
    file = [("name", f"{top}.sv"), ("fileType", "systemVerilogSource")]
    component = [
        *[("vendor", "eskin"), ("library", "ip"), ("name", top), ("version", version)],
        *interfaces,
        ("memoryMaps", [("memoryMap", [("name", "eskin"), ("addressBlock", block), ("addressUnitBits", 8)])]),
        ("model", [("ports", [("port", port(name, *shape)) for name, shape in ports.items()])]),
        ("fileSets", [("fileSet", [("name", "rtl"), ("file", file)])]),
    ]
    root = _element("component", component)
    for element in root.iter():
        element.tag = f"ipxact:{element.tag}"
        element.attrib = {f"ipxact:{name}": value for name, value in element.attrib.items()}
    return _document(root).replace("<ipxact:component>", f'<ipxact:component xmlns:ipxact="{IPXACT}">', 1)


# -------------------------------------------------------------------- documents
def markdown() -> str:
    """Every register that a design may have, as a table."""
    lines = ["| word | byte | register | access | holds |", "| --- | --- | --- | --- | --- |"]
    for register in (*Register, *InterfaceRegister, *ShellRegister, *TeachRegister):
        row = entry(register)
        bits = [
            f"{field.high}..{field.low} {field.name}" if field.width > 1 else f"{field.low} {field.name}"
            for field in row.fields
            if field.name != "VALUE"
        ]
        sentence = " ".join([row.sentence, f"Bits: {', '.join(bits)}."] if bits else [row.sentence])
        lines.append(
            f"| 0x{row.address:02X} | 0x{4 * row.address:03X} | {row.name} | {row.access} | {sentence} |"
        )
    return "\n".join(lines)
