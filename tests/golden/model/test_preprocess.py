"""Windows against a table worked out by hand, the width of their sums, batches, and touches of real recordings."""

import dataclasses
import time

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.data import load_recordings
from eskin.golden.core import PRESETS, signed_bits
from eskin.golden.data import Recordings
from eskin.golden.model import find_touches
from eskin.training.made_up import random_recordings
from tests.support.strategies import configurations
from tests.support.table import each_row

THESIS = PRESETS["thesis"]
REST = 26400  # inside the thesis band, codes
OUT = 27000  # outside it


# ---------------------------------------------------------------- windows of the thesis
IMPULSES = {  # position in the touch -> windows (1-based) that hold it; window k is 307(k-1)+1 .. 307(k-1)+615, the last one ends at 6144
    1: {1},
    307: {1},
    308: {1, 2},
    614: {1, 2},
    615: {1, 2, 3},
    616: {2, 3},
    922: {2, 3, 4},
    6140: {19, 20},
    6141: {19, 20},
    6142: {20},
    6144: {20},
    6145: set(),
}


def test_thesis_windows_hold_an_impulse():
    onset, start, height, taxel, streams = 201, 151, 77, 5, []
    for position in IMPULSES:
        stream = np.full((7000, THESIS.sensor.taxels), REST, dtype=np.int32)
        stream[onset - 1, 3] = OUT
        stream[start + position - 2, taxel] += height  # positions count from 1 at the start frame, frames too
        streams.append(stream)
    touches = find_touches(THESIS, Recordings.of(streams, sample_rate_hz=3000))
    assert set(touches.start_frame) == {start} and set(touches.completed) == {20}
    assert touches.recording.tolist() == [*range(len(IMPULSES))] and not touches.partial.any()
    for sums, windows in zip(touches.sums[..., taxel], IMPULSES.values(), strict=True):
        expected = [(615 if k < 20 else 311) * REST + height * (k in windows) for k in range(1, 21)]
        assert sums.tolist() == expected


@each_row("name, clip", [("thesis", 0), ("pvdf", 0), ("pvdf", 112)])
def test_the_word_of_a_window_sum_holds_a_jump_from_end_to_end_and_a_bit_less_does_not(name, clip):
    config = PRESETS[name].replace(clip=clip)
    ends = [config.sample_format.min_code, config.sample_format.max_code]
    level, taxels = np.repeat(ends, (1000, 6000))[:, None], config.sensor.taxels
    streams = [np.broadcast_to(codes, (7000, taxels)) for codes in (level, sum(ends) - level)]
    peak = np.abs(find_touches(config, Recordings.of(streams, sample_rate_hz=3000)).sums).max()
    assert signed_bits(int(peak)) == config.sum_bits


# ---------------------------------------------------------------- batches
@settings(max_examples=20, deadline=None, derandomize=True)
@given(configurations(), st.integers(0, 1000))
def test_batches_change_nothing_and_are_told(config, seed):
    """The values themselves are held by the hardware's blocks, which compute them in another way."""
    recordings, calls = random_recordings(config, (90, 300, 7, 120), seed), []
    whole = find_touches(config, recordings)
    batched = find_touches(config, recordings, most=400, progress=lambda *call: calls.append(call))
    for field in dataclasses.fields(whole):
        np.testing.assert_array_equal(getattr(batched, field.name), getattr(whole, field.name))
    assert calls[-1] == (4, 4) and len(calls) > 1


# ---------------------------------------------------------------- real recordings
def test_every_indentation_is_detected_where_an_offline_detector_sees_it(shared_data):
    """Offline: median of the first 400 frames as rest, first 64-frame mean beyond 12 codes; the recordings'
    own documentation."""
    config = PRESETS["pvdf"]
    recordings = load_recordings(shared_data / "pvdf_indent" / "recordings.npz", config=config)
    begun = time.process_time()
    touches = find_touches(config, recordings)
    assert time.process_time() - begun < 20
    first = touches.first_touch()
    assert len(first) == 318
    assert (first >= 0).all()
    assert (touches.completed[first] == 20).all()
    assert not touches.partial[first].any()
    lag = []
    for index, onset in enumerate(touches.onset_frame[first]):
        stream = recordings.recording(index)
        total = np.cumsum(stream - np.median(stream[:400], axis=0), axis=0)
        beyond = (np.abs(total[64:] - total[:-64]) > 64 * 12).any(axis=1)
        lag.append(onset - (np.argmax(beyond) + 65))
    lag = np.array(lag)
    assert np.quantile(np.abs(lag), 0.98) <= 18 and lag.min() >= -4 and lag.max() <= 100  # frames of 0.5 ms
