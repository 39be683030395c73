"""The command line `eskin`: options in, one call into golden, rtl or cosim, a table out.

A verb is a file of eskin/verbs: its text is the beginning of the docstring up to the example, and ``command`` is a
function of its request, whose fields are the options. The file is loaded when the verb is called, so that `--help` is
quick.
"""

import functools
import inspect
import math
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer
from typer.core import TyperGroup
from typer.main import get_command_from_info
from typer.models import CommandInfo

from eskin.cli import INTERRUPTED, STOPPED
from eskin.cli.common import PANELS, loaded, options_of, stop, text_of
from eskin.extras import without_extra
from eskin.golden.core import PRESETS, InputError, Record, SimulationError, check_target, write_json

OUTPUTS = ("out", "json")
"""Parameters that name what a verb writes; every other file or folder is read."""
INPUT_WORDS = ("data", "config", "model", "test", "with_")
"""Parameters that name a file or folder, or are a word."""
REPLACING = ("build", "enrol", "export", "generate", "import", "run", "train")
"""Verbs whose --out is a folder that they replace as a whole."""
RESULTS = (".json", ".html", ".svg")
"""Files that no verb reads from a folder, but for a model's own: a run may write them into its model's folder
again."""


def check_outputs(verb: str, options: Record) -> None:
    """Raise InputError for an output that is also an input or another output (by any name), an existing file of
    an input folder, or a folder to replace that holds an input; and for --json over a file that is not an
    earlier result.

    Raises
    ------
    InputError
    """

    # a folder in place of a file is nothing to lose: the verb refuses it
    named = {f"--{name}": options[name] for name in OUTPUTS if options.get(name)}
    outputs = {option: path for option, path in named.items() if option == "--out" or not path.is_dir()}
    words = (None, "", *PRESETS, "synthetic")
    inputs = [
        Path(given)
        for name, value in options.items()
        if name not in OUTPUTS
        for given in (value if isinstance(value, list) else [value])
        if isinstance(given, Path) or (name in INPUT_WORDS and given not in words)
    ]
    for option, path in outputs.items():
        place, why = path.resolve(), ""
        if option == "--json" and "--out" in outputs and outputs["--out"].resolve() == place:
            why = "--out names the same path"
        own = path.suffix in RESULTS and path.name not in ("config.json", "training.json")
        for given in filter(Path.exists, inputs):
            source = given.resolve()
            if source == place or (path.exists() and path.samefile(source)):
                why = f"would overwrite the input {given}"
            elif verb in REPLACING and place in source.parents and option == "--out":
                why = f"would be replaced together with the input {given} in it"
            elif path.is_file() and source in place.parents and not own:
                why = f"would overwrite a file of the input {given}"
        other = option == "--json" and path.suffix != ".json" and path.is_file() and not why
        if other and path.read_bytes().lstrip()[:1] not in (b"", b"{", b"["):
            why = "would overwrite a file that is not JSON"
        if why:
            raise InputError(f"{option} {path}: {why}; give another name")


def check_numbers(options: Record) -> None:
    """Refuse a number that is not finite: typer takes inf and nan.

    Raises
    ------
    InputError
    """
    for name, value in options.items():
        if isinstance(value, float) and not math.isfinite(value):
            raise InputError(f"`{name}` {value}: is not a number; give a finite one")


# ---------------------------------------------------------------------- verbs
@functools.cache
def command_of(verb: str) -> Any:
    """A verb with its options. It refuses an output that would destroy one of its inputs, before it begins. The verb's
    result is written to --json; a failed check (``passed``) gives status 1."""
    command, request = loaded(verb)

    def checked(**options: Any) -> None:
        check_numbers(options)
        check_outputs(verb, options)
        target = options.get("json")
        check_target(target)
        result = command(request(**options))
        if target and result is not None:
            write_json(target, result)
        if not dict(result or ()).get("passed", True):
            raise typer.Exit(1)

    hints, parameters = get_type_hints(request), inspect.signature(request).parameters
    typed = {name: Annotated[hints[name], option] for name, option in options_of(request).items()}
    checked.__annotations__ = typed
    own = [parameters[name].replace(annotation=kind) for name, kind in typed.items()]
    checked.__signature__ = inspect.Signature(own)  # type: ignore[attr-defined]
    help, example = text_of(verb)
    info = CommandInfo(verb, callback=checked, help=help, epilog=example)
    return get_command_from_info(info, pretty_exceptions_short=True, rich_markup_mode="rich")


class Verbs(TyperGroup):
    """Knows of a verb the text alone until it is called."""

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        name, known, rest = super().resolve_command(ctx, args)
        return name, known and command_of(args[0]), rest


app = typer.Typer(
    cls=Verbs,
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)
for panel, verbs in PANELS.items():
    for verb in verbs:
        app.command(verb, help=text_of(verb)[0], rich_help_panel=panel)(lambda: None)


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
        stop(without_extra(error), 2)
    except SystemExit as end:
        if end.code == INTERRUPTED:
            stop(STOPPED, INTERRUPTED)
        raise


if __name__ == "__main__":
    main()
