"""What the verbs share: the application, the console, progress, options, and how recordings and configurations are read."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from eskin.golden.core.errors import InputError
from eskin.verbs.milestones import Milestones

OUTPUTS = ("out", "json", "record")
"""Parameters that name what a verb writes; every other one that names a file or folder names what it reads."""
INPUT_WORDS = ("data", "config", "grid", "model", "test", "with_")
"""Parameters that name a file or folder, or are a word."""
REPLACING = ("build", "enrol", "generate", "import_", "run", "train")
"""Verbs whose --out is a folder that they replace as a whole."""


class Application(typer.Typer):
    """Every verb refuses an output that would destroy one of its inputs, before it begins."""

    def command(self, *names: Any, **options: Any) -> Callable[..., Any]:
        register = super().command(*names, **options)

        def add(verb: Callable[..., Any]) -> Any:
            @functools.wraps(verb)
            def checked(**given: Any) -> Any:
                check_outputs(verb.__name__, given)
                return verb(**given)

            return register(checked)

        return add


def check_outputs(verb: str, given: Mapping[str, Any]) -> None:
    """Refuse an output that is an input or another output, under whatever name, or lies or would wipe out where an input lies.

    Raises
    ------
    InputError
    """
    from eskin.golden.core.config import PRESETS

    outputs = {f"--{name}": given[name] for name in OUTPUTS if given.get(name)}
    words = (*PRESETS, "synthetic", "default", "bits")
    inputs: list[Path] = []
    for name, value in given.items():
        if name not in OUTPUTS:
            several = value if isinstance(value, list) else [value]
            inputs += [Path(path) for path in several if isinstance(path, Path) or (name in INPUT_WORDS and path and path not in words)]
    places = [(path, path.resolve()) for path in inputs if path.exists()]
    for option, path in outputs.items():
        place = path.resolve()
        twin = next((other for other, its in outputs.items() if other != option and its.resolve() == place), None)
        if twin:
            raise InputError(f"{option} {path}: is what {twin} names, too; give each a name of its own")
        for given_path, source in places:
            if source == place or (path.exists() and path.samefile(source)):
                raise InputError(f"{option} {path}: is the input {given_path}, which would be lost; give another name")
            if verb in REPLACING and place in source.parents and option == "--out":
                raise InputError(f"{option} {path}: is replaced as a whole and holds the input {given_path}; name another folder")
            if path.is_file() and source in place.parents:
                raise InputError(f"{option} {path}: is a file of the input {given_path}, which would be lost; give another name")


app = Application(add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode="rich")

console = Console()
if not console.is_terminal:  # a file or a pipe has no width: tables are not broken there
    console = Console(width=max(console.width, 160))

messages = Console(stderr=True)

DATA = (
    "An .npz archive, a folder of .csv, .lvm or .png files (one sub-folder a class), a long .csv table, a .mat file, or the word synthetic."
)

SEED_MAX = 2**31 - 1

CONFIG = "A preset (thesis, synthetic, pvdf, fabric) or a JSON file; without it one is derived from the data."

JobsOption = Annotated[int | None, typer.Option(min=1, metavar="N", help="Processes at a time; default: one a core.")]

DaskOption = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="A dask scheduler, tcp://HOST:PORT, whose workers do it; default: processes here.")
]


def stop(sentence: str, status: int) -> None:
    print(f"eskin: {sentence}", file=sys.stderr)
    sys.exit(status)


@contextmanager
def progress_bars() -> Iterator[Callable[[str, int, int], None]]:
    """Progress bars on standard error, moved by calling ``(what, done, total)``; gone when done. ``Milestones`` where that is no
    terminal."""
    from rich.progress import Progress, TaskID

    if not messages.is_terminal:
        yield Milestones(lambda line: print(line, file=sys.stderr, flush=True))
        return
    with Progress(console=messages, transient=True) as bars:
        tasks: dict[str, TaskID] = {}

        def report(what: str, done: int, total: int) -> None:
            if what not in tasks:
                tasks[what] = bars.add_task(what, total=total)
            bars.update(tasks[what], completed=done, total=total)

        yield report


def load_data(data: str, config: str | None = None):
    """Recordings, and the configuration that was asked for, if one was."""
    from eskin.golden.core.config import AcceleratorConfig
    from eskin.golden.data.load import load_recordings

    chosen = AcceleratorConfig.load(config) if config else None
    return load_recordings(data, config=chosen), chosen


def print_table(title: str, *columns: str, rows: Sequence[tuple]) -> None:
    table = Table(*columns, title=escape(title), title_justify="left")
    for row in rows:
        table.add_row(*(escape(str(cell)) for cell in row))
    console.print(table)


def fitting_config(recordings, asked, groups=None, folds: int = 5):
    """The front end that was asked for, or a chosen one with the table of its rivals; the reasons are printed."""
    from eskin.golden.training.choose_front_end import configure

    with progress_bars() as report:
        front_end = configure(recordings, asked, groups=groups, folds=folds, progress=report)
    for reason in front_end.reasons:
        messages.print(f"configuration: {escape(reason)}", soft_wrap=True)
    if front_end.record:
        show_front_ends(front_end.record)
    return front_end


def show_front_ends(record: dict[str, Any]) -> None:
    from eskin.golden.training.choice_table import front_end_table, front_end_words, left_out

    rows = [
        (
            percent(row["accuracy"]),
            f"{100 * row['standard_error']:.2f}",
            f"{100 * row['behind']:.2f} +- {100 * row['behind_error']:.2f}",
            "chosen" if row is record["chosen"] else "level" if row["level"] else "",
            row["missed"],
            front_end_words(row),
        )
        for row in front_end_table(record)
    ]
    title = (
        f"front ends, judged by a linear classifier leaving out {left_out(record['split'])}, {record['recordings_looked_at']} recordings"
    )
    print_table(title, "accuracy", "standard error", "behind the best", "", "missed", "front end", rows=rows)


def recordings_for(data: str, config):
    """Recordings that fit a model's configuration."""
    from eskin.golden.data.load import load_recordings
    from eskin.golden.data.recordings import check_fit

    recordings = load_recordings(data, config=config)
    check_fit(recordings, config)
    return recordings


def percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.2f} %"


class CellChoice(StrEnum):
    """Cells, networks for images, and auto: the smallest network that is enough."""

    gru = "gru"
    lstm = "lstm"
    linear = "linear"
    tactnet = "tactnet"
    tactnet_half = "tactnet-half"
    four = "four"
    four_lean = "four-lean"
    auto = "auto"


CELL_CHOICE = (
    "tactnet, tactnet-half, four, four-lean are for images. auto: the smallest of several that is enough. Default: auto without --config "
    "and --hidden, else the configuration's."
)


class LaneType(StrEnum):
    """Lanes of one design."""

    plain = "plain"
    dsp = "dsp"
    serial = "serial"


class ClassPins(StrEnum):
    """How a board shows the class."""

    each = "each"
    binary = "binary"
    none = "none"


LaneTypeOption = Annotated[LaneType | None, typer.Option(help="plain; dsp: the iCE40's DSP blocks; serial: one lane without a multiplier.")]


def how_many(text: str) -> int | None:
    """The number in ``--recordings N|all``; None is all."""
    if text == "all":
        return None
    if not (text.isdecimal() and len(text) < 10 and int(text)):
        raise InputError(f"--recordings {text[:20]}: is no number of recordings; give 1 or more, or all")
    return int(text)


def group_names(group: str) -> list[str]:
    """Group names of ``--group A,B``."""
    return [name.strip() for name in group.split(",") if name.strip()]
