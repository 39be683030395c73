"""A chip's netlist as a C program that steps a clock cycle at a time and adds up what changes cost: it compiles in seconds.

No delays: in each cycle all nets settle, the edge passes the clock gates that were enabled before it, flip-flops and macros take what
they see, and latches whose gate's clock is high take what the flip-flops then give. `eskin.cosim.gate_bench` plays recordings into it.
"""

from __future__ import annotations

import ctypes
import random
import re
import subprocess
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from eskin.cosim.runner import need_tools
from eskin.golden.core.errors import SimulationError

STATEMENTS = 300
"""Of a C function: short ones compile quickly."""
COMPILE_LIMIT_S = 900.0
COUNT = """
static double *cost, *gate_cost; static unsigned char *kind, *gate_kind;
void costs(double *c, unsigned char *k, double *g, unsigned char *h) { cost = c; kind = k; gate_cost = g; gate_kind = h; }
void count(double *joule) {
  for (int i = 0; i < NETS; i++) if (n[i] != p[i]) { joule[kind[i]] += cost[i]; p[i] = n[i]; }
  for (int i = 0; i < GATES; i++) if (g[i]) joule[gate_kind[i]] += gate_cost[i];
}
"""


def _net(bit: int | str) -> str:
    return f"n[{bit}]" if isinstance(bit, int) else "1" if bit == "1" else "0"


def _functions(name: str, statements: Sequence[str]) -> list[str]:
    parts = [statements[low : low + STATEMENTS] for low in range(0, len(statements), STATEMENTS)]
    made = [f"static void {name}_{k}(void) {{\n" + "\n".join(part) + "\n}" for k, part in enumerate(parts)]
    return [*made, f"void {name}(void) {{ {' '.join(f'{name}_{k}();' for k in range(len(parts)))} }}"]


