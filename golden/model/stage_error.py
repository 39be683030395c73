"""Float against integer, stage by stage: how far they are apart, what saturates, how much of its format each
stage uses."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.formats import QFormat
from eskin.golden.model.cells import Fixed, Float, run_cell
from eskin.golden.model.model import FloatModel, IntegerModel, network_formats
from eskin.golden.model.pipeline import feature_codes, float_features

if TYPE_CHECKING:
    from eskin.golden.model.preprocess import Touches

STAGES = {
    "features": "rounding and saturation of the normaliser",
    "accumulators": "rounding and saturation of weights and biases; sums are exact",
    "gates": "sigmoid and tanh tables: steps, ends, rounded entries",
    "hidden state": "rounding and saturation of states and of values in their format",
    "logits": "rounding and saturation of logits",
}
"""Stages in the order of the chain, and what each of them does to a value."""


@dataclass(frozen=True)
class StageError:
    """One stage of an integer model beside the same stage of the float one, over completed steps of touches.

    mean, max: absolute difference, real values (all stages before it included). saturated: share of values at
    an end of the stage's format, of pre-activations beyond their table, of weights at an end. used: largest
    absolute code over the format's largest. logit_mean, logit_max: the logit error that this stage alone
    brings about, every other one in float.
    """

    stage: str
    mean: float
    max: float
    saturated: float
    used: float
    logit_mean: float
    logit_max: float


def stage_errors(real: FloatModel, integer: IntegerModel, touches: Touches) -> list[StageError]:
    """An integer model beside its float one, for every stage of STAGES that its cell has, on all completed
    steps of ``touches``; empty without one. A linear cell has neither gates nor states.

    Parameters
    ----------
    real, integer:
        A network and its integers. Real values of codes are compared: a code over 2**frac, an accumulator
        over 2**product_frac, a feature of the integer normaliser with a float one.
    touches:
        As ``find_touches`` gives them.
    """
    config = integer.config
    done = np.arange(config.windows.steps) < touches.completed[:, None]
    if not done.any():
        return []
    formats, mask = config.formats, done
    ideal, codes = (
        float_features(real, touches)[:, : config.windows.steps],
        feature_codes(integer, touches)[:, : config.windows.steps],
    )
    weights = {name: fmt.to_real(integer.arrays[name]) for name, fmt in network_formats(config).items()}

    float_notes, integer_notes = _NotedFloat(config), _NotedFixed(config)
    logits = _logits(float_notes, config, real.arrays, ideal)
    got = _logits(integer_notes, config, integer.arrays, codes) / 2.0**formats.logit_format.frac_bits

    def alone(stage: str) -> tuple[float, float]:
        features = formats.feature_format.to_real(codes) if stage == "features" else ideal
        arrays = weights if stage == "accumulators" else real.arrays
        error = np.abs(_logits(_Only(config, stage), config, arrays, features) - logits)[mask]
        return float(error.mean()), float(error.max())

    pairs = {
        "features": (ideal[done], formats.feature_format.to_real(codes)[done]),
        **{
            stage: (float_notes.values(stage, mask), integer_notes.values(stage, mask))
            for stage in ("accumulators", "gates", "hidden state")
        },
        "logits": (logits[mask], got[mask]),
    }
    constants = [_at_ends(integer.arrays[name], fmt) for name, fmt in network_formats(config).items()]
    sizes = [integer.arrays[name].size for name in weights]
    reach = integer_notes.reach(mask)
    product_frac = config.product_frac if config.recurrent else config.dense_product_frac
    top = float(
        np.abs(pairs["accumulators"][1]).max() * 2.0**product_frac / 2.0 ** (config.accumulator_bits - 1)
    )
    shares = {
        "features": _shares(codes[done], formats.feature_format),
        "accumulators": (float(np.average(constants, weights=sizes)), top),
        "gates": (float((reach > 1).mean()), min(1.0, float(reach.max()))),
        "hidden state": _shares(
            pairs["hidden state"][1] * 2.0**formats.state_format.frac_bits, formats.state_format
        ),
        "logits": _shares(pairs["logits"][1] * 2.0**formats.logit_format.frac_bits, formats.logit_format),
    }
    errors = []
    for stage, (float_values, integer_values) in pairs.items():
        if not config.recurrent and stage in ("gates", "hidden state"):
            continue
        error = np.abs(integer_values - float_values)
        errors.append(
            StageError(stage, float(error.mean()), float(error.max()), *shares[stage], *alone(stage))
        )
    return errors


QUANTILES = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)
"""Of the absolute values of a signal: ends, whiskers, box and middle."""


@dataclass(frozen=True)
class SignalProfile:
    """One signal of the float network against the format that the integer network gives it; real values.

    signal: an array (``W_z``) or a stage. kind: ``weights`` or ``activations``. format: printed. step, limit:
    the format's step and largest value. quantiles: of the absolute values that are not 0, at QUANTILES; empty
    where there are none. values: how many there are. zero: share that is not 0 and that the format rounds to
    0. beyond: share beyond its ends. error_mean, error_max: absolute difference of the integer network's
    values. used: largest absolute value over the limit.
    """

    signal: str
    kind: str
    format: str
    step: float
    limit: float
    quantiles: tuple[float, ...]
    values: int
    zero: float
    beyond: float
    error_mean: float
    error_max: float
    used: float


def signal_profiles(real: FloatModel, integer: IntegerModel, touches: Touches) -> list[SignalProfile]:
    """Every array of weights, and every stage over the completed steps of ``touches``, against its format:
    what hls4ml calls profiling.

    Parameters
    ----------
    real, integer, touches:
        As for ``stage_errors``.
    """
    config, formats = integer.config, integer.config.formats
    profiles = []
    for name, fmt in network_formats(config).items():
        # the second bias of a float reset-after gate is one with the first
        second = (
            real.arrays.get(name.replace("b_", "bh_", 1)) if name.startswith("b_") and name != "b_y" else None
        )
        ideal_values = real.arrays[name] + (
            second if second is not None and name.replace("b_", "bh_", 1) not in integer.arrays else 0
        )
        profiles.append(profile_of(name, "weights", fmt, ideal_values, fmt.to_real(integer.arrays[name])))
    steps = config.windows.steps
    mask = np.arange(steps) < touches.completed[:, None]
    if not mask.any():
        return profiles
    ideal, codes = float_features(real, touches)[:, :steps], feature_codes(integer, touches)[:, :steps]
    wanted_stages, made_stages = _NotedFloat(config), _NotedFixed(config)
    logits = _logits(wanted_stages, config, real.arrays, ideal)
    got = _logits(made_stages, config, integer.arrays, codes) / 2.0**formats.logit_format.frac_bits
    product_frac = config.product_frac if config.recurrent else config.dense_product_frac
    stages = [("features", formats.feature_format, ideal[mask], formats.feature_format.to_real(codes)[mask])]
    inner = {
        "accumulators": QFormat(config.accumulator_bits - product_frac, product_frac),
        "gates": config.gate_format,
        "hidden state": formats.state_format,
    }
    for stage, fmt in inner.items():
        if config.recurrent or stage == "accumulators":
            stages.append((stage, fmt, wanted_stages.values(stage, mask), made_stages.values(stage, mask)))
    stages.append(("logits", formats.logit_format, logits[mask], got[mask]))
    return profiles + [profile_of(stage, "activations", fmt, a, b) for stage, fmt, a, b in stages]


def profile_of(
    signal: str, kind: str, fmt: QFormat, float_values: np.ndarray, integer_values: np.ndarray
) -> SignalProfile:
    """The profile of one signal. kind: ``weights`` or ``activations``.

    The values are real ones, of the float and of the integer model.
    """
    step, limit = 2.0**-fmt.frac_bits, fmt.max_code * 2.0**-fmt.frac_bits
    size, error = np.abs(float_values).reshape(-1), np.abs(integer_values - float_values)
    nonzero = size[size > 0]
    below, above = float_values < (fmt.min_code - 0.5) * step, float_values > (fmt.max_code + 0.5) * step
    return SignalProfile(
        signal,
        kind,
        str(fmt),
        step,
        limit,
        tuple(float(value) for value in np.quantile(nonzero, QUANTILES)) if len(nonzero) else (),
        size.size,
        float(np.mean((size > 0) & (size < step / 2))),
        float(np.mean(below | above)),
        float(error.mean()),
        float(error.max()),
        float(size.max() / limit),
    )


def logit_error(stages: Sequence[StageError]) -> dict[str, Any]:
    """{mean, max, stage} of ``stage_errors``: the logits' error, and the stage that alone brings about the
    largest; None without steps."""
    if not stages:
        return {"mean": None, "max": None, "stage": None}
    logits = stages[-1]
    return {
        "mean": logits.mean,
        "max": logits.max,
        "stage": max(stages, key=lambda stage: stage.logit_max).stage,
    }


def records(stages: Sequence[StageError | SignalProfile]) -> list[dict[str, Any]]:
    """Plain values for JSON."""
    return [asdict(stage) for stage in stages]


def _at_ends(codes: np.ndarray, fmt: QFormat) -> float:
    return float(np.mean((codes <= fmt.min_code) | (codes >= fmt.max_code)))


def _shares(codes: np.ndarray, fmt: QFormat) -> tuple[float, float]:
    return _at_ends(codes, fmt), float(np.abs(codes).max() / fmt.magnitude)


def _logits(
    arithmetic: Float | Fixed,
    config: AcceleratorConfig,
    arrays: Mapping[str, np.ndarray],
    features: np.ndarray,
) -> np.ndarray:
    parameters = {name: np.asarray(array, dtype=np.float64) for name, array in arrays.items()}
    return run_cell(arithmetic, config, parameters, np.asarray(features, dtype=np.float64))[1]


class _Only(Float):
    """Real arithmetic but for one stage, which is that of the integer model."""

    def __init__(self, config: AcceleratorConfig, stage: str) -> None:
        super().__init__(config)
        self._fixed, self._stage, self._config = Fixed(config), stage, config
        self._state = 2.0**config.formats.state_format.frac_bits

    def sigmoid(self, acc):
        if self._stage != "gates":
            return super().sigmoid(acc)
        return self._fixed.sigmoid(acc * 2.0**self._config.product_frac) / self._fixed.one

    def tanh(self, acc):
        return (
            self._fixed.tanh(acc * 2.0**self._config.product_frac) / self._state
            if self._stage == "gates"
            else super().tanh(acc)
        )

    def tanh_of_state(self, value):
        return (
            self._fixed.tanh_of_state(value * self._state) / self._state
            if self._stage == "gates"
            else super().tanh_of_state(value)
        )

    def value(self, acc):
        return (
            self._fixed.value(acc * 2.0**self._config.product_frac) / self._state
            if self._stage == "hidden state"
            else acc
        )

    def state(self, products):
        return (
            self._fixed.state(products * self._fixed.one * self._state) / self._state
            if self._stage == "hidden state"
            else products
        )

    def logit(self, acc):
        if self._stage != "logits":
            return acc
        return (
            self._fixed.logit(acc * 2.0**self._config.dense_product_frac)
            / 2.0**self._config.formats.logit_format.frac_bits
        )


class _Notes:
    """Real values of stages in the order in which steps make them."""

    def __init__(self, steps: int) -> None:
        self._steps = steps
        self._by_step: dict[str, list[np.ndarray]] = defaultdict(list)
        self._dense: dict[str, np.ndarray] = {}

    def add(self, stage: str, value: np.ndarray) -> None:
        self._by_step[stage].append(value)

    def add_dense(self, stage: str, value: np.ndarray) -> None:
        """``value``: (touches x steps, C), or of a linear cell (steps, touches, C)."""
        self._dense[stage] = (
            value.swapaxes(0, 1) if value.ndim == 3 else value.reshape(-1, self._steps, value.shape[-1])
        )

    def of(self, stage: str, done: np.ndarray) -> np.ndarray:
        """All values of completed steps, flat."""
        calls = self._by_step[stage]
        a_step = len(calls) // self._steps  # the same number of values of a stage in every step
        parts = [value[done[:, k // a_step]].flatten() for k, value in enumerate(calls)]
        if stage in self._dense:
            parts.append(self._dense[stage][done].flatten())
        return np.concatenate(parts) if parts else np.zeros(1)


def _noted(arithmetic: type[Float] | type[Fixed]) -> type:
    """``arithmetic`` that notes accumulators, gates and states as real values, and how far into their table
    pre-activations reach."""

    class Noted(arithmetic):  # type: ignore[misc, valid-type]
        def __init__(self, config: AcceleratorConfig) -> None:
            super().__init__(config)
            fixed = arithmetic is Fixed
            self._notes = _Notes(config.windows.steps)
            self._product = 2.0**config.product_frac if fixed else 1.0
            self._dense_product = 2.0**config.dense_product_frac if fixed else 1.0
            self._state = 2.0**config.formats.state_format.frac_bits if fixed else 1.0

        def values(self, stage: str, done: np.ndarray) -> np.ndarray:
            return self._notes.of(stage, done)

        def reach(self, done: np.ndarray) -> np.ndarray:
            """Pre-activations over the end of their table."""
            return self._notes.of("reach", done)

        def _row(self, acc: np.ndarray) -> np.ndarray:
            self._notes.add("accumulators", acc / self._product)
            return acc

        def _gate(self, before: np.ndarray, span: float, after: np.ndarray, unit: float) -> np.ndarray:
            self._notes.add("reach", np.abs(before) / span)
            self._notes.add("gates", after / unit)
            return after

        def sigmoid(self, acc):
            return self._gate(acc / self._product, 8.0, super().sigmoid(self._row(acc)), self.one)

        def tanh(self, acc):
            return self._gate(acc / self._product, 4.0, super().tanh(self._row(acc)), self._state)

        def tanh_of_state(self, value):
            return self._gate(value / self._state, 4.0, super().tanh_of_state(value), self._state)

        def value(self, acc):
            return self._stored(super().value(self._row(acc)))

        def state(self, products):
            return self._stored(super().state(products))

        def _stored(self, value: np.ndarray) -> np.ndarray:
            self._notes.add("hidden state", value / self._state)
            return value

        def logit(self, acc):
            self._notes.add_dense("accumulators", acc / self._dense_product)
            return super().logit(acc)

    return Noted


_NotedFloat, _NotedFixed = _noted(Float), _noted(Fixed)
