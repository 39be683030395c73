"""Lines of text that tell of progress where there is no terminal to draw bars on."""

from __future__ import annotations

import time
from collections.abc import Callable

MILESTONE_S = 30.0
"""Seconds between two of them."""


class Milestones:
    """Progress as lines, at most one every ``MILESTONE_S`` seconds.

    Parameters
    ----------
    write:
        Called with each line.
    clock:
        Seconds, of any start.
    """

    def __init__(self, write: Callable[[str], None], clock: Callable[[], float] = time.monotonic) -> None:
        self._write, self._clock = write, clock
        self._said = clock()

    def __call__(self, task: str, done: int, total: int) -> None:
        """``done`` of ``total`` of something are there."""
        if self._clock() - self._said >= MILESTONE_S:
            self.say(f"{task}: {done} of {total}")

    def say(self, line: str) -> None:
        """A line now."""
        self._said = self._clock()
        self._write(line)
