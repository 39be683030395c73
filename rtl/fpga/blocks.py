"""The block of the design to which a cell of the placed netlist belongs.

Yosys optimises the whole design at once, so that a logic cell has no block by itself. A cell belongs to the
block that drives the signal at its output, where that is a signal of the design (every flip-flop, memory and
multiplier); otherwise, logic between two signals, to the block that most of its readers belong to. Every cell
belongs to exactly one block: blocks add up to the whole.
"""

import re
from collections import Counter, defaultdict
from collections.abc import Iterable

from eskin.golden.core import Record

BLOCKS = {
    "onset_detector": "onset",
    "pretrigger_ring": "ring",
    "feature_expander": "features",
    "window_averager": "windows",
    "compander": "normaliser",
    "normaliser": "normaliser",
    "engine": "cell",
    "receiver": "receiver",
    "classifier": "classifier",
    "control": "control",
    "uart_link": "link",
    "link": "link",
    "acquisition": "converter",
    "position": "position",
    "stimulation": "stimulator",
    "registers": "registers",
    "loader": "flash loader",
    "buttons": "buttons",
}
"""Submodule of the design: its block. What lies in none is wiring within the accelerator, and the top
otherwise."""

WIRING, TOP = "wiring", "top"


def block_of(path: str) -> str:
    """Block of a signal or cell path: the outermost submodule that is one."""
    parts = path.split(".")
    named = [BLOCKS[part] for part in parts if part in BLOCKS]
    return named[0] if named else WIRING if "accelerator" in parts else TOP


def signal_blocks(rtlil: str, names: Record, top: str) -> dict[str, str]:
    """Block that drives each signal bit, by its name in the flat design (``a.b.signal`` or
    ``a.b.signal[3]``).

    A net has a name in every module that it passes. It is driven in the deepest one, but not within one that
    it enters by an input port.

    Parameters
    ----------
    rtlil:
        The design with its hierarchy.
    names:
        JSON of the same design, flat and not optimised.
    """
    inputs = _module_inputs(rtlil, top)
    nets = names["modules"][top]["netnames"]
    seen_in: dict[int, set[str]] = defaultdict(set)
    enters: dict[int, set[str]] = defaultdict(set)
    for name, net in nets.items():
        path = _module_of(name, inputs)
        is_input = name[len(path) + 1 if path else 0 :] in inputs[path]
        for bit in net["bits"]:
            if isinstance(bit, int):
                seen_in[bit].add(path)
                if is_input:
                    enters[bit].add(path)
    driver = {}
    for bit, paths in seen_in.items():
        outside = [
            path
            for path in paths
            if not any(path == module or path.startswith(f"{module}.") for module in enters[bit])
        ]
        if outside:
            driver[bit] = max(outside, key=lambda path: (_depth(path), path))
    return {
        name if len(net["bits"]) == 1 else f"{name}[{index}]": block_of(driver[bit])
        for name, net in nets.items()
        for index, bit in enumerate(net["bits"])
        if bit in driver
    }


def _depth(path: str) -> int:
    return path.count(".") + 1 if path else 0


def _module_inputs(rtlil: str, top: str) -> dict[str, set[str]]:
    """Input ports of each module by its path below ``top`` (Amaranth names a module by its path)."""
    inputs: dict[str, set[str]] = {}
    for line in rtlil.splitlines():
        if start := re.match(r"module \\(\S+)", line):
            path = start[1].removeprefix(top).removeprefix(".")
            inputs[path] = set()
        elif port := re.match(r"  wire .*\binput \d+ +(?:signed +)?\\(\S+)", line):
            inputs[path].add(port[1])
    return inputs


def _module_of(name: str, modules: Iterable[str]) -> str:
    """The innermost of the modules that a flat name lies in; the path of a name's own parts may hold points
    too."""
    parts = name.split(".")
    for count in range(len(parts) - 1, 0, -1):
        if (path := ".".join(parts[:count])) in modules:
            return path
    return ""


NAMED_CELLS = {
    *("ICESTORM_RAM", "ICESTORM_DSP", "ICESTORM_SPRAM", "DP16KD", "MULT18X18D", "TRELLIS_RAMW"),
    *("SP", "SDP", "DP", "RAM16SDP4", "RAM16SDP2", "RAM16SDP1", "MULT9X9", "MULT18X18", "MULT36X36"),
}
"""Cells that keep the name of the memory or product they come from."""


def cell_blocks(packed: Record, signals: dict[str, str], border: str = "") -> dict[str, str]:
    """Block of each cell of a placed netlist (nextpnr's ``--write``), by its name.

    Parameters
    ----------
    signals:
        Result of `signal_blocks`.
    border:
        The submodule across whose border nothing was optimised: cells outside it are the top's, whatever
        reads them.
    """
    (module,) = packed["modules"].values()
    block_of_bit = {
        bit: signals[name]
        for name, net in module["netnames"].items()
        for bit in net["bits"]
        if name in signals
    }
    drives: dict[str, list[int]] = {}
    reads: dict[str, list[int]] = {}
    readers: dict[int, list[str]] = defaultdict(list)
    writer: dict[int, str] = {}
    for name, cell in module["cells"].items():
        by_direction: dict[str, list[int]] = {"output": [], "input": []}
        for port, bits in cell["connections"].items():
            by_direction.setdefault(cell["port_directions"][port], []).extend(bits)
        drives[name], reads[name] = by_direction["output"], by_direction["input"]
        writer |= dict.fromkeys(drives[name], name)
        for bit in reads[name]:
            readers[bit].append(name)
    owner: dict[str, str] = {}
    for name, outputs in drives.items():
        unwired = not (outputs or reads[name])  # takes a site that belongs to the cell it is named after
        if module["cells"][name]["type"] in NAMED_CELLS or "$RAMW_" in name or unwired:
            owner[name] = block_of(name)
            continue
        if border and not name.startswith((f"{border}.", "$nextpnr", "$PACKER")):
            owner[name] = TOP
            continue
        votes = Counter(block_of_bit[bit] for bit in outputs if bit in block_of_bit)
        if border:
            del votes[TOP]  # not the harness' own, though the harness may read it
        if votes:
            owner[name] = _most(votes)
    # Backwards from what is known, a level of logic at a time; what nobody reads then goes with what it
    # reads.
    for neighbours in (readers, {bit: [name] for bit, name in writer.items()}):
        towards = drives if neighbours is readers else reads
        while True:
            settled = {}
            for name in drives.keys() - owner.keys():
                votes = Counter(
                    owner[neighbour]
                    for bit in towards[name]
                    for neighbour in neighbours.get(bit, ())
                    if neighbour in owner
                )
                if border:
                    del votes[TOP]
                if votes:
                    settled[name] = _most(votes)
            if not settled:
                break
            owner |= settled
    outside = drives.keys() - owner.keys()  # a pin, a constant, what the border's own ports are made of
    return owner | {name: WIRING if border and name.startswith(f"{border}.") else TOP for name in outside}


def _most(votes: Counter[str]) -> str:
    return min(votes, key=lambda block: (-votes[block], block))
