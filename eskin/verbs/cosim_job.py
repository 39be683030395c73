"""Co-simulation of many recordings, `eskin cosim`: parts of them run beside each other, here or on a cluster;
their results are joined."""

import contextlib
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from eskin.cosim.flow import joined
from eskin.golden.core import Record, content_key
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel
from eskin.jobs import Jobs
from eskin.memo import Memo, code_version
from eskin.verbs import flow

CACHE = flow.BUILD / "cosim_parts"
"""Finished parts of a run that was interrupted; gone when all are done."""
PART = {"verilator": 40, "icarus": 8}
"""Recordings of a part. It does not depend on the number of workers, so that the result does not either: a
part loads the design anew. Small enough that no worker waits long for the last part, and far more work than
starting a simulator."""
IN_BULK = 400
"""The same where recordings are played in bulk: one process does that on all cores (`eskin.cosim.bulk`)."""
CODE = partial(code_version, "golden", "rtl", "cosim")
"""Code on which a co-simulation depends beside data and model."""

Piece = tuple[int, int]
"""First recording of a part, and the one after its last."""
Shared = tuple[IntegerModel, Recordings, list[int], int, Record, Path]
"""Model, all recordings, what they are called, how many of them (the first) are played under cocotb, options, the work
folder."""


def one_of_each(labels: np.ndarray) -> list[int]:
    """The first recording of each class: what a run shows under cocotb."""
    return sorted(np.unique(labels, return_index=True)[1].tolist())


def cosimulate(
    model: IntegerModel,
    recordings: Recordings,
    numbers: Sequence[int],
    *,
    work: Path,
    jobs: Jobs,
    simulator: str = "verilator",
    bench: str = "sample",
    cache: Path = CACHE,
    **options: Any,
) -> Record:
    """The result of ``eskin.verbs.flow.cosimulate`` over all recordings, from parts of ``PART`` recordings.

    Parameters
    ----------
    numbers:
        What each recording is called in messages.
    work:
        Folder for the parts' files where workers see it; for the waves of a mismatch always.
    jobs:
        Where the parts are played.
    bench:
        ``cocotb``: all recordings are played under cocotb; ``sample``: one of each class, and the others in bulk where
        that can be (`eskin.cosim.flow.cosim`).
    options:
        As for ``eskin.verbs.flow.cosimulate``, as JSON holds them.
    """
    options = {**options, "simulator": simulator}
    chip = options.get("target") == "asic"  # compiled in minutes under cocotb
    sample = [] if chip else one_of_each(recordings.labels)
    shown = sample if bench == "sample" else [*range(len(numbers))]
    order = [*shown, *sorted({*range(len(numbers))} - {*shown})]
    recordings, numbers = recordings.subset(order), [int(numbers[place]) for place in order]
    config = flow.with_converter(model.config, options.get("converter"), options.get("clock_hz"))
    alone = bench == "cocotb" or config.interface.converter.name != "none"  # in the simulator's process
    alone = alone or bool(options.get("stalls") or (options.get("target") and not chip))
    size = PART[simulator] if alone or simulator != "verilator" else IN_BULK
    content = content_key(CODE(), model, recordings, numbers, len(shown), options)
    parts = [(low, min(low + size, len(numbers))) for low in range(0, len(numbers), size)]
    pieces = {content_key(content, part): part for part in parts}
    keep, folder = Memo(cache), work.resolve() / content[:16]
    if work.is_dir():
        folder.mkdir(exist_ok=True)
    shared = (model, recordings, numbers, len(shown), options, folder)
    results = jobs.results(play, pieces, shared, keep=keep, what="parts co-simulated")
    config = model.config.with_lanes(options.get("lanes"), options.get("lane_type"))
    result = joined(config, list(results.values()))
    differing = next((pieces[key] for key, part in results.items() if part["mismatches"]), None)
    if differing:  # once more, for its waves: those of a worker are not on this machine
        result["waves"] = play(shared, differing, waves=True)["waves"]
    keep.forget(pieces)
    return result


def play(shared: Shared, piece: Piece, *, waves: bool = False) -> Record:
    """The result of one part; in a worker without waves."""
    model, recordings, numbers, shown, options, folder = shared
    places = range(*piece)
    with contextlib.ExitStack() as stack:
        if not folder.is_dir():  # on another machine
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        return flow.cosimulate(
            model,
            recordings.subset(places),
            numbers=[numbers[i] for i in places],
            cocotb=range(shown - piece[0]),
            work=folder / f"from{piece[0]}",
            design=folder / "design",
            waves=waves,
            **options,
        )
