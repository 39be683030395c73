"""The order of things: golden trace, generated files, co-simulation. Each step lives in its own package; here they are only called."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cosim import flow
from golden.config import AcceleratorConfig
from golden.errors import InputError
from golden.model import IntegerModel
from golden.pipeline import Trace, run
from golden.recordings import Recordings
from golden.vectors import random_recordings, write_vectors
from rtl.generate import generate

BUILD = Path("build")
"""Everything generated on the way."""


def check_hardware(config: AcceleratorConfig) -> None:
    """Refuse a configuration whose defences only the golden model expresses so far.

    Raises
    ------
    InputError
        A fault detector, or an onset of M of K.
    """
    for field, off in (("fault_frames", 0), ("onset_span", 1)):
        if getattr(config, field) != off:
            raise InputError(f"configuration '{config.name}', field {field}: is {getattr(config, field)}, which the hardware does not have "
                             f"yet; set it to {off} to generate or co-simulate")


def generate_design(
    model: IntegerModel, out: Path, *, lanes: int | None = None, lane_type: str | None = None, recordings: Recordings | None = None,
    seed: int = 1,
) -> Path:  # fmt: skip
    """``eskin generate``: Verilog and its companions; the self-checking testbench plays the first of ``recordings`` (default: random)."""
    config = model.config.with_lanes(lanes, lane_type)
    check_hardware(config)
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
    check_hardware(model.config)
    design = generate(model.config.with_lanes(lanes, lane_type), model.arrays, work / "design")
    vectors = write_vectors(work / "vectors.npz", trace or run(model, recordings), recordings, numbers)
    options = {"builds": BUILD / "simulators", **options}
    if lowest:
        return flow.lowest_clock(design, vectors, work=work, **options)[1]
    return flow.cosim(design, vectors, work=work / "run", **options)
