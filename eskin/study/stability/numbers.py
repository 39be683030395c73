"""Failure modes of a network's numbers: roundings that pile up, ranges, and single bit flips in weights, tables,
constants, configuration and state."""

import contextlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from eskin.golden.core import AcceleratorConfig, Arrays, InputError, QFormat, Record
from eskin.golden.model import (
    Fixed,
    FloatModel,
    constants_shape,
    network_formats,
    network_shapes,
    pipeline,
    preprocess,
)
from eskin.study.stability.core import COMMON_OFFSET, Bench, Case, Outcome, agreement, curve

GROWTH_STEPS = (20, 200, 2000, 20000)
SEQUENCES = 32
"""Sequences that run without a reset."""


def amplified(config: AcceleratorConfig, sums: np.ndarray, gain: float) -> np.ndarray:
    """Sums that the windows would have (as ``sums``, int64) if the touches were ``gain`` times as strong;
    clipped to +-2**40."""
    scaled = np.clip(np.rint(sums * gain), -(2**40), 2**40).astype(np.int64)
    features = config.features
    integral = [features.feature_kinds[kind] == "integral" for kind in config.input_kinds]
    # A gain acts on the integral, not on its logarithm: undo the companding, amplify, compand again. Other sums
    # are no logarithms, and would be too large for it.
    logarithms = sums[..., integral]
    unit = 1 << features.integral_frac
    whole, part = np.divmod(np.abs(logarithms), unit)
    before = np.sign(logarithms) * (
        (unit + part) * 2.0 ** (whole + features.integral_knee - features.integral_frac)
        - 2.0**features.integral_knee
    )
    scaled[..., integral] = preprocess.companded(
        np.rint(gain * before).astype(np.int64), features.integral_knee, features.integral_frac
    )
    return scaled


def _ideal(bench: Bench, codes: np.ndarray) -> np.ndarray:
    """h' in real arithmetic of the very weights and features that the integers stand for."""
    config, constants = bench.config, constants_shape(bench.config)
    real = {name: fmt.to_real(bench.model.arrays[name]) for name, fmt in network_formats(config).items()}
    second = network_shapes(config, real=True).keys() - real.keys()
    real |= {name: np.zeros_like(real["b_n"]) for name in second}
    real |= {"mu": np.zeros(constants), "sigma": np.ones(constants)}
    return FloatModel(config, real).forward(config.formats.feature_format.to_real(codes))[0]


