"""The design's files, with a cocotb bench that plays a recording; no simulator is needed to write them."""

import tempfile
from pathlib import Path
from typing import Any

from eskin.golden.core import InputError
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel, images_of, run, run_images, write_image_vectors, write_vectors
from eskin.rtl.fpga.generate import generate
from eskin.training.made_up import decided_recordings, random_images


def generate_design(
    model: IntegerModel,
    out: Path,
    *,
    lanes: int | None = None,
    lane_type: str | None = None,
    recordings: Recordings | None = None,
    number: int = 0,
    **system: Any,
) -> Path:
    """``eskin generate``: Verilog and its companions; the cocotb bench plays recording ``number`` of
    ``recordings`` (default: random). ``system``: bus, axis and top of `generate`."""
    config = model.config.with_lanes(lanes, lane_type)
    if not out.name:
        raise InputError(f"--out {out}: cannot be replaced; name a new folder")
    with tempfile.TemporaryDirectory() as folder:
        vectors = Path(folder) / "vectors.npz"
        if config.is_image:
            images = (
                random_images(config, 1, 1) if recordings is None else images_of(recordings.subset([number]))
            )
            write_image_vectors(vectors, run_images(model, images).streams, images)
        else:
            length = config.rest_level.rest_frames + config.last_frame + 4 * config.windows.hop
            if recordings is None:
                shown, trace = decided_recordings(model, [length])
            else:
                shown = recordings.subset([number]).scanned(config.sensor.scan_every)
                trace = run(model, shown)
            write_vectors(vectors, trace, shown, [number])
        return generate(config, model.arrays, out, vectors=vectors, **system)
