"""Verbs that look at recordings."""

import math
from pathlib import Path

from rich.markup import escape

from eskin.cli.common import app, load, load_data, messages, recordings_for, show, show_text, warn
from eskin.data import Reading, load_recordings
from eskin.data.archive import save_archive
from eskin.data.fit import for_model
from eskin.golden.core import AcceleratorConfig, InputError, Record, check_target
from eskin.golden.data.codes import Worth
from eskin.golden.model import IntegerModel, load_config, load_training
from eskin.pages.views import short_name, words, write_text
from eskin.requests import ConvertRequest, InspectRequest, WatchRequest, parse_names


@app.command(epilog="Example: eskin inspect recordings.npz --json archive.json")
def inspect(request: InspectRequest) -> Record:
    """Show the content of an archive: taxels, rate, lengths, classes, groups, the onset of each recording,
    a picture."""
    from eskin.pages.inspect_data import draw, in_rows
    from eskin.pages.inspect_data import inspect as look

    picture = request.out or Path("build/inspect") / f"{short_name(request.data)}.png"
    check_target(picture)
    readme = picture.with_suffix("") / "README.md"
    if request.card and readme.exists():
        raise InputError(f"{readme}: exists already and may be filled in; move it, or give another --out")
    recordings, _ = load_data(request.data)
    figures = look(recordings)
    draw(recordings, figures.get("onset_frames"), picture)
    more = {} if recordings.image_shape else in_rows(recordings, figures, request.data)
    show("inspect", **figures, **more, picture=picture)
    if request.card:
        write_text(readme, words("card", held=recordings, name=short_name(request.data), **figures))
        show_text(f"data card: {readme}; replace each TO FILL IN")
    return figures


@app.command(
    epilog="Example: eskin convert measurements --rate 1000 --out mine.npz, then eskin inspect mine.npz"
)
def convert(request: ConvertRequest) -> None:
    """Convert recordings to an archive, and print how eskin interpreted them."""

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
        record = load_training(like)
        names, unit = record.get("channel_names", []), record.get("unit", "")
        return load_config(like), tuple(map(str, names)) if isinstance(names, list) else (), str(unit)
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


@app.command(
    epilog="Example: eskin watch model --data recordings.npz, or eskin watch model --simulate, or "
    "eskin watch model --data recordings.npz --port /dev/ttyUSB1"
)
def watch(request: WatchRequest) -> Record:
    """Watch a model live in the browser: taxels, windows, features, hidden state, logits and decisions."""
    from eskin.verbs import board_job, build_job

    if request.port and request.simulate:
        raise InputError("--simulate: cannot be combined with --port; leave one out")
    if not (request.data or request.port or request.simulate):
        raise InputError(
            "--data: is missing; name recordings, or a board with --port, or add --simulate for a synthetic "
            "scene"
        )
    baud, lanes, lane_type = build_job.board_of(request.model) if request.port else (None, None, None)
    integer = IntegerModel.load(request.model).with_lanes(lanes, lane_type)
    recordings = (
        None
        if request.port and not request.data
        else recordings_for(request.data or "synthetic", integer.config)
    )
    if request.simulate:
        messages.print("watch: building the simulator, once a design", soft_wrap=True)
    result = board_job.watch(
        request,
        integer,
        recordings,
        baud,
        lambda address, _: messages.print(
            f"watch: {escape(address)} (stop with Ctrl-C)", soft_wrap=True, highlight=False
        ),
    )
    show("watch", **result, hardware=bool(request.simulate or request.port))
    return result
