"""Broken variants of the modes that play recordings into the hardware: the generated Verilog, changed in one
place."""

import re
from collections.abc import Callable
from pathlib import Path

from eskin.cosim.netlist import Hardware
from eskin.golden.model import IntegerModel
from eskin.rtl.fpga.generate import generate
from eskin.rtl.program.memory_map import Register


def broken_design(model: IntegerModel, key: str, folder: Path) -> Hardware:
    """The generated design of a model, broken as ``BROKEN_DESIGNS`` says."""
    text = (generate(model.config, model.arrays, folder / "design") / "accelerator.sv").read_text()
    broken = folder / "accelerator.sv"
    broken.write_text(BROKEN_DESIGNS[key](text))
    return Hardware((broken,))


def _replaced(pattern: str, by: str, text: str) -> str:
    """``text`` with ``pattern`` replaced, which must be there once in its first module, the top."""
    top, end, others = text.partition("endmodule")
    top, count = re.subn(pattern, by, top, flags=re.DOTALL)
    if count != 1:
        raise RuntimeError(f"the generated design has {count} places for a broken variant, {pattern}")
    return top + end + others


def _never_waits(text: str) -> str:
    """The classifier takes the receiver for ready in every cycle."""
    return _replaced(r"\.o__ready\(o__ready\)", ".o__ready(1'b1)", text)


def _never_locks(text: str) -> str:
    """Every word that is written to MEMORY_DATA reaches a memory."""
    condition = f"assign load__enable = bus__w_stb & (bus__addr == {int(Register.MEMORY_DATA)});"
    return _replaced(
        r"(\\accelerator\.control  control [^;]*\.load__enable\()load__enable(\))",
        rf"{condition}\n  \1\2",
        text,
    )


BROKEN_DESIGNS: dict[str, Callable[[str], str]] = {"stalls": _never_waits, "probe": _never_locks}
"""The modes that play recordings: key -> what makes the broken variant of the generated Verilog."""
