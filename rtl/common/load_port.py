"""The port by which the host writes memories."""

from amaranth.lib import wiring

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common.ports import outputs
from eskin.rtl.program.image_passes import ImagePlan, plan_of
from eskin.rtl.program.memory_map import ImageMemory, memories

HOST_BITS = 16
"""Bits of a word of the host, and of a place in a memory."""


def load_lines(config: AcceleratorConfig) -> dict[int, int]:
    """The line of ``select`` of a memory, by its value of MEMORY_SELECT."""
    if config.is_image:
        return image_lines(plan_of(config))
    lanes = 0 if config.is_forest else config.hardware.lanes
    return {select: line for line, select in enumerate((*range(lanes), *memories(config)))}


def image_lines(plan: ImagePlan) -> dict[int, int]:
    """`load_lines` for images: first the columns of the convolutions' weights, then the other memories."""
    return {select: line for line, select in enumerate((*range(plan.columns), *ImageMemory))}


def load_signature(config: AcceleratorConfig) -> wiring.Signature:
    """16-bit ``data`` to word ``address`` where ``enable``, of the memory whose line of ``select`` is high;
    seen from the host."""
    return lines_signature(len(load_lines(config)))


def lines_signature(lines: int) -> wiring.Signature:
    """`load_signature` with this number of lines."""
    return wiring.Signature(outputs(select=lines, address=HOST_BITS, data=HOST_BITS, enable=1))
