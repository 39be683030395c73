"""A chip's netlist as tables that one small C++ program steps a clock cycle at a time, adding up what changes
cost.

The program (cosim/gates.cpp) is compiled once, whatever the netlist: a cell is its truth table and the nets
at its pins, and only cells whose inputs changed are looked at. In each cycle all nets settle. The edge then
passes the enabled clock gates, flip-flops and macros sample their inputs, and latches with a high gate take
the new outputs of the flip-flops. With delays the same happens in order of time, so that glitches are seen
and counted apart.
"""

import functools
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from graphlib import TopologicalSorter
from pathlib import Path
from typing import Any

import numpy as np

from eskin.cosim import device
from eskin.cosim.runner import kept, need_tools, step
from eskin.golden.core import SimulationError

BUILDS = Path("build/gates")
"""The compiled program by content; safe to delete."""
SOURCES = device.KERNEL, Path(__file__).with_suffix(".cpp")
"""The first one includes the other."""
COMPILE = ("g++", "-std=c++17", "-O2", "-shared", "-fPIC", "-DNETLIST", str(device.KERNEL), "-o", "gates.so")
TICK_S = 1e-12
"""Unit of delays."""
HORIZON = 1 << 16
"""Ticks of a delay, less than these."""
NAME = re.compile(r"[A-Za-z_]\w*")


@functools.cache
def _truth(function: str, names: tuple[str, ...]) -> int:
    """Truth table of a function in Python's operators for the combinations of ``names``, the first one the
    lowest bit of its number."""
    code = compile(function.strip(), "liberty", "eval")
    values = (
        (at, {name: at >> place & 1 for place, name in enumerate(names)}) for at in range(1 << len(names))
    )
    return sum((eval(code, {"__builtins__": {}}, value) & 1) << at for at, value in values)


def _ticks(cell: Any, pin: str) -> int:
    return min(HORIZON - 1, max(1, round(cell.pins[pin].delay_s / TICK_S)))


_Function = tuple[int, list[int], int, int]
"""Net, nets of its inputs, truth table, delay."""


