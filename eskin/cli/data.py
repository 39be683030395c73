"""Verbs that look at recordings."""

import math
from pathlib import Path
from typing import Annotated, Literal

from eskin.cli.common import (
    DATA,
    ConfigOption,
    JsonOption,
    app,
    argument,
    group_names,
    load_data,
    option,
    show,
    show_text,
)
from eskin.golden.core import InputError, Record, check_target


@app.command(epilog="Example: eskin inspect recordings.npz --json archive.json")
def inspect(
    data: Annotated[str, argument(DATA)],
    config: ConfigOption = None,
    out: Annotated[Path | None, option("The picture; default build/inspect/NAME.png.")] = None,
    card: Annotated[
        bool, option("Also write a data card, README.md in a folder called as the picture.", "--card")
    ] = False,
    json: JsonOption = None,
) -> Record:
    """Show what an archive holds: taxels, rate, lengths, classes, groups, the onset of each recording, a
    plot."""
    from eskin.pages.inspect_data import draw, in_rows
    from eskin.pages.inspect_data import inspect as look
    from eskin.pages.views import short_name, words, write_text

    picture = out or Path("build/inspect") / f"{short_name(data)}.png"
    check_target(picture)
    readme = picture.with_suffix("") / "README.md"
    if card and readme.exists():
        raise InputError(f"{readme}: is there already, maybe filled in; move it away, or give another --out")
    recordings, chosen = load_data(data, config)
    figures = look(recordings, chosen)
    draw(recordings, figures.get("onset_frames"), picture)
    more = {} if recordings.image_shape else in_rows(recordings, figures, data)
    show("inspect", **figures, **more, picture=picture)
    if card:
        write_text(readme, words("card", held=recordings, name=short_name(data), **figures))
        show_text(f"data card: {readme}; fill in what stands as TO FILL IN")
    return figures


@app.command(
    epilog="Example: eskin convert measurements --rate 1000 --out mine.npz, then eskin inspect mine.npz"
)
def convert(
    source: Annotated[
        Path,
        argument(
            "A folder by class of .csv, .parquet, .lvm or .png files or logs, one long .csv or .parquet table, a "
            ".mat or .h5 file, a log (.mcap, a ROS bag), an archive of images."
        ),
    ],
    out: Annotated[Path, option("The archive to write, FILE.npz.")],
    rate: Annotated[
        float | None, option("Frames a second; default: of the time column.", metavar="HZ")
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
        option(
            "The class: a column, an attribute, of .mat and .h5 the array of classes, of a log their topic.",
            "--class",
            metavar="NAME",
        ),
    ] = None,
    delimiter: Annotated[str | None, option("What separates the cells: a character, or tab, blank.")] = None,
    samples: Annotated[
        str | None, option(".mat, .h5: the array of samples. Log: the topic of frames.", metavar="NAME")
    ] = None,
    labels: Annotated[
        Path | None,
        option("Log: a .csv table of start, end (s) and class, a row a recording.", metavar="FILE"),
    ] = None,
    clock: Annotated[
        Literal["log", "header"],
        option("Log: whose times frames and labels have, the log's or their headers'."),
    ] = "log",
    scale: Annotated[
        float | None, option("What one code is worth; default: whole numbers are codes, others get a scale.")
    ] = None,
    size: Annotated[
        str | None, option("Images: bring them to so many pixels, 26x47 say.", metavar="HxW")
    ] = None,
) -> None:
    """Write an archive of recordings in another form, and say what was understood of them."""
    from eskin.data import Reading, image_size, load_recordings, resized
    from eskin.golden.data import save_archive

    if out.suffix != ".npz":
        raise InputError(f"--out {out}: is no archive's name; end it in .npz")
    for name, value in (("--rate", rate), ("--scale", scale)):
        if value is not None and not (math.isfinite(value) and value > 0):
            raise InputError(f"{name} {value}: is out of range; give a number above 0")
    check_target(out)
    reading = Reading(
        rate_hz=rate,
        columns=tuple(group_names(columns or "")),
        recording=recording,
        label=class_,
        delimiter=delimiter,
        samples=samples,
        labels=labels,
        clock=clock,
        scale=scale,
    )
    recordings = load_recordings(source, reading=reading)
    if size is not None:
        recordings = resized(recordings, *image_size(size))
    save_archive(recordings, out)
    show("convert", source=source, recordings=recordings, out=out)
