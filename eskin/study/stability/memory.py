"""Failure modes of the memories, in the golden model: single bit flips in weights, tables, constants,
configuration and state."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from eskin.golden.core import Arrays, InputError, QFormat
from eskin.golden.model import Fixed, IntegerModel, network_formats, network_shapes, pipeline, run_cell
from eskin.study.stability.core import COMMON_OFFSET, Bench, Case, Curve, Outcome

BATCH = 32
"""Variants of the network that run at once."""

Site = tuple[Any, int, int]
"""A bit: the array, the value's place in it (flat), the bit of the value."""


def logits_of(model: IntegerModel, variants: Arrays, features: np.ndarray) -> np.ndarray:
    """Logit codes (variants, n, K, C), int64: the network once for each variant of its arrays, name ->
    (variants, *shape); arrays without a variant stay. The codes are not checked against their formats."""
    count, names = len(next(iter(variants.values()))), network_shapes(model.config, real=False)
    arrays = {name: np.broadcast_to(model.arrays[name], (count, *model.arrays[name].shape)) for name in names}
    parameters = {name: array.astype(np.float64) for name, array in {**arrays, **variants}.items()}
    return run_cell(Fixed(model.config), model.config, parameters, features.astype(np.float64))[1].astype(
        np.int64
    )


def flipped(codes: np.ndarray, bit: int | np.ndarray, fmt: QFormat) -> np.ndarray:
    """``codes`` with one bit of their two's-complement words inverted."""
    word = (np.asarray(codes, dtype=np.int64) ^ (1 << bit)) & ((1 << fmt.width) - 1)
    return np.where(fmt.signed & (word >> (fmt.width - 1) == 1), word - (1 << fmt.width), word)


def upset(array: np.ndarray, place: int, bit: int, fmt: QFormat) -> np.ndarray:
    """A copy of ``array`` with one bit of one value inverted."""
    array = array.copy()
    array.flat[place] = flipped(array.flat[place], bit, fmt)
    return array


def every_bit(arrays: Arrays, formats: Mapping[str, QFormat]) -> list[Site]:
    """Every bit of the arrays that have a format."""
    return [
        (name, place, bit)
        for name, fmt in formats.items()
        for place in range(arrays[name].size)
        for bit in range(fmt.width)
    ]


def by_bit(sites: Iterable[Sequence[Any]], changed: Iterable[float]) -> Curve:
    """The share of decisions that flips change against the bit that was inverted, the last of each site."""
    shares: dict[int, list[float]] = {}
    for site, share in zip(sites, changed, strict=True):
        shares.setdefault(site[-1], []).append(float(share))
    bits = sorted(shares)
    lines = {
        "mean of the flips": [float(np.mean(shares[bit])) for bit in bits],
        "worst flip": [max(shares[bit]) for bit in bits],
    }
    return Curve("bit (0 = lowest)", "share of decisions changed", bits, lines)


def _decisions(bench: Bench, logits: np.ndarray) -> np.ndarray:
    """Global decisions of a bench's touches by their logits."""
    return bench.parts.decide(bench.config, logits, bench.touches.completed)[2]


def _changed(bench: Bench, logits: np.ndarray) -> float:
    """Share of global decisions of the sample's touches that differ from the undisturbed ones."""
    few = bench.sample
    clean = few.remember("decisions", lambda: _decisions(few, few.forward(few.codes)[1]))
    return float(np.mean(_decisions(few, logits) != clean))


# ---------------------------------------------------------------------- words that stay
def _weight_flips(bench: Bench) -> tuple[list[Site], np.ndarray, str, Case]:
    """Every flip tried, the share of decisions it changes, the worst in words and for the hardware."""
    formats, arrays, few = network_formats(bench.config), bench.model.arrays, bench.sample
    sites = every_bit(arrays, formats)
    if len(sites) > bench.flips:
        sites = [sites[i] for i in np.sort(bench.rng(9).permutation(len(sites))[: bench.flips])]
    changed: list[float] = []
    for start in range(0, len(sites), BATCH):
        batch = sites[start : start + BATCH]
        variants = {
            name: np.stack(
                [
                    upset(arrays[name], place, bit, formats[name]) if hit == name else arrays[name]
                    for hit, place, bit in batch
                ]
            )
            for name in dict.fromkeys(hit for hit, *_ in batch)
        }
        changed += [_changed(bench, logits) for logits in logits_of(bench.model, variants, few.codes)]
    name, place, bit = sites[int(np.argmax(changed))]
    model = IntegerModel(
        bench.config, {**arrays, name: upset(arrays[name], place, bit, formats[name])}, bench.model.source
    )
    where = [int(index) for index in np.unravel_index(place, arrays[name].shape)]
    return (
        sites,
        np.array(changed),
        f"{name}{where} bit {bit}",
        Case(few.clean.subset(range(min(3, len(few.clean)))), model),
    )


def weight_flips(bench: Bench) -> Outcome:
    """Every bit of every weight and bias inverted, one at a time (at random where there are too many): mean
    share of decisions changed."""
    sites, changed, worst, case = bench.remember("weight flips", lambda: _weight_flips(bench))
    words = f"{worst}: {changed.max():.3f}; {np.mean(changed == 0):.1%} of {len(sites)} flips change nothing"
    return Outcome(float(changed.mean()), words, by_bit(sites, changed), case)


def worst_flip(bench: Bench) -> Outcome:
    """The same flips: the one that changes most decisions."""
    sites, changed, worst, case = bench.remember("weight flips", lambda: _weight_flips(bench))
    by_array: dict[str, float] = {}
    for (name, *_), share in zip(sites, changed, strict=True):
        by_array[name] = max(by_array.get(name, 0.0), float(share))
    lines = {"worst flip of " + ", ".join(by_array): list(by_array.values())}
    curve = Curve("array", "share of decisions changed", range(1, len(by_array) + 1), lines)
    return Outcome(float(changed.max()), worst, curve, case)


