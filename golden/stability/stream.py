"""Failure modes of the stream: touches that come late, twice or not at all, glitches, drift, frames lost, clocks."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import pairwise

import numpy as np

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.data.recordings import Recordings
from eskin.golden.stability.core import ONE_TAXEL_WORST, Bench, Case, Change, Curve, Outcome, disturbed, rebuilt
from eskin.golden.stability.shapes import Whole, worst_recordings

RATE_ERRORS = (0.02, 0.05, 0.1, 0.2, 0.4)


# ---------------------------------------------------------------------- disturbances of whole streams
def drift(bench: Bench, level: float) -> Change:
    """All taxels ramp by so many standard deviations of the features in a touch."""

    def ramp(stream, onset, rng):
        return stream + (level * bench.sigma / bench.config.last_frame * np.arange(len(stream), dtype=np.float32))[:, None]

    return ramp


def hum(bench: Bench, level: float) -> Change:
    """50 Hz on all taxels, with so many times the amplitude of the noise at rest."""

    def add(stream, onset, rng):
        phase = 2 * np.pi * 50 / bench.config.sensor.sample_rate_hz * np.arange(len(stream)) + rng.uniform(0, 2 * np.pi)
        return stream + (level * bench.rest_noise * np.sin(phase)).astype(np.float32)[:, None]

    return add


def frames_lost(bench: Bench, level: float) -> Change:
    """A share of the frames is missing, at random; the stream closes up."""
    return lambda stream, onset, rng: stream[rng.random(len(stream)) >= level]


def frames_repeated(bench: Bench, level: float) -> Change:
    """A share of the frames comes twice, at random."""
    return lambda stream, onset, rng: np.repeat(stream, 1 + (rng.random(len(stream)) < level), axis=0)


def gap(bench: Bench, level: float) -> Change:
    """A share of a touch's frames is missing in one piece, at a random place in the touch."""

    def cut(stream, onset, rng):
        length = round(level * bench.config.last_frame)
        begin = onset + int(rng.integers(0, bench.config.last_frame))
        return np.concatenate([stream[:begin], stream[begin + length :]])

    return cut


def rate_off(bench: Bench, level: float) -> Change:
    """Sampled too slowly by the share ``level``; negative: too fast."""
    return lambda stream, onset, rng: _resampled(stream, 1 + level)


def _resampled(stream: np.ndarray, factor: float) -> np.ndarray:
    position = np.arange(0, len(stream) - 1, factor)
    lower = position.astype(np.int64)
    part = (position - lower).astype(np.float32)[:, None]
    return stream[lower] * (1 - part) + stream[np.minimum(lower + 1, len(stream) - 1)] * part


# ---------------------------------------------------------------------- disturbances of quiet stretches
def _amplified(stream: np.ndarray, gain: float, config: AcceleratorConfig) -> np.ndarray:
    level = stream[: max(config.rest_level.rest_frames, 1)].mean(axis=0)
    return np.asarray(level + gain * (stream - level), dtype=np.float32)


def louder(bench: Bench, stream: np.ndarray, place: int, gain: float) -> np.ndarray:
    """Noise and bursts times ``gain``."""
    return _amplified(stream, gain, bench.config)


def glitch(bench: Bench, stream: np.ndarray, place: int, height: float) -> np.ndarray:
    """One sample of one taxel off by ``height`` codes; up in one stretch, down in the next."""
    spoiled = stream.astype(np.float32)
    settled = bench.config.rest_level.rest_frames + bench.config.onset_rule.onset_mean_frames
    frame = int(bench.rng(4, place).integers(settled, len(stream)))
    spoiled[frame, bench.live[place % len(bench.live)]] += height * (1 - 2 * (place % 2))
    return spoiled


def ramp(bench: Bench, stream: np.ndarray, place: int, speed: float) -> np.ndarray:
    """All taxels ramp by so many standard deviations of the features a second."""
    step = speed * bench.sigma / bench.config.sensor.sample_rate_hz
    return stream + (step * np.arange(len(stream), dtype=np.float32))[:, None]


def stretches_and_frames(bench: Bench, streams: Sequence[np.ndarray]) -> str:
    """How much quiet there was, in words."""
    return f"{len(streams)} quiet stretches, {sum(map(len, streams))} frames"


def ramp_in_codes(bench: Bench, streams: Sequence[np.ndarray]) -> str:
    """The ramp in codes, beside what the rest level follows, in words."""
    config = bench.config
    tracked = f"tracking follows {config.sensor.sample_rate_hz / 16:.0f} at most"
    return f"{bench.sigma:.3g} codes a second; {tracked if config.rest_level.rest == 'tracked' else 'the rest level is not tracked'}"


# ---------------------------------------------------------------------- touches in time


