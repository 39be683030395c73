"""Progress: a line that changes on a terminal, elsewhere lines of text from time to time."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.text import Text

from eskin.golden.core import Progress

MILESTONE_S = 10.0
"""Seconds between two lines of text, at least; after so long a silence there is one, too."""


@contextmanager
def shown(console: Console, name: str = "") -> Iterator[Progress]:
    """Progress on ``console``, moved by calling ``(what, done, total)`` (a total of 0: not known, and with nothing done:
    it is waited for ``what``, which has no count); ``name`` is what all of it belongs to."""
    latest, ended = name or "at work", threading.Event()
    begun = last = time.monotonic()

    def say(line: str) -> None:
        nonlocal last
        last = time.monotonic()
        console.print(line, highlight=False, markup=False, soft_wrap=True)

    def notify(task: str, done: int, total: int) -> None:
        nonlocal latest
        latest = f"{name}, {task}" if name else task
        latest += f": {done} of {total}" if total else f": {done} so far" * bool(done)
        if console.is_terminal:
            status.update(Text(latest))
        elif time.monotonic() - last >= MILESTONE_S:
            say(latest)

    def beats() -> None:
        while not ended.wait(MILESTONE_S / 4):
            if time.monotonic() - last >= MILESTONE_S:
                say(f"{latest}, {time.monotonic() - begun:.0f} s")

    if console.is_terminal:
        with console.status(Text(latest)) as status:
            yield notify
        return
    thread = threading.Thread(target=beats, daemon=True)
    thread.start()
    try:
        yield notify
    finally:
        ended.set()
        thread.join()
