"""A chip's netlist as tables that one small C++ program steps a clock cycle at a time, adding up what changes
cost.

The program (cosim/gates.cpp) is compiled once, whatever the netlist: a cell is its truth table and the nets
at its pins, and only cells whose inputs changed are looked at. In each cycle all nets settle. The edge then
passes the enabled clock gates, flip-flops and macros sample their inputs, and latches with a high gate take
the new outputs of the flip-flops. With delays the same happens in order of time, so that glitches are seen
and counted apart. `eskin.cosim.gate_bench` plays recordings into it.
"""

import ctypes
import functools
import hashlib
import random
import re
import subprocess
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from graphlib import TopologicalSorter
from pathlib import Path
from typing import Any

import numpy as np

from eskin.cosim import device
from eskin.cosim.c_source import library, structure
from eskin.cosim.runner import kept, need_tools
from eskin.golden.core import Record, SimulationError

KERNEL = Path(__file__).with_suffix(".cpp")
"""Part of ``device.KERNEL``, which is what is compiled."""
BUILDS = Path("build/gates")
"""The compiled program by content; safe to delete."""
COMPILE_LIMIT_S = 120.0
COMPILE = ("g++", "-std=c++17", "-O2", "-shared", "-fPIC", "-DNETLIST")
TICK_S = 1e-12
"""Unit of delays."""
HORIZON = 1 << 16
"""Ticks of a delay, less than these."""
WORD_BITS = 16
"""Random bits of a macro's word."""
FLIP = "flip "
"""With a state's number behind it: a port that inverts that state."""
NAME = re.compile(r"[A-Za-z_]\w*")


_Tables = structure(KERNEL, "Tables")


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


_Placed = tuple[str, Any, dict]
"""A cell of the netlist: name, library cell, connections."""
_Function = tuple[int, list[int], int, int]
"""Net, nets of its inputs, truth table, delay."""


