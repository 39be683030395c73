"""Disturbances of the sensor (taxels dead, stuck, noisy, off in gain or offset, exchanged; how the fault detector
sees them) and of the stream (touches that come late, twice or not at all, glitches, drift, frames lost, clocks).
"""

from functools import partial

import numpy as np

from eskin.golden.core import AcceleratorConfig
from eskin.golden.data import Recordings
from eskin.golden.model import preprocess
from eskin.study.leak import Leak, known_without_touch
from eskin.study.stability.core import At, Bench, Case, Outcome, Scene, curve, disturbed, lead_ins, rebuilt

SPIKE_CODES = 3000
"""The largest spikes in the recordings of PVDF taxels are about as large."""


# ---------------------------------------------------------------------- one taxel
def rest_of(stream: np.ndarray, scene: Scene) -> np.ndarray:
    """Rest level of each taxel: the median of the first frames."""
    return np.median(stream[: max(scene.config.rest_level.rest_frames, 5)], axis=0)


def stuck(stream: np.ndarray, at: At, end: str = "high") -> np.ndarray:
    """Taxels held at an ``end`` of their range, ``high`` or ``low``, or at their ``rest`` level without noise, from
    ``level`` touch lengths after the onset on."""
    config, columns = at.scene.config, list(at.taxels)
    begin = max(0, at.onset - 1 + round(at.level * at.frames))
    held = {"high": config.sample_format.max_code, "low": config.sample_format.min_code}
    stream[begin:, columns] = held.get(end, rest_of(stream, at.scene)[columns])
    return stream


def stuck_from_start(stream: np.ndarray, at: At) -> np.ndarray:
    """Taxels at the highest code from the first frame on."""
    stream[:, at.taxels] = at.scene.config.sample_format.max_code
    return stream


def noisy(stream: np.ndarray, at: At) -> np.ndarray:
    """White noise of ``level`` times the taxels' noise at rest."""
    noise = at.rng.standard_normal((len(stream), len(at.taxels))).astype(np.float32)
    stream[:, at.taxels] += at.level * at.scene.rest_noise[list(at.taxels)] * noise
    return stream


def gain_off(stream: np.ndarray, at: At) -> np.ndarray:
    """Taxels that are more sensitive by the share ``level``."""
    rest = rest_of(stream, at.scene)[at.taxels]
    stream[:, at.taxels] = rest + (1 + at.level) * (stream[:, at.taxels] - rest)
    return stream


def offset(stream: np.ndarray, at: At) -> np.ndarray:
    """Taxels shifted together by ``level`` standard deviations of the features at the onset."""
    stream[max(at.onset - 1, 0) :, at.taxels] += at.level * at.scene.sigma[list(at.taxels)]
    return stream


# ---------------------------------------------------------------------- several taxels, or all
def dead_together(stream: np.ndarray, at: At) -> np.ndarray:
    """Taxels that rest from shortly before the touch on; the level is how many."""
    return stuck(stream, at._replace(level=-0.1), "rest")


def exchanged(stream: np.ndarray, at: At) -> np.ndarray:
    """Each taxel in the place of its predecessor, the first in the place of the last."""
    stream[:, at.taxels] = stream[:, [*at.taxels[-1:], *at.taxels[:-1]]]
    return stream


def gains(stream: np.ndarray, at: At) -> np.ndarray:
    """Every taxel with another gain, drawn within +-level."""
    rest, errors = rest_of(stream, at.scene), at.rng.uniform(-1, 1, stream.shape[1])
    return rest + np.float32(1 + at.level * errors) * (stream - rest)


def clipped(stream: np.ndarray, at: At) -> np.ndarray:
    """Every taxel limited to ``level`` standard deviations of the features around its rest level."""
    rest, room = rest_of(stream, at.scene), at.level * at.scene.sigma
    return np.clip(stream, rest - room, rest + room)


def spikes(stream: np.ndarray, at: At) -> np.ndarray:
    """A share of the samples off by ``SPIKE_CODES``, either way, from the onset on."""
    touch = stream[at.onset - 1 :]
    hit = at.rng.random(touch.shape) < at.level
    touch += SPIKE_CODES * hit * np.sign(at.rng.standard_normal(touch.shape))
    return stream


