"""The block of the design to which a cell of the placed netlist belongs.

Yosys optimises the whole design at once, so that a logic cell has no block by itself. A cell belongs to the
block that drives the signal at its output, where that is a signal of the design (every flip-flop, memory and
multiplier); otherwise, logic between two signals, to the block that most of its readers belong to. Every cell
belongs to exactly one block: blocks add up to the whole.
"""

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping

from eskin.golden.core import Record

BLOCKS = {
    "onset_detector": "onset",
    "pretrigger_ring": "ring",
    "feature_expander": "features",
    "window_averager": "windows",
    "normaliser": "normaliser",
    "engine": "cell",
    "receiver": "receiver",
    "classifier": "classifier",
    "control": "control",
    "link": "link",
    "acquisition": "converter",
    "position": "position",
    "stimulation": "stimulator",
    "registers": "registers",
    "standby": "standby",
    "scans": "standby",
}
"""Submodule of the design: its block. What lies in none is wiring within the accelerator, and the top
otherwise."""

WIRING, TOP = "wiring", "top"


def block_of(path: str) -> str:
    """Block of a signal or cell path: the outermost submodule that is one."""
    parts = path.split(".")
    named = [BLOCKS[part] for part in parts if part in BLOCKS]
    return named[0] if named else WIRING if "accelerator" in parts else TOP


def signal_blocks(names: Record) -> dict[str, str]:
    """Block that drives each signal bit, by its name in the flat design (``a.b.signal`` or
    ``a.b.signal[3]``).

    Parameters
    ----------
    names:
        JSON of the design, flat and not optimised: there a cell's name begins with its path.
    """
    (module,) = names["modules"].values()
    driver = {
        bit: block_of(re.sub(r"\$flatten|\\", "", name))
        for name, cell in module["cells"].items()
        for port, bits in cell["connections"].items()
        for bit in bits
        if cell.get("port_directions", {}).get(port) == "output"  # an instance has none
    }
    return {
        name if len(net["bits"]) == 1 else f"{name}[{index}]": driver[bit]
        for name, net in module["netnames"].items()
        for index, bit in enumerate(net["bits"])
        if bit in driver
    }


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
    # backwards from the known blocks; a cell that nobody reads then goes with the cells it reads
    join(owner, drives, readers, TOP if border else "")
    join(owner, reads, {bit: [name] for bit, name in writer.items()}, TOP if border else "")
    outside = drives.keys() - owner.keys()  # a pin, a constant, what the border's own ports are made of
    return owner | {name: WIRING if border and name.startswith(f"{border}.") else TOP for name in outside}


def join(
    owner: dict[str, str],
    ends: Mapping[str, Iterable[int]],
    neighbours: Mapping[int, Iterable[str]],
    never: str = "",
) -> None:
    """Add to ``owner`` each other cell of ``ends``: the block of most cells at its nets, a level of logic at a
    time; none joins the block ``never``."""
    settled: dict[str, str] = {"": ""}
    while settled:
        settled = {}
        for name in ends.keys() - owner.keys():
            owners = (owner.get(other) for bit in ends[name] for other in neighbours.get(bit, ()))
            if votes := Counter(block for block in owners if block and block != never):
                settled[name] = _most(votes)
        owner |= settled


def _most(votes: Counter[str]) -> str:
    return min(votes, key=lambda block: (-votes[block], block))
