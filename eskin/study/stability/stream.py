"""Failure modes of the stream: touches that come late, twice or not at all, glitches, drift, frames lost,
clocks."""

from collections.abc import Sequence

import numpy as np

from eskin.golden.core import AcceleratorConfig
from eskin.golden.data import Recordings
from eskin.golden.model import Touches
from eskin.study.leak import Leak, known_without_touch
from eskin.study.stability.core import Bench, Case, Change, Curve, Outcome, Scene, rebuilt
from eskin.study.stability.shapes import lead_ins

LEFT_IN = (0.0, 0.05, 0.1, 0.25, 0.5, 1.0)


# ---------------------------------------------------------------------- disturbances of whole streams
def drift(bench: Scene, level: float, taxels: Sequence[int]) -> Change:
    """All taxels ramp by ``level`` standard deviations of the features during a touch."""

    def ramp(stream, onset, rng):
        slope = level * bench.sigma / bench.config.last_frame
        return stream + (slope * np.arange(len(stream))[:, None]).astype(np.float32)

    return ramp


def hum(bench: Scene, level: float, taxels: Sequence[int]) -> Change:
    """50 Hz on all taxels, at ``level`` times the amplitude of the noise at rest."""

    def add(stream, onset, rng):
        phase = 2 * np.pi * 50 / bench.config.sensor.scan_rate_hz * np.arange(len(stream)) + rng.uniform(
            0, 2 * np.pi
        )
        return stream + (level * bench.rest_noise * np.sin(phase)[:, None]).astype(np.float32)

    return add


def frames_lost(bench: Scene, level: float, taxels: Sequence[int]) -> Change:
    """A share of the frames is missing, at random; the stream closes up."""
    return lambda stream, onset, rng: stream[rng.random(len(stream)) >= level]


def frames_repeated(bench: Scene, level: float, taxels: Sequence[int]) -> Change:
    """A share of the frames comes twice, at random."""
    return lambda stream, onset, rng: np.repeat(stream, 1 + (rng.random(len(stream)) < level), axis=0)


def gap(bench: Scene, level: float, taxels: Sequence[int]) -> Change:
    """A share of a touch's frames is missing in one piece, at a random place in the touch."""

    def cut(stream, onset, rng):
        length = round(level * bench.config.last_frame)
        begin = onset + int(rng.integers(0, bench.config.last_frame))
        return np.concatenate([stream[:begin], stream[begin + length :]])

    return cut


def rate_off(bench: Scene, level: float, taxels: Sequence[int]) -> Change:
    """Sampled too slowly by the share ``level``; negative: too fast."""
    return lambda stream, onset, rng: _resampled(stream, 1 + level)


def _resampled(stream: np.ndarray, factor: float) -> np.ndarray:
    position = np.arange(0, len(stream) - 1, factor)
    lower = position.astype(np.int64)
    part = (position - lower).astype(np.float32)[:, None]
    return stream[lower] * (1 - part) + stream[np.minimum(lower + 1, len(stream) - 1)] * part


def cut_short(bench: Scene, share: float, taxels: Sequence[int]) -> Recordings:
    """Streams that end after a share of the touch's steps."""
    clean, touches = bench.clean, bench.touches
    ends = clean.lengths.copy()
    steps = max(1, round(share * bench.config.windows.steps))
    last = touches.start_frame - 1 + bench.config.window_spans[steps - 1][1]
    ends[touches.recording] = np.minimum(last, ends[touches.recording])
    return rebuilt(clean, [clean.recording(i)[:end] for i, end in enumerate(ends)])


def without_lead(bench: Scene, quiet: float, taxels: Sequence[int]) -> Change:
    """Streams that begin ``quiet`` frames before the onset."""
    return lambda stream, onset, rng: stream[max(onset - 1 - int(quiet), 0) :]


def overlapped(bench: Scene, share: float, taxels: Sequence[int]) -> Recordings:
    """The movement of a recording of another class added after a share of the touch."""
    clean, onsets, labels = bench.clean, bench.onsets, bench.clean.labels
    streams = []
    for i, stream in enumerate(clean.recording(i).astype(np.float32) for i in range(len(clean))):
        partner = next((int(j) for j in np.roll(np.arange(len(clean)), -i) if labels[j] != labels[i]), i)
        begin = int(onsets[i]) + round(share * bench.config.last_frame)
        neighbour = clean.recording(partner).astype(np.float32)
        neighbour = neighbour[max(int(onsets[partner]) - bench.config.onset_rule.onset_mean_frames, 1) - 1 :]
        length = min(max(len(stream) - begin, 0), len(neighbour))
        stream[begin : begin + length] += neighbour[:length] - neighbour[0]
        streams.append(stream)
    return rebuilt(clean, streams)


# ---------------------------------------------------------------------- disturbances of quiet stretches
def _amplified(stream: np.ndarray, gain: float, config: AcceleratorConfig) -> np.ndarray:
    level = stream[: max(config.rest_level.rest_frames, 1)].mean(axis=0)
    return np.asarray(level + gain * (stream - level), dtype=np.float32)


def louder(bench: Scene, gain: float, taxels: Sequence[int]) -> Change:
    """Noise and bursts, multiplied by ``gain``."""
    return lambda stream, place, rng: _amplified(stream, gain, bench.config)