def fainter(stream: np.ndarray, at: At) -> np.ndarray:
    """Rest noise and signal times ``level``."""
    rest = rest_of(stream, at.scene)
    return rest + at.level * (stream - rest)


# ---------------------------------------------------------------------- the detector
def _flagged(config: AcceleratorConfig, recordings: Recordings) -> np.ndarray:
    """(recordings, taxels) the frame, from 1, that raised the taxel's fault flag, 0 = none."""
    flagged = preprocess.find_touches(config, recordings, steps=0).flagged
    return np.zeros((len(recordings), config.sensor.taxels)) if flagged is None else flagged


def _missed(bench: Bench, end: str, within: int) -> float:
    """Share of recordings, for the worst taxel, in which a taxel that fails a quarter into the touch is not
    flagged within the given number of frames, or another taxel is flagged."""
    shares = [0.0]
    last = np.maximum(0, bench.onsets - 1 + round(0.25 * bench.config.last_frame)) + within
    for taxel in bench.live:
        recordings = disturbed(bench, partial(stuck, end=end), 0.25, [taxel])
        flagged = _flagged(bench.config, recordings)
        its_own = (flagged[:, taxel] > 0) & (flagged[:, taxel] <= last)
        other_flags = np.delete(flagged, taxel, axis=1).any(axis=1)
        alive = recordings.lengths >= last
        shares.append(1 - float(np.mean((its_own & ~other_flags)[alive])) if alive.any() else 1.0)
    return max(shares)


