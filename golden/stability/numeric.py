"""Failure modes of the arithmetic: rounding, saturation, widths, tables, ties, bits, ranges."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.golden.core.formats import QFormat, signed_bits
from eskin.golden.model import pipeline
from eskin.golden.model.cells import Fixed, run_cell
from eskin.golden.model.model import FloatModel, constants_shape, network_formats
from eskin.golden.model.preprocess import _scan, amplified, by_input, sums_alone
from eskin.golden.stability.core import Bench, Case, Curve, Outcome, finite, rebuilt
from eskin.golden.stability.shapes import float_decisions

GROWTH_STEPS = (20, 200, 2000, 20000)
SEQUENCES = 32
"""Sequences that run without a reset."""
WORST_ROWS = 64


# ---------------------------------------------------------------------- arithmetics to measure with
class Unrounded(Fixed):
    """The tables of the integer cell, but states and values are never rounded, only saturated."""

    def state(self, products):
        return self._unrounded(products, self._config.formats.gate_frac, self._config.formats.state_format)

    def value(self, acc):
        return self._unrounded(acc, self._config.value_shift, self._config.formats.state_format)

    @staticmethod
    def _unrounded(value, shift: int, fmt: QFormat):
        return (value * 2.0**-shift).clip(fmt.min_code, fmt.max_code)


def changed_tables(change: Callable[[np.ndarray, AcceleratorConfig], np.ndarray]) -> type[Fixed]:
    """A Fixed whose two tables were changed."""

    class Changed(Fixed):
        def __init__(self, config: AcceleratorConfig) -> None:
            super().__init__(config)
            for name in ("_sigmoid", "_tanh"):
                setattr(self, name, change(getattr(self, name).copy(), config))

    return Changed


def _tables(bench: Bench) -> tuple[np.ndarray, np.ndarray]:
    """The sigmoid and tanh tables of the arithmetic under test, found by looking every entry up."""
    config, arithmetic = bench.config, bench.parts.arithmetic(bench.config)
    index = np.arange(-config.formats.table_entries // 2, config.formats.table_entries // 2, dtype=np.float64)
    return arithmetic.sigmoid(index * 2.0**config.sigmoid_shift), arithmetic.tanh(index * 2.0**config.tanh_shift)


def _real_network(bench: Bench) -> dict[str, np.ndarray]:
    """The integer weights as real numbers, under the float network's names."""
    formats = network_formats(bench.config)
    real = {name: fmt.to_real(bench.model.arrays[name]) for name, fmt in formats.items()}
    for gate in bench.config.gates:
        if bench.config.network.cell == "gru" and bench.config.network.reset == "after" and gate != "n":
            real[f"bh_{gate}"] = np.zeros_like(real[f"b_{gate}"])
    return real | {"mu": np.zeros(constants_shape(bench.config)), "sigma": np.ones(constants_shape(bench.config))}


