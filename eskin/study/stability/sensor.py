"""Disturbances of the sensor: taxels dead, stuck, noisy, off in gain or offset, exchanged; and how the fault
detector sees them."""

from functools import partial

import numpy as np

from eskin.golden.core import AcceleratorConfig
from eskin.golden.data import Recordings
from eskin.golden.model import preprocess
from eskin.study.stability.core import At, Bench, Outcome, Scene, curve, disturbed

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
    begin = max(0, at.onset - 1 + round(at.level * config.last_frame))
    held = {"high": config.sample_format.max_code, "low": config.sample_format.min_code}
    stream[begin:, columns] = held.get(end, rest_of(stream, at.scene)[columns])
    return stream


def stuck_from_start(stream: np.ndarray, at: At) -> np.ndarray:
    """Taxels at the highest code from the first frame on."""
    stream[:, at.taxels] = at.scene.config.sample_format.max_code
    return stream


def noisy(stream: np.ndarray, at: At) -> np.ndarray:
    """White noise of ``level`` times the taxels' own rest noise."""
    quiet = stream[: max(at.onset - at.scene.config.onset_rule.onset_mean_frames, 32), at.taxels]
    noise = at.rng.standard_normal((len(stream), len(at.taxels))).astype(np.float32)
    stream[:, at.taxels] += at.level * quiet.std(axis=0) * noise
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
    """Each taxel in the place of the one before it, the first in that of the last."""
    stream[:, at.taxels] = stream[:, [*at.taxels[-1:], *at.taxels[:-1]]]
    return stream


def gains(stream: np.ndarray, at: At) -> np.ndarray:
    """Every taxel with its own gain, drawn within +-level."""
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
