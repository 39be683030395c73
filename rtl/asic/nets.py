"""A flat netlist of library cells as a graph: at which pins its nets begin and end, and the energy of a change of each.

A change of a net costs ``e = E_out + sum E_in + C V^2 / 2`` with the driver's and the receivers' internal
energies of an edge and ``C`` = pins + wire. A clock net costs ``2 e`` for each of its cycles.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from eskin.rtl.asic.liberty import Cell, WireLoad

BAND = 2.0
"""Within such a factor a chip's true figure lies, by the feasibility study; no layout checks it."""


class Nets:
    """A flat module of Yosys' JSON, of library cells.

    Attributes
    ----------
    cells: library cell of each instance; driver: (instance, pin) that drives each net; receivers: (instance,
    pin, place in a wide pin) that read it; clock: the clock's own net.
    """

    def __init__(self, module: Mapping[str, Any], library: Mapping[str, Cell]):
        self.module, self.clock = module, module["ports"]["clk"]["bits"][0]
        self.cells = {name: library[cell["type"].lstrip("\\")] for name, cell in module["cells"].items()}
        self.driver: dict[int, tuple[str, str]] = {}
        self.receivers: dict[int, list[tuple[str, str, int]]] = {}
        for name, cell in self.cells.items():
            for pin, bits in module["cells"][name]["connections"].items():
                for place, bit in enumerate(bits):
                    if isinstance(bit, int) and cell.pins[pin].direction == "output":
                        self.driver[bit] = name, pin
                    elif isinstance(bit, int):
                        self.receivers.setdefault(bit, []).append((name, pin, place))


@dataclass(frozen=True, kw_only=True)
class Costs:
    """joule, kind: of a change of each net by its number; of a cycle for nets of kind ``clock``, which gates
    drive. Other nets have the kind of the cell that drives them. root_j: a cycle of the clock's first net, which no
    gate stops."""

    joule: Mapping[int, float]
    kind: Mapping[int, str]
    root_j: float


def costs(nets: Nets, voltage: float, wire: WireLoad) -> Costs:
    """Costs of a netlist whose nets all have the load of ``wire``."""

    def toggle(name: str, pin: str) -> float:  # a macro's reads and writes are counted by themselves
        return 0.0 if nets.cells[name].kind == "memory" else nets.cells[name].pins[pin].toggle_j

    def edge(bit: int) -> float:
        ends = nets.receivers.get(bit, ())
        load = sum(nets.cells[name].pins[pin].capacitance for name, pin, _ in ends) + wire.capacitance(
            len(ends)
        )
        own = toggle(*nets.driver[bit]) if bit in nets.driver else 0.0
        return own + sum(toggle(name, pin) for name, pin, _ in ends) + load * voltage**2 / 2

    joule, kind = {}, {}
    for bit in {*nets.driver, *nets.receivers} - {nets.clock}:
        kind[bit] = nets.cells[nets.driver[bit][0]].kind if bit in nets.driver else "input"
        if kind[bit] == "gate":
            kind[bit] = "clock"
        joule[bit] = edge(bit) * (1 + (kind[bit] == "clock"))
    return Costs(joule=joule, kind=kind, root_j=2 * edge(nets.clock))
