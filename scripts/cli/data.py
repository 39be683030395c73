"""Verbs that look at recordings."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape

from eskin.scripts.cli.common import CONFIG, DATA, app, console, load_data, print_table


@app.command(epilog="Example: eskin inspect recordings.npz --json archive.json")
def inspect(
    data: Annotated[str, typer.Argument(help=DATA)],
    config: Annotated[str | None, typer.Option(help=CONFIG)] = None,
    out: Annotated[Path | None, typer.Option(help="The picture; default build/inspect/NAME.png.")] = None,
    json: Annotated[Path | None, typer.Option(help="Also write the figures as JSON.")] = None,
) -> None:
    """Show what an archive holds: taxels, rate, lengths, classes, groups, the onset of each recording, a plot."""
    from eskin.golden.core.files import check_target, write_json
    from eskin.golden.pages.inspect_data import draw
    from eskin.golden.pages.inspect_data import inspect as look

    picture = out or Path("build/inspect") / f"{_short_name(data)}.png"
    check_target(picture)
    check_target(json)
    recordings, chosen = load_data(data, config)
    figures = look(recordings, chosen)
    draw(recordings, figures["onset_frames"], picture)
    if json:
        write_json(json, figures)
    _show_inspection(recordings, figures)
    console.print(f"picture: {escape(str(picture))}")


def _short_name(data: str) -> str:
    path = Path(data)
    return Path(os.path.abspath(path)).parent.name if path.name == "recordings.npz" else path.stem or "recordings"


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
    print_table(figures["source"], "what", "value", rows=rows)
    onsets = figures["onset_frames"]
    class_rows = []
    for label, (name, count) in enumerate(figures["classes"].items()):
        mine = [] if onsets is None else [frame for frame, of in zip(onsets, recordings.labels, strict=True) if of == label]
        found = sorted(frame for frame in mine if frame >= 0)
        span = f"{found[0]}/{found[len(found) // 2]}/{found[-1]}" if found else "-"
        class_rows.append((name, count, len(mine) - len(found) if onsets is not None else "-", span))
    print_table("classes", "class", "recordings", "no onset", "onset frame (first/median/last)", rows=class_rows)
    odd = [(index, taxel["state"], taxel["min"], taxel["max"]) for index, taxel in enumerate(figures["taxel"]) if taxel["state"] != "ok"]
    if odd:
        print_table("taxels to look at", "taxel", "state", "smallest", "largest", rows=odd)
    for reason in figures["configuration"]["reasons"]:
        console.print(f"configuration: {escape(reason)}", soft_wrap=True)
    if onsets is not None and any(frame != 0 for frame in onsets):
        console.print("onset frame of each recording (-1: none), ten a line:")
        for first in range(0, len(onsets), 10):
            console.print(f"{first:6d}: " + " ".join(f"{frame:6d}" for frame in onsets[first : first + 10]), highlight=False)
    elif onsets is not None:
        console.print("the gate is open from frame 1 in every recording, so none has an onset")