def motor_burst(bench: Bench) -> Outcome:
    """Everything before the touch, bursts of the axis's motor included, times 1.5: onsets more than a window earlier than recorded."""
    clean = bench.onsets

    def early(where: Bench, gain: float) -> tuple[float, Recordings]:
        def change(stream, onset, rng):
            quiet = max(onset - where.config.onset_rule.onset_mean_frames, 0)
            level = stream[: max(where.config.rest_level.rest_frames, 1)].mean(axis=0)
            stream[:quiet] = level + gain * (stream[:quiet] - level)
            return stream

        made = disturbed(where, change)
        touches = where.parts.find_touches(where.config, made, steps=0)
        first = touches.first_touch()
        found = np.where(first >= 0, touches.onset_frame[first], 1 << 30)
        return float(np.mean(found < where.onsets - where.config.windows.window)), made

    share, made = early(bench, 1.5)
    gains = [1.0, 1.5, 2.0, 3.0, 4.0, 6.0]
    curve = Curve("burst / recorded", "share with an early onset", gains, {"early": [early(bench.sample, gain)[0] for gain in gains]})
    return Outcome(share, f"{round(share * len(clean))} of {len(clean)} recordings", curve, Case(made.subset(range(min(3, len(made))))))


def late_touch(bench: Bench) -> Outcome:
    """Streams that end in the middle of the touch: the decision of the completed steps; the curve: other shares of the steps."""
    config, touches = bench.config, bench.touches

    def cut(share: float) -> tuple[float, np.ndarray, Recordings]:
        steps = max(1, round(share * config.windows.steps))
        ends = np.full(len(bench.clean), 1 << 40, dtype=np.int64)
        ends[touches.recording] = touches.start_frame - 1 + config.window_spans[steps - 1][1]
        made = rebuilt(
            bench.clean, [bench.clean.recording(i)[: min(end, n)] for i, (end, n) in enumerate(zip(ends, bench.clean.lengths, strict=True))]
        )
        decisions = bench.decisions(made)
        return float(np.mean(decisions == made.labels)), decisions, made

    shares = [1.0, 0.75, 0.5, 0.35, 0.25, 0.15, 0.1, 0.05]
    line = [cut(share)[0] for share in shares]
    _, decisions, made = cut(0.5)
    bound = ONE_TAXEL_WORST * bench.clean_accuracy
    first = next((s for s, a in zip(shares, line, strict=True) if a < bound), None)
    what = f"below {bound:.3g} from {first:g} of the steps on" if first else "any share of the steps does"
    return Outcome(
        line[2],
        what,
        Curve("share of the steps there are", "accuracy", shares, {"accuracy": line}),
        worst_recordings(bench, made, decisions),
    )


def touch_at_once(bench: Bench) -> Outcome:
    """Streams that begin at the onset: the rest level settles within the touch. Curve: quiet frames before the onset."""

    def begin(where: Bench, quiet: int) -> Recordings:
        return disturbed(where, lambda stream, onset, rng: stream[max(onset - 1 - quiet, 0) :])

    leads = [400, 200, 128, 96, 64, 32, 0]
    made = begin(bench, 0)
    decisions = bench.decisions(made)
    line = [bench.sample.accuracy(begin(bench.sample, quiet)) for quiet in leads]
    accuracy = float(np.mean(decisions == made.labels))
    curve = Curve("quiet frames before the onset", "accuracy", leads, {"accuracy": line})
    what = f"{int(np.sum(decisions < 0))} of {len(made)} without a decision"
    return Outcome(accuracy, what, curve, worst_recordings(bench, made, decisions))


