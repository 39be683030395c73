"""Disturbances of the sensor: taxels dead, stuck, noisy, off in gain or offset, exchanged; and how the fault detector sees them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from eskin.golden.stability.core import Bench, Change, Curve, Outcome, disturbed

SPIKE_CODES = 3000
"""The largest spikes in the recordings of PVDF taxels are about as large."""

TaxelChange = Callable[[Bench, int, float], tuple[Bench, Change]]
"""(bench, taxel, level) -> (the bench that decides, the disturbance)."""


# ---------------------------------------------------------------------- one taxel
def rest_of(stream: np.ndarray, bench: Bench) -> np.ndarray:
    """Rest level of each taxel: the median of the first frames."""
    return np.median(stream[: max(bench.config.rest_level.rest_frames, 5)], axis=0)


def held(bench: Bench, taxels: Sequence[int], level: str, since: float | None) -> Change:
    """Taxels held at ``rest``, ``high`` or ``low`` (ends of the code range): from the first frame (None), or from so many touch lengths
    after the onset on."""
    fmt = bench.config.sample_format

    def change(stream: np.ndarray, onset: int, rng: np.random.Generator) -> np.ndarray:
        begin = 0 if since is None else max(0, onset - 1 + round(since * bench.config.last_frame))
        columns = list(taxels)
        stream[begin:, columns] = {"high": fmt.max_code, "low": fmt.min_code}.get(level, rest_of(stream, bench)[columns])
        return stream

    return change


def dead(where: Bench, taxel: int, since: float) -> tuple[Bench, Change]:
    """A taxel that rests without a sound from so many touch lengths after the onset on."""
    return where, held(where, [taxel], "rest", since)


def stuck(level: str) -> TaxelChange:
    """A taxel at an end of its range from so many touch lengths after the onset on."""
    return lambda where, taxel, since: (where, held(where, [taxel], level, since))


def stuck_from_start(where: Bench, taxel: int, level: float) -> tuple[Bench, Change]:
    """A taxel at the highest code from the first frame on."""
    return where, held(where, [taxel], "high", None)


def stuck_and_masked(where: Bench, taxel: int, since: float) -> tuple[Bench, Change]:
    """A taxel at the highest code whose mask bit is set."""
    masked = where.changed({"masked_taxels": tuple(sorted({*where.config.sensor.masked_taxels, taxel}))})
    return masked, held(where, [taxel], "high", since)


def noisy(where: Bench, taxel: int, level: float) -> tuple[Bench, Change]:
    """White noise of ``level`` times the taxel's own rest noise."""

    def change(stream, onset, rng):
        quiet = stream[: max(onset - where.config.onset_rule.onset_mean_frames, 32)]
        stream[:, taxel] += level * quiet[:, taxel].std() * rng.standard_normal(len(stream)).astype(np.float32)
        return stream

    return where, change


def gain_off(where: Bench, taxel: int, level: float) -> tuple[Bench, Change]:
    """A taxel that is more sensitive by the share ``level``."""

    def change(stream, onset, rng):
        level_of = rest_of(stream, where)[taxel]
        stream[:, taxel] = level_of + (1 + level) * (stream[:, taxel] - level_of)
        return stream

    return where, change


def offset(where: Bench, taxel: int, level: float) -> tuple[Bench, Change]:
    """A taxel shifted by so many standard deviations of the features at the onset."""

    def change(stream, onset, rng):
        stream[max(onset - 1, 0) :, taxel] += level * where.sigma
        return stream

    return where, change


# ---------------------------------------------------------------------- several taxels, or all
def dead_together(bench: Bench, taxels: Sequence[int]) -> Change:
    """Taxels that rest from shortly before the touch on."""
    return held(bench, taxels, "rest", -0.1)


def exchanged(bench: Bench, taxels: Sequence[int]) -> Change:
    """Each taxel in the place of the one before it, the first in that of the last."""
    order = list(range(bench.config.sensor.taxels))
    for source, target in zip(taxels, [*taxels[1:], *taxels[:1]], strict=True):
        order[target] = source
    return lambda stream, onset, rng: stream[:, order]


