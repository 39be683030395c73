"""Failure modes of the sensor: taxels dead, stuck, noisy, off in gain or offset, exchanged; and how the fault detector sees them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations

import numpy as np

from eskin.golden.stability.core import ONE_TAXEL_MEAN, ONE_TAXEL_WORST, Bench, Change, Curve, Outcome, disturbed, harmless, mode
from eskin.golden.stability.stream import SHOWS_EVERYTHING, full_scale, last_sample_windows, worst_recordings

TWO_TAXELS_MEAN = 0.90
"""Accuracy that must be left when two taxels are gone, mean over the pairs: less sharp, not broken."""
PAIRS = 28
"""Pairs of taxels tried at most: all of an array of 8."""


# ---------------------------------------------------------------------- disturbances
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


def _masked(bench: Bench, taxels: Sequence[int]) -> Bench:
    return bench.changed({"masked_taxels": tuple(sorted({*bench.config.sensor.masked_taxels, *taxels}))})


def _one_listener(bench: Bench, *, deaf: bool = False) -> Bench:
    """A network that hears one taxel only, or none."""
    heard = bench.live[0]
    arrays = {}
    for gate in bench.config.gates:
        arrays[f"W_{gate}"] = np.zeros_like(bench.model.arrays[f"W_{gate}"])
        if not deaf:
            arrays[f"W_{gate}"][:, heard] = bench.model.arrays[f"W_{gate}"][:, heard]
    return bench.changed(arrays=arrays)


def _undefended(bench: Bench) -> Bench:
    """No detector, no clip, and a network that hears one taxel."""
    return _one_listener(bench).changed({"fault_frames": 0, "clip": 0})


def _shares(bench: Bench, changes: dict[str, tuple[Bench, Change]]) -> dict[str, tuple[float, object]]:
    """Accuracy under each disturbance, by what it is called, and its three worst recordings."""
    found = {}
    for name, (where, change) in changes.items():
        made = disturbed(bench, change)
        decisions = where.decisions(made)
        found[name] = (float(np.mean(decisions == made.labels)), worst_recordings(where, made, decisions))
    return found


def _of_taxels(
    bench: Bench,
    change: Callable[[Bench, int, float], tuple[Bench, Change]],
    nominal: float,
    levels: Sequence[float],
    xlabel: str,
    *,
    mean: bool,
    key: str,
    log: bool = False,
) -> Outcome:
    """Each taxel in turn under ``change(bench, taxel, level)``: the mean over the taxels or the worst one, at the nominal level."""

    def make() -> tuple[dict, dict[str, list[float]]]:
        all_of = _shares(bench, {str(taxel): change(bench, taxel, nominal) for taxel in bench.live})
        lines: dict[str, list[float]] = {"mean": [], "worst taxel": []}
        for level in bench.thin(levels):
            few = bench.sample
            shares = [share for share, _ in _shares(few, {str(taxel): change(few, taxel, level) for taxel in bench.live}).values()]
            lines["mean"].append(float(np.mean(shares)))
            lines["worst taxel"].append(min(shares))
        return all_of, lines

    shares, lines = bench.remember(key, make)
    worst = min(shares, key=lambda name: shares[name][0])
    average = float(np.mean([share for share, _ in shares.values()]))
    order = ("mean", "worst taxel") if mean else ("worst taxel", "mean")
    curve = Curve(xlabel, "accuracy", bench.thin(levels), {name: lines[name] for name in order}, log)
    what = f"taxel {worst}: {shares[worst][0]:.4f}; mean {average:.4f}, clean {bench.clean_accuracy:.4f}"
    return Outcome(average if mean else shares[worst][0], what, curve, shares[worst][1])


BEGINS = (0.9, 0.75, 0.5, 0.25, 0.1, 0.0, -0.1)
"""Where in the touch a taxel fails, in touch lengths after the onset; later is milder."""


def _dead(where: Bench, taxel: int, since: float) -> tuple[Bench, Change]:
    return where, held(where, [taxel], "rest", since)


def _stuck(level: str) -> Callable[[Bench, int, float], tuple[Bench, Change]]:
    return lambda where, taxel, since: (where, held(where, [taxel], level, since))


@mode(
    "one dead taxel, mean",
    "sensor",
    unit="accuracy",
    at_least=ONE_TAXEL_MEAN,
    because="one of many taxels fails sooner or later; the array must go on",
    broken=("a network that hears one taxel", _one_listener),
)
def dead_mean(bench: Bench) -> Outcome:
    """Each taxel in turn rests without a sound from shortly before the touch on: mean over the taxels. Curve: when it dies."""
    return _of_taxels(bench, _dead, -0.1, BEGINS, "touch lengths from the onset to the failure", mean=True, key="dead")


@mode(
    "one dead taxel, worst",
    "sensor",
    unit="accuracy",
    at_least=ONE_TAXEL_WORST,
    because="no single taxel may carry the decision",
    broken=("a network that hears one taxel", _one_listener),
)
def dead_worst(bench: Bench) -> Outcome:
    """The same, the taxel that is missed most."""
    return _of_taxels(bench, _dead, -0.1, BEGINS, "touch lengths from the onset to the failure", mean=False, key="dead")


@mode(
    "one taxel stuck at full scale, masked, mean",
    "sensor",
    unit="accuracy",
    at_least=ONE_TAXEL_MEAN,
    because="once masked a stuck taxel is a dead one",
    broken=("a network that hears one taxel", _one_listener),
)
def masked_mean(bench: Bench) -> Outcome:
    """Each taxel in turn at the highest code from shortly before the touch on, its mask bit set: mean over the taxels."""
    return _of_taxels(bench, _stuck_masked, -0.1, BEGINS, "touch lengths from the onset to the failure", mean=True, key="masked")


@mode(
    "one taxel stuck at full scale, masked, worst",
    "sensor",
    unit="accuracy",
    at_least=ONE_TAXEL_WORST,
    because="once masked a stuck taxel is a dead one",
    broken=("a network that hears one taxel", _one_listener),
)
def masked_worst(bench: Bench) -> Outcome:
    """The same, the worst taxel."""
    return _of_taxels(bench, _stuck_masked, -0.1, BEGINS, "touch lengths from the onset to the failure", mean=False, key="masked")


def _stuck_masked(where: Bench, taxel: int, since: float) -> tuple[Bench, Change]:
    return _masked(where, [taxel]), held(where, [taxel], "high", since)


@mode(
    "one taxel stuck high from power-on",
    "sensor",
    unit="accuracy",
    at_least=ONE_TAXEL_WORST,
    because="a level that never moves is removed with the rest level or masked",
    broken=("a network that hears one taxel", _one_listener),
)
def stuck_from_start(bench: Bench) -> Outcome:
    """Each taxel in turn at the highest code from the first frame on: the worst one."""

    def stuck(where: Bench, taxel: int, level: float) -> tuple[Bench, Change]:
        return where, held(where, [taxel], "high", None)

    return _of_taxels(bench, stuck, 0, (0,), "from the first frame on", mean=False, key="stuck from start")


@mode(
    "one taxel sticks high in the touch",
    "sensor",
    unit="accuracy",
    at_least=ONE_TAXEL_WORST,
    because="the detector must find and mask it while the vote can still be saved",
    broken=("no detector, and a network that hears one taxel", _undefended),
    detector=True,
)
def stuck_high(bench: Bench) -> Outcome:
    """Each taxel in turn jumps to the highest code a quarter into the touch and stays: the worst one. Curve: when it sticks."""
    return _of_taxels(bench, _stuck("high"), 0.25, BEGINS, "touch lengths from the onset to the failure", mean=False, key="stuck high")


@mode(
    "one taxel sticks low in the touch",
    "sensor",
    unit="accuracy",
    at_least=ONE_TAXEL_WORST,
    because="the detector must find and mask it while the vote can still be saved",
    broken=("no detector, and a network that hears one taxel", _undefended),
    detector=True,
)
def stuck_low(bench: Bench) -> Outcome:
    """Each taxel in turn falls to the lowest code a quarter into the touch and stays: the worst one."""
    return _of_taxels(bench, _stuck("low"), 0.25, BEGINS, "touch lengths from the onset to the failure", mean=False, key="stuck low")


@mode(
    "one taxel sticks high at the onset",
    "sensor",
    unit="accuracy",
    at_least=ONE_TAXEL_WORST,
    because="the same bound as later in the touch: the first windows are lost until the detector has seen a whole block",
    broken=("no detector, and a network that hears one taxel", _undefended),
    detector=True,
)
def stuck_at_onset(bench: Bench) -> Outcome:
    """Each taxel in turn jumps to the highest code with the onset and stays: the worst one."""
    return _of_taxels(bench, _stuck("high"), 0.0, BEGINS, "touch lengths from the onset to the failure", mean=False, key="stuck at onset")


@mode(
    "one taxel sticks high before the touch",
    "sensor",
    unit="accuracy",
    at_least=ONE_TAXEL_WORST,
    onset=True,
    because="a jump of one taxel is an onset to the rule: the touch it opens must not swallow the real one",
    broken=("no detector, and a network that hears one taxel", _undefended),
    detector=True,
)
def stuck_before(bench: Bench) -> Outcome:
    """Each taxel in turn jumps to the highest code a fifth of a touch before the onset: the worst one; the first touch decides."""
    return _of_taxels(
        bench,
        _stuck("high"),
        -0.2,
        (-0.05, -0.1, -0.2, -0.4),
        "touch lengths from the onset to the failure",
        mean=False,
        key="stuck before",
    )


@mode(
    "two taxels dead",
    "sensor",
    unit="accuracy",
    at_least=TWO_TAXELS_MEAN,
    because="with two gone the array is less sharp, not broken",
    broken=("a network that hears one taxel", _one_listener),
)
def two_dead(bench: Bench) -> Outcome:
    """Every pair of taxels dead from shortly before the touch on: mean over the pairs. Curve: number of dead taxels."""
    pairs = list(combinations(bench.live, 2))
    pairs = [pairs[i] for i in np.sort(bench.rng(5).permutation(len(pairs))[:PAIRS])]
    shares = _shares(bench, {f"{a} and {b}": (bench, held(bench, [a, b], "rest", -0.1)) for a, b in pairs})
    worst = min(shares, key=lambda name: shares[name][0])
    counts, line = bench.thin(range(0, len(bench.live))), []
    for count in counts:
        some = [bench.rng(6, count, k).permutation(bench.live)[:count].tolist() for k in range(4)]
        line.append(float(np.mean([bench.sample.accuracy(disturbed(bench.sample, held(bench, taxels, "rest", -0.1))) for taxels in some])))
    average = float(np.mean([share for share, _ in shares.values()]))
    what = f"taxels {worst}: {shares[worst][0]:.4f}; mean of {len(pairs)} pairs {average:.4f}"
    return Outcome(average, what, Curve("dead taxels", "accuracy", counts, {"mean": line}), shares[worst][1])


# ---------------------------------------------------------------------- noise, gain, offset
def _noise(where: Bench, taxel: int, level: float) -> tuple[Bench, Change]:
    def change(stream, onset, rng):
        quiet = stream[: max(onset - where.config.onset_rule.onset_mean_frames, 32)]
        stream[:, taxel] += level * quiet[:, taxel].std() * rng.standard_normal(len(stream)).astype(np.float32)
        return stream

    return where, change


@mode(
    "one noisy taxel",
    "sensor",
    unit="accuracy",
    at_least=harmless,
    because="a loose contact is several times noisier than the rest; the window mean must hold it",
    broken=("a window is one sample", lambda bench: bench.changed({"clip": 0}, find_touches=last_sample_windows)),
)
def noisy(bench: Bench) -> Outcome:
    """White noise of three times its own rest noise on each taxel in turn: the worst one."""
    return _of_taxels(bench, _noise, 3.0, (1, 2, 3, 5, 10, 20), "noise / rest noise", mean=False, key="noise", log=True)


def _gain(where: Bench, taxel: int, level: float) -> tuple[Bench, Change]:
    def change(stream, onset, rng):
        level_of = rest_of(stream, where)[taxel]
        stream[:, taxel] = level_of + (1 + level) * (stream[:, taxel] - level_of)
        return stream

    return where, change


@mode(
    "gain of one taxel 20 % high",
    "sensor",
    unit="accuracy",
    at_least=harmless,
    because="taxels of one film differ by as much",
    broken=("every feature at full scale", full_scale),
)
def gain_high(bench: Bench) -> Outcome:
    """Each taxel in turn 20 % more sensitive: the worst one."""
    return _of_taxels(bench, _gain, 0.2, (0.1, 0.2, 0.5, 1.0, 3.0), "gain error", mean=False, key="gain high")


@mode(
    "gain of one taxel 20 % low",
    "sensor",
    unit="accuracy",
    at_least=harmless,
    because="taxels of one film differ by as much, and they age",
    broken=("every feature at full scale", full_scale),
)
def gain_low(bench: Bench) -> Outcome:
    """Each taxel in turn 20 % less sensitive: the worst one."""
    return _of_taxels(bench, _gain, -0.2, (-0.1, -0.2, -0.4, -0.6, -0.8), "gain error", mean=False, key="gain low")


@mode(
    "gains of all taxels within 20 %",
    "sensor",
    unit="accuracy",
    at_least=harmless,
    because="another film of the same make",
    broken=("every feature at full scale", full_scale),
)
def gains(bench: Bench) -> Outcome:
    """Every taxel with a gain of its own, drawn within +-20 %, one draw a recording."""

    def change(level: float) -> Change:
        def scale(stream, onset, rng):
            level_of = rest_of(stream, bench)
            return level_of + (1 + level * rng.uniform(-1, 1, stream.shape[1])).astype(np.float32) * (stream - level_of)

        return scale

    return _whole(bench, change, 0.2, (0.1, 0.2, 0.4, 0.6, 0.9), "largest gain error", "within 20 %")


def _whole(bench: Bench, change, nominal: float, levels: Sequence[float], xlabel: str, what: str, *, log: bool = False) -> Outcome:
    made = disturbed(bench, change(nominal))
    decisions = bench.decisions(made)
    levels = bench.thin(levels)
    line = [bench.sample.accuracy(disturbed(bench.sample, change(level))) for level in levels]
    text = f"{what}; clean {bench.clean_accuracy:.4f}"
    return Outcome(
        float(np.mean(decisions == made.labels)),
        text,
        Curve(xlabel, "accuracy", levels, {"accuracy": line}, log),
        worst_recordings(bench, made, decisions),
    )


def _offset(where: Bench, taxel: int, level: float) -> tuple[Bench, Change]:
    def change(stream, onset, rng):
        stream[max(onset - 1, 0) :, taxel] += level * where.sigma
        return stream

    return where, change


@mode(
    "offset of one taxel by one deviation up",
    "sensor",
    unit="accuracy",
    at_least=ONE_TAXEL_WORST,
    because="an offset that comes with the touch cannot be told from it: it may not cost more than the taxel itself",
    broken=("a network that hears one taxel", _one_listener),
)
def offset_up(bench: Bench) -> Outcome:
    """Each taxel in turn shifted up by one standard deviation of the features at the onset: the worst one."""
    return _of_taxels(
        bench, _offset, 1.0, (0.25, 0.5, 1.0, 2.0, 4.0), "offset (standard deviations of the features)", mean=False, key="offset up"
    )


@mode(
    "offset of one taxel by one deviation down",
    "sensor",
    unit="accuracy",
    at_least=ONE_TAXEL_WORST,
    because="an offset that comes with the touch cannot be told from it: it may not cost more than the taxel itself",
    broken=("a network that hears one taxel", _one_listener),
)
def offset_down(bench: Bench) -> Outcome:
    """Each taxel in turn shifted down by one standard deviation of the features at the onset: the worst one."""
    return _of_taxels(
        bench, _offset, -1.0, (-0.25, -0.5, -1.0, -2.0, -4.0), "offset (standard deviations of the features)", mean=False, key="offset down"
    )


@mode(
    "offset of all taxels at the onset",
    "sensor",
    unit="accuracy",
    at_least=harmless,
    because="a supply step of a quarter of the features' deviation is seen by every taxel alike",
    broken=("every feature at full scale", full_scale),
)
def offset_all(bench: Bench) -> Outcome:
    """All taxels shifted together by a quarter of the features' standard deviation at the onset."""

    def change(level: float) -> Change:
        def add(stream, onset, rng):
            stream[max(onset - 1, 0) :] += level * bench.sigma
            return stream

        return add

    return _whole(bench, change, 0.25, (0.125, 0.25, 0.5, 1.0, 2.0), "offset (standard deviations of the features)", "a quarter", log=True)