class Program:
    """Tables of a module of Yosys' JSON, one flat netlist.

    Parameters
    ----------
    cells:
        Library cells by name (eskin.rtl.asic.liberty.Cell).
    expression:
        A Liberty function in C's operators, which are Python's.
    wrong:
        A logic cell that says the opposite.

    Attributes
    ----------
    nets: how many; gates: nets of the clock gates' outputs, in the order of their tables; top: number of the
    gate that all clocks come from, or None; enable: the net that opens it; states, words: flip-flops and
    latches, words of macros with their outputs; macros: their names; state_nets: of each flip-flop, then of each
    latch, its nets.
    """

    def __init__(
        self,
        module: Mapping[str, Any],
        cells: Mapping[str, Any],
        expression: Callable[[str], str],
        wrong: str | None = None,
    ) -> None:
        self._expression, self._wrong = expression, wrong
        root = module["ports"]["clk"]["bits"][0]
        ends = [bits for cell in module["cells"].values() for bits in cell["connections"].values()]
        ends += [port["bits"] for port in module["ports"].values()]
        nets = [bit for bits in ends for bit in bits if isinstance(bit, int)]
        self.nets = 1 + max(nets)
        by_kind: defaultdict[str, list[_Placed]] = defaultdict(list)
        for name, cell in module["cells"].items():
            kind = cells[cell["type"]]
            by_kind[kind.kind].append((name, kind, cell["connections"]))
        self._fixed = {
            bits[0]: int("HI" in pin)
            for _, kind, connections in by_kind["other"]
            for pin, bits in connections.items()
            if isinstance(bits[0], int) and kind.pins[pin].direction == "output"
        }
        roles = [
            {
                port.gate: connections[pin][0]
                for pin, port in kind.pins.items()
                if port.gate and pin in connections
            }
            for _, kind, connections in by_kind["gate"]
        ]
        of_net = {role["output"]: role for role in roles}
        order = TopologicalSorter({net: {role["clock"]} for net, role in of_net.items()}).static_order()
        self.gates = [net for net in order if net in of_net]
        roles = [of_net[net] for net in self.gates]
        self._gate_of = {root: -1} | {net: number for number, net in enumerate(self.gates)}
        entered = [number for number, role in enumerate(roles) if role["clock"] == root]
        self.top = entered[0] if len(entered) == nets.count(root) - 1 == 1 else None
        self.enable = self.net(roles[self.top]["enable"]) if self.top is not None else 0
        functions = self._logic(by_kind["logic"])
        """Then those of flip-flops that take more than a pin."""
        flops = self._states(by_kind["flip-flop"], "clocked_on", "next_state", functions)
        latches = self._states(by_kind["latch"], "enable", "data_in", functions)
        rows: list[Any] = [(net, -1, *row) for net, *row in functions]
        rows += [(q, inverse, [data], 0b10, delay) for _, data, q, inverse, delay in latches]
        memory = self._memories(by_kind["memory"])
        self.macros = [name for name, *_ in by_kind["memory"]]
        self.states = len(flops) + len(latches)
        self.state_nets = [[net for net in row[2:4] if net >= 0] for row in (*flops, *latches)]
        columns = np.array(flops, np.int32).reshape(-1, 5).T
        arrays: Record = {
            "output": [row[0] for row in rows],
            "inverse": [row[1] for row in rows],
            "first": np.cumsum([0, *(len(row[2]) for row in rows)]),
            "inputs": [net for row in rows for net in row[2]],
            "delay": [row[4] for row in rows],
            "gate_enable": [self.net(role["enable"]) for role in roles],
            "gate_clock": [self._gate_of[role["clock"]] for role in roles],
            "memory": memory,
        }
        arrays |= {f"flop_{name}": columns[k] for k, name in enumerate(("data", "q", "inverse", "delay"), 1)}
        # behind no gate (-1), the first gate, the second ...
        for name, group in (("flop_first", flops), ("latch_first", latches)):
            arrays[name] = np.searchsorted([row[0] for row in group], range(-1, len(roles) + 1))
        # kept, because the tables hold no more than the arrays' addresses
        self._arrays = {name: np.ascontiguousarray(values, np.int32) for name, values in arrays.items()}
        self._arrays["table"] = np.array([row[3] for row in rows], np.uint64)
        self.tables = _Tables(
            nets=self.nets,
            cells=len(functions),
            latches=len(latches),
            gates=len(roles),
            flops=len(flops),
            memories=len(by_kind["memory"]),
            **{name: values.ctypes.data for name, values in self._arrays.items()},
        )

    def _states(
        self, cells: Sequence[_Placed], clock: str, data: str, functions: list[_Function]
    ) -> list[tuple[int, ...]]:
        """(gate, net of its input, nets of its outputs, delay) of each, by gate. clock, data: their names in the library.

        An input that is a function of several pins is one more of ``functions``.
        """
        states = []
        for _, kind, connections in cells:
            ends = {pin: bits[0] for pin, bits in connections.items() if bits}
            gate, following = self._gate_of[ends[kind.state[clock]]], kind.state[data]
            q, inverse, delay = self._outputs(kind, ends)
            if following not in ends:
                if q < 0:  # a net that nobody else sees, for the function that reads the state
                    q, self.nets = self.nets, self.nets + 1
                functions.append((self.nets, *self._evaluated(following, ends | {kind.state["state"]: q}), 1))
                ends[following], self.nets = self.nets, self.nets + 1
            states.append((gate, self.net(ends[following]), q, inverse, delay))
        return sorted(states, key=lambda row: row[0])

    def _memories(self, cells: Sequence[_Placed]) -> list[int]:
        """The macros, one behind the other, as the C++ program reads them; counts their ``words``."""
        memory: list[int] = []
        self.words = 0
        for _, kind, connections in cells:
            pins = {pin: [self.net(bit) for bit in bits] for pin, bits in connections.items()}
            shows = [bit if isinstance(bit, int) else -1 for bit in connections["A_DOUT"]]
            memory += [
                self._gate_of[connections["A_CLK"][0]],
                *(pins[pin][0] for pin in ("A_MEN", "A_WEN", "A_REN")),
                kind.words,
                len(pins["A_ADDR"]),
                len(shows),
                _ticks(kind, "A_DOUT"),
                *pins["A_ADDR"],
                *pins["A_DIN"],
                *pins["A_BM"],
                *shows,
            ]
            self.words += kind.words + sum(net >= 0 for net in shows)
        return memory

    def net(self, bit: int | str) -> int:
        """Number of a net; 0 and 1 are those that never change."""
        return self._fixed.get(bit, bit) if isinstance(bit, int) else int(bit == "1")

    def _outputs(self, kind: Any, ends: Mapping[str, int]) -> tuple[int, int, int]:
        """Nets of a state and of its opposite, -1 where there is none; delay."""
        nets, delay = {True: -1, False: -1}, 1
        for pin, port in kind.pins.items():
            if port.direction == "output" and pin in ends:
                nets[port.function == kind.state["state"]] = ends[pin]
                delay = _ticks(kind, pin)
        return nets[True], nets[False], delay

    def _evaluated(self, function: str, ends: Mapping[str, int | str]) -> tuple[list[int], int]:
        """Nets of a function's inputs and its truth table; ``ends``: the net of each name."""
        text = self._expression(function)
        names = tuple(sorted(set(NAME.findall(text))))
        return [self.net(ends[name]) for name in names], _truth(text, names)

    def _logic(self, cells: Sequence[_Placed]) -> list[_Function]:
        """Outputs of logic cells, each behind those that it reads."""
        functions: dict[int, _Function] = {}
        for name, kind, connections in cells:
            ends = {pin: bits[0] for pin, bits in connections.items() if bits}
            for pin, port in kind.pins.items():
                if port.direction == "output" and port.function and pin in ends:
                    inputs, table = self._evaluated(port.function, ends)
                    if name == self._wrong:
                        table ^= (1 << (1 << len(inputs))) - 1
                    functions[ends[pin]] = ends[pin], inputs, table, _ticks(kind, pin)
        order = TopologicalSorter({net: row[1] for net, row in functions.items()}).static_order()
        return [functions[net] for net in order if net in functions]