class Program:
    """C text of a module of Yosys' JSON, one flat netlist.

    Parameters
    ----------
    cells:
        Library cells by name (eskin.rtl.asic.liberty.Cell).
    expression:
        A Liberty function in C's operators.
    wrong:
        A logic cell that says the opposite.

    Attributes
    ----------
    text; nets: how many; gates: nets of the clock gates' outputs, in the order of ``g``; states: nets that flip-flops and latches drive;
    top: number of the gate that all clocks come from, or None; enable: the net that opens it.
    """

    def __init__(
        self, module: Mapping[str, Any], cells: Mapping[str, Any], expression: Callable[[str], str], wrong: str | None = None
    ) -> None:
        self._module, self._cells, self._expression, self._wrong = module, cells, expression, wrong
        self._root = module["ports"]["clk"]["bits"][0]
        used = [bit for cell in module["cells"].values() for bits in cell["connections"].values() for bit in bits if isinstance(bit, int)]
        used += [bit for port in module["ports"].values() for bit in port["bits"] if isinstance(bit, int)]
        self.nets = 1 + max(used)
        by_kind: dict[str, list[tuple[Any, dict]]] = {}
        for cell in module["cells"].values():
            by_kind.setdefault(cells[cell["type"]].kind, []).append((cells[cell["type"]], cell["connections"]))
        roles = [
            ({what.gate: connections[pin][0] for pin, what in kind.pins.items() if what.gate and pin in connections})
            for kind, connections in by_kind.get("gate", [])
        ]
        self.gates = [role["output"] for role in roles]
        self._gate_of = {net: number for number, net in enumerate(self.gates)}
        entered = [number for number, role in enumerate(roles) if role["clock"] == self._root]
        self.top = entered[0] if len(entered) == used.count(self._root) - 1 == 1 else None
        self.enable = roles[self.top]["enable"] if self.top is not None else 0

        def gates_before(number: int) -> int:
            clock = roles[number]["clock"]
            return 0 if clock == self._root else 1 + gates_before(self._gate_of[clock])

        behind = sorted(range(len(roles)), key=gates_before)
        sample = [f"g[{k}] = {_net(roles[k]['enable'])} & {self._passes(roles[k]['clock'])};" for k in behind]
        flops, latches, memories, shows = [], [], [], []
        self.states: list[int] = []
        for kind, connections in by_kind.get("flip-flop", []):
            passes = self._passes(connections[kind.state["clocked_on"]][0])
            sample.append(f"if ({passes}) d[{len(flops)}] = {_net(connections[kind.state['next_state']][0])};")
            flops.append(f"if ({passes}) {{ {self._outputs(kind, connections, f'd[{len(flops)}]')} }}")
        for kind, connections in by_kind.get("latch", []):
            passes = self._passes(connections[kind.state["enable"]][0])
            latches.append(f"if ({passes}) {{ any = 1; {self._outputs(kind, connections, _net(connections[kind.state['data_in']][0]))} }}")
        words = []
        for k, (kind, connections) in enumerate(by_kind.get("memory", [])):
            bus = {
                pin: " | ".join(f"(unsigned){_net(bit)} << {place}" for place, bit in enumerate(connections[pin]))
                for pin in ("A_ADDR", "A_DIN")
            }
            enable, write, read = (_net(connections[pin][0]) for pin in ("A_MEN", "A_WEN", "A_REN"))
            words.append(f"unsigned m{k}[{kind.words}], q{k}; const int words{k} = {kind.words};")
            memories.append(
                f"if ({self._passes(connections['A_CLK'][0])} && {enable}) {{ unsigned a = {bus['A_ADDR']};\n"
                f"if ({write}) {{ m{k}[a] = {bus['A_DIN']}; accesses[1]++; }} else if ({read}) {{ q{k} = m{k}[a]; accesses[0]++; }} }}"
            )
            shows += [f"{_net(bit)} = q{k} >> {place} & 1;" for place, bit in enumerate(connections["A_DOUT"]) if isinstance(bit, int)]
        constants = [
            f"{_net(bits[0])} = {int('HI' in pin)};"
            for kind, connections in by_kind.get("other", [])
            for pin, bits in connections.items()
            if isinstance(bits[0], int)
        ]
        head = f"typedef unsigned char u8;\nu8 n[{self.nets}], p[{self.nets}], g[{len(roles) + 1}], d[{len(flops) + 1}];"
        self.text = "\n".join(
            [
                head,
                "long long accesses[2]; static int any;",
                *words,
                *_functions("settle", self._logic()),
                *_functions("sample", sample),
                *_functions("memories", memories),
                *_functions("show", [*flops, *shows]),
                *_functions("latches", latches),
                *_functions("constants", constants),
                "void begin(void) { constants(); settle(); }",
                "void edge(void) { sample(); memories(); show(); settle(); any = 0; latches(); if (any) settle(); }",
                COUNT.replace("NETS", str(self.nets)).replace("GATES", str(len(roles))),
            ]
        )

    def _passes(self, net: int) -> str:
        return "1" if net == self._root else f"g[{self._gate_of[net]}]"

    def _outputs(self, kind, connections, source: str) -> str:
        text = f"u8 v = {source};"
        for pin, what in kind.pins.items():
            if what.direction == "output" and connections.get(pin):
                self.states.append(connections[pin][0])
                text += f" {_net(connections[pin][0])} = {'v' if what.function == kind.state['state'] else '!v'};"
        return text

    def _logic(self) -> list[str]:
        """An assignment an output, each behind those that it reads."""
        cells, rows = self._cells, self._module["cells"]
        logic = {name: cell for name, cell in rows.items() if cells[cell["type"]].kind == "logic"}
        driver = {
            bits[0]: name
            for name, cell in logic.items()
            for pin, bits in cell["connections"].items()
            if cells[cell["type"]].pins[pin].direction == "output"
        }
        order, seen = [], set()
        for first in logic:
            stack = [(first, False)]
            while stack:
                name, ready = stack.pop()
                if ready:
                    order.append(name)
                elif name not in seen:
                    seen.add(name)
                    stack.append((name, True))
                    stack += [(driver[bit], False) for bits in logic[name]["connections"].values() for bit in bits if bit in driver]
        lines = []
        for name in order:
            kind, connections = cells[logic[name]["type"]], logic[name]["connections"]
            for pin, what in kind.pins.items():
                if what.direction == "output" and what.function and connections.get(pin):
                    function = re.sub(
                        r"[A-Za-z_]\w*", lambda found, ends=connections: _net(ends[found[0]][0]), self._expression(what.function)
                    )
                    lines.append(f"{_net(connections[pin][0])} = {'!' if name == self._wrong else ''}(({function}) & 1);")
        return lines