def gains(bench: Bench, level: float) -> Change:
    """Every taxel with a gain of its own, drawn within +-level."""

    def scale(stream, onset, rng):
        level_of = rest_of(stream, bench)
        return level_of + (1 + level * rng.uniform(-1, 1, stream.shape[1])).astype(np.float32) * (stream - level_of)

    return scale


def offset_of_all(bench: Bench, level: float) -> Change:
    """All taxels shifted by so many standard deviations of the features at the onset."""

    def add(stream, onset, rng):
        stream[max(onset - 1, 0) :] += level * bench.sigma
        return stream

    return add


def clipped(bench: Bench, level: float) -> Change:
    """Every taxel limited to so many standard deviations of the features around its rest level."""

    def limit(stream, onset, rng):
        middle = rest_of(stream, bench)
        return np.clip(stream, middle - level * bench.sigma, middle + level * bench.sigma)

    return limit


def spikes(bench: Bench, level: float) -> Change:
    """A share of the samples off by ``SPIKE_CODES``, either way, from the onset on."""

    def add(stream, onset, rng):
        size = stream[onset - 1 :].shape
        stream[onset - 1 :] += SPIKE_CODES * (rng.random(size) < level) * np.sign(rng.standard_normal(size))
        return stream

    return add


# ---------------------------------------------------------------------- the detector
def _found(bench: Bench, level: str, since: float, within: float) -> float:
    """Share of failed taxels whose flag is raised within ``within`` frames of the failure; no other taxel's flag may be."""
    found = []
    for taxel in bench.live:
        made = disturbed(bench, held(bench, [taxel], level, since))
        flagged = bench.parts.find_touches(bench.config, made, steps=0).flagged
        begin = np.maximum(0, bench.onsets - 1 + round(since * bench.config.last_frame))
        if flagged is None:
            found.append(0.0)
            continue
        alive = made.lengths >= begin + within
        mine = (flagged[:, taxel] > 0) & (flagged[:, taxel] <= begin + within)
        others = np.delete(flagged, taxel, axis=1).any(axis=1)
        found.append(float(np.mean((mine & ~others)[alive])) if alive.any() else 0.0)
    return min(found)


def missed(bench: Bench) -> Outcome:
    """Each taxel in turn sticks at an end of its range or at its rest level, a quarter into the touch: flags not raised within two blocks
    of the detector, or raised for another taxel; the worst taxel and level. Curve: within how many frames."""
    block = bench.config.faults.fault_frames or 64
    few = bench.sample
    share = {level: 1 - _found(few, level, 0.25, 2 * block) for level in ("high", "low", "rest")}
    frames = bench.thin([4 * block, 2 * block, 3 * block // 2, block, block // 2])
    line = [max(1 - _found(few, level, 0.25, frame) for level in ("high", "rest")) for frame in frames]
    worst = max(share, key=share.__getitem__)
    blocks = f"{bench.config.faults.fault_frames} frames" if bench.config.faults.fault_frames else "no detector"
    return Outcome(
        share[worst],
        f"stuck {worst}: {share[worst]:.4f}; {blocks} a block",
        Curve("frames after the failure", "share missed", frames, {"missed": line}),
    )


def false_alarms(bench: Bench) -> Outcome:
    """Undisturbed recordings, to their very end, in which a fault flag is raised. Curve: rest noise and signal reduced by a factor."""

    def share(where: Bench, gain: float) -> float:
        made = disturbed(where, lambda s, onset, rng: rest_of(s, where) + gain * (s - rest_of(s, where))) if gain != 1 else where.clean
        flagged = where.parts.find_touches(where.config, made, steps=0).flagged
        return 0.0 if flagged is None else float(np.mean(flagged.any(axis=1)))

    flagged = bench.parts.find_touches(bench.config, bench.recordings, steps=0).flagged
    value = 0.0 if flagged is None else float(np.mean(flagged.any(axis=1)))
    gains_ = bench.thin([1.0, 0.7, 0.5, 0.35, 0.25, 0.15])
    line = [share(bench.sample, gain) for gain in gains_]
    first = next((g for g, s in zip(gains_, line, strict=True) if s > 0), None)
    what = f"none until noise and signal fall to {first:g}" if first else "none on the whole curve"
    return Outcome(
        value, f"{len(bench.recordings)} recordings; {what}", Curve("amplitude / recorded", "share with a flag", gains_, {"flagged": line})
    )
