"""Convert recordings to an archive, and print how eskin interpreted them.

Example: eskin convert measurements --rate 1000 --out mine.npz, then eskin inspect mine.npz
"""

import math
from pathlib import Path
from typing import Literal

from eskin.cli.common import Options, argument, load, option, required, show, warn
from eskin.data import Reading, load_recordings
from eskin.data.archive import save_archive
from eskin.data.fit import for_model
from eskin.golden.core import AcceleratorConfig, InputError, Record, check_target
from eskin.golden.data.codes import Worth
from eskin.golden.model import load_config
from eskin.training.record import training_of
from eskin.training.settings import parse_names


class ConvertRequest(Options):
    source: Path = argument(
        "A folder by class of .csv, .parquet or .lvm files or logs, one long .csv or .parquet table, a "
        ".mat or .h5 file, a log (.mcap, a ROS bag), an archive of images."
    )
    out: Path = required("Archive to write, FILE.npz.")
    rate: float | None = option("Frames per second. Default: from the time column.", metavar="HZ")
    columns: str | None = option("Taxel columns: names, or numbers from 1 such as 2-17.", metavar="A,B..")
    recording: str | None = option("Long table: column that names a row's recording.", metavar="COLUMN")
    class_: str | None = option(
        "Column, attribute, array or topic that names the class.", None, "--class", metavar="NAME"
    )
    delimiter: str | None = option("Separator of cells: a character, tab or blank.")
    samples: str | None = option("Array (.mat, .h5) or topic (log) of the samples.", metavar="NAME")
    labels: Path | None = option(
        "Log: .csv table of start, end (s) and class, one row per recording.", metavar="FILE"
    )
    clock: Literal["log", "header"] = option("Log: clock of frames and labels.", "log")
    scale: float | None = option("Value of one code. Default: 1 for integers, else from the data.")
    like: Path | None = option(
        "Take scale, columns, classes and rate from this model or archive.", metavar="MODEL|FILE"
    )


def command(request: ConvertRequest) -> None:

    if request.out.suffix != ".npz":
        raise InputError(f"--out {request.out}: must end in .npz; give such a name")
    for name, value in (("--rate", request.rate), ("--scale", request.scale)):
        if value is not None and not (math.isfinite(value) and value > 0):
            raise InputError(f"{name} {value}: is out of range; give a number above 0")
    check_target(request.out)
    scale: Worth | None = request.scale
    columns, rate = tuple(parse_names(request.columns or "")), request.rate
    if request.like is not None:
        model, columns_of, unit = _sensor_of(request.like)
        if not (columns or columns_of):
            warn(
                f"--like {request.like}: does not name its columns, so eskin chooses them; --columns overrides this"
            )
        columns = columns or columns_of
        scale, rate = scale or model.sensor.volt_per_code or None, rate or model.sensor.sample_rate_hz
    reading = Reading(
        rate_hz=rate,
        columns=columns,
        recording=request.recording,
        label=request.class_,
        delimiter=request.delimiter,
        samples=request.samples,
        labels=request.labels,
        clock=request.clock,
        scale=scale,
    )
    recordings = load(request.source, reading=reading)
    if request.like is not None:
        if unit and recordings.unit and unit != recordings.unit:
            raise InputError(
                f"--like {request.like}: its samples are in {unit}, those of '{request.source}' in {recordings.unit}; convert them to "
                "one unit"
            )
        recordings = for_model(recordings, model)
    save_archive(recordings, request.out)
    show("convert", source=request.source, recordings=recordings, out=request.out)


def _sensor_of(like: Path) -> tuple[AcceleratorConfig, tuple[str, ...], str]:
    """(a configuration with the sensor and the classes, the names of the columns and the unit, empty where they are
    not said) of a model folder or an archive."""

    if like.is_dir():
        record = training_of(like)
        return load_config(like), tuple(record.channel_names), record.unit
    of = load_recordings(like)
    if of.image_shape:
        raise InputError(f"--like {like}: holds images, which have no scale; leave it out")
    sensor: Record = {
        "name": f"--like {like}",
        "taxels": of.taxels,
        "sample_rate_hz": of.sample_rate_hz,
        "sample_bits": of.sample_bits,
        "sample_signed": of.sample_signed,
        "volt_per_code": of.volt_per_code,
        "clock_hz": 4.0 * of.taxels * of.sample_rate_hz,  # whatever takes the frames
    }
    return AcceleratorConfig.of(**sensor, class_names=of.class_names), of.channel_names, of.unit