@mode(
    "clipped signals",
    "sensor",
    unit="accuracy",
    at_least=ONE_TAXEL_WORST,
    because="an amplifier has room for four deviations of the features; what stays at a limit for a whole block is masked as stuck",
    broken=("every feature at full scale", full_scale),
)
def clipped(bench: Bench) -> Outcome:
    """Every taxel limited to four standard deviations of the features around its rest level."""

    def change(level: float) -> Change:
        def limit(stream, onset, rng):
            middle = rest_of(stream, bench)
            return np.clip(stream, middle - level * bench.sigma, middle + level * bench.sigma)

        return limit

    return _whole(bench, change, 4.0, (8, 4, 2, 1, 0.5, 0.25), "limit (deviations of the features)", "four deviations", log=True)


@mode(
    "spikes",
    "sensor",
    unit="accuracy",
    at_least=harmless,
    because="recordings hold spikes of a few samples; the clip and the window mean must hold them",
    broken=SHOWS_EVERYTHING,
)
def spikes(bench: Bench) -> Outcome:
    """One sample in a hundred of every taxel off by 3000 codes, either way, from the onset on."""

    def change(level: float) -> Change:
        def add(stream, onset, rng):
            size = stream[onset - 1 :].shape
            stream[onset - 1 :] += 3000 * (rng.random(size) < level) * np.sign(rng.standard_normal(size))
            return stream

        return add

    return _whole(bench, change, 0.01, (0.003, 0.01, 0.03, 0.1, 0.3), "share of samples", "one in a hundred", log=True)


