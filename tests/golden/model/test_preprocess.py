"""Onset, windows and normaliser against tables worked out by hand and a frame-by-frame reading of the
specification."""

import dataclasses
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import eskin.golden.model.preprocess as preprocess
from eskin.data import load_recordings
from eskin.golden.core import PRESETS, AcceleratorConfig, QFormat, signed_bits
from eskin.golden.data import Recordings
from eskin.golden.model import find_touches, normalise
from tests.support.front_end_cases import detect
from tests.support.strategies import configurations

THESIS = PRESETS["thesis"]
REST = 26400  # inside the thesis band, codes
OUT = 27000  # outside it


def recordings_of(config: AcceleratorConfig, *streams: np.ndarray) -> Recordings:
    """The streams (frames, taxels) as a set of recordings, all of class 0."""
    return Recordings(
        samples=np.concatenate([np.asarray(stream, dtype=np.int32) for stream in streams]),
        offsets=np.cumsum([0, *(len(stream) for stream in streams)]),
        labels=np.zeros(len(streams), dtype=np.int64),
        class_names=config.network.class_names,
        sample_rate_hz=config.sensor.sample_rate_hz,
    )


def quiet_stream(frames: int, config: AcceleratorConfig = THESIS, level: int = REST) -> np.ndarray:
    return np.full((frames, config.sensor.taxels), level, dtype=np.int32)


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
        stream = quiet_stream(7000)
        stream[onset - 1, 3] = OUT
        stream[start + position - 2, taxel] += height  # positions count from 1 at the start frame, frames too
        streams.append(stream)
    touches = find_touches(THESIS, recordings_of(THESIS, *streams))
    assert set(touches.start_frame) == {start} and set(touches.completed) == {20}
    assert touches.recording.tolist() == [*range(len(IMPULSES))] and not touches.partial.any()
    for sums, windows in zip(touches.sums[..., taxel], IMPULSES.values(), strict=True):
        expected = [(615 if k < 20 else 311) * REST + height * (k in windows) for k in range(1, 21)]
        assert sums.tolist() == expected


@pytest.mark.parametrize("name", ["thesis", "pvdf"])
@pytest.mark.parametrize("clip", [0, 112])
def test_the_word_of_a_window_sum_holds_a_jump_from_end_to_end_and_a_bit_less_does_not(name, clip):
    config = PRESETS[name].replace(clip=clip if name == "pvdf" else 0)
    ends = [config.sample_format.min_code, config.sample_format.max_code]
    level, taxels = np.repeat(ends, (1000, 8000))[:, None], config.sensor.taxels
    streams = [np.broadcast_to(codes, (9000, taxels)) for codes in (level, sum(ends) - level)]
    peak = np.abs(find_touches(config, recordings_of(config, *streams)).sums).max()
    assert signed_bits(int(peak)) == config.sum_bits


# ---------------------------------------------------------------- the specification, frame by frame
def expected_touches(config: AcceleratorConfig, stream: np.ndarray) -> tuple[list[tuple], list[int]]:
    """(f, start, completed, partial, sums, faults) of each touch, and the frame that raised each taxel's
    fault flag."""
    seen, result = detect(config, stream), []
    for f, s, e in seen.touches:
        ends = [s - 1 + last for _, last in config.window_spans]
        whole = [end <= len(stream) for end in ends]
        sums = [
            seen.values[s + first - 2 : end].sum(axis=0).tolist() if full else [0] * config.sensor.taxels
            for (first, _), end, full in zip(config.window_spans, ends, whole, strict=True)
        ]
        faults = [[0 < frame <= end for frame in seen.flagged] for end in ends]
        result.append((f, s, sum(whole), len(stream) < e, sums, faults))
    return result, seen.flagged


