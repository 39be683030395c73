"""Entry point of the installed command. An interrupt during imports ends it like any later one."""

import os
import signal
from types import FrameType
from typing import NoReturn

from eskin.cli import INTERRUPTED, STOPPED


def _leave(number: int, frame: FrameType | None) -> NoReturn:
    os.write(2, f"eskin: {STOPPED}\n".encode())
    os._exit(INTERRUPTED)  # an exception within an import may be taken for a missing module


def main() -> None:
    """The command line, `eskin.cli.main.main`."""
    heard = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # a background job is deaf to it
    if heard:
        signal.signal(signal.SIGINT, _leave)
    from eskin.cli.main import main as run

    if heard:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        run()
    except KeyboardInterrupt:
        _leave(signal.SIGINT, None)


if __name__ == "__main__":
    main()
