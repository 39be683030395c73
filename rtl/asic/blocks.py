"""To which block of the chain each cell of a flat netlist belongs: for areas and energies by block."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from typing import Any

from eskin.rtl.asic.liberty import Cell

ROUNDS = 60
"""Cells between two signals that have names, at most."""
OTHERS = "others"


def blocks_of(module: Mapping[str, Any], known: Mapping[str, Cell]) -> dict[str, str]:
    """Block of each cell of a module of Yosys' JSON, by name.

    A cell belongs to the block that names what it drives; where nothing does, to that of most of its receivers.

    Parameters
    ----------
    known:
        Library cells by name.
    """
    names: dict[int, str] = {}
    for name, net in module["netnames"].items():
        if not net["hide_name"] and ".chain." in name:
            for bit in net["bits"]:
                if isinstance(bit, int) and name.count(".") > names.get(bit, "").count("."):
                    names[bit] = name
    of_net = {bit: _block(name) for bit, name in names.items()}
    drives: dict[str, list[int]] = {cell: [] for cell in module["cells"]}
    readers: dict[int, list[str]] = {}
    for cell, what in module["cells"].items():
        for pin, bits in what["connections"].items():
            for bit in (bit for bit in bits if isinstance(bit, int)):
                if known[what["type"]].pins[pin].direction == "output":
                    drives[cell].append(bit)
                else:
                    readers.setdefault(bit, []).append(cell)
    of_cell = {
        cell: _block(cell)
        if known[module["cells"][cell]["type"]].kind == "memory"
        else next((of_net[bit] for bit in bits if bit in of_net), "")
        for cell, bits in drives.items()
    }
    for _ in range(ROUNDS):
        found = {}
        for cell in (cell for cell, block in of_cell.items() if not block):
            votes = Counter(of_cell.get(end, "") for bit in drives[cell] for end in readers.get(bit, ()) if of_cell.get(end))
            if votes:
                found[cell] = min(votes.items(), key=lambda row: (-row[1], row[0]))[0]
        if not found:
            break
        of_cell |= found
    return {cell: block or OTHERS for cell, block in of_cell.items()}


def _block(name: str) -> str:
    """``engine.addends`` of ``accelerator.chain.engine.addends.sums.word``; lanes are one."""
    parts = re.sub(r"\[\d+\]", "", name.split(".chain.", 1)[1]).split(".")[:-1]
    depth = 2 if parts[:1] and parts[0] in ("engine", "front_end") else 1
    return re.sub(r"_\d+$", "", ".".join(parts[:depth])) or OTHERS
