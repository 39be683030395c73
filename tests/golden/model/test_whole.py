"""Windows that follow the touch: the specification's example, a store worked frame by frame, the stream."""

import dataclasses

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from eskin.choose.first_touches import cut_windows, first_touches
from eskin.golden.core import FEATURE_KINDS, AcceleratorConfig
from eskin.golden.data import Recordings
from eskin.golden.model import Stream, find_touches, run
from eskin.golden.model.preprocess import companded
from eskin.training.made_up import random_recordings
from tests.golden.model.test_stream import check_same, whole_recordings
from tests.support.random_models import random_integer_model
from tests.support.strategies import configurations, examples
from tests.support.table import each_row, refused

EXAMPLE = AcceleratorConfig.of(
    taxels=1,
    sample_rate_hz=1000.0,
    onset="band",
    band_low=0,
    band_high=10,
    rearm_frames=4,
    window_mode="whole",
    touch_frames=64,
    hop=2,
    window=4,
    steps=2,
    store_per_window=2,
)
FRAMES = [0, 0, 12, 12, 15, 18, 21, 24, 21, 18, 15, 12, 11, 5, 2, 1, 0]


def found(frames, **changes):
    """The touches of a recording of EXAMPLE."""
    stream = np.array(frames, dtype=np.int32)[:, None]
    return find_touches(EXAMPLE.replace(**changes), Recordings.of([stream], sample_rate_hz=1000))


@each_row(
    "frames, changes, sums, lengths, ended, cut, partial",
    [
        (FRAMES, {}, [33, 54], [0, 1], 17, False, False),
        (FRAMES[:6], {}, [27, 27], [0, 0], 6, True, False),
        # the longest touch: six frames are three sums of hop 2
        (FRAMES, {"touch_frames": 6}, [27, 84], [0, 1], 9, False, True),
        # quiet from its first frame on: its first sum counts
        ([*FRAMES[:3], 4, 3, 2, 1], {}, [7, 7], [0, 0], 7, False, False),
    ],
)
def test_the_example_of_the_specification_and_its_other_ends(
    frames, changes, sums, lengths, ended, cut, partial
):
    touches = found(frames, **changes)
    assert touches.sums[0, :, 0].tolist() == sums and touches.lengths[0].tolist() == lengths
    assert touches.ended[0] == ended and touches.cut[0] == cut and touches.partial[0] == partial
    assert touches.completed[0] == 2 and len(touches) == 1


def test_a_touch_without_a_whole_sum_has_no_window():
    touches = found(FRAMES[:4])
    assert touches.completed.tolist() == [0] and touches.cut.tolist() == [True]


def stored(config, deviations):
    """(sums, doublings) of a store of ``config`` that takes the deviations (frames) of a touch one by one."""
    hop, sums, under_way, frames, doublings = config.windows.hop, [], 0, 0, 0
    for deviation in deviations:
        under_way, frames = under_way + deviation, frames + 1
        if frames == hop << doublings:
            sums, under_way, frames = [*sums, under_way], 0, 0
        if len(sums) == config.windows.steps * config.windows.store_per_window:
            sums = [first + second for first, second in zip(sums[::2], sums[1::2], strict=True)]
            doublings += 1
    return sums, doublings


