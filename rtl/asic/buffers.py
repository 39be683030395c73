"""Drivers of nets with many receivers, which synthesis leaves to placement: buffer trees, without which such
a net limits the clock, and one constant cell per few pins."""

from collections.abc import Mapping

from eskin.golden.core import Record
from eskin.rtl.asic.liberty import Cell
from eskin.rtl.asic.nets import Nets

RECEIVERS_MAX = 16
"""A net with more gets buffers."""


def buffer_of(cells: Mapping[str, Cell]) -> Cell | None:
    """The smallest buffer, with the smallest leakage if there are several; None if a process has none. A chip
    for sensors has clocks of a few MHz, so the load of 16 receivers needs no larger one."""
    buffers = [cell for cell in cells.values() if cell.kind == "logic" and cell.usable and _through(cell)]
    return min(buffers, key=lambda cell: (cell.area, cell.leakage, cell.name), default=None)


def _through(cell: Cell) -> tuple[str, str] | None:
    """(input, output) of a cell that forwards its only input."""
    inputs, outputs = (
        [name for name, pin in cell.pins.items() if pin.direction == way] for way in ("input", "output")
    )
    if len(inputs) == len(outputs) == 1 and "buf" in cell.name:
        hands_on = cell.pins[outputs[0]].function.strip("() ") == inputs[0]
        return (inputs[0], outputs[0]) if hands_on else None
    return None


def insert(module: Record, cells: Mapping[str, Cell], most: int = RECEIVERS_MAX) -> int:
    """Insert buffers into a module of Yosys' JSON, so that no net has more than ``most`` receivers. Returns
    their number. A constant gets more cells instead of buffers. The clock's net, and nets behind a clock
    gate, wait for a clock tree.
    """
    chosen = buffer_of(cells)
    if chosen is None:
        return 0
    enters, leaves = _through(chosen) or ("", "")
    nets = Nets(module, cells)
    left_alone = {
        nets.clock,
        *(bit for bit, (name, _) in nets.driver.items() if nets.cells[name].kind == "gate"),
    }
    named = (bit for name in module["netnames"].values() for bit in name["bits"] if isinstance(bit, int))
    following = 1 + max(1, *nets.driver, *nets.receivers, *named)
    buffers = 0
    for net, pins in sorted(nets.receivers.items()):
        ends: list[tuple[list, int]] = [
            (module["cells"][name]["connections"][pin], place) for name, pin, place in pins
        ]
        driver, out = nets.driver.get(net, ("", ""))
        constant = driver and not any(pin.direction == "input" for pin in nets.cells[driver].pins.values())
        while net not in left_alone and len(ends) > most:
            above: list[tuple[list, int]] = []
            size = -(-len(ends) // -(-len(ends) // most))  # as many in each
            for low in range(size if constant else 0, len(ends), size):
                for bits, place in ends[low : low + size]:
                    bits[place] = following
                connections = {out: [following]} if constant else {enters: [net], leaves: [following]}
                kind = module["cells"][driver]["type"] if constant else chosen.name
                module["cells"][f"buffer_{following}"] = {"type": kind, "connections": connections}
                if not constant:
                    above.append((connections[enters], 0))
                    buffers += 1
                following += 1
            ends = above
    return buffers
