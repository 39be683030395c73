"""Disturbances of the sensor: taxels dead, stuck, noisy, off in gain or offset, exchanged; and how the fault
detector sees them."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from eskin.golden.data import Recordings
from eskin.study.stability.core import Bench, Change, Curve, Outcome, Scene, disturbed

SPIKE_CODES = 3000
"""The largest spikes in the recordings of PVDF taxels are about as large."""


# ---------------------------------------------------------------------- one taxel
def rest_of(stream: np.ndarray, bench: Scene) -> np.ndarray:
    """Rest level of each taxel: the median of the first frames."""
    return np.median(stream[: max(bench.config.rest_level.rest_frames, 5)], axis=0)


def stuck_taxels(bench: Scene, taxels: Sequence[int], level: str, since: float | None) -> Change:
    """Taxels held at ``rest``, ``high`` or ``low`` (ends of the code range): from the first frame (None),
    or from ``since`` touch lengths after the onset on."""
    fmt = bench.config.sample_format

    def change(stream: np.ndarray, onset: int, rng: np.random.Generator) -> np.ndarray:
        begin = 0 if since is None else max(0, onset - 1 + round(since * bench.config.last_frame))
        columns = list(taxels)
        stream[begin:, columns] = {"high": fmt.max_code, "low": fmt.min_code}.get(
            level, rest_of(stream, bench)[columns]
        )
        return stream

    return change


def stuck(level: str) -> Callable[[Scene, float, Sequence[int]], Change]:
    """Taxels at an end of their range, or at their rest level without noise, from ``since`` touch lengths after
    the onset on."""
    return lambda bench, since, taxels: stuck_taxels(bench, taxels, level, since)


def stuck_from_start(bench: Scene, level: float, taxels: Sequence[int]) -> Change:
    """Taxels at the highest code from the first frame on."""
    return stuck_taxels(bench, taxels, "high", None)


def noisy(bench: Scene, level: float, taxels: Sequence[int]) -> Change:
    """White noise of ``level`` times the taxels' own rest noise."""

    def change(stream, onset, rng):
        quiet = stream[: max(onset - bench.config.onset_rule.onset_mean_frames, 32), taxels]
        noise = rng.standard_normal((len(stream), len(taxels))).astype(np.float32)
        stream[:, taxels] += level * quiet.std(axis=0) * noise
        return stream

    return change


def gain_off(bench: Scene, level: float, taxels: Sequence[int]) -> Change:
    """Taxels that are more sensitive by the share ``level``."""

    def change(stream, onset, rng):
        level_of = rest_of(stream, bench)[taxels]
        stream[:, taxels] = level_of + (1 + level) * (stream[:, taxels] - level_of)
        return stream

    return change


def offset(bench: Scene, level: float, taxels: Sequence[int]) -> Change:
    """Taxels shifted together by ``level`` standard deviations of the features at the onset."""

    def add(stream, onset, rng):
        stream[max(onset - 1, 0) :, taxels] += level * bench.sigma[list(taxels)]
        return stream

    return add


# ---------------------------------------------------------------------- several taxels, or all
def dead_together(bench: Scene, count: float, taxels: Sequence[int]) -> Change:
    """Taxels that rest from shortly before the touch on."""
    return stuck_taxels(bench, taxels, "rest", -0.1)


def exchanged(bench: Scene, count: float, taxels: Sequence[int]) -> Change:
    """Each taxel in the place of the one before it, the first in that of the last."""
    order = list(range(bench.config.sensor.taxels))
    for source, target in zip(taxels, [*taxels[1:], *taxels[:1]], strict=True):
        order[target] = source
    return lambda stream, onset, rng: stream[:, order]


def gains(bench: Scene, level: float, taxels: Sequence[int]) -> Change:
    """Every taxel with its own gain, drawn within +-level."""

    def scale(stream, onset, rng):
        level_of = rest_of(stream, bench)
        return level_of + (1 + level * rng.uniform(-1, 1, stream.shape[1])).astype(np.float32) * (
            stream - level_of
        )

    return scale