def plateaus(config: AcceleratorConfig, seed: int) -> list[np.ndarray]:
    """Streams that make a drawn configuration work: plateaus, glitches and noise, in steps of about what its
    onset rule looks for."""
    rng, taxels, fmt = np.random.default_rng(seed), config.sensor.taxels, config.sample_format
    unit = max((fmt.max_code - fmt.min_code) // 63, 1)
    streams = []
    for frames in (int(rng.integers(1, 40)), 260 + seed % 4):
        walk = rng.integers(26, 39, taxels) + np.cumsum(rng.integers(-1, 2, (frames, taxels)), axis=0) * (
            rng.random() < 0.3
        )
        for _ in range(rng.integers(1, 8)):
            begin, length = rng.integers(0, frames), rng.choice([1, 2, 10, 30])
            walk[begin : begin + length, rng.integers(0, taxels)] += rng.integers(-40, 41)
        walk = unit * np.clip(walk + rng.integers(-2, 3, walk.shape), 0, 63) + rng.integers(0, unit)
        streams.append(np.clip(walk + fmt.min_code, fmt.min_code, fmt.max_code))
    return streams


@settings(max_examples=80, deadline=None, derandomize=True)
@given(configurations(), st.integers(0, 2**32 - 1), st.sampled_from([400, preprocess.BATCH_SAMPLES]))
def test_equal_to_the_specification_frame_by_frame(config, seed, batch):
    """Whatever the batches."""
    config = config.replace(feature_kinds=("mean",), feature_shift=(), scan_every=1)
    streams, calls = [*plateaus(config, seed), *plateaus(config, seed + 1)], []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(preprocess, "BATCH_SAMPLES", batch)
        touches = find_touches(
            config, recordings_of(config, *streams), progress=lambda *call: calls.append(call)
        )
    assert calls[-1] == (4, 4) and len(calls) == (4 if batch == 400 else 1)
    literal = [expected_touches(config, stream) for stream in streams]
    expected = [(index, *touch) for index, (of_stream, _) in enumerate(literal) for touch in of_stream]
    flags = [flagged for _, flagged in literal]
    if not config.faults.fault_frames:
        assert touches.faults is None and touches.flagged is None
        empty = np.zeros(touches.sums.shape, dtype=bool)
        touches = dataclasses.replace(touches, faults=empty, flagged=np.array(flags))
    fields = ("recording", "onset_frame", "start_frame", "completed", "partial", "sums", "faults")
    columns = (getattr(touches, field).tolist() for field in fields)
    assert list(zip(*columns, strict=True)) == expected and touches.flagged.tolist() == flags


# ---------------------------------------------------------------- normaliser


@settings(max_examples=100, deadline=None, derandomize=True)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(0, 12),
    st.integers(0, 12),
    st.sampled_from([QFormat(4, 8), QFormat(4, 4), QFormat(2, 8)]),
)
def test_normaliser_is_the_formula(seed, shift_long, shift_last, feature_format):
    config = THESIS.replace(
        feature_shift=(shift_long, shift_last), feature_format=feature_format, masked_taxels=(0, 9)
    )
    rng = np.random.default_rng(seed)
    sums = rng.integers(-(1 << 25), 1 << 25, (3, 20, 16)) >> rng.integers(0, 20, (3, 20, 1))
    mean, scale = rng.integers(-(1 << 24), 1 << 24, 2) >> rng.integers(0, 24), rng.integers(1, 1 << 15, 2)
    completed, faults = np.array([20, 0, 7]), rng.random(sums.shape) < 0.1
    codes = normalise(config, sums, completed, mean, scale, faults)
    assert codes.dtype == np.int64
    low, high = feature_format.min_code, feature_format.max_code
    for touch in range(3):
        for k in range(20):
            q = 0 if k < 19 else 1
            shift = (shift_long, shift_last)[q]
            for taxel in range(16):
                centred = max(-32768, min(32767, (int(sums[touch, k, taxel]) - int(mean[q])) // (1 << shift)))
                # gate_frac 13, half up
                feature = max(low, min(high, (centred * int(scale[q]) + (1 << 12)) // (1 << 13)))
                if taxel in (0, 9) or k >= completed[touch] or faults[touch, k, taxel]:
                    feature = 0
                assert codes[touch, k, taxel] == feature


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
