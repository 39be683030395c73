"""What verbs share: options, the console, progress, and how recordings are read.

A verb is a file of eskin/verbs. Its request, a dataclass, holds the options: a field has help text, default and
spelling on the command line. Options that several verbs have are in a base class here.
"""

import functools
import keyword
import re
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import MISSING, dataclass, field, fields
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, NoReturn, dataclass_transform, get_type_hints

import typer
from rich.console import Console
from rich.markup import escape

from eskin.choose.cost import Prefer
from eskin.data import load_recordings
from eskin.data.fit import for_model
from eskin.golden.core import AcceleratorConfig, InputError, Progress, Record
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel
from eskin.pages.views import Rows, parts, terminal_table, words
from eskin.training.settings import TrainingSettings
from eskin.verbs.milestones import shown

PANELS = {
    "The whole job": ("run", "report"),
    "Recordings": ("inspect", "convert", "watch"),
    "Networks": ("train", "enrol", "import", "quantise", "evaluate", "compare"),
    "Hardware": ("generate", "export", "cosim", "build", "replay", "schedule", "energy", "asic", "stability"),
}
"""Verbs as the help groups them."""
VERBS = sum(PANELS.values(), ())
Cell = Literal["gru", "lstm", "linear", "trees"]
CellChoice = Literal["gru", "lstm", "linear", "trees", "tactnet", "tactnet-half", "four", "four-lean", "auto"]
"""Cells, networks for images, and auto: the smallest network that is enough."""
STRESS = "on"
"""Default of --stress for `train` and `run`."""
DATA = "Recordings: .npz, a folder by class, a table, .mat, .h5, a log, or synthetic."
CONFIG = "Preset (thesis, synthetic, pvdf, fabric) or JSON file. Default: derived."


@dataclass_transform(kw_only_default=True, frozen_default=True)
class Options:
    """Keywords that nobody changes: each subclass is a dataclass."""

    def __init_subclass__(cls) -> None:
        dataclass(frozen=True, kw_only=True)(cls)


def option(help: str, default: Any = None, *names: str, **settings: Any) -> Any:
    """An option of a verb; ``names`` where it is not the field's, ``settings`` as `typer.Option` takes them."""
    return field(default=default, metadata={"of": typer.Option(*names, help=help, **settings)})


def required(help: str, **settings: Any) -> Any:
    """An option that must be given."""
    return option(help, MISSING, **settings)


def argument(help: str, default: Any = MISSING, **settings: Any) -> Any:
    """An argument of a verb."""
    return field(default=default, metadata={"of": typer.Argument(help=help, **settings)})


def parse_count(text: str) -> int:
    """The number in ``N|all``; all: more than there are of anything."""
    if text == "all":
        return sys.maxsize
    if not (text.isdecimal() and len(text) < 10 and int(text)):
        raise InputError(f"--recordings {text[:20]}: is not a number of recordings; give 1 or more, or all")
    return int(text)


def parse_lanes(text: str | None, option: str = "--lanes") -> tuple[Any, Any]:
    """(lanes, their type) of ``P[:TYPE]``; None where it is not said."""
    number, colon, kind = (text or "").partition(":")
    if text is None:
        return None, None
    if not (number.isdecimal() and len(number) < 4) or (colon and kind not in ("plain", "dsp")):
        raise InputError(
            f"{option} {text[:20]}: is not of the form P[:TYPE]; give a number and maybe plain or dsp, such as 4:dsp"
        )
    return int(number), kind or None


# ---------------------------------------------------------------------- what verbs share
class ModelOptions(Options):
    model: Path = argument("A quantised model folder.")


class DataOptions(Options):
    data: str = required(DATA)


class ModelDataOptions(ModelOptions, DataOptions):
    """A model and recordings for it."""


class JsonOptions(Options):
    json: Path | None = option("Also write the result as JSON.")


class ClusterOptions(Options):
    dask: str | None = option(
        "A dask scheduler, tcp://HOST:PORT. Default: one process per core.", metavar="ADDRESS"
    )


class FrontEndOptions(DataOptions):
    """Recordings, and the front end that they go through."""

    config: str | None = option(CONFIG)


