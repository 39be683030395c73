"""A decision as the word that a CPU reads (docs/specification_interfaces.md, section 17)."""

from collections.abc import Iterable

from eskin.golden.core import AcceleratorConfig

NO_DECISION = 2**32 - 1
"""Value that DECISION has while no decision waits to be read."""


def decision_word(config: AcceleratorConfig, row: Iterable[int]) -> int:
    """The word of a row of the stream ``decision``: is_global, step, class, margin, partial, unsure."""
    is_global, step, label, margin, partial, unsure = (int(value) for value in row)
    in_votes = is_global and config.network.decision == "vote"
    # a logit margin has up to 16 bits and the field 14: its two lowest bits are dropped, and it saturates
    units = min(margin if in_votes else margin // 4, 2**14 - 1)
    word = 0
    for value, width in ((unsure, 1), (partial, 1), (is_global, 1), (units, 14), (step, 8), (label, 7)):
        if not 0 <= value < 2**width:
            raise ValueError(f"{value} does not fit in {width} bits of a decision word")
        word = word << width | value
    if word == NO_DECISION:
        raise ValueError("a decision of all ones would read as none")
    return word
