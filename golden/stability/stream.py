"""Failure modes of the stream: touches that come late, twice or not at all, glitches, drift, frames lost, clocks."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.formats import QFormat
from eskin.golden.data.recordings import Recordings
from eskin.golden.model.pipeline import decide
from eskin.golden.model.preprocess import Touches, find_touches
from eskin.golden.stability.core import ONE_TAXEL_WORST, Bench, Case, Curve, Outcome, disturbed, harmless, mode, rebuilt

GLITCH_CODES = 3000
"""The largest spikes in the recordings of PVDF taxels are about as large."""
RAMPS = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
"""Standard deviations of the features a second."""


def last_sample_windows(config: AcceleratorConfig, recordings: Recordings, **options) -> Touches:
    """A broken front end: a window is its last frame times its length, so nothing is averaged."""
    streams = [recordings.recording(i) for i in range(len(recordings))]
    hop = config.windows.hop
    held = [stream[np.minimum(np.arange(len(stream)) // hop * hop + hop - 1, len(stream) - 1)] for stream in streams]
    return find_touches(config.replace(fault_frames=0), rebuilt(recordings, held), **options)  # which would take it for a taxel that sticks


def lowest_bits(config, logits, completed):
    """A broken decision: by the lowest bits of the last logits, so that any change shows."""
    local, margin, _, lead = decide(config, logits, completed)
    last = logits[np.arange(len(logits)), np.maximum(completed - 1, 0)]
    return local, margin, last.sum(axis=-1) % config.classes, lead


SHOWS_EVERYTHING = ("the lowest bits of the last logits decide", lambda bench: bench.changed(decide=lowest_bits))
"""A broken variant for modes in which little changes."""


def _sensitive(bench: Bench) -> Bench:
    """A broken onset rule: one sample one code off is a touch."""
    config = bench.config
    if config.onset_rule.onset == "band":
        level = (config.onset_rule.band_low + config.onset_rule.band_high) // 2
        return bench.changed({"band_low": level, "band_high": level})
    return bench.changed({"onset_threshold": 1, "onset_mean_frames": config.onset_rule.onset_check_frames, "clip": 0})


def _accuracies(bench: Bench, levels, change) -> list[float]:
    """Accuracy on the bench's few recordings at each level; ``change(level)`` is the disturbance."""
    return [bench.sample.accuracy(disturbed(bench.sample, change(level))) for level in bench.thin(levels)]


def _swept(bench: Bench, levels, nominal: float, change, xlabel: str, what: str, *, log: bool = False) -> Outcome:
    """Accuracy of all recordings at the nominal level, the curve from the few, and three wrongly decided recordings as a case."""
    made = disturbed(bench, change(nominal))
    decisions = bench.decisions(made)
    accuracy = float(np.mean(decisions == made.labels))
    curve = Curve(xlabel, "accuracy", bench.thin(levels), {"accuracy": _accuracies(bench, levels, change)}, log)
    return Outcome(accuracy, f"{what}; clean {bench.clean_accuracy:.4f}", curve, worst_recordings(bench, made, decisions))


def worst_recordings(bench: Bench, recordings: Recordings, decisions: np.ndarray, count: int = 3) -> Case:
    """Up to ``count`` recordings for the hardware, wrongly decided ones first, with the bench's model."""
    order = np.argsort(decisions == recordings.labels, kind="stable")[:count]
    return Case(recordings.subset(np.sort(order)), bench.model)


def _lead_ins(bench: Bench) -> tuple[list[np.ndarray], list[int]]:
    """The quiet frames before each recording's touch, where there are enough of them."""
    config, streams, which = bench.config, [], []
    for i, onset in enumerate(bench.onsets):
        end = int(onset) - config.onset_rule.onset_mean_frames - config.windows.pretrigger_frames
        if end > config.rest_level.rest_frames + 2 * config.onset_rule.onset_mean_frames:
            streams.append(bench.clean.recording(i)[:end])
            which.append(i)
    if not streams:  # recordings that begin in contact: the rest level with its noise, as far as there is any
        streams, which = [np.repeat(bench.clean.recording(0)[:1], config.rest_level.rest_frames + 512, axis=0)], [0]
    return streams, which


def _false_onsets(bench: Bench, streams: list[np.ndarray], which: list[int]) -> tuple[float, Recordings]:
    recordings = rebuilt(bench.clean, streams, which)
    touches = bench.parts.find_touches(bench.config, recordings, steps=0)
    return len(np.unique(touches.recording)) / len(streams), recordings


