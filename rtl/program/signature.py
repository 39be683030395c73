"""The signature that a step makes of every constant it reads, and the check words that bring it to zero:
docs/specification_interfaces.md section 11.

Plain Python (no Amaranth), so that command line and benches can share it. The hardware is
`eskin.rtl.engine.memory_check`.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from eskin.rtl.program.microcode import Microcode

WIDTH = 16
"""Bits of a signature."""
TAPS = 0x002D
"""x^16 + x^5 + x^3 + x^2 + 1 without its highest term: primitive."""
START = 0xFFFF
"""First value of a signature, so that memories that were never loaded do not sum up to zero."""

Contents = Mapping[Any, Sequence[int]]
"""Words by memory: a lane's weights by its number, ``addend``, ``gate`` (the constants)."""
Read = tuple[str | int, int]
"""(memory, address): a lane by its number, ``addend`` or ``gate``."""


def advance(signature: int) -> int:
    """The signature after one more slot, before the constants of that slot are added."""
    signature <<= 1
    return signature ^ (TAPS | 1 << WIDTH) if signature >> WIDTH else signature


def retreat(signature: int) -> int:
    """The inverse of ``advance``."""
    return (signature ^ (TAPS | 1 << WIDTH)) >> 1 if signature & 1 else signature >> 1


def fold(word: int, bits: int) -> int:
    """``word`` (two's complement of ``bits``) in pieces of ``WIDTH`` bits, added without carry."""
    word &= (1 << bits) - 1
    total = 0
    while word:
        total ^= word & (1 << WIDTH) - 1
        word >>= WIDTH
    return total


def reads(code: Microcode, check: int) -> Iterator[tuple[int, Read]]:
    """(slots before the judged one, source) of every constant that a step adds to its signature.

    Parameters
    ----------
    check:
        Number of the step's check word (`eskin.rtl.program.microcode.Layout.checks`): of its window's length,
        or of its set of weights.
    """
    layout, constant, judged = code.layout, code.plan.constant_addends, code.judged
    length, weight_set = layout.checks[check]
    weight = weight_set * len(code.plan.weight_words)
    for slot, word in enumerate(code.unrolled()):
        if code.again <= slot < judged - 1:
            age = judged - 2 - slot
            if word["mac"]:
                for lane in range(code.plan.config.hardware.lanes):
                    yield age, (lane, weight)
            if word["addend"] in constant:
                yield age, ("addend", word["addend"])
            if word["gate"] >= layout.constants:
                index = word["gate"] - layout.constants
                chosen = check if index == layout.check_base else length
                yield age, ("gate", index | chosen if word["scale"] else index)
        if slot >= code.again:
            weight += word["mac"]


def spread(code: Microcode, read: Read, word: int) -> int:
    """Contribution of a memory word to the signature in the slot in which it is read."""
    config = code.plan.config
    memory, _ = read
    if isinstance(memory, int):  # all lanes' words side by side
        bits = config.weight_bits
        return fold((word & (1 << bits) - 1) << memory * bits, config.hardware.lanes * bits)
    return fold(word, config.accumulator_bits if memory == "addend" else WIDTH)


def residue(code: Microcode, images: Contents, check: int) -> int:
    """The signature at the judged slot."""
    by_age: dict[int, int] = defaultdict(int)
    for age, (memory, address) in reads(code, check):
        by_age[age] ^= spread(code, (memory, address), images[memory][address])
    signature = START
    for age in range(code.judged - 2 - code.again, -1, -1):
        signature = advance(signature) ^ by_age[age]
    return signature


def check_words(code: Microcode, images: Contents) -> list[int]:
    """The check words (two's complement): with the check word of its number, read where the program reads it, a
    step's signature ends as 0.

    Parameters
    ----------
    images:
        Of the constants those in front of the check words, zeros in their places.
    """
    layout = code.layout
    words = []
    for check in range(len(layout.checks)):
        (age,) = (age for age, read in reads(code, check) if read == ("gate", layout.check_base | check))
        word = residue(code, images, check)
        for _ in range(age):
            word = retreat(word)
        words.append(word - (word >> WIDTH - 1 << WIDTH))
    return words


def parity(word: int, bits: int) -> int:
    """1 when ``word`` has an odd number of ones among its lowest ``bits``."""
    return (word & (1 << bits) - 1).bit_count() & 1


def with_parity(word: int, bits: int) -> int:
    """The lowest ``bits`` of ``word``, and on top the bit that makes the number of ones even."""
    return word & (1 << bits) - 1 | parity(word, bits) << bits
