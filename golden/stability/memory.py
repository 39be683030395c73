"""Failure modes of the memories, in the golden model: single bit flips in weights, tables, constants, configuration and state."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

import numpy as np

from eskin.golden.core.errors import InputError
from eskin.golden.core.formats import QFormat
from eskin.golden.model import pipeline
from eskin.golden.model.cells import Fixed
from eskin.golden.model.model import IntegerModel, network_formats
from eskin.golden.stability.core import Bench, Case, Curve, Outcome

MEAN_CHANGED = 0.02
"""Share of decisions that a bit flip, any one, may change on average: what a fault is worth until the checksum is read."""
BATCH = 32
"""Variants of the network that run at once."""


def flipped(codes: np.ndarray, bit: int, fmt: QFormat) -> np.ndarray:
    """``codes`` with one bit of their two's-complement words inverted."""
    word = (np.asarray(codes, dtype=np.int64) ^ (1 << bit)) & ((1 << fmt.width) - 1)
    return np.where(fmt.signed & (word >> (fmt.width - 1) == 1), word - (1 << fmt.width), word)


def _chosen(bench: Bench, sites: list, key: int) -> list:
    """All of ``sites``, or ``flips`` of them at random, in order."""
    if len(sites) <= bench.flips:
        return sites
    return [sites[i] for i in np.sort(bench.rng(key).permutation(len(sites))[: bench.flips])]


def _changes(bench: Bench, logits: np.ndarray) -> np.ndarray:
    """Share of global decisions of the sample's touches that differ from the undisturbed ones, for each variant's logits (V, n, K, C)."""
    few = bench.sample
    clean = few.parts.decide(few.config, few.forward(few.codes)[1], few.touches.completed)[2]
    return np.array([np.mean(few.parts.decide(few.config, one, few.touches.completed)[2] != clean) for one in logits])


def _by_bit(sites_bits: np.ndarray, changed: np.ndarray) -> Curve:
    bits = sorted(set(sites_bits.tolist()))
    return Curve(
        "bit (0 = lowest)",
        "share of decisions changed",
        bits,
        {
            "mean of the flips": [float(changed[sites_bits == bit].mean()) for bit in bits],
            "worst flip": [float(changed[sites_bits == bit].max()) for bit in bits],
        },
    )


def _weight_flips(bench: Bench) -> tuple[list[tuple[str, tuple[int, ...], int]], np.ndarray]:
    """(array, index, bit) of every flip tried, and the share of decisions it changes."""

    def make():
        formats = network_formats(bench.config)
        sites = [
            (name, index, bit)
            for name, fmt in formats.items()
            for index in np.ndindex(bench.model.arrays[name].shape)
            for bit in range(fmt.width)
        ]
        sites = _chosen(bench, sites, 9)
        changed = []
        for batch in _batches(sites):
            variants = {}
            for v, (name, index, bit) in enumerate(batch):
                if name not in variants:
                    variants[name] = np.repeat(bench.model.arrays[name][None], len(batch), axis=0)
                variants[name][v][index] = flipped(bench.model.arrays[name][index], bit, formats[name])
            changed.append(_changes(bench, bench.model.logits_of(variants, bench.sample.codes)))
        return sites, np.concatenate(changed)

    return bench.remember("weight flips", make)


def _batches(sites: list) -> Iterator[list]:
    left = iter(sites)
    while batch := list(islice(left, BATCH)):
        yield batch


def weight_flips(bench: Bench) -> Outcome:
    """Every bit of every weight and bias inverted, one at a time (at random where there are too many): mean share of decisions changed."""
    sites, changed = _weight_flips(bench)
    worst = int(changed.argmax())
    name, index, bit = sites[worst]
    case = Case(_few(bench), _with_flip(bench, sites[worst]))
    harmless = float(np.mean(changed == 0))
    what = f"{name}{list(index)} bit {bit}: {changed[worst]:.3f}; {harmless:.1%} of {len(sites)} flips change nothing"
    return Outcome(float(changed.mean()), what, _by_bit(np.array([bit for *_, bit in sites]), changed), case)


