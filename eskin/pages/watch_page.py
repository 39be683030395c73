"""The live view's page: one static file that brings its own style and script; and the shape in which an array
is drawn."""

import math
from pathlib import Path

TEMPLATE = Path(__file__).with_name("templates") / "watch.html"
LONGEST = 4
"""Columns a row at most, of a shape that is guessed."""


def page() -> bytes:
    """The page as it is served."""
    return TEMPLATE.read_bytes()


def guessed_shape(taxels: int) -> tuple[int, int]:
    """(rows, columns) of an array with this number of taxels, if the configuration has no shape: the squarest rectangle that they fill,
    no longer than ``LONGEST`` to 1; where there is none, the smallest square grid that holds them, with cells
    left over."""
    for rows in range(math.isqrt(taxels), 0, -1):
        if taxels % rows == 0 and taxels // rows <= LONGEST * rows:
            return rows, taxels // rows
    rows = math.isqrt(taxels)
    return rows, -(-taxels // rows)