def _library(builds: Path) -> ctypes.CDLL:
    """The compiled program; an unchanged one is taken from ``builds``."""
    need_tools(("g++",), "playing a chip's netlist")

    def make(folder: Path) -> None:
        command = [*COMPILE, "-o", str(folder / "gates.so"), str(device.KERNEL)]
        finished = subprocess.run(
            command, capture_output=True, text=True, timeout=COMPILE_LIMIT_S, check=False
        )
        if finished.returncode:
            raise SimulationError(f"compiling {KERNEL.name} failed:\n{finished.stderr[-800:]}")

    sources = [hashlib.sha256(path.read_bytes()).hexdigest() for path in (KERNEL, device.KERNEL)]
    folder = kept(builds, "gates", [*sources, *COMPILE], make)
    return library(folder / "gates.so", device.KERNEL, KERNEL, defined="NETLIST")


class Chip:
    """A `Program` at work, whose states begin at random.

    Parameters
    ----------
    seed:
        Of what states and memories begin with.
    delays:
        Each cell takes its table's delay; otherwise nets settle without one.
    builds:
        Where the compiled program is kept.
    Others as of `Program`.

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
        self.delays = delays
        self.library = _library(builds)
        program = self.program = Program(module, cells, expression, wrong)
        self._chip = self.library.make(ctypes.byref(program.tables))
        if delays:
            self.library.with_delays(self._chip)
        ports: dict[str, list[int]] = {}
        for name, port in module["ports"].items():
            indexed = re.fullmatch(r"(.+)\[(\d+)\]", name)
            bits = ports.setdefault(indexed[1] if indexed else name, [])
            place = int(indexed[2]) if indexed else 0
            bits += [0] * (place + len(port["bits"]) - len(bits))
            bits[place : place + len(port["bits"])] = map(program.net, port["bits"])
        self._ports = {name: ((ctypes.c_int32 * len(bits))(*bits), len(bits)) for name, bits in ports.items()}
        self.begin(seed)

    def __del__(self) -> None:
        if getattr(self, "_chip", None):
            self.library.drop(self._chip)

    def begin(self, seed: int) -> None:
        """As after power-on: every flip-flop, latch and word of a macro anything."""
        rng, program = random.Random(seed), self.program
        states = (ctypes.c_ubyte * (program.states + 1))(*(rng.getrandbits(1) for _ in range(program.states)))
        words = (ctypes.c_uint32 * (program.words + 1))(
            *(rng.getrandbits(WORD_BITS) for _ in range(program.words))
        )
        if self.library.begin(self._chip, states, words):
            raise SimulationError("the netlist does not settle within a clock cycle")

    def open(self) -> int:
        """As `eskin.cosim.device.Model`; another one's states are this one's."""
        return self.library.open_device(self._chip, self.program.top is not None, self.program.enable)

    def port(self, opened: int, name: str) -> int:
        """As `eskin.cosim.device.Model`; ``flip N`` inverts state N (`Program.state_nets`) where it is 1."""
        if name.startswith(FLIP):
            nets = self.program.state_nets[int(name.removeprefix(FLIP))]
            return self.library.port_of(opened, (ctypes.c_int32 * len(nets))(*nets), len(nets), 1)
        return self.library.port_of(opened, *self._ports[name], 0) if name in self._ports else -1

    def count_into(self, joule: np.ndarray, costs: Sequence[np.ndarray]) -> None:
        """Add up in ``joule``, by kind, what changes cost, and the clock gates that let an edge through, from every edge
        of a device on.

        Parameters
        ----------
        joule:
            With delays twice as long: behind the kinds the changes that a net takes back within a cycle.
        costs:
            Joule a change, kind, of every net; joule of an edge, kind, of every gate; joule of a read and a write,
            kind, of every macro. Kinds are places in ``joule``.
        """
        arrays = [
            np.ascontiguousarray(part, kind) for part, kind in zip(costs, 3 * (float, np.uint8), strict=True)
        ]
        kinds = len(joule) // (1 if self.delays is None else 2)
        self.library.costs(self._chip, joule.ctypes.data, kinds, *(part.ctypes.data for part in arrays))
        self._kept = arrays, joule