def missed(bench: Bench) -> Outcome:
    """Each taxel in turn sticks at an end of its range or at its rest level, a quarter into the touch: flags
    not raised within two blocks of the detector, or raised for another taxel; the worst taxel and level.
    Curve: within how many frames."""
    few, fault_frames = bench.sample, bench.config.faults.fault_frames
    block = fault_frames or 64
    shares = {end: _missed(few, end, 2 * block) for end in ("high", "low", "rest")}
    frames = bench.thin([4 * block, 2 * block, 3 * block // 2, block, block // 2])
    line = [max(_missed(few, end, int(frame)) for end in ("high", "rest")) for frame in frames]
    worst = max(shares, key=shares.__getitem__)
    words = f"stuck {worst}: {shares[worst]:.4f}; {f'{fault_frames} frames' if fault_frames else 'no detector'} a block"
    return Outcome(
        shares[worst], words, curve("frames after the failure", "share missed", frames, {"missed": line})
    )


def false_alarms(bench: Bench) -> Outcome:
    """Undisturbed recordings, to their very end, in which a fault flag is raised. Curve: rest noise and
    signal reduced by a factor."""

    def share(recordings: Recordings) -> float:
        return float(np.mean(_flagged(bench.config, recordings).any(axis=1)))

    few, amplitudes = bench.sample, bench.thin([1.0, 0.7, 0.5, 0.35, 0.25, 0.15])
    line = {gain: share(disturbed(few, fainter, gain, [])) for gain in amplitudes}
    first = next((gain for gain, flagged in line.items() if flagged > 0), None)
    words = f"none until noise and signal fall to {first:g}" if first else "none on the whole curve"
    drawn = curve("amplitude / recorded", "share with a flag", line, {"flagged": line.values()})
    return Outcome(share(bench.recordings), f"{len(bench.recordings)} recordings; {words}", drawn)


LEFT_IN = (0.0, 0.05, 0.1, 0.25, 0.5, 1.0)


# ---------------------------------------------------------------------- disturbances of whole streams
def ramp(stream: np.ndarray, at: At, frames: float | None = None) -> np.ndarray:
    """All taxels ramp by ``level`` standard deviations of the features in so many frames; None: in a second."""
    slope = at.level * at.scene.sigma / (frames or at.scene.config.sensor.scan_rate_hz)
    return stream + (slope * np.arange(len(stream))[:, None]).astype(np.float32)


def drift(stream: np.ndarray, at: At) -> np.ndarray:
    """The same during a touch."""
    return ramp(stream, at, at.frames)


def hum(stream: np.ndarray, at: At) -> np.ndarray:
    """50 Hz on all taxels, at ``level`` times the amplitude of the noise at rest."""
    turn = 2 * np.pi * 50 / at.scene.config.sensor.scan_rate_hz
    phase = turn * np.arange(len(stream)) + at.rng.uniform(0, 2 * np.pi)
    return stream + (at.level * at.scene.rest_noise * np.sin(phase)[:, None]).astype(np.float32)


def frames_lost(stream: np.ndarray, at: At) -> np.ndarray:
    """A share of the frames is missing, at random; the stream closes up."""
    return stream[at.rng.random(len(stream)) >= at.level]


def frames_repeated(stream: np.ndarray, at: At) -> np.ndarray:
    """A share of the frames comes twice, at random."""
    return np.repeat(stream, 1 + (at.rng.random(len(stream)) < at.level), axis=0)


def gap(stream: np.ndarray, at: At) -> np.ndarray:
    """A share of a touch's frames is missing in one piece, at a random place in the touch."""
    touch = at.frames
    begin = at.onset + int(at.rng.integers(0, touch))
    return np.concatenate([stream[:begin], stream[begin + round(at.level * touch) :]])


def rate_off(stream: np.ndarray, at: At) -> np.ndarray:
    """Sampled too slowly by the share ``level``; negative: too fast."""
    position = np.arange(0, len(stream) - 1, 1 + at.level)
    lower = position.astype(np.int64)
    part = (position - lower).astype(np.float32)[:, None]
    return stream[lower] * (1 - part) + stream[np.minimum(lower + 1, len(stream) - 1)] * part


def cut_short(stream: np.ndarray, at: At) -> np.ndarray:
    """Streams that end after a share of the touch's steps."""
    config, touches = at.scene.config, at.scene.touches
    last = config.window_spans[max(1, round(at.level * config.windows.steps)) - 1][1]
    if config.follows_touch:  # as much of its length
        last = max(round(at.level * at.frames), config.windows.hop)
    for start in touches.start_frame[touches.recording == at.place]:  # none without a completed step
        stream = stream[: start - 1 + last]
    return stream


def without_lead(stream: np.ndarray, at: At) -> np.ndarray:
    """Streams that begin ``level`` frames before the onset."""
    return stream[max(at.onset - 1 - int(at.level), 0) :]


def overlapped(stream: np.ndarray, at: At) -> np.ndarray:
    """The movement of a recording of another class added after a share of the touch."""
    clean, config = at.scene.clean, at.scene.config
    others = np.roll(clean.labels, -at.place) != clean.labels[at.place]
    partner = (at.place + int(np.argmax(others))) % len(clean)  # itself where there is no other class
    begin = at.onset + round(at.level * at.frames)
    first = max(int(at.scene.onsets[partner]) - config.onset_rule.onset_mean_frames, 1) - 1
    neighbour = clean.recording(partner).astype(np.float32)[first:]
    length = min(max(len(stream) - begin, 0), len(neighbour))
    stream[begin : begin + length] += neighbour[:length] - neighbour[0]
    return stream


# ---------------------------------------------------------------------- disturbances of quiet stretches
def louder(stream: np.ndarray, at: At) -> np.ndarray:
    """Noise and bursts, multiplied by ``level``."""
    rest = stream[: max(at.scene.config.rest_level.rest_frames, 1)].mean(axis=0)
    return np.asarray(rest + at.level * (stream - rest), dtype=np.float32)


def burst(stream: np.ndarray, at: At) -> np.ndarray:
    """Everything before the touch, bursts of the axis's motor included, times ``level``."""
    quiet = max(at.onset - at.scene.config.onset_rule.onset_mean_frames, 0)
    stream[:quiet] = louder(stream, at)[:quiet]
    return stream


def glitch(stream: np.ndarray, at: At) -> np.ndarray:
    """One sample of one taxel off by ``level`` codes; up in one stretch, down in the next."""
    config = at.scene.config
    settled = config.rest_level.rest_frames + config.onset_rule.onset_mean_frames
    frame, taxel = int(at.rng.integers(settled, len(stream))), at.taxels[at.place % len(at.taxels)]
    stream[frame, taxel] += at.level * (1 - 2 * (at.place % 2))
    return stream


def stretches_and_frames(bench: Scene) -> str:
    """Amount of quiet, in words."""
    streams = lead_ins(bench)[0]
    return f"{len(streams)} quiet stretches, {sum(map(len, streams))} frames"


def ramp_in_codes(bench: Scene) -> str:
    """The ramp in codes, beside what the rest level follows, in words."""
    config = bench.config
    tracked = f"tracking follows {config.sensor.scan_rate_hz / 16:.0f} at most"
    return f"{bench.sigma.max():.3g} codes a second; {tracked if config.rest_level.rest == 'tracked' else 'the rest level is not tracked'}"


# ---------------------------------------------------------------------- touches in time
def two_touches(bench: Bench) -> Outcome:
    """Each recording's touch after that of another one, with its own lead-in in between: nine in ten local
    decisions those it had in its own recording."""
    clean, config, numbers = bench.sample.clean, bench.config, np.arange(len(bench.sample.clean))
    # the shift by which most recordings meet one of another class
    shift = np.argmax([np.mean(clean.labels != np.roll(clean.labels, -k)) for k in numbers])
    partners, hop, streams, starts = np.roll(numbers, -shift), config.windows.hop, [], []
    for i, partner in enumerate(partners.tolist()):
        before, after = clean.recording(i), clean.recording(partner)
        # whole hops before it, so that the second touch meets the hops as it did alone
        before = before[: len(before) // hop * hop]
        settle = max(config.rest_level.rest_frames, 1)
        # shifted to the first one's rest level, as on one and the same array
        level = np.rint(before[:settle].mean(axis=0) - after[:settle].mean(axis=0))
        after = after + level.astype(after.dtype)
        quiet = after[: max(int(bench.sample.onsets[partner]) - config.onset_rule.onset_mean_frames, 1)]
        frames = -(-3 * config.onset_rule.rearm_frames // hop) * hop
        between = np.resize(quiet, (frames, config.sensor.taxels)) if len(quiet) >= frames else quiet[:frames]
        streams.append(np.concatenate([before, between, after]))
        starts.append(len(before) + len(between))
    pair = rebuilt(clean, streams, partners)
    (alone, alone_decided), (touches, decided) = bench.decided(clean), bench.decided(pair)
    compared, differing = 0, []
    for i, partner in enumerate(partners.tolist()):
        in_stream = decided.local[(touches.recording == i) & (touches.onset_frame > starts[i])]
        for alone_row in alone_decided.local[alone.recording == partner][:1]:
            compared += 1
            if not len(in_stream) or np.mean(in_stream[0] == alone_row) < 0.9:
                differing.append(i)
    words = f"{len(differing)} of {compared} second touches differ in a tenth of their steps"
    share = (compared - len(differing)) / max(compared, 1)
    return Outcome(share, words, case=Case(pair.subset(differing[:2] or [0])))


def leak_of(bench: Bench, left_in: float = 0.0) -> Leak:
    """Accuracy of the model on the recordings without their touches, except the share ``left_in`` of their
    frames; empty if none has a lead-in."""
    frames = round(left_in * bench.config.last_frame)
    return known_without_touch(bench.model, bench.clean, frames) or Leak(0, 0.0, 1.0)


def without_touch(bench: Bench) -> Outcome:
    """Every touch is replaced by the quiet frames before it, repeated, and the gate opens where it did."""
    leak, shares = bench.remember("leak", lambda: leak_of(bench)), bench.thin(LEFT_IN)
    known = [leak_of(bench.sample, share).accuracy for share in shares]
    drawn = curve("share of the touch left in", "share of recordings known", shares, {"known": known})
    return Outcome(leak.accuracy, f"{leak.recordings} recordings have a quiet lead-in long enough", drawn)
