"""Failure modes of a network's numbers: roundings that pile up, ranges."""

import dataclasses

import numpy as np

from eskin.golden.core import AcceleratorConfig, InputError
from eskin.golden.model import FloatModel, constants_shape, network_formats, network_shapes
from eskin.golden.model.preprocess import companded
from eskin.study.stability.core import Bench, Outcome, curve
from eskin.study.stability.shapes import agreement

GROWTH_STEPS = (20, 200, 2000, 20000)
SEQUENCES = 32
"""Sequences that run without a reset."""


def amplified(config: AcceleratorConfig, sums: np.ndarray, gain: float) -> np.ndarray:
    """Sums that the windows would have (as ``sums``, int64) if the touches were ``gain`` times as strong;
    clipped to +-2**40."""
    scaled = np.clip(np.rint(sums * gain), -(2**40), 2**40).astype(np.int64)
    features = config.features
    if "integral" not in features.feature_kinds:
        return scaled
    # A gain acts on the integral, not on its logarithm: undo the companding, amplify, compand again.
    unit = 1 << features.integral_frac
    whole, part = np.divmod(np.abs(sums), unit)
    before = np.sign(sums) * (
        (unit + part) * 2.0 ** (whole + features.integral_knee - features.integral_frac)
        - 2.0**features.integral_knee
    )
    after = companded(np.rint(gain * before).astype(np.int64), features.integral_knee, features.integral_frac)
    integral = [features.feature_kinds[kind] == "integral" for kind in config.input_kinds]
    return np.where(integral, after, scaled)


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
    largest of steps 200 to 20000 over that of step 20.

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
        louder = dataclasses.replace(bench.touches, sums=amplified(bench.config, bench.touches.sums, gain))
        line[gain] = agreement(bench.model, bench.real, louder)
    xlabel, ylabel = "strength of the touch / recorded", "share of local decisions as in float"
    drawn = curve(xlabel, ylabel, line, {"agreement": line.values()}, log=True)
    return Outcome(line[2.0], f"twice the recorded strength; 16 times: {line[16.0]:.3f}", drawn)
