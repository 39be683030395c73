"""Bits of the constants in memory that could flip without a change of the signature: none may, and an empty list is
the proof (docs/specification_interfaces.md, section 11)."""

from collections import defaultdict
from collections.abc import Mapping

import numpy as np

from eskin.rtl.program.image_passes import ImagePlan
from eskin.rtl.program.image_signature import tap_places
from eskin.rtl.program.microcode import Microcode
from eskin.rtl.program.signature import WIDTH, Read, advance, reads, spread


def unseen(code: Microcode, words: Mapping[str | int, int]) -> list[tuple[Read, int]]:
    """(word, bit) of every single flip that would leave the signature unchanged. An empty list is a proof.

    Parameters
    ----------
    words:
        Number of constant words by memory: every one of them must be read, ``gate`` counted from the region
        of the constants on. Words that nothing uses (`Layout.used_constants`) do not count.
    """
    config, layout = code.plan.config, code.layout
    longest = code.judged - code.again
    powers = [[1 << bit for bit in range(WIDTH)]]
    for _ in range(longest):
        powers.append([advance(value) for value in powers[-1]])
    ages: dict[int, dict[Read, list[int]]] = {}
    for check in range(len(layout.checks)):
        ages[check] = defaultdict(list)
        for age, read in reads(code, check):
            ages[check][read].append(age)
    missed = []
    for memory, count in words.items():
        bits = (
            config.weight_bits
            if isinstance(memory, int)
            else config.accumulator_bits
            if memory == "addend"
            else WIDTH
        )
        used = (
            [index for index in layout.used_constants if index < count] if memory == "gate" else range(count)
        )
        for address in used:
            for bit in range(bits):
                position = spread(code, (memory, address), 1 << bit).bit_length() - 1
                sums = []
                for check in ages:
                    total = 0
                    for age in ages[check].get((memory, address), ()):
                        total ^= powers[age][position]
                    sums.append(total)
                if not any(sums):
                    missed.append(((memory, address), bit))
    return missed


def unseen_weights(plan: ImagePlan) -> list[tuple[int, int]]:
    """(number of the layer, number of a tap's weights) of every word in which a wrong bit could go unnoticed.

    An empty list is a proof. A bit's place in its word only multiplies by a power of x, so either all bits of
    a word are covered or none.
    """
    missed = []
    for pass_ in plan.passes:
        places = tap_places(pass_)
        powers = np.empty(len(places), dtype=np.int64)
        power = 1
        for age in range(len(places)):
            powers[age] = power
            power = advance(power)
        sums = np.zeros(pass_.taps, dtype=np.int64)
        np.bitwise_xor.at(sums, places, powers[::-1])
        missed += [(pass_.number, int(place)) for place in np.flatnonzero(sums == 0)]
    return missed