class ChoiceOptions(TrainingSettings, FrontEndOptions):
    """Recordings to choose, judge and train a network on; all that the user does not ask for is chosen."""

    group: str | None = option("Group arrays A[,B..] kept on one side of every split.")
    cell: CellChoice | None = option("Cell, or network for images. auto: the cheapest that is good enough.")
    hidden: int | None = option("Hidden units.")
    seeds: int | None = option("Seeds of the cross-validation. Default: 3; images 1.", min=1, max=100)
    prefer: Prefer = option("Cost to minimise among candidates as good as the best.", "energy")
    fits: str | None = option(
        "Board that must hold the design. Default: icebreaker, if possible.", metavar="BOARD"
    )
    stress: str = option(
        "Judge candidates on disturbed recordings, too: on, off, or a JSON file of weights.",
        STRESS,
        metavar="on|off|FILE",
    )


class LaneOptions(ModelOptions):
    lanes: str | None = option(
        "Parallel multipliers, such as 4 or 4:dsp (iCE40 DSP blocks). Default: 4.", metavar="P[:TYPE]"
    )


# ---------------------------------------------------------------------- verbs
def module_of(verb: str) -> str:
    """Name of a verb's module."""
    return f"{verb}_" if keyword.iskeyword(verb) else verb


def text_of(verb: str) -> tuple[str, str]:
    """(help, example) of a verb, which is not loaded."""
    file = Path(__file__).parents[1] / "verbs" / f"{module_of(verb)}.py"
    help, _, example = file.read_text().split('"""')[1].partition("\n\nExample: ")
    return help, " ".join(["Example:", *example.partition("\n\n")[0].split()])


def loaded(verb: str) -> tuple[Callable[[Any], Any], type]:
    """A verb's function and the class of its request."""
    command = import_module(f"eskin.verbs.{module_of(verb)}").command
    return command, get_type_hints(command)["request"]


def options_of(request: Any) -> Record:
    """Options of a request by field."""
    return {each.name: each.metadata["of"] for each in fields(request) if "of" in each.metadata}


@functools.cache
def spellings() -> dict[str, str]:
    """Option that sets a field, of all verbs."""
    options: dict[str, str] = {}
    for verb in VERBS:
        for name, option in options_of(loaded(verb)[1]).items():
            own = isinstance(option.default, str)
            options[name] = option.default if own else f"--{name.replace('_', '-')}"
    return options | {f"no_{name}": f"--no-{option[2:]}" for name, option in options.items()}


def spelled(sentence: str) -> str:
    """A sentence with options in place of fields in back quotes."""
    return re.sub(r"`(\w+)`", lambda found: spellings().get(found[1], found[0]), sentence)


# ---------------------------------------------------------------------- the console, and recordings
console = Console()
if not console.is_terminal:  # a file or a pipe has no width: tables are not broken there
    console = Console(width=max(console.width, 160))

messages = Console(stderr=True)


def stop(sentence: str, status: int) -> NoReturn:
    """End with a sentence on standard error."""
    print(f"eskin: {spelled(sentence)}", file=sys.stderr)
    sys.exit(status)


def progress_bars() -> AbstractContextManager[Progress]:
    """Progress on standard error, moved by calling ``(what, done, total)``; gone when done."""
    return shown(messages)


def say(sentence: str) -> None:
    """A line of the result, whatever letters it holds."""
    console.print(escape(spelled(sentence)), soft_wrap=True)


LONG_S, AT_MOST_S = 10.0, 600.0
"""A choice of front ends that takes longer is followed by a long one of networks: by this and ten times as long at most."""


def remaining(front_ends_s: float, folds: bool = True) -> str:
    """How long the networks will take after front ends that took ``front_ends_s``, and how to shorten that; empty where it is
    short. They took 3.5 times as long with 576 recordings of 256 taxels, about ten times with 1100 of 35, and 9 to 15 minutes
    after 10 to 51 seconds with 168 to 518 recordings of 4 to 31 taxels."""
    if front_ends_s < LONG_S or not folds:
        return ""
    least, most = max(round(3 * front_ends_s / 60), 1), round((AT_MOST_S + 10 * front_ends_s) / 60)
    return f"the networks and their folds take {least} to {most} minutes more; --stress off or a --cell shortens that"


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


def integer_model(folder: Path):
    """The integer model of a folder, for recordings or images."""
    return IntegerModel.load(folder, images=True)


def recordings_for(data: str | None, config):
    """Recordings that fit a model's configuration; recordings of another scale are brought to its codes, which is said. None
    without data."""
    return None if data is None else for_model(load(data, config=config), config, warn)
