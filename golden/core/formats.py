"""Fixed point: formats and the arithmetic that defines rounding and overflow, in plain integers.

This file is the definition shared by the golden model and the hardware (docs/specification.md, section 1).
The modes have their usual names: TRN drops bits (floor), RND adds half an LSB first (half up), RND_CONV
rounds half to even; WRAP keeps the low bits, SAT clamps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

Rounding = Literal["TRN", "RND", "RND_CONV"]
Overflow = Literal["WRAP", "SAT"]


@dataclass(frozen=True)
class QFormat:
    """A two's-complement fixed-point format, printed ``SQ(int, frac)``; the value of a code is ``code /
    2**frac``.

    Parameters
    ----------
    int_bits:
        Bits left of the point, sign included (the convention of ap_fixed and apytypes). May be negative.
    frac_bits:
        Bits right of the point. May be negative.
    signed:
        False gives ``UQ``: no sign bit, codes from 0.

    Raises
    ------
    ValueError
        When the width is below 1 bit or above 48 (float64 must hold every product exactly).
    """

    int_bits: int
    frac_bits: int
    signed: bool = True

    def __post_init__(self) -> None:
        if not 1 <= self.width <= 48:
            raise ValueError(f"{self} has {self.width} bits; a format has 1 to 48")

    def __str__(self) -> str:
        return f"{'S' if self.signed else 'U'}Q({self.int_bits},{self.frac_bits})"

    @property
    def width(self) -> int:
        """Total bits."""
        return self.int_bits + self.frac_bits

    @property
    def min_code(self) -> int:
        """Smallest code."""
        return -(1 << (self.width - 1)) if self.signed else 0

    @property
    def max_code(self) -> int:
        """Largest code."""
        return (1 << (self.width - 1)) - 1 if self.signed else (1 << self.width) - 1

    @property
    def magnitude(self) -> int:
        """Largest absolute value of a code, from which accumulator bounds are computed."""
        return max(-self.min_code, self.max_code)

    def quantise(self, value, *, rounding: Rounding = "RND_CONV"):
        """Codes (int64) nearest to real ``value``, saturated. For constants made offline, never in a
        datapath."""
        scaled = np.asarray(value, dtype=np.float64) * 2.0**self.frac_bits
        rounders: dict[str, Callable[[np.ndarray], np.ndarray]] = {
            "RND_CONV": np.rint,
            "TRN": np.floor,
            "RND": lambda v: np.floor(v + 0.5),
        }
        rounded = rounders[rounding](scaled)
        return np.clip(rounded, self.min_code, self.max_code).astype(np.int64)

    def to_real(self, code):
        """Real value of ``code`` (float64)."""
        return np.asarray(code, dtype=np.float64) / 2.0**self.frac_bits

    @classmethod
    def parse(cls, text: str) -> QFormat:
        """The format that prints as ``text``, such as ``SQ(4,12)``."""
        kind, _, digits = text.partition("Q(")
        try:
            int_bits, frac_bits = (int(part) for part in digits.rstrip(")").split(","))
            if kind not in ("S", "U") or not digits.endswith(")"):
                raise ValueError
        except ValueError:
            raise ValueError(f"'{text}' is not a number format; write SQ(int,frac), as in SQ(4,12)") from None
        return cls(int_bits, frac_bits, kind == "S")


def shift_right(code, shift: int, rounding: Rounding = "RND"):
    """``code / 2**shift`` as an integer under ``rounding``; ``shift`` >= 0. Works on ints and int64 arrays.

    RND: ``floor((code + 2**(shift-1)) / 2**shift)``. RND_CONV: nearest, ties to even.
    """
    if shift < 0:
        raise ValueError(f"a narrowing shifts right by 0 or more, not by {shift}")
    if shift == 0:
        return code
    if rounding == "TRN":
        return code >> shift
    half = 1 << (shift - 1)
    if rounding == "RND":
        return (code + half) >> shift
    floor = code >> shift
    remainder = code - (floor << shift)
    return floor + ((remainder > half) | ((remainder == half) & (floor & 1 == 1)))


def clamp(code, fmt: QFormat, overflow: Overflow = "SAT"):
    """``code`` brought into ``fmt``: clamped (SAT) or with its low bits kept (WRAP). Ints or int64 arrays."""
    if overflow == "SAT":
        if isinstance(code, int):
            return min(max(code, fmt.min_code), fmt.max_code)
        return np.clip(code, fmt.min_code, fmt.max_code)
    # no branch, so that ints and arrays take one path: a comparison counts as 0 or 1
    low = code & ((1 << fmt.width) - 1)
    return low - ((low > fmt.max_code) * (1 << fmt.width)) if fmt.signed else low


def narrow(code, shift: int, fmt: QFormat, rounding: Rounding = "RND", overflow: Overflow = "SAT"):
    """The narrowing that all of the datapath uses: round away ``shift`` bits, then fit into ``fmt``."""
    return clamp(shift_right(code, shift, rounding), fmt, overflow)


def signed_bits(bound: int) -> int:
    """Bits of the smallest two's-complement word that holds every integer from ``-bound`` to ``bound``."""
    # int(): numpy's integers have no bit_length
    return int(bound).bit_length() + 1