def _few(bench: Bench):
    return bench.sample.clean.subset(range(min(3, len(bench.sample.clean))))


def _with_flip(bench: Bench, site) -> IntegerModel:
    name, index, bit = site
    array = bench.model.arrays[name].copy()
    array[index] = flipped(array[index], bit, network_formats(bench.config)[name])
    return IntegerModel(bench.config, {**bench.model.arrays, name: array}, bench.model.source)


def worst_flip(bench: Bench) -> Outcome:
    """The same flips: the one that changes most decisions."""
    sites, changed = _weight_flips(bench)
    worst = int(changed.argmax())
    name, index, bit = sites[worst]
    by_array: dict[str, float] = {}
    for (array, *_), share in zip(sites, changed, strict=True):
        by_array[array] = max(by_array.get(array, 0.0), float(share))
    curve = Curve(
        "array",
        "share of decisions changed",
        range(1, len(by_array) + 1),
        {"worst flip of " + ", ".join(by_array): list(by_array.values())},
    )
    return Outcome(float(changed[worst]), f"{name}{list(index)} bit {bit}", curve, Case(_few(bench), _with_flip(bench, sites[worst])))


def table_flips(bench: Bench) -> Outcome:
    """Bits of entries of both activation tables inverted, one at a time, at random: mean share of decisions changed."""
    config, few = bench.config, bench.sample
    entries = bench.config.formats.table_entries
    sites = [
        (table, entry, bit)
        for table, width in (("_sigmoid", config.formats.gate_frac + 1), ("_tanh", config.formats.state_format.width))
        for entry in range(entries)
        for bit in range(width)
    ]
    order = bench.rng(10).permutation(len(sites))[: max(min(bench.flips // 8, len(sites)), 16)]
    sites = [sites[i] for i in np.sort(order)]
    changed = []
    for table, entry, bit in sites:
        arithmetic = bench.parts.arithmetic(config)
        fmt = QFormat(config.formats.gate_frac + 2, 0) if table == "_sigmoid" else config.formats.state_format
        values = getattr(arithmetic, table).copy()
        values[entry] = flipped(values[entry].astype(np.int64), bit, fmt)
        setattr(arithmetic, table, values)
        changed.append(_changes(bench, few.forward(few.codes, arithmetic)[1][None])[0])
    shares = np.array(changed)
    table, entry, bit = sites[int(shares.argmax())]
    what = f"{table.strip('_')} entry {entry - entries // 2} bit {bit}: {shares.max():.3f}; {len(sites)} flips tried"
    return Outcome(float(shares.mean()), what, _by_bit(np.array([bit for *_, bit in sites]), shares))


def constant_flips(bench: Bench) -> Outcome:
    """Every bit of the normaliser's mean and scale inverted, one at a time: share of decisions changed."""
    few, config = bench.sample, bench.config
    clean = few.parts.decide(config, few.forward(few.codes)[1], few.touches.completed)[2]
    formats = {"mean": QFormat(config.sum_bits, 0), "scale": config.scale_format}
    sites, shares = [], []
    for name, fmt in formats.items():
        for q in range(bench.model.arrays[name].size):
            for bit in range(fmt.width):
                array = bench.model.arrays[name].copy()
                array.flat[q] = flipped(array.flat[q], bit, fmt)
                constants = {**bench.model.arrays, name: array}
                codes = pipeline.feature_codes(few.model, few.touches, few.parts.normalise, constants)
                decisions = few.parts.decide(config, few.forward(codes)[1], few.touches.completed)[2]
                sites.append((name, q, bit))
                shares.append(float(np.mean(decisions != clean)))
    bits, changed = np.array([bit for *_, bit in sites]), np.array(shares)
    lower = np.where(bits < 12, changed, 0.0)
    name, q, bit = sites[int(changed.argmax())]
    return Outcome(float(lower.max()), f"over all bits {name}[{q}] bit {bit}: {changed.max():.3f}", _by_bit(bits, changed))


def register_flips(bench: Bench) -> Outcome:
    """Every bit of onset threshold, band, clip, rearm count and mask inverted, one at a time, on the whole front end: decisions changed."""
    config = bench.config
    few = bench.with_recordings(bench.clean.subset(bench.clean.evenly(max(bench.few // 4, 8))))
    clean = few.decisions(few.clean)
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
            shares.append(float(np.mean(wrong.decisions(few.clean) != clean)))
    for taxel in range(config.sensor.taxels):
        masks = set(config.sensor.masked_taxels) ^ {taxel}
        sites.append(("mask", taxel))
        shares.append(float(np.mean(few.changed({"masked_taxels": tuple(sorted(masks))}).decisions(few.clean) != clean)))
    changed = np.array(shares)
    name, bit = sites[int(changed.argmax())]
    what = f"{name} bit {bit}: {changed.max():.3f}; {len(sites)} flips of {', '.join(fields)} and mask"
    return Outcome(float(changed.mean()), what, _by_bit(np.array([bit for _, bit in sites]), changed))


# ---------------------------------------------------------------------- the state
class Upset(Fixed):
    """Inverts one bit of one unit's state after one step, a different one in each row (touch)."""

    def __init__(self, config, step: np.ndarray, unit: np.ndarray, bit: np.ndarray) -> None:
        super().__init__(config)
        self._step, self._unit, self._bit, self._calls = step, unit, bit, 0

    def state(self, products):
        made = super().state(products)
        step, second = divmod(self._calls, 2)  # every cell narrows two values a step; the second is the new h
        self._calls += 1
        if second:
            rows = np.flatnonzero(self._step == step)
            if len(rows):
                made = made.copy()
                old = made[rows, self._unit[rows]].astype(np.int64)
                fmt = self._config.formats.state_format
                made[rows, self._unit[rows]] = [flipped(v, int(b), fmt) for v, b in zip(old, self._bit[rows], strict=True)]
        return made


def _state_upsets(bench: Bench, tries: int):
    """Logits of every touch of the sample, ``tries`` times over, each with one upset of its own; and (step, unit, bit)."""
    few, config = bench.sample, bench.config
    codes = np.concatenate([few.codes] * tries)
    rng = bench.rng(11)
    sites = tuple(
        rng.integers(0, limit, len(codes)) for limit in (config.windows.steps, config.network.hidden, config.formats.state_format.width)
    )
    return few.forward(codes, Upset(config, *sites))[1], sites, np.concatenate([few.touches.completed] * tries)


def state_flips(bench: Bench) -> Outcome:
    """One bit of one unit's state inverted after a random step of each touch: share of global decisions changed. Curve: which step."""
    few, config = bench.sample, bench.config
    clean = few.parts.decide(config, few.forward(few.codes)[1], few.touches.completed)[2]
    tries = max(1, bench.flips // (4 * len(few.codes)))
    logits, (step, _, bit), completed = _state_upsets(bench, tries)
    changed = few.parts.decide(config, logits, completed)[2] != np.tile(clean, tries)
    line = [float(changed[step == k].mean()) if np.any(step == k) else 0.0 for k in range(config.windows.steps)]
    by_bit = [float(changed[bit == b].mean()) if np.any(bit == b) else 0.0 for b in range(config.formats.state_format.width)]
    worst = int(np.argmax(by_bit))
    what = f"bit {worst}: {by_bit[worst]:.4f}; {len(changed)} upsets"
    curve = Curve("step of the upset", "share of decisions changed", range(1, config.windows.steps + 1), {"all bits": line})
    return Outcome(float(changed.mean()), what, curve)
