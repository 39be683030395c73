"""Energy of a change of each net of a chip's netlist: Liberty energy of the cells, capacitance of pins and of
a wire load.

A change of a net costs ``e = E_out + sum E_in + C V^2 / 2`` with the driver's and the receivers' internal
energies of an edge and ``C`` = pins + wire. A clock net costs ``2 e`` for each of its cycles. Glitches cost
as much a change, and are counted apart (`eskin.verbs.chip_energy`).
"""

from collections.abc import Mapping
from dataclasses import dataclass

from eskin.rtl.asic.liberty import WireLoad
from eskin.rtl.asic.nets import Nets

BAND = 2.0
"""Within such a factor a chip's true figure lies, by the feasibility study; no layout checks it."""


@dataclass(frozen=True, kw_only=True)
class Costs:
    """joule, kind: of a change of each net by its number; of a cycle for nets of kind ``clock``, which gates
    drive. Other kinds are those of the cells that drive them. root_j: a cycle of the clock's first net, which no
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