def glitch(bench: Scene, height: float, taxels: Sequence[int]) -> Change:
    """One sample of one taxel off by ``height`` codes; up in one stretch, down in the next."""
    settled = bench.config.rest_level.rest_frames + bench.config.onset_rule.onset_mean_frames

    def spoil(stream, place, rng):
        frame = int(rng.integers(settled, len(stream)))
        stream[frame, taxels[place % len(taxels)]] += height * (1 - 2 * (place % 2))
        return stream

    return spoil


def ramp(bench: Scene, speed: float, taxels: Sequence[int]) -> Change:
    """All taxels ramp by ``speed`` standard deviations of the features a second."""
    step = speed * bench.sigma / bench.config.sensor.scan_rate_hz
    return lambda stream, place, rng: stream + (step * np.arange(len(stream))[:, None]).astype(np.float32)


def stretches_and_frames(bench: Scene) -> str:
    """Amount of quiet, in words."""
    streams = lead_ins(bench)[0]
    return f"{len(streams)} quiet stretches, {sum(map(len, streams))} frames"


def ramp_in_codes(bench: Scene) -> str:
    """The ramp in codes, beside what the rest level follows, in words."""
    config = bench.config
    tracked = f"tracking follows {config.sensor.scan_rate_hz / 16:.0f} at most"
    return f"{bench.sigma.max():.3g} codes a second; {tracked if config.rest_level.rest == 'tracked' else 'the rest level is not tracked'}"


def burst(bench: Scene, gain: float, taxels: Sequence[int]) -> Change:
    """Everything before the touch, bursts of the axis's motor included, times ``gain``."""

    def louder_lead(stream, onset, rng):
        quiet = max(onset - bench.config.onset_rule.onset_mean_frames, 0)
        stream[:quiet] = _amplified(stream, gain, bench.config)[:quiet]
        return stream

    return louder_lead


# ---------------------------------------------------------------------- touches in time
def two_touches(bench: Bench) -> Outcome:
    """Each recording's touch after that of another one, with its own lead-in in between: nine in ten local
    decisions those it had in its own recording."""
    clean, config = bench.sample.clean, bench.config
    count = len(clean)
    shift = (
        int(np.argmax([np.mean(clean.labels != np.roll(clean.labels, -k)) for k in range(1, count)])) + 1
        if count > 1
        else 0
    )
    streams, starts = [], []
    for i in range(count):
        before, after = clean.recording(i), clean.recording((i + shift) % count)
        # whole hops before it, so that the second touch meets the hops as it did alone
        before = before[: len(before) // config.windows.hop * config.windows.hop]
        settle = max(config.rest_level.rest_frames, 1)
        # shifted to the first one's rest level, as on one and the same array
        after = after + np.rint(before[:settle].mean(axis=0) - after[:settle].mean(axis=0)).astype(
            after.dtype
        )
        quiet = after[
            : max(int(bench.sample.onsets[(i + shift) % count]) - config.onset_rule.onset_mean_frames, 1)
        ]
        frames = -(-3 * config.onset_rule.rearm_frames // config.windows.hop) * config.windows.hop
        between = np.resize(quiet, (frames, config.sensor.taxels)) if len(quiet) >= frames else quiet[:frames]
        streams.append(np.concatenate([before, between, after]))
        starts.append(len(before) + len(between))
    partners = (np.arange(count) + shift) % count
    pair = rebuilt(clean, streams, partners)
    alone, alone_local, _ = bench.decide_all(clean)
    touches, local, _ = bench.decide_all(pair)
    compared, differing = 0, []
    for i, partner in enumerate(partners):
        in_stream = local[(touches.recording == i) & (touches.onset_frame > starts[i])]
        for alone_row in alone_local[alone.recording == partner][:1]:
            compared += 1
            if not len(in_stream) or np.mean(in_stream[0] == alone_row) < 0.9:
                differing.append(i)
    failed = range(len(differing) + 1)
    curve = Curve("recording", "touches that differ", [k + 1 for k in failed], {"sum": failed})
    words = f"{len(differing)} of {compared} second touches differ in a tenth of their steps"
    return Outcome(
        (compared - len(differing)) / max(compared, 1), words, curve, Case(pair.subset(differing[:2] or [0]))
    )


def leak_of(bench: Bench, left_in: float = 0.0) -> Leak:
    """Accuracy of the model under test on the recordings without their touches, except the share
    ``left_in`` of their frames; empty if none has a lead-in."""

    def decide(touches: Touches) -> np.ndarray:
        logits = bench.forward(bench.features(touches))[1]
        return bench.parts.decide(bench.config, logits, touches.completed)[2]

    frames = round(left_in * bench.config.last_frame)
    leak = known_without_touch(bench.model, bench.clean, bench.parts.find_touches, decide, frames)
    return leak or Leak(0, 0.0, 1.0)


def without_touch(bench: Bench) -> Outcome:
    """Every touch is replaced by the quiet frames before it, repeated, and the gate opens where it did."""
    leak, shares = bench.remember("leak", lambda: leak_of(bench)), bench.thin(LEFT_IN)
    known = [leak_of(bench.sample, share).accuracy for share in shares]
    curve = Curve("share of the touch left in", "share of recordings known", shares, {"known": known})
    return Outcome(leak.accuracy, f"{leak.recordings} recordings have a quiet lead-in long enough", curve)