# ---------------------------------------------------------------------- touches in time
@mode(
    "no touch",
    "stream",
    unit="share of quiet recordings with an onset",
    at_most=0,
    onset=True,
    because="a decision without a touch is an invention",
    broken=("one code off is a touch", _sensitive),
)
def no_touch(bench: Bench) -> Outcome:
    """The frames before each recording's touch alone, noise and motor bursts included: recordings in which an onset is found."""
    streams, which = _lead_ins(bench)
    share, recordings = _false_onsets(bench, streams, which)
    gains = [1.0, 1.25, 1.5, 2.0, 3.0, 4.0]
    line = [_false_onsets(bench, [_amplified(s, gain, bench.config) for s in streams], which)[0] for gain in gains]
    curve = Curve("noise and bursts / recorded", "share with a false onset", gains, {"false onsets": line})
    return Outcome(
        share,
        f"{len(streams)} quiet stretches, {sum(map(len, streams))} frames",
        curve,
        Case(recordings.subset(range(min(3, len(streams))))),
    )


def _amplified(stream: np.ndarray, gain: float, config: AcceleratorConfig) -> np.ndarray:
    level = stream[: max(config.rest_level.rest_frames, 1)].mean(axis=0)
    return np.asarray(level + gain * (stream - level), dtype=np.float32)


@mode(
    "motor burst before the touch",
    "stream",
    unit="share of recordings with an onset a window early",
    at_most=0.01,
    onset=True,
    because="a burst taken for the onset makes the touch fall out of its windows; half as much again is a motor's ageing",
    broken=("one code off is a touch", _sensitive),
)
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


@mode(
    "touch near the end of the stream",
    "stream",
    unit="accuracy",
    at_least=ONE_TAXEL_WORST,
    because="half of the steps must do: a cut touch is decided by the steps it has, and flagged partial",
    broken=("the network answers after the last step only", lambda bench: bench.changed(decide=_last_step_only)),
)
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
    first = next((s for s, a in zip(shares, line, strict=True) if a < ONE_TAXEL_WORST), None)
    what = f"below {ONE_TAXEL_WORST} from {first:g} of the steps on" if first else "any share of the steps does"
    return Outcome(
        line[2],
        what,
        Curve("share of the steps there are", "accuracy", shares, {"accuracy": line}),
        worst_recordings(bench, made, decisions),
    )


def _last_step_only(config, logits, completed):
    local, margin, decision, lead = decide(config, logits, completed)
    return local, margin, np.where(completed == config.windows.steps, decision, -1), lead


