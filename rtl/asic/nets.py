"""A flat netlist as a graph: at which pins its nets begin and end."""

from collections.abc import Mapping
from typing import Any

from eskin.rtl.asic.liberty import Cell


class Nets:
    """A flat module of Yosys' JSON, of library cells.

    Attributes
    ----------
    cells: library cell of each instance; driver: (instance, pin) that drives each net; receivers: (instance,
    pin, place in a wide pin) that read it; clock: the clock's own net.
    """

    def __init__(self, module: Mapping[str, Any], library: Mapping[str, Cell]) -> None:
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
