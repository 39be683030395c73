"""What is written for other tools: the design's files with a cocotb bench, and the model in C or ONNX, each with what
checks it. No simulator is needed to write them."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from eskin.exchange import plain_c
from eskin.golden.core import (
    PREFIX,
    InputError,
    Record,
    check_folder,
    check_prefix,
    prefixed,
    replacing_folder,
)
from eskin.golden.data import Recordings
from eskin.golden.model import (
    FloatModel,
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


def generate_design(
    model: IntegerModel, out: Path, *, recordings: Recordings | None = None, **system: Any
) -> Path:
    """``eskin generate``: Verilog and its companions, with a cocotb bench.

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
            shown, trace = _played(model, recordings and recordings.subset([number]))
            write_vectors(vectors, trace, shown.scanned(config.sensor.scan_every), [number])
        return generate(config, model.arrays, out, vectors=vectors, **system)


def _with_touch(model: IntegerModel, recordings: Recordings) -> int:
    """Number of the recording to play."""
    touches, steps = find_touches(model.config, recordings), np.zeros(len(recordings), dtype=np.int64)
    np.maximum.at(steps, touches.recording, np.sign(touches.completed) + ~touches.partial)
    order = [*recordings.evenly(len(recordings.class_names)), *range(len(recordings))]
    return int(max(order, key=steps.__getitem__))


def export_c(
    model: IntegerModel, out: Path, *, recordings: Recordings | None = None, prefix: str = PREFIX
) -> Record:
    """Write the model as plain C into ``out``, new or an earlier exported folder, whole or not at all.

    Parameters
    ----------
    recordings:
        What eskin_check plays; default: made-up ones that reach a decision, or images.
    prefix:
        Begins the names of files and of all that they declare, so that several models go into one program.

    Returns
    -------
    dict
        out, prefix, decisions (that eskin_check compares).
    """
    check_folder(out, prefixed(plain_c.HEADER, check_prefix("--prefix", prefix)))
    files = plain_c.sources(model, prefix)
    samples, lengths, calls = _vectors(model, recordings)
    files |= plain_c.check_sources(model.config, samples, lengths, calls, prefix)
    with replacing_folder(out) as folder:
        for name, text in files.items():
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_text(text)
    return {"out": str(out), "prefix": prefix, "decisions": sum(map(len, calls))}


ONNX_FILE = "model.onnx"
ONNX_LIMIT = 1e-5
"""Allowed difference, as a share of the largest logit, or of 1 if that is less: single precision in
another order."""


def export_onnx(model: FloatModel, out: Path) -> Record:
    """Write the float network as ONNX into ``out``, new or an earlier exported folder, and compare what
    onnxruntime makes of it.

    Returns
    -------
    dict
        file, parameters, touches (of random features, that are compared), difference (largest of a logit), limit,
        passed.
    """
    from eskin.exchange.onnx_file import largest_difference, write_onnx

    check_folder(out, ONNX_FILE)
    config = model.config
    features = np.random.default_rng(1).normal(size=(100, config.windows.steps, config.inputs))
    with replacing_folder(out) as folder:
        difference = largest_difference(model, write_onnx(model, folder / ONNX_FILE), features)
    limit = ONNX_LIMIT * max(1.0, float(np.abs(model.forward(features)[1]).max(initial=0.0)))
    return {
        "file": str(out / ONNX_FILE),
        "parameters": config.parameter_count,
        "touches": len(features),
        "difference": difference,
        "limit": limit,
        "passed": difference <= limit,
    }


def _vectors(model: IntegerModel, recordings: Recordings | None) -> tuple[np.ndarray, Any, Any]:
    """Samples, frames of each recording, and what is expected of every call."""
    config = model.config
    if config.is_image:
        images = random_images(config, 8, 1) if recordings is None else images_of(recordings)
        return (
            images.reshape(len(images), -1),
            [1] * len(images),
            plain_c.expected_of_images(run_images(model, images)),
        )
    played, trace = _played(model, recordings, cut_short=True)
    return played.samples, played.lengths.tolist(), plain_c.expected(trace, played)


def _played(
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
