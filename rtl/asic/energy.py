"""What a change of each net of a chip's netlist costs: Liberty energy of the cells, capacitance of pins and of a wire load.

A change of a net costs ``e = E_out + sum E_in + C V^2 / 2`` with the driver's and the receivers' internal energies of an edge and
``C`` = pins + wire. A clock net costs ``2 e`` for each of its cycles. Glitches cost as much a change, and
are counted apart (`eskin.verbs.chip_energy`).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from eskin.rtl.asic.liberty import Cell, WireLoad

BAND = 2.0
"""Within such a factor a chip's true figure lies, by the feasibility study; no layout checks it."""


@dataclass(frozen=True, kw_only=True)
class Costs:
    """joule, kind: of a change of each net by its number; of a cycle for nets of kind ``clock``, which gates drive. Other kinds are those
    of the cells that drive them. driver: of each net the cell that drives it.
    access_j: of macros, read and write; root_j: a cycle of the clock's first net, which no gate stops."""

    joule: Mapping[int, float]
    kind: Mapping[int, str]
    driver: Mapping[int, str]
    access_j: tuple[float, float]
    root_j: float


def costs(flat: Path, top: str, known: Mapping[str, Cell], voltage: float, wire: WireLoad) -> Costs:
    """Costs of the netlist in Yosys' JSON.

    Parameters
    ----------
    known:
        Cells by name.
    wire:
        Of every net.
    """
    module = json.loads(flat.read_text())["modules"][top]
    root = module["ports"]["clk"]["bits"][0]
    driver: dict[int, tuple[Cell, str]] = {}
    drivers: dict[int, str] = {}
    receivers: dict[int, list[tuple[Cell, str]]] = {}
    for name, cell in module["cells"].items():
        what = known[cell["type"].lstrip("\\")]
        for pin, bits in cell["connections"].items():
            for bit in bits:
                if isinstance(bit, int):
                    if what.pins[pin].direction == "output":
                        driver[bit], drivers[bit] = (what, pin), name
                    else:
                        receivers.setdefault(bit, []).append((what, pin))

    def edge(bit: int) -> float:
        ends = receivers.get(bit, ())
        load = sum(what.pins[pin].capacitance for what, pin in ends) + wire.capacitance(len(ends))
        own = driver[bit][0].pins[driver[bit][1]].toggle_j if bit in driver and driver[bit][0].kind != "memory" else 0.0
        inner = sum(what.pins[pin].toggle_j for what, pin in ends if what.kind != "memory")
        return own + inner + load * voltage**2 / 2

    joule, kind, access = {}, {}, (0.0, 0.0)
    for bit in {bit for bits in (driver, receivers) for bit in bits} - {root}:
        kind[bit] = driver[bit][0].kind if bit in driver else "input"
        if kind[bit] == "gate":
            kind[bit] = "clock"
        joule[bit] = edge(bit) * (1 + (kind[bit] == "clock"))
    for cell in module["cells"].values():
        what = known[cell["type"]]
        if what.kind == "memory":
            access = what.access_j["read"], what.access_j["write"]
    return Costs(joule=joule, kind=kind, driver=drivers, access_j=access, root_j=2 * edge(root))