def two_touches(bench: Bench) -> Outcome:
    """Each recording's touch after that of another one, with its own lead-in in between: logits exactly those of its features alone,
    and nine in ten local decisions those it had in its own recording."""
    clean, config = bench.sample.clean, bench.config
    count = len(clean)
    shift = int(np.argmax([np.mean(clean.labels != np.roll(clean.labels, -k)) for k in range(1, count)])) + 1 if count > 1 else 0
    streams, starts = [], []
    for i in range(count):
        before, after = clean.recording(i), clean.recording((i + shift) % count)
        before = before[: len(before) // config.windows.hop * config.windows.hop]  # the second one's hops fall as they did alone
        settle = max(config.rest_level.rest_frames, 1)
        # the second starts from the first one's rest level, as it would on one array
        after = after + np.rint(before[:settle].mean(axis=0) - after[:settle].mean(axis=0)).astype(after.dtype)
        quiet = after[: max(int(bench.sample.onsets[(i + shift) % count]) - config.onset_rule.onset_mean_frames, 1)]
        frames = -(-3 * config.onset_rule.rearm_frames // config.windows.hop) * config.windows.hop
        between = np.resize(quiet, (frames, config.sensor.taxels)) if len(quiet) >= frames else quiet[:frames]
        streams.append(np.concatenate([before, between, after]))
        starts.append(len(before) + len(between))
    both = rebuilt(clean, streams, [(i + shift) % count for i in range(count)])
    alone, alone_local, _, _ = bench.decide_all(clean)
    touches, local, _, _ = bench.decide_all(both)
    # the features of a touch, run alone by the part under test, give the logits that it must have after another touch
    exact = (bench.logits(touches) == bench.forward(bench.features(touches))[1]).all(axis=(1, 2))
    same, compared = 0, 0
    differing = []
    for i in range(count):
        other = (i + shift) % count
        mine = np.flatnonzero((touches.recording == i) & (touches.onset_frame > starts[i]))
        theirs = np.flatnonzero(alone.recording == other)
        if len(theirs):
            compared += 1
            equal = len(mine) > 0 and exact[mine[0]] and np.mean(local[mine[0]] == alone_local[theirs[0]]) >= 0.9
            same += equal
            differing += [] if equal else [i]
    curve = Curve("recording", "touches that differ", range(1, len(differing) + 2), {"sum": range(len(differing) + 1)})
    case = Case(both.subset(differing[:2] or [0]))
    return Outcome(same / max(compared, 1), f"{compared - same} of {compared} second touches differ in a tenth of their steps", curve, case)


def overlapping(bench: Bench) -> Outcome:
    """The movement of a recording of another class is added to the last quarter of the touch: the first touch's decision."""
    levels = [0.9, 0.75, 0.6, 0.5, 0.4, 0.25]

    def change(where: Bench):
        clean, onsets = where.clean, where.onsets
        labels, count = clean.labels, len(clean)
        partner = [next((j for j in ((i + k) % count for k in range(1, count)) if labels[j] != labels[i]), i) for i in range(count)]

        def at(share: float) -> Recordings:
            streams = []
            for i in range(count):
                stream = clean.recording(i).astype(np.float32)
                other = clean.recording(partner[i]).astype(np.float32)
                other = other[max(int(onsets[partner[i]]) - where.config.onset_rule.onset_mean_frames, 1) - 1 :]
                begin = int(onsets[i]) + round(share * where.config.last_frame)
                length = min(len(stream) - begin, len(other))
                if length > 0:
                    stream[begin : begin + length] += other[:length] - other[0]
                streams.append(stream)
            return rebuilt(clean, streams)

        return at

    made = change(bench)(0.75)
    decisions = bench.decisions(made)
    few = change(bench.sample)
    levels = list(bench.thin(levels))
    curve = Curve("where in the touch the second begins", "accuracy", levels, {"accuracy": [bench.sample.accuracy(few(x)) for x in levels]})
    accuracy = float(np.mean(decisions == made.labels))
    return Outcome(accuracy, f"clean {bench.clean_accuracy:.4f}", curve, worst_recordings(bench, made, decisions))


def wrong_rate(bench: Bench) -> Outcome:
    """The stream is sampled 5 % too fast and 5 % too slow: the worse accuracy."""
    ways = {
        name: Whole(rate_off, sign * 0.05, [sign * level for level in RATE_ERRORS], "error of the rate", f"5 % {name.split()[0]}")
        for name, sign in (("slow sampling", 1), ("fast sampling", -1))
    }
    outcomes = {name: way(bench) for name, way in ways.items()}
    worse = outcomes[min(outcomes, key=lambda name: outcomes[name].value)]
    lines = {name: outcome.curve.lines["accuracy"] for name, outcome in outcomes.items()}
    both = {"the worse": np.min([*lines.values()], axis=0).tolist(), **lines}
    curve = Curve("error of the rate", "accuracy", bench.thin(RATE_ERRORS), both)
    return Outcome(worse.value, worse.worst_case, curve, worse.case)


def _cut(length: int, stream: np.ndarray, onset: int, rng: np.random.Generator) -> np.ndarray:
    return stream[max(onset - 1, 0) :][:length]


def short_stream(bench: Bench) -> Outcome:
    """Recordings cut after one frame up to the first window: touches with a step that is complete."""
    config = bench.config
    first = (
        config.rest_level.rest_frames + 1 if config.rest_level.rest_frames and not config.opens_at_once else config.window_spans[0][1] - 1
    )
    lengths = sorted({1, 2, max(first // 2, 1), first})
    counts = []
    for length in lengths:
        made = disturbed(bench.sample, partial(_cut, length))
        touches = bench.parts.find_touches(config, made)
        counts.append(int(touches.completed.astype(bool).sum()))
    return Outcome(
        sum(counts),
        f"{len(bench.sample.clean)} recordings at each of {len(lengths)} lengths",
        Curve("frames", "decisions", lengths, {"decisions": counts}),
    )


def last_steps(bench: Bench) -> Outcome:
    """Multiplies of a step over the lanes against the cycles between the two windows that end closest together, at the configured clock."""
    config = bench.config
    ends = sorted({last for _, last in config.window_spans})
    frames = min((later - earlier for earlier, later in pairwise(ends)), default=config.last_frame)
    cycles = frames * config.hardware.clock_hz / config.sensor.sample_rate_hz
    clocks = [1e7, 3e6, 1e6, 3e5, 1e5, 3e4, 1e4]
    share = [config.step_ideal * config.sensor.sample_rate_hz / (frames * clock) for clock in clocks]
    needed = config.step_ideal * config.sensor.sample_rate_hz / frames
    curve = Curve("clock (Hz)", "share of the cycles there are", clocks, {"step": share}, log=True)
    what = f"windows {frames} frames apart: needs {needed / 1e3:.3g} kHz at {config.hardware.lanes} lanes"
    return Outcome(config.step_ideal / cycles, what, curve)