class Chip:
    """A module of Yosys' JSON, one flat netlist, in simulation; its states begin at random.

    Parameters
    ----------
    cells:
        Library cells by name (eskin.rtl.asic.liberty.Cell).
    expression:
        A Liberty function in C's operators, which are Python's.
    seed:
        Of what states and memories begin with.
    wrong:
        A logic cell that says the opposite.
    delays:
        Each cell takes its table's delay; otherwise nets settle without one.
    builds:
        Where the compiled program is kept.

    Attributes
    ----------
    nets: how many; gates: nets of the clock gates' outputs, in the order of their tables; top: number of the
    gate that all clocks come from, or None; macros: their names.

    Raises
    ------
    InputError, SimulationError
        There is no g++; the netlist does not settle.
    """

    def __init__(
        self,
        module: Mapping[str, Any],
        cells: Mapping[str, Any],
        expression: Callable[[str], str],
        seed: int,
        wrong: str | None = None,
        *,
        delays: bool = False,
        builds: Path = BUILDS,
    ) -> None:
        need_tools(("g++",), "playing a chip's netlist")
        folder = kept(builds, "gates", [COMPILE, *SOURCES], lambda folder: step(COMPILE, folder))
        self.library = device.Library(folder / "gates.so")
        self._expression, self._wrong = expression, wrong
        root = module["ports"]["clk"]["bits"][0]
        ends = [bits for cell in module["cells"].values() for bits in cell["connections"].values()]
        ends += [port["bits"] for port in module["ports"].values()]
        nets = [bit for bits in ends for bit in bits if isinstance(bit, int)]
        self.nets = 1 + max(nets)
        by_kind: defaultdict[str, list[tuple[str, Any, dict]]] = defaultdict(list)
        for name, cell in module["cells"].items():
            kind, pins = cells[cell["type"]], cell["connections"]
            by_kind[kind.kind].append((name, kind, {pin: bits for pin, bits in pins.items() if bits}))
        self._fixed = {
            bits[0]: int("HI" in pin)
            for _, kind, pins in by_kind["other"]
            for pin, bits in pins.items()
            if isinstance(bits[0], int) and kind.pins[pin].direction == "output"
        }
        of_net = {}
        for _, kind, pins in by_kind["gate"]:
            role = {kind.pins[pin].gate: bits[0] for pin, bits in pins.items()}
            of_net[role["output"]] = role["clock"], role["enable"]
        order = TopologicalSorter({net: {clock} for net, (clock, _) in of_net.items()}).static_order()
        self.gates = [net for net in order if net in of_net]
        clocks = [of_net[net][0] for net in self.gates]
        enables = [self.net(of_net[net][1]) for net in self.gates]
        self._gate_of = {root: -1} | {net: number for number, net in enumerate(self.gates)}
        entered = [number for number, clock in enumerate(clocks) if clock == root]
        self.top = entered[0] if len(entered) == nets.count(root) - 1 == 1 else None
        self._functions = self._logic(by_kind["logic"])  # those of flip-flops follow
        flops = self._states(by_kind["flip-flop"], "clocked_on", "next_state")
        latches = self._states(by_kind["latch"], "enable", "data_in")
        rows: list[Any] = [(net, -1, *row) for net, *row in self._functions]
        rows += [(q, inverse, [data], 0b10, delay) for _, data, q, inverse, delay in latches]
        output, inverse, inputs, table, delay = zip(*rows, strict=True)
        words, memory = self._memories(by_kind["memory"])
        self.macros = [name for name, *_ in by_kind["memory"]]
        groups = [[row[0] for row in group] for group in (flops, latches)]
        bounds = range(-1, len(enables) + 1)  # behind no gate (-1), the first gate, the second ...
        tables: list[Any] = [
            output,
            inverse,
            np.cumsum([0, *map(len, inputs)]),
            np.concatenate(inputs),
            delay,
        ]
        tables += [enables, [self._gate_of[clock] for clock in clocks], memory]
        tables += [
            *np.array(flops).reshape(-1, 5).T[1:],
            *(np.searchsorted(group, bounds) for group in groups),
        ]
        # kept, because the program is told no more than their addresses
        self._kept = [np.ascontiguousarray(column, np.int32) for column in tables]
        self._kept.append(np.array(table, np.uint64))
        counts = [self.nets, len(self._functions), len(latches), len(enables), len(flops), len(self.macros)]
        addresses = [column.ctypes.data for column in self._kept]
        self._chip = self.library.make(np.array([*counts, *addresses], np.int64))
        self._enable = enables[self.top] if self.top is not None else 0
        self._sizes = len(flops) + len(latches), words
        if delays:
            self.library.with_delays(self._chip)
        self._ports: defaultdict[str, list[int]] = defaultdict(list)
        for name, port in module["ports"].items():
            of, _, place = name.removesuffix("]").partition("[")  # of a vector, or of one of its bits
            bits, low = self._ports[of], int(place or 0)
            bits += [0] * (low + len(port["bits"]) - len(bits))
            bits[low : low + len(port["bits"])] = map(self.net, port["bits"])
        self.begin(seed)

    def __del__(self) -> None:
        if getattr(self, "_chip", None):
            self.library.drop(self._chip)

    def begin(self, seed: int) -> None:
        """As after power-on: every flip-flop, latch and word of a macro anything."""
        rng, (states, words) = np.random.default_rng(seed), self._sizes
        bits, contents = rng.integers(0, 2, states, np.uint8), rng.integers(0, 1 << 16, words, np.uint32)
        if self.library.begin(self._chip, bits, contents):
            raise SimulationError("the netlist does not settle within a clock cycle")

    def open(self) -> int:
        """As `eskin.cosim.device.Model`; another one's states are this one's."""
        return self.library.open_device(self._chip, self.top is not None, self._enable)

    def port(self, opened: int, name: str) -> int:
        """As `eskin.cosim.device.Model`."""
        nets = self._ports.get(name)
        return self.library.port_of(opened, np.array(nets), len(nets)) if nets else -1

    def count_into(self, joule: np.ndarray, costs: Sequence[np.ndarray]) -> None:
        """Add up in ``joule``, by kind, what changes cost, and the clock gates that let an edge through, from every edge
        of a device on.

        Parameters
        ----------
        joule:
            Twice as many places as kinds; with delays the second half is for changes that a net takes back within a cycle.
        costs:
            Joule a change, kind, of every net; joule of an edge, kind, of every gate; joule of a read and a write,
            kind, of every macro. Kinds are places in ``joule``.
        """
        kinds = zip(costs, 3 * (float, np.uint8), strict=True)
        self._costs = joule, *(np.ascontiguousarray(part, kind) for part, kind in kinds)
        self.library.costs(self._chip, joule, len(joule) // 2, *self._costs[1:])

    def net(self, bit: int | str) -> int:
        """Number of a net; 0 and 1 are those that never change."""
        return self._fixed.get(bit, bit) if isinstance(bit, int) else int(bit == "1")

    def _states(self, cells: Iterable[tuple[str, Any, dict]], clock: str, data: str) -> list[tuple[int, ...]]:
        """(gate, net of its input, net of the state and of its opposite or -1, delay) of each, by gate. clock, data: their
        names in the library.

        An input that depends on several pins counts as one more function.
        """
        states = []
        for _, kind, pins in cells:
            ends = {pin: bits[0] for pin, bits in pins.items()}
            following, nets, delay = kind.state[data], {True: -1, False: -1}, 1
            for pin, port in kind.pins.items():
                if port.direction == "output" and pin in ends:
                    nets[port.function == kind.state["state"]] = ends[pin]
                    delay = _ticks(kind, pin)
            if following not in ends:
                if nets[True] < 0:  # a net that nobody else sees, for the function that reads the state
                    nets[True], self.nets = self.nets, self.nets + 1
                of = self._evaluated(following, ends | {kind.state["state"]: nets[True]})
                self._functions.append((self.nets, *of, 1))
                ends[following], self.nets = self.nets, self.nets + 1
            gate = self._gate_of[ends[kind.state[clock]]]
            states.append((gate, self.net(ends[following]), nets[True], nets[False], delay))
        return sorted(states, key=lambda row: row[0])

    def _memories(self, cells: Iterable[tuple[str, Any, dict]]) -> tuple[int, list[int]]:
        """Words of the macros, their outputs among them, and the macros, one behind the other, as the C++ program
        reads them."""
        memory: list[int] = []
        total = 0
        for _, kind, pins in cells:
            shows = [bit if isinstance(bit, int) else -1 for bit in pins["A_DOUT"]]
            memory.append(self._gate_of[pins["A_CLK"][0]])
            memory += [self.net(pins[pin][0]) for pin in ("A_MEN", "A_WEN", "A_REN")]
            memory += [kind.words, len(pins["A_ADDR"]), len(shows), _ticks(kind, "A_DOUT")]
            memory += [self.net(bit) for pin in ("A_ADDR", "A_DIN", "A_BM") for bit in pins[pin]]
            memory += shows
            total += kind.words + sum(net >= 0 for net in shows)
        return total, memory

    def _evaluated(self, function: str, ends: Mapping[str, int | str]) -> tuple[list[int], int]:
        """Nets of a function's inputs and its truth table; ``ends``: the net of each name."""
        text = self._expression(function)
        names = tuple(sorted(set(NAME.findall(text))))
        return [self.net(ends[name]) for name in names], _truth(text, names)

    def _logic(self, cells: Iterable[tuple[str, Any, dict]]) -> list[_Function]:
        """Outputs of logic cells in topological order."""
        functions: dict[int, _Function] = {}
        for name, kind, pins in cells:
            ends = {pin: bits[0] for pin, bits in pins.items()}
            for pin, port in kind.pins.items():
                if port.direction == "output" and port.function and pin in ends:
                    inputs, table = self._evaluated(port.function, ends)
                    if name == self._wrong:
                        table ^= (1 << (1 << len(inputs))) - 1
                    functions[ends[pin]] = ends[pin], inputs, table, _ticks(kind, pin)
        order = TopologicalSorter({net: row[1] for net, row in functions.items()}).static_order()
        return [functions[net] for net in order if net in functions]
