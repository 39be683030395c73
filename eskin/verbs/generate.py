"""Write the accelerator: Verilog, memory images, config.json, register map, C header, a cocotb bench.

Example: eskin generate model --out design --lanes 4

No simulator is needed to write the bench.
"""

import tempfile
from pathlib import Path
from typing import Any, Literal

import numpy as np

from eskin.cli.common import LaneOptions, integer_model, option, parse_lanes, recordings_for, required, say
from eskin.golden.core import InputError
from eskin.golden.data import Recordings
from eskin.golden.model import (
    IntegerModel,
    Trace,
    find_touches,
    images_of,
    run,
    run_images,
    write_image_vectors,
    write_vectors,
)
from eskin.rtl.fpga.generate import generate
from eskin.training.made_up import decided_recordings, random_images


class GenerateRequest(LaneOptions):
    out: Path = required("Folder to write: new, or an earlier design to replace.")
    data: str | None = option("The bench plays the first of these recordings. Default: a synthetic one.")
    bus: Literal["wishbone", "axi4lite"] | None = option("Add a bus shell for a CPU, with a C driver.")
    streams: Literal["axis"] | None = option(
        "Take frames from an AXI-Stream; without --bus send decisions on one."
    )
    top: str | None = option("Name of the top module, and prefix of all other names.", metavar="NAME")


def command(request: GenerateRequest) -> None:
    integer = integer_model(request.model).with_lanes(*parse_lanes(request.lanes))
    recordings = recordings_for(request.data, integer.config)
    folder = generate_design(
        integer,
        request.out,
        recordings=recordings,
        bus=request.bus,
        axis=request.streams is not None,
        top=request.top,
    )
    say(f"{folder}: {', '.join(sorted(path.name for path in folder.iterdir()))}")


def generate_design(
    model: IntegerModel, out: Path, *, recordings: Recordings | None = None, **system: Any
) -> Path:
    """Verilog and its companions, with a cocotb bench.

    Parameters
    ----------
    recordings:
        The bench plays the first image, or the first recording, taken evenly over the classes, with a whole touch, else
        the first with a completed step. Default: a random one.
    system:
        bus, axis and top of `generate`.

    Raises
    ------
    InputError
        No recording has a completed step.
    """
    config = model.config
    if not out.name:
        raise InputError(f"--out {out}: cannot be replaced; name a new folder")
    with tempfile.TemporaryDirectory() as folder:
        vectors = Path(folder) / "vectors.npz"
        if config.is_image:
            images = random_images(config, 1, 1) if recordings is None else images_of(recordings.subset([0]))
            write_image_vectors(vectors, run_images(model, images).streams, images)
        else:
            number = 0 if recordings is None else _with_touch(model, recordings)
            shown, trace = played(model, recordings and recordings.subset([number]))
            write_vectors(vectors, trace, shown.scanned(config.sensor.scan_every), [number])
        return generate(config, model.arrays, out, vectors=vectors, **system)


def _with_touch(model: IntegerModel, recordings: Recordings) -> int:
    """Number of the recording to play."""
    touches, steps = find_touches(model.config, recordings), np.zeros(len(recordings), dtype=np.int64)
    np.maximum.at(steps, touches.recording, np.sign(touches.completed) + ~touches.partial)
    order = [*recordings.evenly(len(recordings.class_names)), *range(len(recordings))]
    return int(max(order, key=steps.__getitem__))


def played(
    model: IntegerModel, recordings: Recordings | None, *, cut_short: bool = False
) -> tuple[Recordings, Trace]:
    """Recordings and their trace; by default a made-up touch, and one that the recording cuts short."""
    lead, whole, windows = model.config.rest_level.rest_frames, model.config.last_frame, model.config.windows
    lengths = [lead + whole + 4 * windows.hop, lead + whole // 2 + windows.pretrigger_frames]
    if recordings is None:
        recordings, trace = decided_recordings(model, lengths[: 1 + cut_short])
    else:
        trace = run(model, recordings)
    if not len(trace.streams["decision"][0]):
        raise InputError(
            f"recordings '{recordings.source}': none has a touch with a completed step, so nothing would be compared; "
            "give others with --data"
        )
    return recordings, trace
