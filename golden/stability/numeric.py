"""Failure modes of a network's numbers: roundings that pile up, tables, bits, ranges."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.golden.core.formats import QFormat
from eskin.golden.model.cells import Fixed, run_cell
from eskin.golden.model.model import FloatModel, constants_shape, network_formats
from eskin.golden.model.preprocess import amplified
from eskin.golden.stability.core import Bench, Curve, Outcome
from eskin.golden.stability.shapes import float_decisions

GROWTH_STEPS = (20, 200, 2000, 20000)
SEQUENCES = 32
"""Sequences that run without a reset."""
WORST_ROWS = 64


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


def _real_network(bench: Bench) -> dict[str, np.ndarray]:
    """The integer weights as real numbers, under the float network's names."""
    formats = network_formats(bench.config)
    real = {name: fmt.to_real(bench.model.arrays[name]) for name, fmt in formats.items()}
    for gate in bench.config.gates:
        if bench.config.network.cell == "gru" and bench.config.network.reset == "after" and gate != "n":
            real[f"bh_{gate}"] = np.zeros_like(real[f"b_{gate}"])
    return real | {
        "mu": np.zeros(constants_shape(bench.config)),
        "sigma": np.ones(constants_shape(bench.config)),
    }


def _ideal(bench: Bench, codes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(h', logits) in real arithmetic of the very weights and features that the integers stand for."""
    return FloatModel(bench.config, _real_network(bench)).forward(
        bench.config.formats.feature_format.to_real(codes)
    )


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
    largest of steps 200 to 20000 over that of step 20.

    The median, because a touch that follows another one without a reset can bring a sequence to a point where
    the real network itself decides by a hair: there the two part for some steps, whatever the arithmetic. The
    curve shows the worst sequence too.
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
    lines = {
        "median of the sequences": ratios,
        "worst sequence": [value / max(worst_of[0], 1e-12) for value in worst_of],
    }
    curve = Curve("steps without a reset", "error / error at step 20", steps, lines, log=True)
    unit = 2.0**config.formats.state_format.frac_bits
    what = f"step {steps[worst]}: {middle[worst] * unit:.2g} LSB against {middle[0] * unit:.2g} at step 20; worst sequence "
    what += f"{max(worst_of) * unit:.3g} LSB"
    return Outcome(ratios[worst], what, curve)


def carried_bias(bench: Bench) -> Outcome:
    """Mean signed difference of the state after each step to the same cell that never rounds a state: the
    largest over the steps."""
    codes = bench.codes
    arrays = {name: array.astype(np.float64) for name, array in bench.model.arrays.items()}
    exact = run_cell(Unrounded(bench.config), bench.config, arrays, codes.astype(np.float64))[0]
    bias = (bench.forward(codes)[0] - exact).mean(axis=(0, 2))
    worst = int(np.abs(bias).argmax())
    curve = Curve(
        "step", "mean signed error (state LSB)", range(1, len(bias) + 1), {"bias": np.abs(bias).tolist()}
    )
    return Outcome(
        float(np.abs(bias[worst])),
        f"step {worst + 1}: {bias[worst]:+.3f} LSB, over {codes.shape[0]} touches",
        curve,
    )


def limit_cycle(bench: Bench) -> Outcome:
    """Peak-to-peak movement of the state under a constant input, in the last steps of a long hold of each
    touch's last feature, less that of real arithmetic."""
    hold = min(bench.long, 2000)
    rows = bench.rng(2).permutation(len(bench.codes))[:WORST_ROWS]
    codes = np.repeat(bench.codes[rows, -1:, :], hold, axis=1)
    codes[::2] = 0
    spans = {}
    fixed, ideal = (
        bench.forward(codes)[0],
        _ideal(bench, codes)[0] * 2.0**bench.config.formats.state_format.frac_bits,
    )
    points = [hold // 20, hold // 8, hold // 4, hold // 2, hold]
    for t in points:
        window = slice(max(0, t - 50), t)
        spans[t] = np.ptp(fixed[:, window], axis=1) - np.floor(np.ptp(ideal[:, window], axis=1))
    last = spans[points[-1]]
    touch, unit = np.unravel_index(int(np.argmax(last)), last.shape)
    curve = Curve(
        "steps of constant input",
        "peak to peak (state LSB)",
        points,
        {"worst unit": [float(spans[t].max()) for t in points]},
    )
    return Outcome(max(0.0, float(last.max())), f"unit {unit}, input of touch {int(rows[touch])}", curve)


def table_resolution(bench: Bench) -> Outcome:
    """Local decisions equal to those of a cell with the exact sigmoid and tanh, everything else in integers;
    the curve: other sizes."""

    class Exact(Fixed):
        def sigmoid(self, acc):
            return self._smooth_sigmoid(acc / 2.0**self._config.product_frac) * self.one

        def _tanh_at(self, value, shift, frac_bits):
            return np.tanh(value / 2.0**frac_bits) * 2.0**self._config.formats.state_format.frac_bits

    exact = bench.local(bench.codes, Exact(bench.config))
    own = float(np.mean(bench.local(bench.codes) == exact))
    sizes, line = [64, 128, 256, 512, 1024], []
    for size in sizes:
        step = bench.config.formats.table_entries / size

        def thin(table: np.ndarray, config: AcceleratorConfig, step: float = step) -> np.ndarray:
            half = len(table) // 2
            entry = np.clip(
                np.rint((np.arange(len(table)) - half) / step) * step + half, 0, len(table) - 1
            ).astype(int)
            return table[entry]

        line.append(
            float(np.mean(bench.local(bench.codes, changed_tables(thin)(bench.config)) == exact))
            if step >= 1
            else own
        )
    curve = Curve(
        "table entries (more than there are: as now)",
        "share of equal local decisions",
        sizes,
        {"agreement": line},
        log=True,
    )
    return Outcome(own, f"{bench.config.formats.table_entries} entries, {exact.size} local decisions", curve)


def outside_range(bench: Bench) -> Outcome:
    """Window sums of the recordings times 2: local decisions equal to the float network's on the same; the
    curve: other factors."""
    gains, line = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0], []
    for gain in gains:
        louder = dataclasses.replace(bench.touches, sums=amplified(bench.config, bench.touches.sums, gain))
        codes = bench.features(louder)
        line.append(float(np.mean(bench.local(codes) == float_decisions(bench, louder))))
    curve = Curve(
        "strength of the touch / recorded",
        "share of local decisions as in float",
        gains,
        {"agreement": line},
        log=True,
    )
    return Outcome(line[1], f"twice the recorded strength; 16 times: {line[4]:.3f}", curve)
