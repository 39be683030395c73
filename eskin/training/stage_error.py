"""Float against integer, stage by stage: difference, share of saturated values, used part of each format."""

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np

from eskin.golden.core import AcceleratorConfig, Arrays, QFormat, Record
from eskin.golden.model.cells import Fixed, Float, run_cell
from eskin.golden.model.model import FloatModel, IntegerModel, network_formats
from eskin.golden.model.pipeline import feature_codes, float_features
from eskin.golden.model.preprocess import Touches

STAGES = {
    "features": "rounding and saturation of the normaliser",
    "accumulators": "rounding and saturation of weights and biases; sums are exact",
    "gates": "sigmoid and tanh tables: steps, ends, rounded entries",
    "hidden state": "rounding and saturation of states and of values in their format",
    "logits": "rounding and saturation of logits",
}
"""Stages in the order of the chain, and the errors that each of them adds to a value."""


FIGURES = ("mean", "max", "saturated", "used", "logit_mean", "logit_max")
"""Figures for one stage of an integer model compared with the same stage of the float one, over completed
steps of touches.

mean, max: absolute difference, real values (all stages before it included). saturated: share of values at an
end of the stage's format, of pre-activations beyond their table, of weights at an end. used: largest absolute
code over the format's largest. logit_mean, logit_max: the logit error that this stage alone causes, with
every other stage in float.
"""


def stage_errors(real: FloatModel, integer: IntegerModel, touches: Touches) -> list[Record]:
    """An integer model beside its float one: stage and FIGURES of every stage of STAGES that its cell has, on all
    completed steps of ``touches``; empty without one. A linear cell has neither gates nor states.

    Parameters
    ----------
    real, integer:
        A network and its integers. Real values of codes are compared: a code over 2**frac, an accumulator
        over 2**product_frac, a feature of the integer normaliser with a float one.
    touches:
        As ``find_touches`` gives them.
    """
    runs, errors = _Runs(real, integer, touches), []
    for stage, (fmt, ideal, values) in runs.values.items():
        error, alone = np.abs(values - ideal), runs.alone(stage)
        size = np.abs(values).max() * 2.0**fmt.frac_bits
        at_ends, used = _at_ends(values * 2.0**fmt.frac_bits, fmt), size / fmt.magnitude
        if stage == "accumulators":
            names = network_formats(integer.config)
            ends = [_at_ends(integer.arrays[name], fmt) for name, fmt in names.items()]
            at_ends = float(np.average(ends, weights=[integer.arrays[name].size for name in names]))
        elif stage == "gates":
            at_ends, used = float(np.mean(runs.reach > 1)), min(1.0, runs.reach.max())
        errors.append(figures_of(stage, error, at_ends, used, alone))
    return errors


def figures_of(stage: str, error: np.ndarray, at_ends: float, used: float, alone: np.ndarray) -> Record:
    """The record of a stage: absolute errors of its values, and of the logits by it alone."""
    figures = (error.mean(), error.max(), at_ends, used, alone.mean(), alone.max())
    return {"stage": stage, **dict(zip(FIGURES, map(float, figures), strict=True))}


def logit_error(stages: Sequence[Record]) -> Record:
    """{mean, max, stage} of ``stage_errors``: the logits' error, and the stage that alone brings about the
    largest; None without steps."""
    if not stages:
        return {"mean": None, "max": None, "stage": None}
    most = max(stages, key=lambda row: row["logit_max"])
    return {"mean": stages[-1]["mean"], "max": stages[-1]["max"], "stage": most["stage"]}


def _at_ends(codes: np.ndarray, fmt: QFormat) -> float:
    return float(np.mean((codes <= fmt.min_code) | (codes >= fmt.max_code)))


# ---------------------------------------------------------------------- both networks, every value looked at
OPERATIONS = {
    "sigmoid": ("gates", "product", "gate"),
    "tanh": ("gates", "product", "state"),
    "tanh_of_state": ("gates", "state", "state"),
    "value": ("hidden state", "product", "state"),
    "state": ("hidden state", "gate x state", "state"),
    "logit": ("logits", "dense", "logit"),
}
"""Operations of an arithmetic: the stage that each belongs to, and the units of its operand and result."""
TABLE_ENDS = {"sigmoid": 8.0, "tanh": 4.0, "tanh_of_state": 4.0}
"""Largest pre-activation of each table."""


def _units(config: AcceleratorConfig) -> dict[str, float]:
    """Codes of 1.0, by unit."""
    gate, state = float(config.gate_one), 2.0**config.formats.state_format.frac_bits
    products = {"product": 2.0**config.product_frac, "dense": 2.0**config.dense_product_frac}
    logit = 2.0**config.formats.logit_format.frac_bits
    return products | {"gate": gate, "state": state, "gate x state": gate * state, "logit": logit}