@mode(
    "two taxels exchanged",
    "sensor",
    unit="accuracy",
    at_least=0.5,
    because="nothing defends against a wiring mistake, which installation finds; at half of the decisions the array is of no use",
    broken=("a network that hears nothing", lambda bench: _one_listener(bench, deaf=True)),
)
def exchanged(bench: Bench) -> Outcome:
    """Every pair of taxels exchanged: mean over the pairs. Curve: taxels that changed places."""

    def swap(order: Sequence[int]) -> Change:
        return lambda stream, onset, rng: stream[:, list(order)]

    def pair(a: int, b: int) -> list[int]:
        order = list(range(bench.config.sensor.taxels))
        order[a], order[b] = b, a
        return order

    pairs = list(combinations(bench.live, 2))
    pairs = [pairs[i] for i in np.sort(bench.rng(7).permutation(len(pairs))[:PAIRS])]
    shares = _shares(bench, {f"{a} and {b}": (bench, swap(pair(a, b))) for a, b in pairs})
    worst = min(shares, key=lambda name: shares[name][0])
    counts, line = bench.thin(range(0, len(bench.live) + 1, 2)), []
    for count in counts:
        accuracies = []
        for k in range(4):
            order, moved = list(range(bench.config.sensor.taxels)), bench.rng(8, count, k).permutation(bench.live)[:count].tolist()
            for source, target in zip(moved, [*moved[1:], *moved[:1]], strict=True):
                order[target] = source
            accuracies.append(bench.sample.accuracy(disturbed(bench.sample, swap(order))))
        line.append(float(np.mean(accuracies)))
    average = float(np.mean([share for share, _ in shares.values()]))
    what = f"taxels {worst}: {shares[worst][0]:.4f}; mean of {len(pairs)} pairs {average:.4f}"
    return Outcome(average, what, Curve("taxels that changed places", "accuracy", counts, {"mean": line}), shares[worst][1])


# ---------------------------------------------------------------------- the detector
def _no_detector(bench: Bench) -> Bench:
    return bench.changed({"fault_frames": 0})


def _found(bench: Bench, level: str, since: float, within: int) -> float:
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


@mode(
    "failed taxels not found",
    "sensor",
    unit="share missed within two blocks",
    at_most=0.0,
    because="the detector judges whole blocks: a taxel that sticks is in one by the end of the next",
    broken=("no detector", _no_detector),
    detector=True,
)
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


@mode(
    "sound taxels masked",
    "sensor",
    unit="share of recordings with a flag",
    at_most=0.0,
    because="a detector that masks what is sound does more harm than good",
    broken=(
        "a detector that takes rest noise for silence",
        lambda bench: bench.changed(
            {"fault_frames": max(bench.config.faults.fault_frames, bench.config.onset_rule.onset_check_frames, 16), "fault_activity": 65535}
        ),
    ),
    detector=True,
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
