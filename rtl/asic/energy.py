"""What a change of each net of a chip's netlist costs: Liberty energy of the cells, capacitance of pins and of a wire load.

A change of a net costs ``e = E_out + sum E_in + C V^2 / 2`` with the driver's and the receivers' internal energies of an edge and
``C`` = pins + wire. A clock net costs ``2 e`` for each of its cycles. Delays are none, so nets change once a cycle: no glitches.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from eskin.rtl.asic.liberty import Cell, WireLoad

STEP = 1.15
"""Nets whose costs differ by less are counted together, at their mean."""
BAND = 2.0
"""Within such a factor a chip's true figure lies, by the feasibility study; no layout checks it."""


@dataclass(frozen=True, kw_only=True)
class Counted:
    """Nets that one counter counts. kind: of the cells that drive them, or ``clock``, ``read``, ``write``; joule: of one count."""

    kind: str
    joule: float
    nets: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Costs:
    """root_j: a cycle of the clock's first net, which no gate stops; enable: the net that lets the first gate's edges through, or None."""

    counted: tuple[Counted, ...]
    root_j: float
    enable: str | None


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
    driver: dict[int, tuple[Cell, str, dict]] = {}
    receivers: dict[int, list[tuple[Cell, str]]] = {}
    for cell in module["cells"].values():
        what = known[cell["type"].lstrip("\\")]
        for pin, bits in cell["connections"].items():
            for bit in bits:
                if isinstance(bit, int):
                    if what.pins[pin].direction == "output":
                        driver[bit] = what, pin, cell["connections"]
                    else:
                        receivers.setdefault(bit, []).append((what, pin))

    def edge(bit: int) -> float:
        ends = receivers.get(bit, ())
        load = sum(what.pins[pin].capacitance for what, pin in ends) + wire.capacitance(len(ends))
        own = driver[bit][0].pins[driver[bit][1]].toggle_j if bit in driver and driver[bit][0].kind != "memory" else 0.0
        inner = sum(what.pins[pin].toggle_j for what, pin in ends if what.kind != "memory")
        return own + inner + load * voltage**2 / 2

    classes: dict[tuple[str, int], list[tuple[float, str]]] = {}

    def count(kind: str, joule: float, net: str) -> None:
        if joule > 0:
            classes.setdefault((kind, round(math.log(joule, STEP))), []).append((joule, net))

    enable = None
    nets = {bit for bits in (driver, receivers) for bit in bits} - {root}
    for bit in nets:
        if bit in driver and driver[bit][0].kind == "gate":
            gate, _, connections = driver[bit]
            role = {pin.gate: name for name, pin in gate.pins.items() if pin.gate}
            passes = f"n{connections[role['enable']][0]}"
            if connections[role["clock"]][0] == root and len(receivers[root]) == 1:
                enable = passes
            count("clock", 2 * edge(bit), passes)
        else:
            kind = driver[bit][0].kind if bit in driver else "input"
            count(kind, edge(bit), f"n{bit}")
    for cell in module["cells"].values():
        what = known[cell["type"].lstrip("\\")]
        if what.kind == "memory":
            enables = [f"n{cell['connections'][pin][0]}" for pin in ("A_MEN", "A_WEN", "A_REN")]
            count("read", what.access_j["read"], f"({enables[0]} & ~{enables[1]} & {enables[2]})")
            count("write", what.access_j["write"], f"({enables[0]} & {enables[1]})")
    counted = [
        Counted(kind=kind, joule=sum(joule for joule, _ in rows) / len(rows), nets=tuple(net for _, net in rows))
        for (kind, _), rows in sorted(classes.items())
    ]
    return Costs(counted=tuple(counted), root_j=2 * edge(root), enable=enable)


def simulated(flat: Path, top: str) -> str:
    """The netlist of Yosys' JSON as Verilog with a wire ``nN`` for each net, and ports that are vectors again."""
    module = json.loads(flat.read_text())["modules"][top]
    ports: dict[str, dict[int, tuple[str, int | str]]] = {}
    for name, port in module["ports"].items():
        found = re.fullmatch(r"(.+)\[(\d+)\]", name)
        for offset, bit in enumerate(port["bits"]):
            ports.setdefault(found[1] if found else name, {})[int(found[2]) if found else offset] = port["direction"], bit
    nets = {bit for bits in ports.values() for _, bit in bits.values() if isinstance(bit, int)}
    body = []
    for number, cell in enumerate(module["cells"].values()):
        pins = []
        for pin, bits in cell["connections"].items():
            nets |= {bit for bit in bits if isinstance(bit, int)}
            joined = ", ".join(_net(bit) for bit in reversed(bits))
            pins.append(f".{pin}({{{joined}}})" if len(bits) > 1 else f".{pin}({joined})")
        body.append(f"{cell['type']} c{number} ({', '.join(pins)});")
    lines = [f"module {top} ({', '.join(ports)});"]
    for name, bits in ports.items():
        way = next(iter(bits.values()))[0]
        lines.append(f"{way} [{max(bits)}:0] {name};")
        for index, (_, bit) in bits.items():
            if way == "output":
                body.append(f"assign {name}[{index}] = {_net(bit)};")
            elif isinstance(bit, int):
                body.append(f"assign n{bit} = {name}[{index}];")
    lines += [*(f"wire n{bit};" for bit in sorted(nets)), *body]
    return "\n".join([*lines, "endmodule", ""])


def _net(bit: int | str) -> str:
    return f"n{bit}" if isinstance(bit, int) else f"1'b{bit if bit in '01' else '0'}"
