"""rtl/frontend/window_averager.py: exact sums of overlapping windows, against sums taken straight over the
frames."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.golden.core.config import PRESETS, AcceleratorConfig
from eskin.rtl.frontend.window_averager import WindowAverager
from tests.support.front_end_cases import (
    BAND,
    BASE,
    CASES,
    TOUCH,
    detect,
    make_stream,
    sum_beats,
    window_beats,
)
from tests.support.stream_bench import Bench, beats_after_reset, values
from tests.support.table import each_row


def run(config, beats, *, stalls=(0.0, 0.0), seed=0):
    dut = WindowAverager(config)
    bench = Bench(dut, seed=seed)
    taken = bench.drive(dut.i, beats, stall=stalls[0])
    out = bench.collect(dut.o, stall=stalls[1])
    bench.run()
    return out, taken


WINDOWS = (
    "thesis 6 taxels",
    "two end together, faults",
    "three end together",
    "even windows together",
    "short first window",
    "immediate touch, faults",
    "band initial",
    "pvdf faults",
    "fabric",
)
"""One case for each way in which windows lie, in touches and in running hops; the onset rules before them
make no difference here."""


@pytest.mark.parametrize("name", WINDOWS)
def test_sums_of_every_window(name):
    config = CASES[name]
    seen = detect(config, make_stream(config, 250, seed=11))
    expected = sum_beats(config, seen)
    assert len(expected) >= config.sensor.taxels * config.windows.steps
    out, _ = run(config, window_beats(config, seen), stalls=(0.3, 0.5), seed=3)
    assert values(out) == expected


@pytest.mark.parametrize("taxels", [1, 2, 3])
@pytest.mark.parametrize("name", ["three end together", "fabric"])
def test_arrays_of_few_taxels(name, taxels):
    """A sum is read again one, two or three beats after it was changed: beats come as fast as they may."""
    config = CASES[name].replace(taxels=taxels, masked_taxels=())
    seen = detect(config, make_stream(config, 250, seed=11))
    expected = sum_beats(config, seen)
    assert len(expected) >= taxels * config.windows.steps
    out, _ = run(config, window_beats(config, seen))
    assert values(out) == expected


def one_touch(config, frames):
    """A touch from frame 1 on with the given deviations (frames, taxels)."""
    return SimpleNamespace(values=frames, touches=[(0, 1, config.last_frame)])


def thesis_of(steps, touch_frames=6144, **changes):
    hop = touch_frames // steps
    return AcceleratorConfig.of(
        **(
            BASE
            | BAND
            | TOUCH
            | dict(hop=hop, window=2 * hop + 1, steps=steps, touch_frames=touch_frames)
            | changes
        )
    )


@pytest.mark.parametrize(("steps", "touch_frames"), [(1, 131), (7, 128), (64, 131)])
def test_any_number_of_windows(steps, touch_frames):
    config = thesis_of(steps, touch_frames)
    rng = np.random.default_rng(steps)
    seen = one_touch(config, rng.integers(-4095, 4096, (config.last_frame, 4)))
    out, _ = run(config, window_beats(config, seen), stalls=(0.0, 0.2))
    assert values(out) == sum_beats(config, seen) and len(out) == 4 * steps


@settings(max_examples=25, deadline=None, derandomize=True)
@given(
    hop=st.integers(1, 9),
    odd=st.booleans(),
    steps=st.integers(1, 8),
    extra=st.integers(0, 20),
    seed=st.integers(0, 1 << 30),
)
def test_any_touch_window(hop, odd, steps, extra, seed):
    """Every way in which windows can be clipped or end together, two touches in a row."""
    frames = max(2, hop * (steps - 1) + 1 + extra)
    config = AcceleratorConfig.of(
        **(
            BASE
            | BAND
            | TOUCH
            | dict(pretrigger_frames=0, hop=hop, window=2 * hop + odd, steps=steps, touch_frames=frames)
        )
    )
    rng = np.random.default_rng(seed)
    last = config.last_frame
    seen = SimpleNamespace(
        values=rng.integers(-4095, 4096, (2 * last, 4)), touches=[(0, 1, last), (0, last + 1, 2 * last)]
    )
    out, _ = run(config, window_beats(config, seen), stalls=(0.2, 0.2), seed=seed)
    assert values(out) == sum_beats(config, seen)


def test_extreme_sums_do_not_overflow():
    for sign in (-1, 1):
        config = thesis_of(6, 60)
        seen = one_touch(config, np.full((config.last_frame, 4), sign * config.deviation_bound))
        out, _ = run(config, window_beats(config, seen))
        assert values(out) == sum_beats(config, seen)


@each_row("name", ["two end together", "three end together", "even windows together", "short first window"])
def test_latency_and_full_rate(name):
    """A cycle a beat and one for each hop that a window is made of besides the last; the passes of further
    windows that end together take the same."""
    config = CASES[name]
    last, taxels, hop = config.last_frame, config.sensor.taxels, config.windows.hop
    seen = SimpleNamespace(
        values=np.random.default_rng(1).integers(-9, 9, (2 * last, taxels)),
        touches=[(0, 1, last), (0, last + 1, 2 * last)],
    )
    out, taken = run(config, window_beats(config, seen))
    assert values(out) == sum_beats(config, seen)
    cycle, beats, sums = 0, [], []
    for frame in list(range(1, last + 1)) * 2:
        costs = [1 + (frame - 1) // hop - k for k, (_, end) in enumerate(config.window_spans) if end == frame]
        for number, cost in enumerate(costs or [1]):
            for _ in range(taxels):
                cycle += cost
                beats += [cycle - 1] * (number == 0)
                sums += [cycle] * bool(costs)
    assert taken == beats
    assert [beat.cycle for beat in out] == sums


@pytest.mark.parametrize(("name", "cut"), [("three end together", 90), ("pvdf", 90)])
def test_a_reset_begins_anew(name, cut):
    config = CASES[name]
    first, second = (detect(config, make_stream(config, 200, seed=seed)) for seed in (11, 12))
    whole = window_beats(config, first)
    cut_beats = whole[: min(cut * config.sensor.taxels, len(whole)) - 2]
    assert values(
        beats_after_reset(WindowAverager(config), cut_beats, window_beats(config, second))
    ) == sum_beats(config, second)


IMPULSES = (1, 307, 308, 614, 615, 616, 922, 6140, 6141, 6144)


@pytest.mark.slow
@pytest.mark.parametrize("steps", [20, 256])
def test_thesis_impulses(steps):
    """The exact constants of the thesis on four taxels: each impulse frame shows in its windows and in no
    other."""
    config = PRESETS["thesis"].replace(
        taxels=4, hop=6144 // steps, window=2 * (6144 // steps) + 1, steps=steps
    )
    frames = np.zeros((6144, 4), dtype=np.int64)
    for number, frame in enumerate(IMPULSES):
        frames[frame - 1] = [1 << number, 3 << number, -(1 << number), 26400]
    seen = one_touch(config, frames)
    out, _ = run(config, window_beats(config, seen))
    assert values(out) == sum_beats(config, seen) and len(out) == 4 * steps
    if steps == 20:
        sums = [~out[4 * k].value["complement"] for k in range(20)]
        windows = {
            frame: {k + 1 for k in range(20) if sums[k] >> number & 1}
            for number, frame in enumerate(IMPULSES)
        }
        assert windows == {
            1: {1},
            307: {1},
            308: {1, 2},
            614: {1, 2},
            615: {1, 2, 3},
            616: {2, 3},
            922: {2, 3, 4},
            6140: {19, 20},
            6141: {19, 20},
            6144: {20},
        }
