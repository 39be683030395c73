"""Position of the touch, frame by frame, and direction of a slide: docs/specification_interfaces.md section 13."""

from dataclasses import dataclass

import numpy as np

from eskin.golden.core import AcceleratorConfig

FRACTION = 4
"""Fraction bits of a position: sixteenths of a cell."""


@dataclass(frozen=True)
class Position:
    """Position of the touch in a frame. frame: its index. x, y: centre, sixteenths of a cell, 0 = middle of
    column or row 0. peak: index of the largest cell. ended: True in the frame after the last one of a touch;
    x, y and peak are then the last touched frame's. direction: as of `direction`, if ``ended``."""

    frame: int
    x: int
    y: int
    peak: int
    ended: bool = False
    direction: int = 0


class PositionStream:
    """Positions of frames as they come. ``arm`` forgets the touch before and counts frames from 0."""

    def __init__(self, config: AcceleratorConfig) -> None:
        self._config = config
        self.arm()

    def arm(self) -> None:
        """Restart."""
        self._frame = 0
        self._first: Position | None = None
        self._last: Position | None = None

    def push(self, samples: np.ndarray) -> list[Position]:
        """Positions of the next frames (frames, taxels): one for each with a touched cell, one more where a
        touch ends."""
        interface = self._config.interface
        height = samples.astype(np.int64) - interface.position_rest
        height = np.where(height > interface.position_threshold, height, 0).reshape(
            -1, interface.rows, interface.columns
        )
        positions: list[Position] = []
        # cell by cell in integers: floats would not round a half as the hardware does
        for cells in height:
            total, first, last = int(cells.sum()), self._first, self._last
            if total:
                x, y = (
                    _rounded(int((cells.sum(axis=axis) * np.arange(cells.shape[1 - axis])).sum()), total)
                    for axis in (0, 1)
                )
                self._last = Position(self._frame, x, y, int(cells.argmax()))
                self._first = first or self._last
                positions.append(self._last)
            elif first and last:
                way = direction(last.x - first.x, last.y - first.y, interface.slide_least)
                positions.append(Position(self._frame, last.x, last.y, last.peak, True, way))
                self._first = None
            self._frame += 1
        return positions


def _rounded(moment: int, total: int) -> int:
    """RND(2**FRACTION * moment / total): twice the quotient plus 1, halved, so that no half is lost."""
    return (2 * (moment << FRACTION) + total) // (2 * total)


def direction(across: int, down: int, least: int) -> int:
    """1 right (x grows), 2 left, 3 down (y grows), 4 up: along the longer axis, or across if both are equal;
    0 if the longer one is shorter than ``least``."""
    if max(abs(across), abs(down)) < least:
        return 0
    if abs(across) >= abs(down):
        return 1 if across > 0 else 2
    return 3 if down > 0 else 4
