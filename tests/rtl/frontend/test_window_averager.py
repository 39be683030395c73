"""rtl/frontend/window_averager.py: exact sums of overlapping windows, against sums taken straight over the
frames."""

from types import SimpleNamespace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.frontend.window_averager import WindowAverager
from tests.support.front_end_cases import (
    BAND,
    BASE,
    CASES,
    FREE,
    TOUCH,
    TRACKED,
    detect,
    make_stream,
    sum_beats,
    window_beats,
)
from tests.support.strategies import examples
from tests.support.stream_bench import play, values
from tests.support.table import each_row


def sums_are_exact(config, seen, **pace):
    """What `play` gives."""
    played = play(WindowAverager(config), window_beats(config, seen), **pace)
    assert values(played[0]) == sum_beats(config, seen)
    return played


@examples(25, 500)
@given(
    taxels=st.sampled_from([4, 1, 2, 3]),
    hop=st.integers(1, 9),
    odd=st.booleans(),
    steps=st.integers(1, 8),
    extra=st.integers(0, 20),
    clip=st.integers(1, 4095),
    seed=st.integers(0, 1 << 30),
)
def test_any_touch_window(taxels, hop, odd, steps, extra, clip, seed):
    """Every way in which windows can be clipped or end together, two touches in a row, the first of the
    largest deviations of any clip; of few taxels a sum is read again as soon as it was changed. Masks stay
    with their taxels."""
    frames = max(2, hop * (steps - 1) + 1 + extra)
    windows = dict(hop=hop, window=2 * hop + odd, steps=steps, touch_frames=frames)
    sizes = dict(taxels=taxels, clip=clip, pretrigger_frames=0, fault_frames=2 * (seed % 2), **windows)
    config = AcceleratorConfig.of(**(BASE | BAND | TOUCH | sizes))
    rng, last, bound = np.random.default_rng(seed), config.last_frame, config.deviation_bound
    deviations = rng.integers(-bound, bound + 1, (2 * last, taxels))
    deviations[:last] = rng.choice([-bound, bound])
    touches, masked = [(0, 1, last), (0, last + 1, 2 * last)], rng.integers(0, 2, (2 * last, taxels))
    seen = SimpleNamespace(values=deviations, touches=touches, masked=masked)
    sums_are_exact(config, seen, stalls=(0.2 * (seed % 2), 0.2 * (seed % 3 > 0)), seed=seed)


@examples(15, 300)
@given(
    taxels=st.sampled_from([4, 1, 2, 3]),
    hop=st.integers(1, 9),
    steps=st.integers(1, 8),
    clip=st.integers(1, 4095),
    seed=st.integers(0, 1 << 30),
)
def test_any_free_window(taxels, hop, steps, clip, seed):
    sizes = dict(taxels=taxels, clip=clip, hop=hop, window=2 * hop, steps=steps)
    config = AcceleratorConfig.of(**(BASE | TRACKED | FREE | sizes))
    seen, bound = detect(config, make_stream(config, 120, seed=seed)), config.deviation_bound
    seen.values[:] = np.random.default_rng(seed).choice([-bound, 0, bound], seen.values.shape)
    sums_are_exact(config, seen, stalls=(0.2 * (seed % 2), 0.2 * (seed % 3 > 0)), seed=seed)


@each_row("name", ["three end together", "short first window"])
def test_latency_and_full_rate(name):
    """A cycle a beat and one for each hop that a window is made of besides the last; the passes of further
    windows that end together take the same."""
    config = CASES[name]
    last, taxels, hop = config.last_frame, config.sensor.taxels, config.windows.hop
    seen = SimpleNamespace(
        values=np.random.default_rng(1).integers(-9, 9, (2 * last, taxels)),
        touches=[(0, 1, last), (0, last + 1, 2 * last)],
    )
    out, accepted = sums_are_exact(config, seen)
    cycle, beats, sums = 0, [], []
    for frame in list(range(1, last + 1)) * 2:
        costs = [1 + (frame - 1) // hop - k for k, (_, end) in enumerate(config.window_spans) if end == frame]
        for number, cost in enumerate(costs or [1]):
            for _ in range(taxels):
                cycle += cost
                beats += [cycle - 1] * (number == 0)
                sums += [cycle] * bool(costs)
    assert accepted == beats
    assert [beat.cycle for beat in out] == sums
