"""Sequences of calls across golden, rtl and cosim: what the verbs that need all three do. The only place that imports all of them."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cosim import flow
from golden import pipeline
from golden.model import IntegerModel
from golden.recordings import Recordings, check_fit
from golden.vectors import random_recordings, write_vectors
from rtl import generate as generator

BUILD = Path("build")
"""Where simulators and the work of co-simulations are kept."""

Progress = Callable[[str, int, int], None]
"""Called with (what, done, in all)."""


def load_integer(model: str | Path, lanes: int | None = None) -> IntegerModel:
    """The integer model of a folder, with another number of lanes if one is given."""
    loaded = IntegerModel.load(model)
    return loaded if lanes is None else IntegerModel(loaded.config.replace(lanes=lanes), loaded.arrays, loaded.source)


def generate(model: IntegerModel, out: Path, recordings: Recordings | None = None) -> Path:
    """The generated folder, with the self-checking testbench of one recording: the first, or a made-up one without recordings."""
    if recordings is None:
        config = model.config
        length = config.rest_frames + config.pretrigger_frames + 3 * (config.last_frame + config.hop)
        one = random_recordings(config, [length], seed=1)
    else:
        check_fit(recordings, model.config)
        one = recordings.subset([0])
    with tempfile.TemporaryDirectory() as work:
        vectors = write_vectors(Path(work) / "vectors.npz", pipeline.run(model, one), one)
        return generator.generate(model.config, model.arrays, out, vectors=vectors)


def cosimulate(model: IntegerModel, recordings: Recordings, numbers: np.ndarray, *, progress: Progress, **options: Any) -> dict[str, Any]:
    """Co-simulate the recordings ``numbers`` against the golden model; ``options`` as for cosim.flow.cosim. The CONTRACT's result.

    The work folder is kept only after a mismatch, because its waves are in it.
    """
    check_fit(recordings, model.config)
    chosen = recordings.subset(numbers)
    trace = pipeline.run(model, chosen, progress=lambda done, total: progress("golden model", done, total))
    (BUILD / "cosim").mkdir(parents=True, exist_ok=True)
    work = Path(tempfile.mkdtemp(prefix="run.", dir=BUILD / "cosim"))
    keep = False
    try:
        design = generator.generate(model.config, model.arrays, work / "design")
        vectors = write_vectors(work / "vectors.npz", trace, chosen, numbers)
        result = flow.cosim(
            design, vectors, work=work, builds=BUILD / "simulators",
            progress=lambda done, total: progress("simulated frames", done, total), **options,
        )  # fmt: skip
        keep = result["waves"] is not None
        return result
    finally:
        if not keep:
            shutil.rmtree(work, ignore_errors=True)
