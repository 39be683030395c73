"""The memories of the image engine as the host loads them. Plain Python (no Amaranth): command line and benches share it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from eskin.rtl.image.passes import ImagePlan
from eskin.rtl.program.memory_map import ImageMemory


def image_lines(plan: ImagePlan) -> dict[int, int]:
    """The line of ``select`` that stands for a memory, by its value of MEMORY_SELECT; first the convolutions' columns."""
    return {select: line for line, select in enumerate((*range(plan.columns), *ImageMemory))}


def image_memories(plan: ImagePlan, arrays: Mapping[str, np.ndarray]) -> dict[int, list[int]]:
    """16-bit words of every memory, by its value of MEMORY_SELECT."""
    conv, dense = plan.conv_weights(arrays), plan.dense_weights(arrays)
    biases = [word >> 16 * half & 0xFFFF for word in plan.addends(arrays) for half in range(2)]
    return {
        **{column: [word >> 16 * column & 0xFFFF for word in conv] for column in range(plan.columns)},
        ImageMemory.BIASES: biases,
        ImageMemory.PASSES: plan.program(),
        ImageMemory.DENSE_LOW: [word & 0xFFFF for word in dense],
        ImageMemory.DENSE_HIGH: [word >> 16 for word in dense],
    }
