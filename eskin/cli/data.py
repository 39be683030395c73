"""Verbs that look at recordings."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape

from eskin.cli.common import CONFIG, DATA, app, console, group_names, load_data, percent, print_table
from eskin.golden.core.errors import InputError


@app.command(epilog="Example: eskin inspect recordings.npz --json archive.json")
def inspect(
    data: Annotated[str, typer.Argument(help=DATA)],
    config: Annotated[str | None, typer.Option(help=CONFIG)] = None,
    out: Annotated[Path | None, typer.Option(help="The picture; default build/inspect/NAME.png.")] = None,
    json: Annotated[Path | None, typer.Option(help="Also write the figures as JSON.")] = None,
) -> None:
    """Show what an archive holds: taxels, rate, lengths, classes, groups, the onset of each recording, a plot."""
    from eskin.golden.core.files import check_target, write_json
    from eskin.pages.inspect_data import draw
    from eskin.pages.inspect_data import inspect as look

    picture = out or Path("build/inspect") / f"{_short_name(data)}.png"
    check_target(picture)
    check_target(json)
    recordings, chosen = load_data(data, config)
    if recordings.image_shape:
        _inspect_images(recordings, picture, json)
        return
    figures = look(recordings, chosen)
    draw(recordings, figures["onset_frames"], picture)
    if json:
        write_json(json, figures)
    console.print(f"picture: {escape(str(picture))}")
    _show_inspection(recordings, figures, data)


@app.command(epilog="Example: eskin convert measurements --rate 1000 --out mine.npz, then eskin inspect mine.npz")
def convert(
    source: Annotated[
        Path, typer.Argument(help="A folder of .csv, .lvm or .png files by class, one long .csv table, a .mat file, an archive of images.")
    ],
    out: Annotated[Path, typer.Option(help="The archive to write, FILE.npz.")],
    rate: Annotated[float | None, typer.Option(metavar="HZ", help="Frames a second; default: of the time column.")] = None,
    time: Annotated[str | None, typer.Option(metavar="COLUMN", help="The time column, by name or number from 1.")] = None,
    columns: Annotated[
        str | None, typer.Option(metavar="A,B..", help="The taxels: names or numbers from 1, such as 2-17; default: all else.")
    ] = None,
    recording: Annotated[str | None, typer.Option(metavar="COLUMN", help="Long table: what recording a row belongs to.")] = None,
    class_: Annotated[
        str | None, typer.Option("--class", metavar="NAME", help="Long table: the class of a row. .mat: the array of classes.")
    ] = None,
    group: Annotated[str | None, typer.Option(metavar="A,B..", help="Long table: columns that are groups. .mat: arrays.")] = None,
    delimiter: Annotated[str | None, typer.Option(help="What separates the cells: a character, or tab, blank.")] = None,
    samples: Annotated[str | None, typer.Option(metavar="NAME", help=".mat: the array of samples.")] = None,
    scale: Annotated[
        float | None, typer.Option(help="What one code is worth; default: whole numbers are codes, others get a scale.")
    ] = None,
    size: Annotated[str | None, typer.Option(metavar="HxW", help="Images: bring them to so many pixels, 26x47 say.")] = None,
) -> None:
    """Write an archive of recordings in another form, and say what was understood of them."""
    from eskin.golden.core.files import check_target
    from eskin.golden.data.archive import save_archive
    from eskin.golden.data.load import load_recordings
    from eskin.golden.data.pictures import image_size, resized
    from eskin.golden.data.text import Reading

    if out.suffix != ".npz":
        raise InputError(f"--out {out}: is no archive's name; end it in .npz")
    for name, value in (("--rate", rate), ("--scale", scale)):
        if value is not None and not (math.isfinite(value) and value > 0):
            raise InputError(f"{name} {value}: is out of range; give a number above 0")
    check_target(out)
    reading = Reading(
        rate_hz=rate,
        time=time,
        columns=tuple(group_names(columns or "")),
        recording=recording,
        label=class_,
        groups=tuple(group_names(group or "")),
        delimiter=delimiter,
        samples=samples,
        scale=scale,
    )
    recordings = load_recordings(source, reading=reading)
    if size is not None:
        recordings = resized(recordings, *image_size(size))
    save_archive(recordings, out)
    counts = ", ".join(f"{name} {count}" for name, count in zip(recordings.class_names, recordings.class_counts, strict=True))
    lengths = recordings.lengths
    rows = [
        ("recordings", f"{len(recordings)}, of {lengths.min()} to {lengths.max()} frames"),
        ("classes", counts),
        *_size(recordings),
        ("codes", f"{recordings.sample_format}" + (f", one is {recordings.volt_per_code:.6g}" if recordings.volt_per_code else "")),
        ("groups", ", ".join(f"{name} ({len(set(values.tolist()))} values)" for name, values in recordings.groups.items()) or "none"),
    ]
    print_table(str(source), "what", "understood", rows=rows)
    for note in recordings.notes:
        console.print(escape(note), soft_wrap=True)
    console.print(f"archive: {escape(str(out))}; look at it with: eskin inspect {escape(str(out))}", soft_wrap=True)


def _inspect_images(recordings, picture: Path, json: Path | None) -> None:
    from eskin.golden.core.files import write_json
    from eskin.pages.inspect_images import draw_images, inspect_images

    figures = inspect_images(recordings)
    draw_images(recordings, picture)
    if json:
        write_json(json, figures)
    silent = [f"{len(figures[name])} {name.removeprefix('silent_')}" for name in ("silent_rows", "silent_columns") if figures[name]]
    rows = [
        ("images", f"{figures['recordings']} of {figures['image_height']} x {figures['image_width']} pixels (height x width)"),
        ("pixels", f"from {figures['sample_min']} to {figures['sample_max']}, {percent(figures['zeros'])} are 0"),
        ("classes", ", ".join(f"{name} {count}" for name, count in figures["classes"].items())),
        ("groups", ", ".join(f"{name} ({count} values)" for name, count in figures["groups"].items()) or "none"),
        ("equal to an earlier image", figures["copies"]),
        ("never change", " and ".join(silent) or "no row or column"),
    ]
    print_table(figures["source"], "what", "value", rows=rows)
    print_table("networks", "--cell", "multiplies an image", rows=list(figures["networks"].items()))
    for reason in figures["reasons"]:
        console.print(escape(reason), soft_wrap=True)
    console.print(f"picture: {escape(str(picture))}")


def _size(recordings) -> list[tuple[str, str]]:
    """Rows of a table: what a recording is made of."""
    if recordings.image_shape:
        return [("images", "{} x {} pixels (height x width)".format(*recordings.image_shape))]
    return [("taxels", str(recordings.taxels)), ("sample rate", f"{recordings.sample_rate_hz:g} Hz")]


def _short_name(data: str) -> str:
    path = Path(data)
    return Path(os.path.abspath(path)).parent.name if path.name == "recordings.npz" else path.stem or "recordings"


def _show_inspection(recordings, figures: dict[str, Any], data: str) -> None:
    from eskin.pages.inspect_data import LISTED, advice

    rate, lengths = figures["sample_rate_hz"], figures["lengths"]
    volts = f", one is {figures['volt_per_code']:.6g} (volt, or the unit of the samples)" if figures["volt_per_code"] else ""
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
    odd = [
        (index, taxel["state"], taxel["min"], taxel["max"], percent(taxel["held"]))
        for index, taxel in enumerate(figures["taxel"])
        if taxel["state"] != "ok"
    ]
    if odd:
        print_table("taxels to look at", "taxel", "state", "smallest", "largest", "held at an end", rows=odd)
    for reason in figures["configuration"]["reasons"]:
        console.print(f"configuration: {escape(reason)}", soft_wrap=True)
    if onsets is not None and any(frame != 0 for frame in onsets):
        lost = [index for index, frame in enumerate(onsets) if frame < 0]
        late = sorted((index for index, frame in enumerate(onsets) if frame >= 0), key=lambda index: onsets[index])
        listed = (lost + late[: LISTED // 2] + late[-(LISTED // 2) :])[:LISTED] if len(onsets) > LISTED else range(len(onsets))
        shown = [
            (index, recordings.class_names[recordings.labels[index]], onsets[index], recordings.lengths[index])
            for index in sorted(set(listed))
        ]
        some = f" of {len(shown)} recordings: those without one, the earliest, the latest (all: --json)"
        title = f"onsets{some if len(onsets) > LISTED else ''}"
        print_table(title, "recording", "class", "onset frame (-1: none)", "frames", rows=shown)
    elif onsets is not None:
        console.print("the gate is open from frame 1 in every recording, so none has an onset")
    for sentence in advice(figures, data):
        console.print(escape(sentence), soft_wrap=True)
