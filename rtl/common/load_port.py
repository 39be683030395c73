"""The port by which the host writes memories."""

from __future__ import annotations

from amaranth.lib import wiring
from amaranth.lib.wiring import Out

from eskin.golden.core.config import AcceleratorConfig
from eskin.rtl.program.memory_map import Memory


def load_lines(config: AcceleratorConfig) -> dict[int, int]:
    """The line of ``select`` that stands for a memory, by its value of MEMORY_SELECT."""
    return {select: line for line, select in enumerate((*range(config.hardware.lanes), *Memory))}


def load_signature(config: AcceleratorConfig) -> wiring.Signature:
    """16-bit ``data`` to word ``address`` where ``enable``, of the memory whose line of ``select`` is high; seen from the host."""
    return wiring.Signature({"select": Out(len(load_lines(config))), "address": Out(16), "data": Out(16), "enable": Out(1)})