@mode(
    "touch at frame 1",
    "stream",
    unit="accuracy",
    at_least=ONE_TAXEL_WORST,
    onset=True,
    because="an array that is switched on while held must not be worse off than one with a dead taxel",
    broken=SHOWS_EVERYTHING,
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


@mode(
    "two touches",
    "stream",
    unit="share of second touches decided as alone",
    at_least=0.98,
    onset=True,
    because="a touch must not know what came before it: state and sums are cleared",
    broken=("the state is not cleared", lambda bench: bench.changed(carry=True)),
)
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


@mode(
    "a touch while one is decided",
    "stream",
    unit="accuracy",
    at_least=harmless,
    because="the vote of the first three quarters stands: what comes then must not change the decision of the touch before",
    broken=SHOWS_EVERYTHING,
)
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


# ---------------------------------------------------------------------- disturbances of the stream
@mode(
    "one-sample glitch before the touch",
    "stream",
    unit="share of quiet recordings with an onset",
    at_most=0,
    onset=True,
    because="one sample is no touch",
    broken=("one sample is enough", _sensitive),
)
def glitch(bench: Bench) -> Outcome:
    """One sample of one taxel, each in turn, off by 3000 codes in the quiet frames before each touch: onsets found."""
    streams, which = _lead_ins(bench)
    streams, which = streams[: bench.few], which[: bench.few]

    def share(height: float) -> tuple[float, Recordings]:
        made = []
        for i, stream in enumerate(streams):
            spoiled = stream.astype(np.float32)
            frame = int(
                bench.rng(4, i).integers(bench.config.rest_level.rest_frames + bench.config.onset_rule.onset_mean_frames, len(stream))
            )
            spoiled[frame, bench.live[i % len(bench.live)]] += height * (1 - 2 * (i % 2))
            made.append(spoiled)
        return _false_onsets(bench, made, which)

    heights = [30, 100, 300, 1000, GLITCH_CODES, 10000, 30000]
    value, made = share(GLITCH_CODES)
    line = [share(height)[0] for height in heights]
    curve = Curve("height of the glitch (codes)", "share with a false onset", heights, {"false onsets": line}, log=True)
    return Outcome(value, f"{len(streams)} quiet stretches", curve, Case(made.subset(range(min(3, len(streams))))))


@mode(
    "slow ramp through the band",
    "stream",
    unit="share of quiet recordings with an onset",
    at_most=0,
    onset=True,
    because="temperature and charge drift move the rest level; what takes a second for a touch's usual height must not look like one",
    broken=(
        "the rest level is frozen after settling",
        lambda bench: bench.changed(
            {"rest": "initial"} if bench.config.rest_level.rest == "tracked" else {"band_low": bench.config.onset_rule.band_low + 1}
        ),
    ),
)
def slow_ramp(bench: Bench) -> Outcome:
    """All taxels ramp by one standard deviation of the features a second before the touch: quiet recordings with an onset."""
    streams, which = _lead_ins(bench)
    streams, which = streams[: bench.few], which[: bench.few]
    rate = bench.config.sensor.sample_rate_hz

    def share(speed: float) -> tuple[float, Recordings]:
        step = speed * bench.sigma / rate
        return _false_onsets(bench, [s + (step * np.arange(len(s), dtype=np.float32))[:, None] for s in streams], which)

    value, made = share(1.0)
    line = [share(speed)[0] for speed in RAMPS]
    curve = Curve("ramp (deviations of the features a second)", "share with a false onset", RAMPS, {"false onsets": line}, log=True)
    tracking = f"tracking follows {rate / 16:.0f} at most" if bench.config.rest_level.rest == "tracked" else "the rest level is not tracked"
    what = f"{bench.sigma:.3g} codes a second; {tracking}"
    return Outcome(value, what, curve, Case(made.subset(range(min(2, len(streams))))))


@mode(
    "drift of all taxels",
    "stream",
    unit="accuracy",
    at_least=harmless,
    because="the rest level is frozen in a touch: what drifts in one touch must stay small beside its features",
    broken=("every feature at full scale", lambda bench: full_scale(bench)),
)
def drift(bench: Bench) -> Outcome:
    """All taxels ramp through the whole recording by a quarter of the features' standard deviation in a touch."""
    levels = [0.125, 0.25, 0.5, 1.0, 2.0]

    def change(level: float):
        def ramp(stream, onset, rng):
            return stream + (level * bench.sigma / bench.config.last_frame * np.arange(len(stream), dtype=np.float32))[:, None]

        return ramp

    return _swept(bench, levels, 0.25, change, "drift in a touch (deviations of the features)", "a quarter of a deviation", log=True)


def full_scale(bench: Bench) -> Bench:
    """A normaliser with the largest scale and the smallest mean: every feature is at full scale."""
    sums = QFormat(bench.config.sum_bits, 0)
    return bench.changed(
        arrays={
            "scale": np.full_like(bench.model.arrays["scale"], bench.config.scale_format.max_code),
            "mean": np.full_like(bench.model.arrays["mean"], sums.min_code),
        }
    )


@mode(
    "mains hum",
    "stream",
    unit="accuracy",
    at_least=harmless,
    because="a window of several hum periods averages it away",
    broken=SHOWS_EVERYTHING,
)
def hum(bench: Bench) -> Outcome:
    """50 Hz on all taxels, with twice the amplitude of the noise at rest."""
    levels = [1, 2, 5, 10, 20, 50]

    def change(level: float):
        def add(stream, onset, rng):
            phase = 2 * np.pi * 50 / bench.config.sensor.sample_rate_hz * np.arange(len(stream)) + rng.uniform(0, 2 * np.pi)
            return stream + (level * bench.rest_noise * np.sin(phase)).astype(np.float32)[:, None]

        return add

    what = f"twice the noise at rest of {bench.rest_noise:.2g} codes"
    return _swept(bench, levels, 2, change, "amplitude / noise at rest", what, log=True)


@mode(
    "frames lost",
    "stream",
    unit="accuracy",
    at_least=harmless,
    because="a link that loses one frame in a hundred is a bad one",
    broken=("a window is one sample and seven of eight frames are lost", lambda bench: bench.changed(find_touches=_thinned)),
)
def lost(bench: Bench) -> Outcome:
    """One frame in a hundred is missing, at random; the stream closes up."""

    def change(level: float):
        return lambda stream, onset, rng: stream[rng.random(len(stream)) >= level]

    return _swept(bench, [0.01, 0.03, 0.1, 0.2, 0.4], 0.01, change, "share of frames lost", "one in a hundred", log=True)


def _thinned(config, recordings, **options):
    made = rebuilt(recordings, [recordings.recording(i)[::8] for i in range(len(recordings))])
    return last_sample_windows(config, made, **options)


@mode(
    "frames repeated",
    "stream",
    unit="accuracy",
    at_least=harmless,
    because="a link that repeats one frame in a hundred is a bad one",
    broken=("a window is one sample and seven of eight frames are lost", lambda bench: bench.changed(find_touches=_thinned)),
)
def repeated(bench: Bench) -> Outcome:
    """One frame in a hundred comes twice, at random."""

    def change(level: float):
        return lambda stream, onset, rng: np.repeat(stream, 1 + (rng.random(len(stream)) < level), axis=0)

    return _swept(bench, [0.01, 0.03, 0.1, 0.2, 0.4], 0.01, change, "share of frames repeated", "one in a hundred", log=True)


@mode(
    "a gap in the touch",
    "stream",
    unit="accuracy",
    at_least=harmless,
    because="a retry of the link takes some milliseconds",
    broken=("a window is one sample and seven of eight frames are lost", lambda bench: bench.changed(find_touches=_thinned)),
)
def gap(bench: Bench) -> Outcome:
    """A hundredth of a touch's frames is missing in one piece, at a random place in the touch."""

    def change(level: float):
        def cut(stream, onset, rng):
            length = round(level * bench.config.last_frame)
            begin = onset + int(rng.integers(0, bench.config.last_frame))
            return np.concatenate([stream[:begin], stream[begin + length :]])

        return cut

    return _swept(bench, [0.01, 0.03, 0.1, 0.3], 0.01, change, "gap / touch", "a hundredth of the touch", log=True)


def _resampled(stream: np.ndarray, factor: float) -> np.ndarray:
    position = np.arange(0, len(stream) - 1, factor)
    lower = position.astype(np.int64)
    part = (position - lower).astype(np.float32)[:, None]
    return stream[lower] * (1 - part) + stream[np.minimum(lower + 1, len(stream) - 1)] * part


@mode(
    "wrong sample rate",
    "stream",
    unit="accuracy",
    at_least=harmless,
    because="an oscillator without a crystal is off by 5 %",
    broken=("a window is one sample and seven of eight frames are lost", lambda bench: bench.changed(find_touches=_thinned)),
)
def wrong_rate(bench: Bench) -> Outcome:
    """The stream is sampled 5 % too fast and 5 % too slow: the worse accuracy."""

    def change(level: float):
        return lambda stream, onset, rng: _resampled(stream, 1 + level)

    levels = [0.02, 0.05, 0.1, 0.2, 0.4]
    outcomes = {sign: _swept(bench, levels, sign * 0.05, change, "", "") for sign in (1, -1)}
    slow = _accuracies(bench, [-level for level in levels], change)
    levels = bench.thin(levels)
    worse = min(outcomes, key=lambda sign: outcomes[sign].value)
    both = {
        "the worse": np.minimum(outcomes[1].curve.lines["accuracy"], slow).tolist(),
        "slow sampling": outcomes[1].curve.lines["accuracy"],
        "fast sampling": slow,
    }
    what = f"{'5 % slow' if worse > 0 else '5 % fast'}; clean {bench.clean_accuracy:.4f}"
    return Outcome(outcomes[worse].value, what, Curve("error of the rate", "accuracy", levels, both), outcomes[worse].case)


@mode(
    "stream shorter than the settling frames",
    "stream",
    unit="decisions",
    at_most=0,
    because="what ends before the rest level is known can be no touch; it must end quietly",
    broken=("no settling", lambda bench: bench.changed(find_touches=_unsettled)),
)
def short_stream(bench: Bench) -> Outcome:
    """Recordings cut after one frame up to the first window: touches with a step that is complete."""
    config = bench.config
    first = (
        config.rest_level.rest_frames + 1 if config.rest_level.rest_frames and not config.opens_at_once else config.window_spans[0][1] - 1
    )
    lengths = sorted({1, 2, max(first // 2, 1), first})
    counts = []
    for length in lengths:
        made = disturbed(bench.sample, lambda stream, onset, rng, length=length: stream[max(onset - 1, 0) :][:length])
        touches = bench.parts.find_touches(config, made)
        counts.append(int(touches.completed.astype(bool).sum()))
    return Outcome(
        sum(counts),
        f"{len(bench.sample.clean)} recordings at each of {len(lengths)} lengths",
        Curve("frames", "decisions", lengths, {"decisions": counts}),
    )


def _unsettled(config, recordings, **options):
    long = rebuilt(recordings, [np.repeat(recordings.recording(i), config.last_frame * 2, axis=0) for i in range(len(recordings))])
    return find_touches(
        config.replace(
            onset="immediate",
            rest="none",
            rest_frames=0,
            window_mode="free",
            window=2 * config.windows.hop,
            pretrigger_frames=0,
            feature_shift=(),
        ),
        long,
        **options,
    )


@mode(
    "last two steps at the slowest clock",
    "stream",
    unit="share of the cycles there are",
    at_most=1.0,
    because="two windows may end some frames apart: a step must be over before the next one's features are due",
    broken=(
        "a clock of two cycles a sample",
        lambda bench: bench.changed({"clock_hz": 2.0 * bench.config.inputs * bench.config.sensor.sample_rate_hz, "lanes": 1}),
    ),
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