def _endless(bench: Bench, steps: int) -> np.ndarray:
    """(SEQUENCES, steps, D) feature codes: touches of the recordings one after the other, in random order."""
    codes = bench.codes[bench.touches.completed == bench.config.windows.steps]
    if not len(codes):
        raise InputError("stability: no touch has all its steps; use whole recordings")
    order = bench.rng(1).integers(0, len(codes), (SEQUENCES, -(-steps // bench.config.windows.steps)))
    return codes[order].reshape(SEQUENCES, -1, codes.shape[2])[:, :steps]


def growth(bench: Bench) -> Outcome:
    """Error of the hidden state against real arithmetic with the same weights, root mean square over the last
    touch's worth of steps, over touches strung together without a reset: the median of the sequences, the
    largest of steps 200 to 20000 over the figure of step 20.

    The median, because a touch that follows another one without a reset can bring a sequence to a point where
    the real network itself decides by a hair: there the two part for some steps, whatever the arithmetic. The
    curve shows the worst sequence too.
    """
    config, steps = bench.config, [t for t in GROWTH_STEPS if t <= bench.long]
    codes = _endless(bench, steps[-1])
    # in LSB
    error = bench.model.forward(codes)[0] - _ideal(bench, codes) * 2.0**config.formats.state_format.frac_bits
    ends = [error[:, max(t - config.windows.steps, 0) : t] for t in steps]
    rms = np.array([np.sqrt(np.mean(end**2, axis=(1, 2))) for end in ends])  # (steps, sequences)
    middle, highest = np.median(rms, axis=1), rms.max(axis=1)
    ratios, of_worst = (line / max(line[0], 1e-12) for line in (middle, highest))
    worst = int(np.argmax(ratios[1:])) + 1 if len(steps) > 1 else 0
    words = (
        f"step {steps[worst]}: {middle[worst]:.2g} LSB against {middle[0]:.2g} at step 20; worst sequence "
    )
    words += f"{highest.max():.3g} LSB"
    lines = {"median of the sequences": ratios, "worst sequence": of_worst}
    drawn = curve("steps without a reset", "error / error at step 20", steps, lines, log=True)
    return Outcome(ratios[worst], words, drawn)


def outside_range(bench: Bench) -> Outcome:
    """Window sums of the recordings times 2: local decisions equal to the float network's on the same; the
    curve: other factors."""
    line = {}
    for gain in (1.0, 2.0, 4.0, 8.0, 16.0, 32.0):
        louder = replace(bench.touches, sums=amplified(bench.config, bench.touches.sums, gain))
        line[gain] = agreement(bench.model, bench.real, louder)
    xlabel, ylabel = "strength of the touch / recorded", "share of local decisions as in float"
    drawn = curve(xlabel, ylabel, line, {"agreement": line.values()}, log=True)
    return Outcome(line[2.0], f"twice the recorded strength; 16 times: {line[16.0]:.3f}", drawn)


# ---------------------------------------------------------------------- bits that turn over
def flipped(codes: np.ndarray, bit: int | np.ndarray, fmt: QFormat) -> np.ndarray:
    """``codes`` with one bit of their two's-complement words inverted."""
    word = (np.asarray(codes, dtype=np.int64) ^ (1 << bit)) & ((1 << fmt.width) - 1)
    return np.where(fmt.signed & (word >> (fmt.width - 1) == 1), word - (1 << fmt.width), word)


@dataclass(frozen=True)
class Flips:
    """Single bits inverted, one at a time, each a share of the decisions changed: their mean, or the worst.

    Parameters
    ----------
    formats:
        Of the words that may be hit, by name.
    words:
        These words as they are.
    decide:
        Decisions with other words in their place.
    allowed:
        May such words be tried?
    playable:
        The words are weights, so that the hardware can play the worst case.
    of:
        Of ``bench.flips`` bits one in so many are tried at most, at random.
    """

    formats: Callable[[AcceleratorConfig], Mapping[str, QFormat]]
    words: Callable[[Bench], Arrays]
    decide: Callable[[Bench, Arrays], np.ndarray]
    allowed: Callable[[Bench, Arrays], bool] = lambda bench, words: True
    playable: bool = False
    of: int = 1
    worst: bool = False

    def __call__(self, bench: Bench) -> Outcome:
        sites, changed = bench.remember(replace(self, worst=False), lambda: self._tried(bench))
        if not sites:
            return Outcome(0.0, "no bit is among them")
        name, place, bit = worst = sites[int(np.argmax(changed))]
        words = (
            f"{name}[{place}] bit {bit}: {changed.max():.3f}; {np.mean(changed == 0):.1%} of {len(sites)} flips change "
            "nothing"
        )
        case, bits = None, np.array([bit for *_, bit in sites])
        if self.playable:
            few = bench.sample.clean
            spoiled = replace(
                bench.model, arrays={**bench.model.arrays, **self._upset(bench, self.words(bench), worst)}
            )
            case = Case(few.subset(range(min(3, len(few)))), spoiled)
        shares = {bit: changed[bits == bit] for bit in np.unique(bits)}
        lines = {
            "mean of the flips": [share.mean() for share in shares.values()],
            "worst flip": [share.max() for share in shares.values()],
        }
        drawn = curve("bit (0 = lowest)", "share of decisions changed", shares, lines)
        return Outcome(float(changed.max() if self.worst else changed.mean()), words, drawn, case)

    def _upset(self, bench: Bench, words: Arrays, site: tuple[str, int, int]) -> Arrays:
        """``words`` with one bit inverted: name of the array, the value's place in it (flat), bit of the value."""
        name, place, bit = site
        array = words[name].copy()
        array.flat[place] = flipped(array.flat[place], bit, self.formats(bench.config)[name])
        return {**words, name: array}

    def _tried(self, bench: Bench) -> tuple[list[tuple[str, int, int]], np.ndarray]:
        words, most = self.words(bench), max(bench.flips // self.of, 16)
        sites = [
            (name, place, bit)
            for name, fmt in self.formats(bench.config).items()
            for place in range(words[name].size)
            for bit in range(fmt.width)
            if self.allowed(bench, self._upset(bench, words, (name, place, bit)))
        ]
        if len(sites) > most:
            sites = [sites[i] for i in np.sort(bench.rng(9).permutation(len(sites))[:most])]
        clean = self.decide(bench, words)
        spoiled = (self.decide(bench, self._upset(bench, words, site)) for site in sites)
        return sites, np.array([float(np.mean(decisions != clean)) for decisions in spoiled])


def _decisions(bench: Bench, logits: np.ndarray) -> np.ndarray:
    """Global decisions of a bench's touches by their logits."""
    return pipeline.decide(bench.config, logits, bench.touches.completed)[2]


# ---------------------------------------------------------------------- words that stay
def _by_weights(bench: Bench, words: Arrays) -> np.ndarray:
    model = replace(bench.model, arrays={**bench.model.arrays, **words})
    return _decisions(bench.sample, model.forward(bench.sample.codes)[1])


def _weight_formats(config: AcceleratorConfig) -> Mapping[str, QFormat]:
    """Formats of weights and biases, of trees of thresholds and votes."""
    formats = network_formats(config)
    return {name: formats[name] for name in formats if name not in ("tree_input", "subtrahend", "child")}


weight_flips = Flips(_weight_formats, lambda bench: bench.model.arrays, _by_weights, playable=True)


def _table_formats(config: AcceleratorConfig) -> Mapping[str, QFormat]:
    """Formats of the words of the activation tables in memory."""
    formats = config.formats
    return {"sigmoid": QFormat(formats.gate_frac + 1, 0, signed=False), "tanh": formats.state_format}


def _by_tables(bench: Bench, words: Arrays) -> np.ndarray:
    arithmetic = Fixed(bench.config)
    vars(arithmetic).update({f"_{name}": table for name, table in words.items()})
    return _decisions(bench.sample, bench.model.run(arithmetic, bench.sample.codes)[1])


table_flips = Flips(
    _table_formats,
    lambda bench: {name: getattr(Fixed(bench.config), f"_{name}") for name in _table_formats(bench.config)},
    _by_tables,
    of=8,
)


def _normalised(bench: Bench, constants: Arrays) -> np.ndarray:
    """Feature codes; a constant may be one that a model must not have."""
    touches = bench.touches
    mask, lengths = touches.faults, touches.lengths
    return preprocess.normalise(
        bench.config, touches.sums, touches.completed, **constants, faults=mask, lengths=lengths
    )


def _as_a_supply_step(bench: Bench, constants: Arrays) -> bool:
    """True if constants move no input by more than a supply step does, root mean square."""
    most = COMMON_OFFSET * 2.0**bench.config.formats.feature_format.frac_bits
    moved = np.square(_normalised(bench, constants) - bench.codes).mean((0, 1))
    return bool(np.sqrt(moved).max() <= most)


constant_flips = Flips(
    lambda config: {"mean": config.mean_format, "scale": config.scale_format},
    lambda bench: {name: bench.model.arrays[name] for name in ("mean", "scale")},
    lambda bench, constants: _decisions(bench, bench.model.forward(_normalised(bench, constants))[1]),
    _as_a_supply_step,
    worst=True,
)


def _registers(config: AcceleratorConfig) -> Mapping[str, QFormat]:
    """Onset threshold, band, clip, rearm count and mask."""
    word = QFormat(16, 0, signed=False)
    formats = {"rearm_frames": word}
    if config.onset_rule.onset == "baseline":
        formats["onset_threshold"] = word
    if config.onset_rule.onset == "band":
        formats |= dict.fromkeys(("band_low", "band_high"), config.sample_format)
    if config.rest_level.clip:
        formats["clip"] = word
    return formats | {"masked_taxels": QFormat(1, 0, signed=False)}


def _register_words(bench: Bench) -> Arrays:
    masked = np.isin(np.arange(bench.config.sensor.taxels), bench.config.sensor.masked_taxels)
    words = {name: np.array([bench.config.value(name)]) for name in _registers(bench.config)}
    return {**words, "masked_taxels": masked.astype(np.int64)}


def _with_registers(bench: Bench, words: Arrays) -> AcceleratorConfig:
    values: Record = {name: int(word[0]) for name, word in words.items()}
    return bench.config.replace(
        **values | {"masked_taxels": tuple(np.flatnonzero(words["masked_taxels"]).tolist())}
    )


def _accepted(bench: Bench, words: Arrays) -> bool:
    """True if the configuration takes these values; what it refuses the register refuses, too."""
    with contextlib.suppress(InputError):
        return bool(replace(bench.model, config=_with_registers(bench, words)))
    return False


register_flips = Flips(
    _registers,
    _register_words,
    lambda bench, words: bench.decide(
        bench.clean.subset(bench.clean.evenly(max(bench.few // 4, 8))), _with_registers(bench, words)
    ),
    _accepted,
)


# ---------------------------------------------------------------------- the state
class Upset(Fixed):
    """Inverts one bit of one unit's state after one step, a different one in each row (touch)."""

    def __init__(self, config, step: np.ndarray, unit: np.ndarray, bit: np.ndarray) -> None:
        super().__init__(config)
        self._step, self._unit, self._bit, self._calls = step, unit, bit, 0

    def state(self, products):
        values = super().state(products)
        step, second = divmod(self._calls, 2)  # every cell narrows two values a step; the second is the new h
        self._calls += 1
        if second:
            rows = np.flatnonzero(self._step == step)
            values = values.copy()
            old = values[rows, self._unit[rows]].astype(np.int64)
            values[rows, self._unit[rows]] = flipped(old, self._bit[rows], self._config.formats.state_format)
        return values


def state_flips(bench: Bench) -> Outcome:
    """One bit of one unit's state inverted after a random step of each touch: share of global decisions
    changed. Curve: which step."""
    few, config = bench.sample, bench.config
    # times the sample's touches, each with another upset
    tries = max(1, bench.flips // (4 * len(few.codes)))
    codes, rng = np.concatenate([few.codes] * tries), bench.rng(11)
    completed = np.tile(few.touches.completed, tries)
    limits = (config.windows.steps, config.network.hidden, config.formats.state_format.width)
    step, unit, bit = (rng.integers(0, limit, len(codes)) for limit in limits)
    decisions, clean = (
        pipeline.decide(config, few.model.run(arithmetic, codes)[1], completed)[2]
        for arithmetic in (Upset(config, step, unit, bit), Fixed(config))
    )
    changed = decisions != clean

    def means(of: np.ndarray, count: int) -> list[float]:
        return [float(changed[of == k].mean()) if np.any(of == k) else 0.0 for k in range(count)]

    shares = means(bit, limits[2])
    worst = int(np.argmax(shares))
    lines = {"all bits": means(step, limits[0])}
    drawn = curve("step of the upset", "share of decisions changed", range(1, limits[0] + 1), lines)
    return Outcome(float(changed.mean()), f"bit {worst}: {shares[worst]:.4f}; {len(changed)} upsets", drawn)
