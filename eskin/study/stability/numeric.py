"""Failure modes of a network's numbers: roundings that pile up, ranges."""

import dataclasses

import numpy as np

from eskin.golden.core import AcceleratorConfig, InputError
from eskin.golden.model import FloatModel, constants_shape, network_formats, network_shapes
from eskin.golden.model.preprocess import companded
from eskin.study.stability.core import Bench, Curve, Outcome
from eskin.study.stability.shapes import float_decisions

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
    config = bench.config
    steps = [t for t in GROWTH_STEPS if t <= bench.long]
    codes = _endless(bench, steps[-1])
    fixed, ideal = bench.forward(codes)[0], _ideal(bench, codes)
    errors = []
    for t in steps:
        last = slice(max(t - config.windows.steps, 0), t)
        error = config.formats.state_format.to_real(fixed[:, last]) - ideal[:, last]
        errors.append(np.sqrt(np.mean(error**2, axis=(1, 2))))
    middle, worst_of = [float(np.median(rms)) for rms in errors], [float(rms.max()) for rms in errors]
    ratios = [value / max(middle[0], 1e-12) for value in middle]
    worst = int(np.argmax(ratios[1:])) + 1 if len(steps) > 1 else 0
    lines = {
        "median of the sequences": ratios,
        "worst sequence": [value / max(worst_of[0], 1e-12) for value in worst_of],
    }
    curve = Curve("steps without a reset", "error / error at step 20", steps, lines, log=True)
    unit = 2.0**config.formats.state_format.frac_bits
    words = f"step {steps[worst]}: {middle[worst] * unit:.2g} LSB against {middle[0] * unit:.2g} at step 20; worst sequence "
    words += f"{max(worst_of) * unit:.3g} LSB"
    return Outcome(ratios[worst], words, curve)


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
