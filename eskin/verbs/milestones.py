"""Progress: a line that changes on a terminal, elsewhere lines of text from time to time."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.text import Text

from eskin.golden.core import Progress

MILESTONE_S = 10.0
"""Seconds between two of them."""


def counted(done: int, total: int) -> str:
    """``done`` of ``total`` in words; 0: the whole is not known."""
    return f"{done} of {total}" if total else str(done)


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
        self._said = self._begun = clock()
        self._last = ""

    def __call__(self, task: str, done: int, total: int) -> None:
        """``done`` of ``total`` (0: not known) of something are there."""
        self._last = f"{task}: {counted(done, total)}"
        if self._clock() - self._said >= MILESTONE_S:
            self.say(self._last)

    def beat(self, name: str) -> None:
        """A progress line after a silence; ``name`` is the task if no count was given."""
        if self._clock() - self._said >= MILESTONE_S:
            self.say(f"{self._last or name}, {self._clock() - self._begun:.0f} s so far")

    @contextmanager
    def alive(self, name: str) -> Iterator[Milestones]:
        """Prints progress while the block runs."""
        ended = threading.Event()

        def beats() -> None:
            while not ended.wait(MILESTONE_S / 4):
                self.beat(name)

        thread = threading.Thread(target=beats, daemon=True)
        thread.start()
        try:
            yield self
        finally:
            ended.set()
            thread.join()

    def say(self, line: str) -> None:
        """A line now."""
        self._said = self._clock()
        self._write(line)


@contextmanager
def shown(console: Console, name: str = "") -> Iterator[Progress]:
    """Progress on ``console``, moved by calling ``(what, done, total)``; ``name`` is what all of it belongs to."""

    def words(task: str) -> str:
        return f"{name}, {task}" if name else task

    if console.is_terminal:
        with console.status(Text(name or "at work")) as status:
            yield lambda task, done, total: status.update(Text(f"{words(task)}: {counted(done, total)}"))
        return
    milestones = Milestones(lambda line: console.print(line, highlight=False, markup=False, soft_wrap=True))
    with milestones.alive(name or "at work"):
        yield lambda task, done, total: milestones(words(task), done, total)
