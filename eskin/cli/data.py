"""Verbs that look at recordings."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Annotated, Any

from rich.markup import escape

from eskin.cli.common import (
    DATA,
    ConfigOption,
    JsonOption,
    app,
    argument,
    console,
    group_names,
    load_data,
    option,
    print_records,
    print_table,
    say,
)
from eskin.golden.core.errors import InputError
from eskin.golden.core.files import check_target, write_json
from eskin.pages.tables import percent


@app.command(epilog="Example: eskin inspect recordings.npz --json archive.json")
def inspect(
    data: Annotated[str, argument(DATA)],
    config: ConfigOption = None,
    out: Annotated[Path | None, option("The picture; default build/inspect/NAME.png.")] = None,
    json: JsonOption = None,
) -> None:
    """Show what an archive holds: taxels, rate, lengths, classes, groups, the onset of each recording, a
    plot."""
    from eskin.pages.inspect_data import draw
    from eskin.pages.inspect_data import inspect as look

    picture = out or Path("build/inspect") / f"{_short_name(data)}.png"
    check_target(picture)
    check_target(json)
    recordings, chosen = load_data(data, config)
    figures = look(recordings, chosen)
    draw(recordings, figures.get("onset_frames"), picture)
    if json:
        write_json(json, figures)
    console.print(f"picture: {escape(str(picture))}")
    if recordings.image_shape:
        _show_images(figures)
    else:
        _show_inspection(recordings, figures, data)


@app.command(
    epilog="Example: eskin convert measurements --rate 1000 --out mine.npz, then eskin inspect mine.npz"
)
def convert(
    source: Annotated[
        Path,
        argument(
            "A folder of .csv, .lvm or .png files by class, one long .csv table, a .mat file, an archive of "
            "images."
        ),
    ],
    out: Annotated[Path, option("The archive to write, FILE.npz.")],
    rate: Annotated[
        float | None, option("Frames a second; default: of the time column.", metavar="HZ")
    ] = None,
    time: Annotated[
        str | None, option("The time column, by name or number from 1.", metavar="COLUMN")
    ] = None,
    columns: Annotated[
        str | None,
        option("The taxels: names or numbers from 1, such as 2-17; default: all else.", metavar="A,B.."),
    ] = None,
    recording: Annotated[
        str | None, option("Long table: what recording a row belongs to.", metavar="COLUMN")
    ] = None,
    class_: Annotated[
        str | None,
        option("Long table: the class of a row. .mat: the array of classes.", "--class", metavar="NAME"),
    ] = None,
    group: Annotated[
        str | None, option("Long table: columns that are groups. .mat: arrays.", metavar="A,B..")
    ] = None,
    delimiter: Annotated[str | None, option("What separates the cells: a character, or tab, blank.")] = None,
    samples: Annotated[str | None, option(".mat: the array of samples.", metavar="NAME")] = None,
    scale: Annotated[
        float | None, option("What one code is worth; default: whole numbers are codes, others get a scale.")
    ] = None,
    size: Annotated[
        str | None, option("Images: bring them to so many pixels, 26x47 say.", metavar="HxW")
    ] = None,
) -> None:
    """Write an archive of recordings in another form, and say what was understood of them."""
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
    counts = ", ".join(
        f"{name} {count}" for name, count in zip(recordings.class_names, recordings.class_counts, strict=True)
    )
    lengths = recordings.lengths
    rows = [
        ("recordings", f"{len(recordings)}, of {lengths.min()} to {lengths.max()} frames"),
        ("classes", counts),
        *_size(recordings),
        (
            "codes",
            f"{recordings.sample_format}"
            + (f", one is {recordings.volt_per_code:.6g}" if recordings.volt_per_code else ""),
        ),
        (
            "groups",
            ", ".join(
                f"{name} ({len(set(values.tolist()))} values)" for name, values in recordings.groups.items()
            )
            or "none",
        ),
    ]
    print_table(str(source), "what", "understood", rows=rows)
    for note in recordings.notes:
        say(note)
    say(f"archive: {out}; look at it with: eskin inspect {out}")


def _show_images(figures: dict[str, Any]) -> None:
    silent = [
        f"{len(figures[name])} {name.removeprefix('silent_')}"
        for name in ("silent_rows", "silent_columns")
        if figures[name]
    ]
    rows = [
        (
            "images",
            f"{figures['recordings']} of {figures['image_height']} x {figures['image_width']} pixels "
            "(height x width)",
        ),
        (
            "pixels",
            f"from {figures['sample_min']} to {figures['sample_max']}, {percent(figures['zeros'])} are 0",
        ),
        ("classes", ", ".join(f"{name} {count}" for name, count in figures["classes"].items())),
        ("groups", _groups(figures)),
        ("equal to an earlier image", figures["copies"]),
        ("never change", " and ".join(silent) or "no row or column"),
    ]
    print_table(figures["source"], "what", "value", rows=rows)
    print_table("networks", "--cell", "multiplies an image", rows=list(figures["networks"].items()))
    for reason in figures["reasons"]:
        say(reason)


def _groups(figures: dict[str, Any]) -> str:
    return ", ".join(f"{name} ({count} values)" for name, count in figures["groups"].items()) or "none"


def _size(recordings) -> list[tuple[str, str]]:
    """Rows of a table: what a recording is made of."""
    if recordings.image_shape:
        return [("images", "{} x {} pixels (height x width)".format(*recordings.image_shape))]
    return [("taxels", str(recordings.taxels)), ("sample rate", f"{recordings.sample_rate_hz:g} Hz")]


def _short_name(data: str) -> str:
    path = Path(data)
    return (
        Path(os.path.abspath(path)).parent.name
        if path.name == "recordings.npz"
        else path.stem or "recordings"
    )


def _show_inspection(recordings, figures: dict[str, Any], data: str) -> None:
    from eskin.pages.inspect_data import LISTED, advice

    rate, lengths = figures["sample_rate_hz"], figures["lengths"]
    volts = (
        f", one is {figures['volt_per_code']:.6g} (volt, or the unit of the samples)"
        if figures["volt_per_code"]
        else ""
    )
    seconds = "/".join(f"{lengths[key] / rate:.3g}" for key in ("min", "median", "max"))
    rows = [
        ("recordings", figures["recordings"]),
        ("taxels", figures["taxels"]),
        ("sample rate", f"{rate:g} Hz"),
        (
            "codes",
            f"{figures['sample_format']}, from {figures['sample_min']} to {figures['sample_max']}{volts}",
        ),
        (
            "lengths (shortest/median/longest)",
            f"{lengths['min']}/{lengths['median']:g}/{lengths['max']} frames, {seconds} s",
        ),
        ("groups", _groups(figures)),
    ]
    print_table(figures["source"], "what", "value", rows=rows)
    onsets = figures["onset_frames"]
    class_rows = []
    for label, (name, count) in enumerate(figures["classes"].items()):
        mine = (
            []
            if onsets is None
            else [frame for frame, of in zip(onsets, recordings.labels, strict=True) if of == label]
        )
        onset_frames = sorted(frame for frame in mine if frame >= 0)
        span = (
            f"{onset_frames[0]}/{onset_frames[len(onset_frames) // 2]}/{onset_frames[-1]}"
            if onset_frames
            else "-"
        )
        class_rows.append((name, count, len(mine) - len(onset_frames) if onsets is not None else "-", span))
    print_table(
        "classes", "class", "recordings", "no onset", "onset frame (first/median/last)", rows=class_rows
    )
    odd = [{"index": index} | taxel for index, taxel in enumerate(figures["taxel"]) if taxel["state"] != "ok"]
    columns = {
        "taxel": "{index}",
        "state": "{state}",
        "smallest": "{min}",
        "largest": "{max}",
        "held at an end": "{held:percent}",
    }
    print_records("taxels to look at", odd, columns)
    for reason in figures["configuration"]["reasons"]:
        say(f"configuration: {reason}")
    if onsets is not None and any(frame != 0 for frame in onsets):
        lost = [index for index, frame in enumerate(onsets) if frame < 0]
        late = sorted(
            (index for index, frame in enumerate(onsets) if frame >= 0), key=lambda index: onsets[index]
        )
        listed = (
            (lost + late[: LISTED // 2] + late[-(LISTED // 2) :])[:LISTED]
            if len(onsets) > LISTED
            else range(len(onsets))
        )
        shown = [
            (
                index,
                recordings.class_names[recordings.labels[index]],
                onsets[index],
                recordings.lengths[index],
            )
            for index in sorted(set(listed))
        ]
        selection = f" of {len(shown)} recordings: those without one, the earliest, the latest (all: --json)"
        title = f"onsets{selection if len(onsets) > LISTED else ''}"
        print_table(title, "recording", "class", "onset frame (-1: none)", "frames", rows=shown)
    elif onsets is not None:
        console.print("the gate is open from frame 1 in every recording, so none has an onset")
    for sentence in advice(figures, data):
        say(sentence)