def table_flips(bench: Bench) -> Outcome:
    """Bits of entries of both activation tables inverted, one at a time, at random: mean share of decisions
    changed."""
    formats, few = bench.config.formats, bench.sample
    words = {"_sigmoid": QFormat(formats.gate_frac + 2, 0), "_tanh": formats.state_format}
    widths = {"_sigmoid": formats.gate_frac + 1, "_tanh": formats.state_format.width}
    entries = formats.table_entries
    sites = [
        (table, entry, bit) for table in words for entry in range(entries) for bit in range(widths[table])
    ]
    order = bench.rng(10).permutation(len(sites))[: max(min(bench.flips // 8, len(sites)), 16)]
    sites, changed = [sites[i] for i in np.sort(order)], []
    for table, entry, bit in sites:
        arithmetic = bench.parts.arithmetic(bench.config)
        setattr(arithmetic, table, upset(getattr(arithmetic, table), entry, bit, words[table]))
        changed.append(_changed(bench, few.forward(few.codes, arithmetic)[1]))
    table, entry, bit = sites[int(np.argmax(changed))]
    words_of = f"{table.strip('_')} entry {entry - entries // 2} bit {bit}: {max(changed):.3f}; {len(sites)} flips tried"
    return Outcome(float(np.mean(changed)), words_of, by_bit(sites, changed))


def constant_flips(bench: Bench) -> Outcome:
    """Every bit of the normaliser's mean and scale inverted, one at a time: share of decisions changed. Small
    flips move no input by more than a supply step does, root mean square."""
    arrays, clean = bench.model.arrays, _decisions(bench, bench.forward(bench.codes)[1])
    formats = {"mean": bench.config.mean_format, "scale": bench.config.scale_format}
    deviation = 2.0**bench.config.formats.feature_format.frac_bits
    sites, moved, changed = every_bit(arrays, formats), [], []
    for name, place, bit in sites:
        constants = {**arrays, name: upset(arrays[name], place, bit, formats[name])}
        codes = pipeline.feature_codes(bench.model, bench.touches, bench.parts.normalise, constants)
        moved.append(np.sqrt(np.square(codes - bench.codes).mean((0, 1))).max() / deviation)
        changed.append(float(np.mean(_decisions(bench, bench.forward(codes)[1]) != clean)))
    name, place, bit = sites[int(np.argmax(changed))]
    small = np.array(changed)[np.array(moved) <= COMMON_OFFSET]
    words = f"{len(small)} of {len(sites)} flips are small; over all {name}[{place}] bit {bit}: {max(changed):.3f}"
    return Outcome(float(small.max(initial=0.0)), words, by_bit(sites, changed))


def register_flips(bench: Bench) -> Outcome:
    """Every bit of onset threshold, band, clip, rearm count and mask inverted, one at a time, on the whole
    front end: decisions changed."""
    config = bench.config
    few = bench.with_recordings(bench.clean.subset(bench.clean.evenly(max(bench.few // 4, 8))))
    clean = few.decide(few.clean)
    fields = {"rearm_frames": 16}
    if config.onset_rule.onset == "baseline":
        fields["onset_threshold"] = 16
    if config.onset_rule.onset == "band":
        fields |= {"band_low": config.sensor.sample_bits, "band_high": config.sensor.sample_bits}
    if config.rest_level.clip:
        fields["clip"] = 16
    sites, shares = [], []
    for name, width in fields.items():
        for bit in range(width):
            try:
                wrong = few.changed({name: config.value(name) ^ (1 << bit)})
            except InputError:  # a value the configuration refuses, as the register does
                continue
            sites.append((name, bit))
            shares.append(float(np.mean(wrong.decide(few.clean) != clean)))
    for taxel in range(config.sensor.taxels):
        masks = set(config.sensor.masked_taxels) ^ {taxel}
        sites.append(("mask", taxel))
        shares.append(
            float(np.mean(few.changed({"masked_taxels": tuple(sorted(masks))}).decide(few.clean) != clean))
        )
    changed = np.array(shares)
    name, bit = sites[int(changed.argmax())]
    words = f"{name} bit {bit}: {changed.max():.3f}; {len(sites)} flips of {', '.join(fields)} and mask"
    return Outcome(float(changed.mean()), words, by_bit(sites, changed))


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
    # times the sample's touches, each with an upset of its own
    tries = max(1, bench.flips // (4 * len(few.codes)))
    codes, rng = np.concatenate([few.codes] * tries), bench.rng(11)
    limits = (config.windows.steps, config.network.hidden, config.formats.state_format.width)
    step, unit, bit = (rng.integers(0, limit, len(codes)) for limit in limits)
    logits = few.forward(codes, Upset(config, step, unit, bit))[1]
    decisions = few.parts.decide(config, logits, np.tile(few.touches.completed, tries))[2]
    changed = decisions != np.tile(_decisions(few, few.forward(few.codes)[1]), tries)

    def means(of: np.ndarray, count: int) -> list[float]:
        return [float(changed[of == k].mean()) if np.any(of == k) else 0.0 for k in range(count)]

    shares = means(bit, limits[2])
    worst = int(np.argmax(shares))
    lines = {"all bits": means(step, limits[0])}
    curve = Curve("step of the upset", "share of decisions changed", range(1, limits[0] + 1), lines)
    return Outcome(float(changed.mean()), f"bit {worst}: {shares[worst]:.4f}; {len(changed)} upsets", curve)
