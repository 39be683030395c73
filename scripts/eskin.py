"""The command line `eskin`: options in, one call into golden, rtl or cosim, a table out.

Modules are imported inside the verbs, so that `--help` is quick.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from golden.errors import InputError

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)
console = Console()
messages = Console(stderr=True)

DATA = "An .npz archive, a folder of .lvm files (one sub-folder a class), or the word synthetic."
CONFIG = "A preset (thesis, synthetic, pvdf, fabric) or a JSON file; without it one is derived from the data."


@app.callback(epilog="Exit status: 0 done and every check held, 1 a check did not hold, 2 bad usage or bad input.")
def eskin() -> None:
    """From recorded tactile streams to a trained GRU or LSTM in bit-exact hardware."""


def main() -> None:
    """Entry point: every foreseen mistake becomes one sentence on standard error and status 2, an interrupt status 130."""
    try:
        app()
    except InputError as error:
        _stop(str(error), 2)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        _stop(f"{where}{error.strerror or error}; check the path, its permissions and the room on the disk", 2)
    except SystemExit as end:
        if end.code == 130:
            _stop("stopped by the user; files that were being written are as they were before", 130)
        raise


def _stop(sentence: str, status: int) -> None:
    print(f"eskin: {sentence}", file=sys.stderr)
    sys.exit(status)


@contextmanager
def _progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """A progress bar on standard error, moved by calling ``(done, total)``; gone when done."""
    from rich.progress import Progress

    with Progress(console=messages, transient=True) as bars:
        task = bars.add_task(what, total=None)
        yield lambda done, total: bars.update(task, completed=done, total=total)


def _load(data: str, config: str | None = None):
    """Recordings and the configuration that was asked for, if one was."""
    from golden.config import AcceleratorConfig
    from golden.recordings import load_recordings

    chosen = AcceleratorConfig.load(config) if config else None
    return load_recordings(data, config=chosen), chosen


def _table(title: str, *columns: str, rows: list[tuple]) -> None:
    table = Table(*columns, title=escape(title), title_justify="left")
    for row in rows:
        table.add_row(*(escape(str(cell)) for cell in row))
    console.print(table)


@app.command(epilog="Example: eskin inspect recordings.npz --json archive.json")
def inspect(
    data: Annotated[str, typer.Argument(help=DATA)],
    config: Annotated[str | None, typer.Option(help=CONFIG)] = None,
    out: Annotated[Path | None, typer.Option(help="The picture; default build/inspect/NAME.png.")] = None,
    json: Annotated[Path | None, typer.Option(help="Also write the figures as JSON.")] = None,
) -> None:
    """Show what an archive holds: taxels, rate, lengths, classes, groups, the onset of each recording, a plot."""
    from golden.files import write_json
    from golden.inspect_data import draw
    from golden.inspect_data import inspect as look

    recordings, chosen = _load(data, config)
    figures = look(recordings, chosen)
    picture = out or Path("build/inspect") / f"{_short_name(data)}.png"
    draw(recordings, figures["onset_frames"], picture)
    if json:
        write_json(json, figures)
    _show_inspection(recordings, figures)
    console.print(f"picture: {escape(str(picture))}")


def _short_name(data: str) -> str:
    path = Path(data)
    return path.resolve().parent.name if path.name == "recordings.npz" else path.stem or "recordings"


def _show_inspection(recordings, figures: dict[str, Any]) -> None:
    rate, lengths = figures["sample_rate_hz"], figures["lengths"]
    volts = f", {1e6 * figures['volt_per_code']:.6g} uV a code" if figures["volt_per_code"] else ""
    groups = ", ".join(f"{name} ({count} values)" for name, count in figures["groups"].items()) or "none"
    seconds = "/".join(f"{lengths[key] / rate:.3g}" for key in ("min", "median", "max"))
    rows = [
        ("recordings", figures["recordings"]),
        ("taxels", figures["taxels"]),
        ("sample rate", f"{rate:g} Hz"),
        ("codes", f"{figures['sample_format']}, from {figures['sample_min']} to {figures['sample_max']}{volts}"),
        ("lengths (shortest/median/longest)", f"{lengths['min']}/{lengths['median']:g}/{lengths['max']} frames, {seconds} s"),
        ("groups", groups),
    ]
    _table(figures["source"], "what", "value", rows=rows)
    onsets = figures["onset_frames"]
    class_rows = []
    for label, (name, count) in enumerate(figures["classes"].items()):
        mine = [] if onsets is None else [frame for frame, of in zip(onsets, recordings.labels, strict=True) if of == label]
        found = sorted(frame for frame in mine if frame >= 0)
        span = f"{found[0]}/{found[len(found) // 2]}/{found[-1]}" if found else "-"
        class_rows.append((name, count, len(mine) - len(found) if onsets is not None else "-", span))
    _table("classes", "class", "recordings", "no onset", "onset frame (first/median/last)", rows=class_rows)
    odd = [(index, taxel["state"], taxel["min"], taxel["max"]) for index, taxel in enumerate(figures["taxel"]) if taxel["state"] != "ok"]
    if odd:
        _table("taxels to look at", "taxel", "state", "smallest", "largest", rows=odd)
    for reason in figures["configuration"]["reasons"]:
        console.print(f"configuration: {escape(reason)}")
    if onsets is not None and any(frame != 0 for frame in onsets):
        console.print("onset frame of each recording (-1: none), ten a line:")
        for first in range(0, len(onsets), 10):
            console.print(f"{first:6d}: " + " ".join(f"{frame:6d}" for frame in onsets[first : first + 10]), highlight=False)
    elif onsets is not None:
        console.print("the gate is open from frame 1 in every recording, so none has an onset")


if __name__ == "__main__":
    main()