def frame_by_frame(config, deviations, quiet_at_end):
    """(values (K), counts (K)) of means of one taxel."""
    sums, doublings = stored(config, deviations)
    hop, steps = config.windows.hop << doublings, config.windows.steps
    loud = len(deviations) - quiet_at_end
    count = min(max(-(-loud // hop), 1), len(sums))
    parts = [sums[k * count // steps : (k + 1) * count // steps] for k in range(steps)]
    if count < steps:
        parts = [[sums[min(k, count - 1)]] for k in range(steps)]
    return [sum(part) >> doublings for part in parts], [len(part) for part in parts]


@examples(80, 5000)
@given(
    steps=st.integers(1, 6),
    store=st.sampled_from([2, 4, 6, 8]),
    hop=st.integers(1, 5),
    loud=st.integers(0, 400),
    quiet=st.integers(5, 30),
    seed=st.integers(0, 1000),
)
def test_the_windows_are_those_of_a_store_that_doubles(steps, store, hop, loud, quiet, seed):
    rng = np.random.default_rng(seed)
    frames = [0, 11, *rng.integers(11, 400, loud), *rng.integers(0, 11, quiet)]
    touches = found(
        frames,
        steps=steps,
        store_per_window=store,
        hop=hop,
        window=2 * hop,
        touch_frames=500,
        rearm_frames=quiet,
    )
    config = EXAMPLE.replace(
        steps=steps, store_per_window=store, hop=hop, window=2 * hop, touch_frames=500, rearm_frames=quiet
    )
    values, counts = frame_by_frame(config, [int(frame) for frame in frames[2:]], quiet)
    assert touches.sums[0, :, 0].tolist() == values and (touches.lengths[0] + 1).tolist() == counts
    assert np.abs(values).max() < 1 << config.sum_bits - 1


def test_all_kinds_of_a_touch_that_doubled_once():
    """h = 4, three sums; the blocks of an activity have two frames, and what goes back to the touch's
    first frame is not shifted."""
    touches = found(FRAMES, feature_kinds=FEATURE_KINDS, activity_block=2, integral_knee=2)
    blocks = np.abs(np.diff([27, 27, 39, 45, 33, 23, 7]))
    total = companded(np.array([66, 174]), 2, 8)
    of_sum = found(FRAMES, feature_kinds=("mean", "activity"), activity_block=2)
    assert of_sum.sums[0].tolist() == [[33, 33], [54, 54]]  # every block is above 0
    extremes = [[21, 12], [24, 2]]  # of the first sum, and of all three
    assert touches.sums[0].tolist() == [[33, 33, total[0], *extremes[0]], [54, 54, total[1], *extremes[1]]]
    change = found(FRAMES, feature_kinds=("activity",), activity_block=2, activity_rule="change")
    assert change.sums[0, :, 0].tolist() == [blocks[:2].sum() // 2, blocks[2:6].sum() // 2]


def whole(config):
    """``config`` with windows that follow the touch, or None where it cannot have them."""
    window, steps = config.windows, config.windows.steps
    return config.replace(
        window_mode="whole",
        window=2 * window.hop,
        store_per_window=2 * (1 + steps % 3),
        touch_frames=window.hop * steps * (5 + steps),
        feature_shift=(),
        activity_block=1,
        rearm_frames=max(config.onset_rule.rearm_frames, window.hop),
        decision="vote" if config.network.decision == "vote" else "last",
    )


@examples(12, 1000)
@given(config=configurations().map(whole), seed=st.integers(0, 1000))
def test_a_stream_and_batches_and_cut_windows_give_the_same(config, seed):
    recordings, model = whole_recordings(config, seed), random_integer_model(config, seed)
    trace = run(model, recordings)
    check_same(
        Stream(model, scanned=True) if config.sensor.scan_every == 1 else Stream(model),
        trace,
        recordings,
        seed,
    )
    touches = trace.touches
    batched = find_touches(config, recordings, most=400)
    for field in dataclasses.fields(touches):
        np.testing.assert_array_equal(getattr(batched, field.name), getattr(touches, field.name))
    first = touches.first_touch()
    own, cut = touches.take(first[first >= 0]), cut_windows(config, first_touches(config, recordings))
    for name in ("sums", "lengths", "completed", "partial", "ended", "cut", "onset_frame", "start_frame"):
        np.testing.assert_array_equal(getattr(cut, name), getattr(own, name))


@each_row(
    "changes, match",
    [
        (
            {"steps": 3, "store_per_window": 3},
            "store_per_window: is 3 with 3 steps; .* make one of them even",
        ),
        ({"touch_frames": 3}, "touch_frames: is 3; the longest touch takes at least 2 hops of 2"),
        ({"window": 5}, "window: is 5; with window_mode 'whole' it is 2 hop = 4"),
        ({"store_per_window": 9}, "store_per_window"),
        (
            {"rearm_frames": 1},
            "rearm_frames: is 1; with window_mode 'whole' it is at least one hop, 2 frames",
        ),
        ({"decision": "early"}, "decision: is 'early' with window_mode 'whole'"),
    ],
)
def test_what_cannot_work_is_refused(changes, match):
    with refused(match):
        EXAMPLE.replace(**changes)


def test_recordings_of_every_end_are_among_those_of_random_designs():
    config = EXAMPLE.replace(taxels=4, sample_bits=10, band_low=300, band_high=700, hop=3, window=6)
    touches = find_touches(config, random_recordings(config, (900, 700, 400, 60, 30), 5))
    assert touches.partial.any() and touches.cut.any() and (~touches.partial & ~touches.cut).any()
