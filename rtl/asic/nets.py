"""A flat netlist of library cells as a graph: at which pins its nets begin and end, the energy of a change of each, and
the block of the chain to which each cell belongs.

A change of a net costs ``e = E_out + sum E_in + C V^2 / 2`` with the driver's and the receivers' internal
energies of an edge and ``C`` = pins + wire. A clock net costs ``2 e`` for each of its cycles.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from eskin.rtl.asic.liberty import Cell, WireLoad
from eskin.rtl.fpga.blocks import join

BAND = 2.0
"""Within such a factor a chip's true figure lies, by the feasibility study; no layout checks it."""


OTHERS, TRUNK = "others", "clock trunk"


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

    def clock_pins(self) -> dict[str, int]:
        """Clock pins on the clock's own net, and behind gates."""
        nets = [
            net
            for net, ends in self.receivers.items()
            for name, pin, _ in ends
            if self.cells[name].pins[pin].clock
        ]
        before = nets.count(self.clock)
        return {"before_gates": before, "behind_gates": len(nets) - before}


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


def blocks_of(nets: Nets) -> dict[str, str]:
    """Block of each cell, by name: the block of the signal that it drives; if that has no name, of most of its
    receivers. The gate that stops the clock before all others is the trunk."""
    names: dict[int, str] = {}
    for name, net in nets.module["netnames"].items():
        if not net["hide_name"] and ".chain." in name:
            for bit in net["bits"]:
                if isinstance(bit, int) and name.count(".") > names.get(bit, "").count("."):
                    names[bit] = name
    drives: dict[str, list[int]] = {name: [] for name in nets.cells}
    for bit, (name, _) in nets.driver.items():
        drives[name].append(bit)
    of_cell = {}
    for name, bits in drives.items():
        memory = nets.cells[name].kind == "memory"
        if signal := name if memory else next((names[bit] for bit in bits if bit in names), ""):
            of_cell[name] = _block(signal)
    join(of_cell, drives, {bit: [name for name, *_ in ends] for bit, ends in nets.receivers.items()})
    gates = {name for name, cell in nets.cells.items() if cell.kind == "gate"}
    first = {name for name, *_ in nets.receivers.get(nets.clock, ())} & gates
    trunk = [n for n in first for bit in drives[n] for end, *_ in nets.receivers.get(bit, ()) if end in gates]
    return dict.fromkeys(nets.cells, OTHERS) | of_cell | dict.fromkeys(trunk, TRUNK)


def _block(name: str) -> str:
    """``engine.addends`` of ``accelerator.chain.engine.addends.sums.word``; lanes are one."""
    parts = re.sub(r"\[\d+\]", "", name.split(".chain.", 1)[1]).split(".")[:-1]
    depth = 2 if parts[:1] and parts[0] in ("engine", "front_end") else 1
    return re.sub(r"_\d+$", "", ".".join(parts[:depth])) or OTHERS