def clipped(bench: Scene, level: float, taxels: Sequence[int]) -> Change:
    """Every taxel limited to ``level`` standard deviations of the features around its rest level."""

    def limit(stream, onset, rng):
        middle = rest_of(stream, bench)
        return np.clip(stream, middle - level * bench.sigma, middle + level * bench.sigma)

    return limit


def spikes(bench: Scene, level: float, taxels: Sequence[int]) -> Change:
    """A share of the samples off by ``SPIKE_CODES``, either way, from the onset on."""

    def add(stream, onset, rng):
        size = stream[onset - 1 :].shape
        stream[onset - 1 :] += SPIKE_CODES * (rng.random(size) < level) * np.sign(rng.standard_normal(size))
        return stream

    return add


# ---------------------------------------------------------------------- the detector
def _missed(bench: Bench, level: str, within: int) -> float:
    """Share of recordings, for the worst taxel, in which a taxel that fails a quarter into the touch is not
    flagged within the given number of frames, or another taxel is flagged."""
    shares = [0.0]
    begin = np.maximum(0, bench.onsets - 1 + round(0.25 * bench.config.last_frame))
    for taxel in bench.live:
        recordings = disturbed(bench, stuck_taxels(bench, [taxel], level, 0.25))
        flagged = bench.parts.find_touches(bench.config, recordings, steps=0).flagged
        if flagged is None:
            return 1.0
        alive = recordings.lengths >= begin + within
        its_own = (flagged[:, taxel] > 0) & (flagged[:, taxel] <= begin + within)
        other_flags = np.delete(flagged, taxel, axis=1).any(axis=1)
        shares.append(1 - float(np.mean((its_own & ~other_flags)[alive])) if alive.any() else 1.0)
    return max(shares)


def missed(bench: Bench) -> Outcome:
    """Each taxel in turn sticks at an end of its range or at its rest level, a quarter into the touch: flags
    not raised within two blocks of the detector, or raised for another taxel; the worst taxel and level.
    Curve: within how many frames."""
    few, fault_frames = bench.sample, bench.config.faults.fault_frames
    block = fault_frames or 64
    shares = {level: _missed(few, level, 2 * block) for level in ("high", "low", "rest")}
    frames = bench.thin([4 * block, 2 * block, 3 * block // 2, block, block // 2])
    line = [max(_missed(few, level, int(frame)) for level in ("high", "rest")) for frame in frames]
    worst = max(shares, key=shares.__getitem__)
    words = f"stuck {worst}: {shares[worst]:.4f}; {f'{fault_frames} frames' if fault_frames else 'no detector'} a block"
    return Outcome(
        shares[worst], words, Curve("frames after the failure", "share missed", frames, {"missed": line})
    )


def false_alarms(bench: Bench) -> Outcome:
    """Undisturbed recordings, to their very end, in which a fault flag is raised. Curve: rest noise and
    signal reduced by a factor."""

    def share(where: Bench, recordings: Recordings) -> float:
        flagged = where.parts.find_touches(where.config, recordings, steps=0).flagged
        return 0.0 if flagged is None else float(np.mean(flagged.any(axis=1)))

    def faint(stream, onset, rng, gain: float):
        return rest_of(stream, bench) + gain * (stream - rest_of(stream, bench))

    few, amplitudes = bench.sample, bench.thin([1.0, 0.7, 0.5, 0.35, 0.25, 0.15])
    line = [
        share(few, few.clean if gain == 1 else disturbed(few, partial(faint, gain=gain)))
        for gain in amplitudes
    ]
    first = next((gain for gain, flagged in zip(amplitudes, line, strict=True) if flagged > 0), None)
    words = f"none until noise and signal fall to {first:g}" if first else "none on the whole curve"
    curve = Curve("amplitude / recorded", "share with a flag", amplitudes, {"flagged": line})
    return Outcome(share(bench, bench.recordings), f"{len(bench.recordings)} recordings; {words}", curve)
