"""The live view's page: one static file that brings its own style and script; and the shape in which an array
is drawn."""

import math
import re
from pathlib import Path

from eskin.golden.core import InputError

TEMPLATE = Path(__file__).with_name("templates") / "watch.html"
LONGEST = 4
"""Columns a row at most, of a shape that is guessed."""


def page() -> bytes:
    """The page as it is served."""
    return TEMPLATE.read_bytes()


def guessed_shape(taxels: int) -> tuple[int, int]:
    """(rows, columns) of an array of so many taxels, when nobody said: the squarest rectangle that they fill,
    no longer than ``LONGEST`` to 1; where there is none, the smallest square grid that holds them, with cells
    left over."""
    for rows in range(math.isqrt(taxels), 0, -1):
        if taxels % rows == 0 and taxels // rows <= LONGEST * rows:
            return rows, taxels // rows
    rows = math.isqrt(taxels)
    return rows, -(-taxels // rows)


def asked_shape(text: str, taxels: int) -> tuple[int, int]:
    """(rows, columns) of ``--shape RxC``.

    Raises
    ------
    InputError
        It is no shape, or holds fewer taxels than there are.
    """
    sides = re.fullmatch(r"(\d{1,4})x(\d{1,4})", text.lower())
    if not sides or not int(sides[1]) * int(sides[2]):
        raise InputError(f"--shape {text[:40]}: is no shape; give rows and columns, such as 4x4")
    shape = int(sides[1]), int(sides[2])
    if shape[0] * shape[1] < taxels or shape[0] > taxels or shape[1] > taxels:
        raise InputError(
            f"--shape {text}: holds {shape[0] * shape[1]} taxels and the array has {taxels}; give rows and "
            "columns that fit"
        )
    return shape