def _ideal(bench: Bench, codes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(h', logits) in real arithmetic of the very weights and features that the integers stand for."""
    return FloatModel(bench.config, _real_network(bench)).forward(bench.config.formats.feature_format.to_real(codes))


def _endless(bench: Bench, steps: int) -> np.ndarray:
    """(SEQUENCES, steps, D) feature codes: touches of the recordings one after the other, in random order."""
    codes = bench.codes[bench.touches.completed == bench.config.windows.steps]
    if not len(codes):
        raise InputError("stability: no touch has all its steps; use whole recordings")
    order = bench.rng(1).integers(0, len(codes), (SEQUENCES, -(-steps // bench.config.windows.steps)))
    return codes[order].reshape(SEQUENCES, -1, codes.shape[2])[:, :steps]


# ---------------------------------------------------------------------- rounding
def growth(bench: Bench) -> Outcome:
    """Error of the hidden state against real arithmetic with the same weights, root mean square over the last touch's worth of steps, over
    touches strung together without a reset: the median of the sequences, the largest of steps 200 to 20000 over that of step 20.

    The median, because a touch that follows another one without a reset can bring a sequence to a point where the real network itself
    decides by a hair: there the two part for some steps, whatever the arithmetic. The curve shows the worst sequence too.
    """
    config = bench.config
    steps = [t for t in GROWTH_STEPS if t <= bench.long]
    codes = _endless(bench, steps[-1])
    fixed, ideal = bench.forward(codes)[0], _ideal(bench, codes)[0]
    each = []
    for t in steps:
        last = slice(max(t - config.windows.steps, 0), t)
        error = config.formats.state_format.to_real(fixed[:, last]) - ideal[:, last]
        each.append(np.sqrt(np.mean(error**2, axis=(1, 2))))
    middle, worst_of = [float(np.median(rms)) for rms in each], [float(rms.max()) for rms in each]
    ratios = [value / max(middle[0], 1e-12) for value in middle]
    worst = int(np.argmax(ratios[1:])) + 1 if len(steps) > 1 else 0
    lines = {"median of the sequences": ratios, "worst sequence": [value / max(worst_of[0], 1e-12) for value in worst_of]}
    curve = Curve("steps without a reset", "error / error at step 20", steps, lines, log=True)
    unit = 2.0**config.formats.state_format.frac_bits
    what = f"step {steps[worst]}: {middle[worst] * unit:.2g} LSB against {middle[0] * unit:.2g} at step 20; worst sequence "
    what += f"{max(worst_of) * unit:.3g} LSB"
    return Outcome(ratios[worst], what, curve)


def carried_bias(bench: Bench) -> Outcome:
    """Mean signed difference of the state after each step to the same cell that never rounds a state: the largest over the steps."""
    codes = bench.codes
    rounded, exact = bench.forward(codes)[0], _unrounded_states(bench, codes)
    bias = (rounded - exact).mean(axis=(0, 2))
    worst = int(np.abs(bias).argmax())
    curve = Curve("step", "mean signed error (state LSB)", range(1, len(bias) + 1), {"bias": np.abs(bias).tolist()})
    return Outcome(float(np.abs(bias[worst])), f"step {worst + 1}: {bias[worst]:+.3f} LSB, over {codes.shape[0]} touches", curve)


def _unrounded_states(bench: Bench, codes: np.ndarray) -> np.ndarray:
    arrays = {name: array.astype(np.float64) for name, array in bench.model.arrays.items()}
    return run_cell(Unrounded(bench.config), bench.config, arrays, codes.astype(np.float64))[0]


def narrowing_bias(bench: Bench) -> Outcome:
    """Mean signed rounding error of every narrowing while the recordings run, unsaturated results only: the largest of them."""
    found: dict[tuple[str, int], list[float]] = {}

    class Watched(bench.parts.arithmetic):  # type: ignore[name-defined]
        def _narrow(self, value, shift, fmt):
            result = super()._narrow(value, shift, fmt)
            inside = (result > fmt.min_code) & (result < fmt.max_code)
            entry = found.setdefault((str(fmt), shift), [0.0, 0.0])
            entry[0] += float(((result - value * 2.0**-shift) * inside).sum())
            entry[1] += float(inside.sum())
            return result

    bench.forward(bench.codes, Watched(bench.config))
    bias = {f"to {fmt}, {shift} bits away": total / max(count, 1.0) for (fmt, shift), (total, count) in found.items()}
    worst = max(bias, key=lambda name: abs(bias[name]))
    curve = Curve("narrowing", "mean signed error (LSB)", range(1, len(bias) + 1), {"bias": [abs(b) for b in bias.values()]})
    return Outcome(abs(bias[worst]), f"{worst}: {bias[worst]:+.4f} LSB", curve)


def dead_zone(bench: Bench) -> Outcome:
    """Distance from its target at which h' = z h + (1 - z) n stands still, z = 1 - 2^-k, found by running the blend until nothing moves."""
    config, arithmetic = bench.config, bench.parts.arithmetic(bench.config)
    powers = list(range(1, config.formats.gate_frac + 1))
    distances = [_standstill(arithmetic, config, k) for k in powers]
    at = powers.index(6) if 6 in powers else len(powers) - 1
    curve = Curve("k of the update gate 1 - 2^-k", "distance that stays (of 1)", powers, {f"{config.formats.state_format}": distances})
    first = next((k for k, d in zip(powers, distances, strict=True) if d > 1 / 64), None)
    where = f"beyond the bound from k = {first} on" if first else "never beyond the bound"
    return Outcome(distances[at], f"k = {powers[at]}: {distances[at] * 2**config.formats.state_format.frac_bits:.0f} LSB; {where}", curve)


def _standstill(arithmetic: Fixed, config: AcceleratorConfig, k: int) -> float:
    """Largest |h - n| left over, real, from both sides, by iterating the blend."""
    unit = 2.0**config.formats.state_format.frac_bits
    z = np.floor(arithmetic.one * (1 - 2.0**-k))
    n = np.array([0.0, 0.0, 0.25 * unit, -0.25 * unit])
    h = np.array([unit, -unit, -0.5 * unit, 0.5 * unit]).clip(config.formats.state_format.min_code, config.formats.state_format.max_code)
    for _ in range(64 << min(k, 8)):
        moved = arithmetic.state(z * h + (arithmetic.one - z) * n)
        if bool((moved == h).all()):
            break
        h = moved
    return float(np.abs(h - n).max()) / unit


def limit_cycle(bench: Bench) -> Outcome:
    """Peak-to-peak movement of the state under a constant input, in the last steps of a long hold of each touch's last feature, less that
    of real arithmetic."""
    hold = min(bench.long, 2000)
    rows = bench.rng(2).permutation(len(bench.codes))[:WORST_ROWS]
    codes = np.repeat(bench.codes[rows, -1:, :], hold, axis=1)
    codes[::2] = 0
    spans = {}
    fixed, ideal = bench.forward(codes)[0], _ideal(bench, codes)[0] * 2.0**bench.config.formats.state_format.frac_bits
    points = [hold // 20, hold // 8, hold // 4, hold // 2, hold]
    for t in points:
        window = slice(max(0, t - 50), t)
        spans[t] = np.ptp(fixed[:, window], axis=1) - np.floor(np.ptp(ideal[:, window], axis=1))
    last = spans[points[-1]]
    touch, unit = np.unravel_index(int(np.argmax(last)), last.shape)
    curve = Curve("steps of constant input", "peak to peak (state LSB)", points, {"worst unit": [float(spans[t].max()) for t in points]})
    return Outcome(max(0.0, float(last.max())), f"unit {unit}, input of touch {int(rows[touch])}", curve)


# ---------------------------------------------------------------------- saturation and widths
def _narrowings(config: AcceleratorConfig) -> dict[str, tuple[int, QFormat]]:
    if not config.recurrent:
        return {"logit": (config.logit_shift, config.formats.logit_format)}
    return {
        "sigmoid index": (config.sigmoid_shift, config.index_format),
        "tanh index": (config.tanh_shift, config.index_format),
        "value": (config.value_shift, config.formats.state_format),
        "state": (config.formats.gate_frac, config.formats.state_format),
        "logit": (config.logit_shift, config.formats.logit_format),
    }


def wraps(bench: Bench) -> Outcome:
    """Every narrowing of the cell driven across and beyond its range, to the accumulator's limits: results on the wrong side."""
    config, arithmetic = bench.config, bench.parts.arithmetic(bench.config)
    wrong: dict[Any, Any] = {}
    factors = [0.5, 1.0, 1.01, 2.0, 8.0, 64.0, 1024.0]
    by_factor = np.zeros(len(factors))
    for name, (shift, fmt) in _narrowings(config).items():
        limit = float(1 << (bench.parts.accumulator_bits(config) - 1))
        for k, factor in enumerate(factors):
            drive = np.linspace(-1, 1, 2001) * factor * fmt.magnitude * 2.0**shift
            drive = np.clip(np.rint(drive), -limit, limit - 1)
            got = arithmetic._narrow(drive, shift, fmt)
            exact = np.clip(np.floor(drive / 2.0**shift + (0.5 if shift else 0.0)), fmt.min_code, fmt.max_code)
            bad = int(np.sum(np.abs(got - exact) > 1))
            by_factor[k] += bad
            wrong[name] = wrong.get(name, 0) + bad
    worst = max(wrong, key=wrong.__getitem__)
    curve = Curve("drive / full scale of the result", "wrong results", factors, {"all narrowings": by_factor.tolist()}, log=True)
    return Outcome(sum(wrong.values()), f"{worst}: {wrong[worst]} of {2001 * len(factors)}", curve)


def normaliser_wrap(bench: Bench) -> Outcome:
    """Window sums from small to the largest that the sum's word holds: features whose sign is not that of (sum - mean)."""
    config = bench.config
    bits = list(range(8, bench.parts.sum_bits(config)))
    wrong = []
    for power in bits:
        sums = np.zeros((2, config.windows.steps, config.inputs), dtype=np.int64)
        sums[0], sums[1] = 1 << power, -(1 << power)
        codes = bench.parts.normalise(
            config, sums, np.full(2, config.windows.steps), bench.model.arrays["mean"], bench.model.arrays["scale"]
        )
        mean = by_input(config, bench.model.arrays["mean"])[list(config.length_index)]
        wrong.append(int(np.sum((np.sign(codes) * np.sign(sums - mean) < 0)[..., ~np.array(config.input_mask)])))
    worst = int(np.argmax(wrong))
    curve = Curve("log2 of the window sum", "wrong features", bits, {"both signs": wrong})
    return Outcome(sum(wrong), f"sum of 2^{bits[worst]}: {wrong[worst]} wrong", curve)


def row_bits(config: AcceleratorConfig, width: int | None = None) -> int:
    """Bits of the worst accumulator under the formats, term by term in plain integers; weights of ``width`` bits with the same points."""

    def least(fmt: QFormat) -> int:
        return -(1 << (width - 1)) if width else fmt.min_code

    feature = config.formats.feature_format.min_code * 2**config.feature_align
    bias = [-config.formats.dense_bias_format.min_code * 2**config.dense_bias_shift, 2 ** (config.logit_shift - 1)]
    if not config.recurrent:  # the sums go on over all windows
        return signed_bits(sum([least(config.formats.dense_format) * feature] * config.inputs * config.windows.steps + bias))
    terms = [least(config.formats.weight_format) * feature] * config.inputs
    terms += [least(config.formats.recurrent_format) * config.formats.state_format.min_code] * config.network.hidden
    half = 2 ** (max(config.sigmoid_shift, config.tanh_shift, config.value_shift) - 1)
    terms += [-config.formats.bias_format.min_code * 2**config.bias_shift, half]
    dense = [least(config.formats.dense_format) * config.formats.state_format.min_code] * config.network.hidden
    return max(signed_bits(sum(terms)), signed_bits(sum(dense + bias)))


def bits_of_this_model(bench: Bench) -> str:
    """What the accumulator needs with this model's weights, in words."""
    return f", this model {signed_bits(max(row_peaks(bench).values()))}"


def row_peaks(bench: Bench) -> dict[str, int]:
    """Largest |accumulator| of each kind of row with this model's weights and the worst vectors."""
    config, arrays = bench.config, bench.model.arrays
    feature, state = config.formats.feature_format.magnitude << config.feature_align, config.formats.state_format.magnitude
    peaks, bias = {}, np.abs(arrays["b_y"]) << config.dense_bias_shift
    if not config.recurrent:
        weights = np.broadcast_to(np.abs(arrays["V"]), (config.windows.steps, config.classes, config.inputs))
        return {"dense": int((weights.sum(axis=(0, 2)) * feature + bias).max())}
    for gate in config.gates:
        row = np.abs(arrays[f"W_{gate}"]).sum(axis=1) * feature + np.abs(arrays[f"U_{gate}"]).sum(axis=1) * state
        peaks[f"gate {gate}"] = int((row + (np.abs(arrays[f"b_{gate}"]) << config.bias_shift)).max())
    peaks["dense"] = int((np.abs(arrays["V"]).sum(axis=1) * state + bias).max())
    return peaks


def elementwise_bits(config: AcceleratorConfig, gate_frac: int | None = None) -> int:
    """Bits of the worst blend and of the worst scaled sum; gates of ``gate_frac`` fraction bits."""
    one = 1 << (config.formats.gate_frac if gate_frac is None else gate_frac)
    scaled = config.centred_format.magnitude * config.scale_format.max_code + one // 2
    if not config.recurrent:
        return signed_bits(scaled)
    # a GRU's two gates add up to one; an LSTM's f and i may both be one, as may r and the constant one of reset after
    both = 1 if config.network.cell == "gru" and config.network.reset == "before" else 2
    blend = both * one * config.formats.state_format.magnitude + one // 2
    return max(signed_bits(blend), signed_bits(scaled))


def window_sum(bench: Bench) -> Outcome:
    """The front end on taxels that settle at one end of the code range and touch at the other, and with activity by changes also on those
    that swing from end to end with every block: the largest window sum."""
    config = bench.config
    low, high = config.sample_format.min_code, config.sample_format.max_code
    quiet, frames = max(config.rest_level.rest_frames, 1) + 2 * config.onset_rule.onset_mean_frames, 4 * config.last_frame
    start = quiet if not config.opens_at_once else config.rest_level.rest_frames
    held = np.ones(quiet + frames - start, dtype=np.int64)
    swings = [(low, held * high), (high, held * low)]
    if "activity" in config.features.feature_kinds and config.features.activity_rule == "change":
        block = config.features.activity_block  # from one end to the other with every block, wherever blocks begin
        places = np.arange(len(held))
        swings += [((low + high) // 2, np.where((places + phase) // block % 2, low, high)) for phase in range(block)]
    streams = []
    for rest, touch in swings:
        stream = np.full((quiet + frames, config.sensor.taxels), rest, dtype=np.int64)
        stream[start:] = touch[:, None]
        streams.append(stream)
    recordings = rebuilt(bench.recordings, streams, [0] * len(streams))
    # the flat streams of this experiment are no sensor's: a detector would take them for stuck
    touches = bench.parts.find_touches(config.replace(fault_frames=0), recordings)
    peak = int(np.abs(touches.sums).max()) if len(touches) else 0
    have = bench.parts.sum_bits(config)
    clips = [2**k for k in range(4, 17)]
    missing = [max(0, signed_bits(config.windows.window * clip) - have) for clip in clips]
    curve = Curve("largest deviation (codes)", "bits missing", clips, {"worst sum": missing}, log=True)
    return Outcome(max(0, signed_bits(peak) - have), f"sum of {peak}: {signed_bits(peak)} bits, there are {have}", curve, Case(recordings))


# ---------------------------------------------------------------------- tables, gates, ties
@dataclass(frozen=True)
class TableError:
    """Every entry of a table against the function at the centre of the interval that addresses it.

    Parameters
    ----------
    table:
        Place among ``_tables``. span: of x that it covers.
    exact:
        (configuration, x) -> the function in table codes.
    """

    table: int
    span: float
    exact: Callable[[AcceleratorConfig, np.ndarray], np.ndarray]
    ylabel: str

    def __call__(self, bench: Bench) -> Outcome:
        entries = bench.config.formats.table_entries
        x = np.arange(-entries // 2, entries // 2, dtype=np.float64) * self.span / entries
        error = np.abs(_tables(bench)[self.table] - self.exact(bench.config, x))
        return Outcome(float(error.max()), f"x = {x[error.argmax()]:g}", Curve("x", self.ylabel, x.tolist(), {"entry": error.tolist()}))


def exact_sigmoid(config: AcceleratorConfig, x: np.ndarray) -> np.ndarray:
    """The gates' function in gate codes."""
    return (1 / (1 + np.exp(-x)) if config.network.gate_activation == "sigmoid" else np.clip(0.2 * x + 0.5, 0, 1)) * config.gate_one


def exact_tanh(config: AcceleratorConfig, x: np.ndarray) -> np.ndarray:
    """tanh in codes of a state."""
    return np.tanh(x) * 2.0**config.formats.state_format.frac_bits


def table_shape(bench: Bench) -> Outcome:
    """Exhaustive: s(-x) + s(x) = one, tanh(-x) = -tanh(x), s(0) = one / 2, both tables never falling; the entries that break a rule."""
    sigmoid, tanh = _tables(bench)
    one, rules = bench.config.gate_one, {}
    rules["sigmoid symmetry"] = int(np.sum(sigmoid[1:] + sigmoid[1:][::-1] != one)) + int(sigmoid[len(sigmoid) // 2] != one // 2)
    rules["tanh symmetry"] = int(np.sum(tanh[1:] + tanh[1:][::-1] != 0))
    rules["sigmoid order"], rules["tanh order"] = int(np.sum(np.diff(sigmoid) < 0)), int(np.sum(np.diff(tanh) < 0))
    rules["sigmoid range"] = int(np.sum((sigmoid < 0) | (sigmoid > one)))
    worst = max(rules, key=rules.__getitem__)
    curve = Curve("rule", "entries that break it", range(1, len(rules) + 1), {", ".join(rules): list(rules.values())})
    return Outcome(sum(rules.values()), f"{worst}: {rules[worst]}", curve)


def table_resolution(bench: Bench) -> Outcome:
    """Local decisions equal to those of a cell with the exact sigmoid and tanh, everything else in integers; the curve: other sizes."""

    class Exact(Fixed):
        def sigmoid(self, acc):
            return self._smooth_sigmoid(acc / 2.0**self._config.product_frac) * self.one

        def _tanh_at(self, value, shift, frac_bits):
            return np.tanh(value / 2.0**frac_bits) * 2.0**self._config.formats.state_format.frac_bits

    def local(arithmetic: Fixed) -> np.ndarray:
        return bench.parts.decide(bench.config, bench.forward(bench.codes, arithmetic)[1], bench.touches.completed)[0]

    exact = local(Exact(bench.config))
    own = float(np.mean(local(bench.parts.arithmetic(bench.config)) == exact))
    sizes, line = [64, 128, 256, 512, 1024], []
    for size in sizes:
        step = bench.config.formats.table_entries / size

        def thin(table: np.ndarray, config: AcceleratorConfig, step: float = step) -> np.ndarray:
            half = len(table) // 2
            entry = np.clip(np.rint((np.arange(len(table)) - half) / step) * step + half, 0, len(table) - 1).astype(int)
            return table[entry]

        line.append(float(np.mean(local(changed_tables(thin)(bench.config)) == exact)) if step >= 1 else own)
    curve = Curve("table entries (more than there are: as now)", "share of equal local decisions", sizes, {"agreement": line}, log=True)
    return Outcome(own, f"{bench.config.formats.table_entries} entries, {exact.size} local decisions", curve)


def gate_ends(bench: Bench) -> Outcome:
    """h' = z h + (1 - z) n for z = 0, 1 LSB, 1 - 1 LSB and 1 over states across the whole format: results outside the span of h and n, or
    not exact at the ends."""
    config, arithmetic = bench.config, bench.parts.arithmetic(bench.config)
    fmt = config.formats.state_format
    levels = np.unique(np.rint(np.linspace(fmt.min_code, fmt.max_code, 257)))
    h, n = (axis.ravel() for axis in np.meshgrid(levels, levels))
    gates = [0, 1, config.gate_one // 2, config.gate_one - 1, config.gate_one]
    wrong = []
    for z in gates:
        got = arithmetic.state(z * h + (arithmetic.one - z) * n)
        bad = (got < np.minimum(h, n)) | (got > np.maximum(h, n))
        if z in (0, config.gate_one):
            bad |= got != (n if z == 0 else h)
        wrong.append(int(bad.sum()))
    worst = int(np.argmax(wrong))
    curve = Curve("gate code", "wrong blends", gates, {f"of {len(h)}": wrong})
    return Outcome(sum(wrong), f"z = {gates[worst]}: {wrong[worst]} of {len(h)}", curve)


def ties(bench: Bench) -> Outcome:
    """Equal logits in every pair of classes, all equal, and equal votes: decisions that are not the lowest class."""
    classes, wrong, tried = bench.config.classes, 0, 0
    worst = "none"
    for first in range(classes):
        for second in range(first + 1, classes):
            logits = np.full((1, bench.config.windows.steps, classes), -5, dtype=np.int64)
            logits[..., [first, second]] = 7
            split = np.full_like(logits, -5)
            split[:, ::2, second], split[:, 1::2, first] = 7, 7
            if bench.config.windows.steps % 2:
                split[:, -1] = logits[:, -1]
            for case, what in ((logits, "logits"), (split, "votes")):
                if what == "votes" and bench.config.network.decision != "vote":
                    continue
                local, margin, decision, _ = bench.parts.decide(bench.config, case, np.full(1, bench.config.windows.steps))
                bad = int(decision[0] != first) + int(what == "logits" and (np.any(local != first) or np.any(margin != 0)))
                wrong, tried = wrong + bad, tried + 1
                if bad:
                    worst = f"classes {first} and {second}, equal {what}"
    curve = Curve("class", "wrong", range(classes), {f"of {tried} ties": [wrong] * classes})
    return Outcome(wrong, worst if wrong else f"none of {tried} ties", curve)


# ---------------------------------------------------------------------- bits and ranges


def outside_range(bench: Bench) -> Outcome:
    """Window sums of the recordings times 2: local decisions equal to the float network's on the same; the curve: other factors."""
    gains, line = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0], []
    for gain in gains:
        louder = dataclasses.replace(bench.touches, sums=amplified(bench.config, bench.touches.sums, gain))
        codes = bench.features(louder)
        line.append(float(np.mean(bench.local(codes) == float_decisions(bench, louder))))
    curve = Curve("strength of the touch / recorded", "share of local decisions as in float", gains, {"agreement": line}, log=True)
    return Outcome(line[1], f"twice the recorded strength; 16 times: {line[4]:.3f}", curve)


def normaliser_error(bench: Bench) -> Outcome:
    """Feature codes of the recordings against (sum / length - mu) / sigma in real numbers, saturated features left out."""
    config, touches = bench.config, bench.touches
    real = pipeline.float_features(bench.real, touches) * 2.0**config.formats.feature_format.frac_bits
    done = np.arange(config.windows.steps) < touches.completed[:, None]
    inside = done[..., None] & (np.abs(real) < config.formats.feature_format.max_code - 1)
    error = np.where(inside, np.abs(bench.codes - real), 0.0)
    edges = [0.25, 0.5, 0.75, 1.0]
    touch, step, taxel = np.unravel_index(int(error.argmax()), error.shape)
    curve = Curve(
        "share of full scale",
        "largest error (LSB)",
        edges,
        {"error": [float(error[np.abs(real) <= edge * config.formats.feature_format.max_code].max(initial=0.0)) for edge in edges]},
    )
    return Outcome(float(error.max()), f"recording {int(touches.recording[touch])}, step {step + 1}, taxel {taxel}", curve)


def window_edges(bench: Bench) -> Outcome:
    """An impulse in the first and last frame of each window of a touch, and next to them: window sums against sums made one by one."""
    config = sums_alone(bench.config)
    stream = bench.clean.recording(int(bench.touches.recording[0])).astype(np.int64)
    start = int(bench.touches.start_frame[0])
    deviations = _scan(config, stream[:, None].astype(np.int32), np.array([len(stream)]))[0][:, 0]
    wrong, tried = np.zeros(config.windows.steps, dtype=np.int64), 0
    found = bench.parts.find_touches(config, rebuilt(bench.recordings, [stream], [0]))
    for k, (first, last) in enumerate(config.window_spans[: int(found.completed[0])]):
        frames = range(start - 1 + first, start + last)
        exact = [sum(int(deviations[frame - 1, taxel]) for frame in frames) for taxel in range(config.sensor.taxels)]
        wrong[k] = int(np.sum(found.sums[0, k] != exact))
        tried += config.sensor.taxels
    curve = Curve("window", "wrong sums", range(1, config.windows.steps + 1), {f"of {config.sensor.taxels} taxels": wrong.tolist()})
    return Outcome(int(wrong.sum()), f"{int(wrong.sum())} of {tried} sums", curve)


def cell_variant(bench: Bench) -> Outcome:
    """Root mean square difference of the hidden state to the float network's, at each step of the recordings: the largest."""
    touches = bench.touches
    features = pipeline.float_features(bench.real, touches)
    error = bench.config.formats.state_format.to_real(bench.forward(bench.codes)[0]) - bench.real.forward(features)[0]
    rms = np.sqrt(np.mean(error**2, axis=(0, 2)))
    curve = Curve("step", "rms difference of the state", range(1, len(rms) + 1), {"rms": rms.tolist()})
    return Outcome(finite(float(rms.max())), f"step {int(rms.argmax()) + 1}", curve)
