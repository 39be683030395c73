"""The signature that an image makes of its passes and weights, and the check words that bring it to zero:
docs/specification_interfaces.md section 11.

Plain Python. The hardware is `eskin.rtl.image.image_check`; step and width come from
`eskin.rtl.program.signature`.
"""

from collections.abc import Iterable, Mapping

import numpy as np

from eskin.rtl.program.image_passes import ImagePlan, Pass
from eskin.rtl.program.signature import START, advance, fold, retreat

BIAS_WORD_BITS = 25
"""Bits of a bias with its rounding half; with ``checksum`` a parity bit stands on top."""


def tap_places(pass_: Pass) -> np.ndarray:
    """For each tap of a pass, in order, the number of its weights among the weights of the pass."""
    kernel = np.arange(pass_.kernel * pass_.span * pass_.channels).reshape(
        pass_.kernel, pass_.span, pass_.channels
    )
    places, group, before = [], -1, None
    for row, column, dy, dx in pass_.sums():
        if (dy, dx) == (0, 0):  # a window of the next group, or of the first one at the next place
            group = group + 1 if (row, column) == before else 0
            before = row, column
        top, left = pass_.radius - row, pass_.radius - column
        inside = kernel[max(0, top) : pass_.rows + top, max(0, left) : pass_.columns + left]
        places.append(inside.ravel() + group * kernel.size)
    return np.concatenate(places)


def after(signature: int, words: Iterable[int]) -> int:
    """The signature when these words were added, one a time."""
    for word in words:
        signature = advance(signature) ^ word
    return signature


def checked_program(plan: ImagePlan, arrays: Mapping[str, np.ndarray]) -> list[int]:
    """The words of all passes, each pass followed by its check word.

    The check word brings the signature to 0 when it is read. A second one follows the last pass and brings
    the signature to 0 after the weights of the last tap.
    """
    program: list[int] = []
    signature = START
    for pass_ in plan.passes:
        words = pass_.words()
        check = advance(after(signature, words))
        folded = np.array([fold(word, pass_.group * plan.weight_bits) for word in plan.packed(pass_, arrays)])
        taps = folded[tap_places(pass_)].tolist()
        program += [*words, check]
        signature = after(0, taps)
        if pass_.last:
            for _ in taps:
                signature = retreat(signature)
            program.append(signature)
    return program
