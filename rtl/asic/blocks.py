"""The block of the chain to which each cell of a flat netlist belongs: for areas and energies by block."""

import re

from eskin.rtl.asic.nets import Nets
from eskin.rtl.fpga.blocks import join

OTHERS, TRUNK = "others", "clock trunk"


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