class Chip:
    """A compiled `Program`, whose states begin at random."""

    def __init__(
        self,
        module: Mapping[str, Any],
        cells: Mapping[str, Any],
        expression: Callable[[str], str],
        folder: Path,
        seed: int,
        wrong: str | None = None,
    ) -> None:
        need_tools(("g++",), "the energy of a chip")
        program = self.program = Program(module, cells, expression, wrong)
        folder.mkdir(parents=True, exist_ok=True)
        source, library = folder / "gates.c", folder / "gates.so"
        source.write_text(program.text)
        command = ["g++", "-x", "c", "-O1", "-shared", "-fPIC", "-o", library.name, source.name]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=COMPILE_LIMIT_S, check=False)
        if done.returncode:
            raise SimulationError(f"compiling the netlist failed:\n{done.stderr[-800:]}")
        self._library = library_ = ctypes.CDLL(str(library.resolve()))
        self._nets = np.frombuffer((ctypes.c_ubyte * program.nets).in_dll(library_, "n"), dtype=np.uint8)
        self._gates = np.frombuffer((ctypes.c_ubyte * (len(program.gates) + 1)).in_dll(library_, "g"), dtype=np.uint8)
        self.accesses = np.frombuffer((ctypes.c_longlong * 2).in_dll(library_, "accesses"), dtype=np.int64)
        self._ports: dict[str, list[int]] = {}
        for name, port in module["ports"].items():
            found = re.fullmatch(r"(.+)\[(\d+)\]", name)
            bits = self._ports.setdefault(found[1] if found else name, [])
            place = int(found[2]) if found else 0
            bits += [0] * (place + len(port["bits"]) - len(bits))
            bits[place : place + len(port["bits"])] = [bit if isinstance(bit, int) else -int(bit == "1") for bit in port["bits"]]
        self._enable = program.enable
        self.begin(seed)

    def begin(self, seed: int) -> None:
        """As after power-on: every flip-flop, latch and word of a macro anything."""
        rng, program = random.Random(seed), self.program
        self._nets[program.states] = [rng.getrandbits(1) for _ in program.states]
        for k in range(program.text.count("const int words")):
            words = ctypes.c_int.in_dll(self._library, f"words{k}").value
            memory = (ctypes.c_uint * words).in_dll(self._library, f"m{k}")
            memory[:] = [rng.getrandbits(16) for _ in range(words)]
        self._library.begin()

    def put(self, name: str, value: int) -> None:
        """Drive an input."""
        for place, bit in enumerate(self._ports[name]):
            self._nets[bit] = value >> place & 1

    def get(self, name: str) -> int:
        """What an output says, once settled."""
        return sum((int(self._nets[bit]) if bit > 0 else -bit) << place for place, bit in enumerate(self._ports[name]))

    def has(self, name: str) -> bool:
        """Whether there is such a port."""
        return name in self._ports

    def settle(self) -> None:
        """Let what comes in reach every net."""
        self._library.settle()

    def edge(self) -> bool:
        """A rising edge of the clock; whether it passed the first gate."""
        self._library.edge()
        return self.program.top is None or bool(self._gates[self.program.top])

    def edge_needed(self) -> bool:
        """Whether the first gate would let an edge through now."""
        self._library.settle()
        return bool(self._nets[self._enable])

    def count_into(self, joule: np.ndarray, costs: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]) -> Callable[[], None]:
        """What adds to ``joule`` by kind what has changed since it was last called, and of the gates that let the last edge through.

        Parameters
        ----------
        costs:
            Joule a change, kind, of every net; joule of an edge, kind, of every gate. Kinds are places in ``joule``.
        """
        arrays = [np.ascontiguousarray(part) for part in costs]
        pointers = [part.ctypes.data_as(ctypes.c_void_p) for part in arrays]
        self._library.costs(*pointers)
        target = joule.ctypes.data_as(ctypes.c_void_p)
        self._kept = arrays, joule
        return lambda: self._library.count(target)
