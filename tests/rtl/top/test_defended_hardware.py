"""Defended designs as they are generated: real recordings with failing taxels in co-simulation, the
testbench, nothing left when off."""

import dataclasses

import numpy as np
import pytest

from eskin.data import load_recordings
from eskin.golden.core import PRESETS, AcceleratorConfig
from eskin.golden.data import Recordings
from eskin.golden.model import random_integer_model, random_recordings, run
from eskin.rtl.fpga.export import export
from eskin.verbs.flow import cosimulate
from eskin.verbs.generate_job import generate_design
from tests.support.generated_bench import flip, make
from tests.support.small_designs import SMALL

DEFENDED = {
    "fault_frames": 64,
    "fault_activity": 30,
    "onset_hits": 3,
    "onset_span": 4,
    "margin_threshold": 10,
}
FLAGGED = SMALL.replace(fault_frames=32, fault_activity=40)
TOUCH = PRESETS["pvdf"].replace(
    window_mode="touch",
    pretrigger_frames=50,
    hop=96,
    window=193,
    touch_frames=1920,
    onset_threshold=8,
    **DEFENDED,
)
"""Windows from before the onset, the last two of which end together: flags through the ring and out of the
sums' memory."""


def failing(recordings: Recordings, config: AcceleratorConfig, seed: int) -> Recordings:
    """One after the other: sound, dead from the start, stuck in the touch, swinging from end to end in the
    touch, two taxels silent."""
    rng, top = np.random.default_rng(seed), config.sample_format.max_code
    samples = recordings.samples.copy()
    for index, (begin, end) in enumerate(zip(recordings.offsets, recordings.offsets[1:], strict=False)):
        taxel, part = int(rng.integers(config.sensor.taxels)), samples[begin:end]
        late = (end - begin) // 2 + int(rng.integers(300))
        kind = index % 5
        if kind == 1:
            part[:, taxel] = part[0, taxel]
        elif kind == 2:
            part[late:, taxel] = top
        elif kind == 3:
            part[late::2, taxel], part[late + 1 :: 2, taxel] = 0, top
        elif kind == 4:
            part[late:, [taxel, taxel - 1]] = part[late, [taxel, taxel - 1]] + rng.integers(
                0, 2, (end - begin - late, 2)
            ) * (taxel % 2)
    return dataclasses.replace(recordings, samples=samples)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_real_recordings_with_failing_taxels(shared_data, tmp_path):
    config = TOUCH
    recordings = load_recordings(shared_data / "pvdf_indent" / "recordings.npz")
    recordings = failing(recordings.subset(recordings.evenly(5)), config, 3)
    model = random_integer_model(config, 4)
    trace = run(model, recordings)
    flagged = trace.touches.flagged > 0
    assert flagged.any(axis=1).tolist() == [False, True, True, True, True] and flagged[4].sum() == 2
    # in the touch
    assert (
        trace.touches.faults[:, 0].any()
        and trace.touches.faults.any(axis=1).sum() > trace.touches.faults[:, 0].sum()
    )
    result = cosimulate(model, recordings, trace=trace, work=tmp_path, stalls=True)
    assert result["mismatch_list"] == [] and result["bit_exact"] and result["passed"]
    assert (
        result["stages"]["fault"]["compared_values"]
        == trace.touches.completed.sum() * config.sensor.taxels
        > 0
    )
    assert result["stages"]["status"]["compared_values"] == 5 * 5  # with TAXEL_FAULTS and its bit of FAULTS


def test_the_generated_bench_compares_the_flags_too(tmp_path):
    model = random_integer_model(FLAGGED.replace(margin_threshold=2), 5)
    made = (random_recordings(model.config, (700,), seed) for seed in range(20))
    recordings = next(one for one in made if 0 < run(model, one).touches.faults.mean() < 1)
    out = generate_design(model, tmp_path / "d", recordings=recordings)

    assert make(out).returncode == 0
    said = flip(out, "fault", 0)
    assert said in make(out).stdout


def test_what_is_off_leaves_nothing_behind():
    """No block, no register, no port of a defence; cells are compared in `eskin stability`'s table."""
    on = random_integer_model(FLAGGED.replace(onset_hits=2, onset_span=2), 1)
    off = random_integer_model(SMALL, 1)
    defended, plain = export(on.config, on.arrays), export(off.config, off.arrays)
    for block in ("fault_detector", "onset_filter"):
        assert block in defended and block not in plain