class _Only:
    """Real arithmetic in which one stage is that of the integer model."""

    def __init__(self, config: AcceleratorConfig, stage: str) -> None:
        self._float = Float(config)
        self._fixed = Fixed(config)
        self._stage = stage
        self._units = _units(config)

    def __getattr__(self, name: str) -> Any:
        stage, source, result = OPERATIONS.get(name, ("", "", ""))
        if stage != self._stage:
            return getattr(self._float, name)
        units, operation = self._units, getattr(self._fixed, name)
        return lambda value: operation(value * units[source]) / units[result]


class _Noted:
    """An arithmetic that notes operands and results of its operations, as real values, step by step."""

    def __init__(self, arithmetic: Float | Fixed, config: AcceleratorConfig) -> None:
        self._arithmetic, self._steps = arithmetic, config.windows.steps
        units = _units(config)
        self._units = units if isinstance(arithmetic, Fixed) else dict.fromkeys(units, 1.0)
        self._calls: dict[str, list[np.ndarray]] = defaultdict(list)
        self._rows = np.zeros(0)
        """Sums of the dense layer (touches, steps, classes)."""

    def __getattr__(self, name: str) -> Any:
        operation = getattr(self._arithmetic, name)
        if name not in OPERATIONS:
            return operation
        stage, source, target = OPERATIONS[name]

        def noted(value: np.ndarray) -> np.ndarray:
            before, result = value / self._units[source], operation(value)
            if source == "dense":  # (touches x steps, classes), of a linear cell (steps, touches, classes)
                by_step = before.reshape(-1, self._steps, before.shape[-1])
                self._rows = before.swapaxes(0, 1) if before.ndim == 3 else by_step
            else:
                self._calls[stage].append(result / self._units[target])
            if source == "product":
                self._calls["accumulators"].append(before)
            if name in TABLE_ENDS:
                self._calls["reach"].append(np.abs(before) / TABLE_ENDS[name])
            return result

        return noted

    def of(self, stage: str, complete: np.ndarray) -> np.ndarray:
        """All values of completed steps, flat."""
        calls = self._calls[stage]
        a_step = len(calls) // self._steps  # the same number of values of a stage in every step
        parts = [value[complete[:, k // a_step]].flatten() for k, value in enumerate(calls)]
        return np.concatenate(parts + [self._rows[complete].flatten()] * (stage == "accumulators"))


class _Runs:
    """A network and its integers on the completed steps of touches.

    values: stage of STAGES -> (format, real values, integer ones as real); nothing without a step. reach:
    pre-activations of the integer network over the end of their table.
    """

    def __init__(self, real: FloatModel, integer: IntegerModel, touches: Touches) -> None:
        self._config = config = integer.config
        self._real, self._integer, formats, steps = real, integer, config.formats, config.windows.steps
        self._complete = complete = np.arange(steps) < touches.completed[:, None]
        self.values: dict[str, tuple[QFormat, np.ndarray, np.ndarray]] = {}
        if not complete.any():
            return
        self._features = float_features(real, touches)[:, :steps]
        codes = feature_codes(integer, touches)[:, :steps]
        self._codes = formats.feature_format.to_real(codes)
        ideal, exact = _Noted(Float(config), config), _Noted(Fixed(config), config)
        self._logits = self._run(ideal, real.arrays, self._features)
        logits = formats.logit_format.to_real(self._run(exact, integer.arrays, codes))
        frac = config.product_frac if config.recurrent else config.dense_product_frac
        inner = {"accumulators": QFormat(config.accumulator_bits - frac, frac)}
        if config.recurrent:
            inner |= {"gates": config.gate_format, "hidden state": formats.state_format}
            self.reach = exact.of("reach", complete)
        self.values["features"] = (formats.feature_format, self._features[complete], self._codes[complete])
        for stage, fmt in inner.items():
            self.values[stage] = (fmt, ideal.of(stage, complete), exact.of(stage, complete))
        self.values["logits"] = (formats.logit_format, self._logits[complete], logits[complete])

    def alone(self, stage: str) -> np.ndarray:
        """Errors of the logits when this stage alone is that of the integer model."""
        arrays = dict(self._real.arrays)
        if stage == "accumulators":
            formats = network_formats(self._config)
            arrays = {name: fmt.to_real(self._integer.arrays[name]) for name, fmt in formats.items()}
        features = self._codes if stage == "features" else self._features
        logits = self._run(_Only(self._config, stage), arrays, features)
        return np.abs(logits - self._logits)[self._complete]

    def _run(self, arithmetic: Any, arrays: Arrays, features: np.ndarray) -> np.ndarray:
        parameters = {name: np.asarray(array, dtype=np.float64) for name, array in arrays.items()}
        return run_cell(arithmetic, self._config, parameters, features.astype(np.float64))[1]
