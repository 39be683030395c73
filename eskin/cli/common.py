"""Common parts of the verbs: the application, the console, progress, options, and how recordings and
configurations are read."""

import functools
import inspect
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer
from rich.console import Console
from rich.markup import escape

from eskin.choose.choice_table import front_end_table, front_end_words
from eskin.data import load_recordings
from eskin.data.fit import for_model
from eskin.golden.core import (
    PRESETS,
    AcceleratorConfig,
    InputError,
    Progress,
    Record,
    check_target,
    write_json,
)
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel
from eskin.pages.views import Rows, parts, terminal_table, words
from eskin.requests import spelled
from eskin.verbs.milestones import shown

OUTPUTS = ("out", "json")
"""Parameters that name what a verb writes; every other file or folder is read."""
INPUT_WORDS = ("data", "config", "model", "test", "with_")
"""Parameters that name a file or folder, or are a word."""
REPLACING = ("build", "enrol", "export", "generate", "import_", "run", "train")
"""Verbs whose --out is a folder that they replace as a whole."""

RESULTS = (".json", ".html", ".svg")
"""Files that no verb reads from a folder, but for a model's own: a run may write them into its model's folder
again."""


PANELS = {
    "The whole job": ("run", "report"),
    "Recordings": ("inspect", "convert", "watch"),
    "Networks": ("train", "import_", "enrol", "quantise", "evaluate", "compare"),
    "Hardware": ("generate", "export", "cosim", "build", "replay", "asic", "schedule", "energy", "stability"),
}
"""Verbs as the help groups them."""


class Application(typer.Typer):
    """Every verb is a function of its request, whose fields are the options. It refuses an output that would
    destroy one of its inputs, before it begins. A verb returns its result, which is written to --json; a
    failed check (``passed``) gives status 1."""

    def command(self, *names: Any, **settings: Any) -> Callable[..., Any]:
        def add(verb: Callable[[Any], Any]) -> Any:
            panel = next((panel for panel, verbs in PANELS.items() if verb.__name__ in verbs), None)
            register = super(Application, self).command(*names, rich_help_panel=panel, **settings)
            request = get_type_hints(verb)["request"]

            @functools.wraps(verb)
            def checked(**options: Any) -> Any:
                check_outputs(verb.__name__, options)
                target = options.get("json")
                check_target(target)
                result = verb(request(**options))
                if target and result is not None:
                    write_json(target, result)
                if not dict(result or ()).get("passed", True):
                    raise typer.Exit(1)

            hints, signature = get_type_hints(request), inspect.signature(request)
            typed = {
                each.name: Annotated[hints[each.name], each.metadata["of"]]
                for each in fields(request)
                if "of" in each.metadata
            }
            parameters = [
                each.replace(annotation=typed[name])
                for name, each in signature.parameters.items()
                if name in typed
            ]
            checked.__annotations__ = typed
            checked.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
            return register(checked)

        return add


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
    words = (None, "", *PRESETS, "synthetic", "default")
    inputs = [
        Path(given)
        for name, value in options.items()
        if name not in OUTPUTS
        for given in (value if isinstance(value, list) else [value])
        if isinstance(given, Path) or (name in INPUT_WORDS and given not in words)
    ]
    of_place: dict[Path, str] = {}
    for option, path in outputs.items():
        place, why = path.resolve(), ""
        if (twin := of_place.setdefault(place, option)) != option:
            why = f"{twin} names the same path"
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


app = Application(
    add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode="rich"
)

console = Console()
if not console.is_terminal:  # a file or a pipe has no width: tables are not broken there
    console = Console(width=max(console.width, 160))

messages = Console(stderr=True)


def stop(sentence: str, status: int) -> None:
    print(f"eskin: {spelled(sentence)}", file=sys.stderr)
    sys.exit(status)


def progress_bars() -> AbstractContextManager[Progress]:
    """Progress on standard error, moved by calling ``(what, done, total)``; gone when done."""
    return shown(messages)


def say(sentence: str) -> None:
    """A line of the result, whatever letters it holds."""
    console.print(escape(spelled(sentence)), soft_wrap=True)


def warn(sentence: str) -> None:
    """A line beside the result."""
    messages.print(escape(spelled(sentence)), soft_wrap=True)


def load_data(data: str, config: str | None = None):
    """Recordings, and the configuration of --config, if given."""

    chosen = AcceleratorConfig.load(config) if config else None
    return load(data, config=chosen), chosen


def load(data: str | Path, **options: Any) -> Recordings:
    """`load_recordings` with its progress shown."""
    with progress_bars() as report:
        return load_recordings(data, progress=report, **options)


def show(name: str, /, **values: Any) -> None:
    """Print a result as the template of that name says it."""
    show_text(words(name, **values))


def show_text(text: str) -> None:
    """Print a result's Markdown."""
    for part in parts(text):
        if isinstance(part, Rows):
            console.print(terminal_table(*part))
        elif part.startswith("! "):
            warn(part.removeprefix("! "))
        else:
            say(part)


def fitting_config(recordings, user_config, groups=None, folds: int = 5, *, prices=None):
    """The front end of --config, or a chosen one with the table of its alternatives; the reasons are
    printed."""
    from eskin.choose.choice import configure
    from eskin.verbs.cost import cost_model

    with progress_bars() as report:
        front_end = configure(
            recordings, user_config, prices or cost_model(), groups=groups, folds=folds, progress=report
        )
    for reason in front_end.reasons:
        warn(f"configuration: {reason}")
    if record := front_end.record():
        rows = [row | {"words": front_end_words(row)} for row in front_end_table(record)]
        show("front_ends", **record, rows=rows)
    return front_end


def integer_model(folder: Path):
    """The integer model of a folder, for recordings or images."""

    return IntegerModel.load(folder, images=True)


def recordings_for(data: str, config):
    """Recordings that fit a model's configuration; those of another scale are brought to its codes, which is said."""

    return for_model(load(data, config=config), config, warn)
