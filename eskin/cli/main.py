"""The command line `eskin`: options in, one call into golden, rtl or cosim, a table out.

What takes long to import is imported inside the verbs, so that `--help` is quick.
"""

from typing import Annotated

import typer

from eskin.cli import INTERRUPTED, STOPPED, data, hardware, learn, studies
from eskin.cli.common import PANELS, app, stop
from eskin.extras import without_extra
from eskin.golden.core import InputError, SimulationError


def _version(show: bool) -> None:
    if show:
        from eskin import __version__

        print(__version__)
        raise typer.Exit


@app.callback(epilog="Exit status: 0 every check held, 1 a check failed, 2 bad usage or bad input.")
def eskin(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Turn recorded tactile streams into a linear cell, GRU or LSTM in bit-exact hardware."""


def main() -> None:
    """Entry point: every foreseen mistake becomes one sentence on standard error and status 2, an interrupt
    status 130."""
    try:
        app()
    except InputError as error:
        stop(str(error), 2)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        stop(f"{where}{error.strerror or error}; check the path, its permissions and the room on the disk", 2)
    except SimulationError as error:
        stop(str(error), 1)
    except ModuleNotFoundError as error:
        sentence = without_extra(error)
        if sentence is None:
            raise
        stop(sentence, 2)
    except SystemExit as end:
        if end.code == INTERRUPTED:
            stop(STOPPED, INTERRUPTED)
        raise


app.registered_commands.sort(key=lambda command: [*PANELS].index(str(command.rich_help_panel)))
VERBS = (data, learn, hardware, studies)
"""Each module has registered its verbs with the application by being imported."""

if __name__ == "__main__":
    main()
