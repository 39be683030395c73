"""The order of things: golden trace, generated files, co-simulation. Each step lives in its own package; here they are only called."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cosim import flow
from golden.model import IntegerModel
from golden.pipeline import Trace, run
from golden.recordings import Recordings
from golden.vectors import random_recordings, write_vectors
from rtl.generate import generate

BUILD = Path("build")
"""Everything generated on the way."""


def generate_design(
    model: IntegerModel, out: Path, *, lanes: int | None = None, lane_type: str | None = None, recordings: Recordings | None = None,
    seed: int = 1,
) -> Path:  # fmt: skip
    """``eskin generate``: Verilog and its companions; the self-checking testbench plays the first of ``recordings`` (default: random)."""
    config = model.config.with_lanes(lanes, lane_type)
    length = config.rest_frames + config.last_frame + 4 * config.hop
    for attempt in range(seed, seed + 50):
        one = recordings.subset([0]) if recordings is not None else random_recordings(config, [length], attempt)
        trace = run(model, one)
        if recordings is not None or len(trace.streams["decision"][0]):
            break  # a random recording without a decision would check nothing
    vectors = out.with_name(f".{out.name}.vectors.npz")
    try:
        write_vectors(vectors, trace, one)
        return generate(config, model.arrays, out, vectors=vectors)
    finally:
        vectors.unlink(missing_ok=True)


def cosimulate(
    model: IntegerModel,
    recordings: Recordings,
    *,
    numbers: Sequence[int] | None = None,
    trace: Trace | None = None,
    lanes: int | None = None,
    lane_type: str | None = None,
    work: Path = BUILD / "cosim",
    lowest: bool = False,
    **options: Any,
) -> dict[str, Any]:
    """``eskin cosim``: the integer model's trace of ``recordings`` against the generated hardware.

    Parameters
    ----------
    lanes, lane_type:
        Other lanes than the configuration's.
    numbers:
        What each recording is called in messages (its index in the whole data set).
    trace:
        The integer run over exactly these recordings, when it is at hand.
    work:
        Folder for design, vectors and captures.
    lowest:
        Look for the lowest clock that meets every budget, at the declared pace; it is the result's ``clock_hz``.
    options:
        As for cosim.flow.cosim.
    """
    design = generate(model.config.with_lanes(lanes, lane_type), model.arrays, work / "design")
    vectors = write_vectors(work / "vectors.npz", trace or run(model, recordings), recordings, numbers)
    options = {"builds": BUILD / "simulators", **options}
    if lowest:
        return flow.lowest_clock(design, vectors, work=work, **options)[1]
    return flow.cosim(design, vectors, work=work / "run", **options)
