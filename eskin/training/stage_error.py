"""Float against integer, stage by stage: difference, share of saturated values, used part of each format.

The stages of a network for recordings are STAGES; the stages of a network for images are its layers
with weights.
"""

from collections import defaultdict
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from eskin.golden.core import AcceleratorConfig, QFormat, Result
from eskin.golden.core.images import PIXEL_FORMAT
from eskin.golden.model import float_images, layer_formats, run_images
from eskin.golden.model.cells import Fixed, Float, run_cell
from eskin.golden.model.forest import run_forest
from eskin.golden.model.image_network import layer_by_layer
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


class StageError(Result):
    """Figures for one stage of an integer model compared with the same stage of the float one, over completed
    steps of touches, or over images.

    mean, max: absolute difference, real values (all stages before it included). saturated: share of values at an
    end of the stage's format, of pre-activations beyond their table, of weights at an end. used: largest absolute
    code over the format's largest. logit_mean, logit_max: the logit error that this stage alone causes, with
    every other stage in float.
    """

    stage: str
    mean: float
    max: float
    saturated: float
    used: float
    logit_mean: float
    logit_max: float


class LogitError(Result):
    """Distance of integer logits from float ones, and the stage that alone causes the largest; None without a step."""

    mean: float | None = None
    max: float | None = None
    stage: str | None = None


def stage_errors(real: FloatModel, integer: IntegerModel, touches: Touches) -> list[StageError]:
    """An integer model beside its float one: the figures of every stage of STAGES that its cell has, on all
    completed steps of ``touches``; empty without one. A linear cell has neither gates nor states.

    Parameters
    ----------
    real, integer:
        A network and its integers. Real values of codes are compared: a code over 2**frac, an accumulator
        over 2**product_frac, a feature of the integer normaliser with a float one.
    touches:
        As ``find_touches`` gives them.
    """
    config, formats, steps = integer.config, integer.config.formats, integer.config.windows.steps
    complete = touches.complete(steps)
    if not complete.any():
        return []
    of_weights = network_formats(config)
    weights = [real.arrays, {name: fmt.to_real(integer.arrays[name]) for name, fmt in of_weights.items()}]
    codes = formats.feature_format.to_real(feature_codes(integer, touches))
    features = [values[:, :steps].astype(np.float64) for values in (float_features(real, touches), codes)]

    if config.is_forest:
        return _forest_errors(real, integer, features, complete)

    def run(stages: Collection[str]) -> tuple[_Arithmetic, np.ndarray]:
        """The network with these stages as in the integer model: the values of all stages, and the logits."""
        arithmetic = _Arithmetic(config, stages)
        arrays = weights["accumulators" in stages].items()
        parameters = {name: np.asarray(array, dtype=np.float64) for name, array in arrays}
        return arithmetic, run_cell(arithmetic, config, parameters, features["features" in stages])[1]

    (ideal, logits), (exact, _) = run(()), run(STAGES)
    frac = config.product_frac if config.recurrent else config.dense_product_frac
    of_stage = {
        "features": formats.feature_format,
        "accumulators": QFormat(config.accumulator_bits - frac, frac),
        "gates": config.gate_format,
        "hidden state": formats.state_format,
        "logits": formats.logit_format,
    }
    errors = []
    for stage in STAGES if config.recurrent else ("features", "accumulators", "logits"):
        fmt = of_stage[stage]
        wanted, values = (
            [of[complete] for of in features]
            if stage == "features"
            else [arithmetic.of(stage, complete) for arithmetic in (ideal, exact)]
        )
        alone = np.abs(run([stage])[1] - logits)[complete]
        size = np.abs(values).max() * 2.0**fmt.frac_bits
        at_ends, used = _at_ends(values * 2.0**fmt.frac_bits, fmt), size / fmt.magnitude
        if stage == "accumulators":
            ends = [_at_ends(integer.arrays[name], fmt) for name, fmt in of_weights.items()]
            at_ends = float(np.average(ends, weights=[integer.arrays[name].size for name in of_weights]))
        elif stage == "gates":
            reach = exact.of("reach", complete)
            at_ends, used = float(np.mean(reach > 1)), min(1.0, reach.max())
        errors.append(_figures(stage, np.abs(values - wanted), at_ends, used, alone))
    return errors


def _forest_errors(
    real: FloatModel, integer: IntegerModel, features: Sequence[np.ndarray], complete: np.ndarray
) -> list[StageError]:
    """The figures of trees: of the features, real and of the integer model, and of the logits, which integer thresholds and
    votes alone move, too."""
    config, formats = integer.config, integer.config.formats
    nodes = {name: np.asarray(array, dtype=np.float64) for name, array in integer.arrays.items()}
    nodes["threshold"] = formats.feature_format.to_real(integer.arrays["threshold"])
    nodes["vote"] = formats.logit_format.to_real(integer.arrays["vote"])
    logits, other_features, other_nodes, exact = (
        run_forest(config, arrays, values)[1] for arrays in (real.arrays, nodes) for values in features
    )

    def figures(
        stage: str, fmt: QFormat, wanted: np.ndarray, values: np.ndarray, moved: np.ndarray
    ) -> StageError:
        codes = values[complete] * 2.0**fmt.frac_bits
        used = np.abs(codes).max() / fmt.magnitude
        error, moved_by = np.abs(values - wanted)[complete], np.abs(moved - logits)[complete]
        return _figures(stage, error, _at_ends(codes, fmt), used, moved_by)

    return [
        figures("features", formats.feature_format, features[0], features[1], other_features),
        figures("logits", formats.logit_format, logits, exact, other_nodes),
    ]


def layer_errors(real: FloatModel, integer: IntegerModel, images: np.ndarray) -> list[StageError]:
    """The same for networks for images: the figures of each layer with weights."""
    config, layers = integer.config, layer_formats(integer.config)
    ideal, trace = float_images(real, images), run_images(integer, images)
    maps = [(ideal.maps[stage.number], trace.maps[stage.number]) for stage, *_ in layers[:-1]]
    errors = []
    for index, (stage, weight, before, after) in enumerate(layers):
        wanted, codes = [*maps, (ideal.logits, trace.logits)][index]
        names = f"W_{stage.number}", f"b_{stage.number}"
        # this layer alone has weights, bias and output format of the integer network
        arrays = dict(real.arrays)
        arrays[names[0]] = weight.to_real(integer.arrays[names[0]])
        arrays[names[1]] = integer.arrays[names[1]] / 2.0 ** (weight.frac_bits + before.frac_bits)

        def behind(number: int, sums: np.ndarray, alone: int = index, fmt: QFormat = after) -> np.ndarray:
            if number == alone:
                return fmt.to_real(fmt.quantise(sums, rounding="RND"))
            return sums if number == len(layers) - 1 else np.maximum(sums, 0.0)

        *_, logits = layer_by_layer(config, arrays, PIXEL_FORMAT.to_real(images)[..., None], behind)
        alone = np.abs(logits.reshape(len(images), -1) - ideal.logits)
        at_end = (codes >= after.max_code) | (after.signed & (codes <= after.min_code))
        used = np.abs(codes.astype(np.int64)).max() / after.max_code
        error = np.abs(after.to_real(codes) - wanted)
        errors.append(_figures(f"{stage.number} {stage.layer}", error, at_end.mean(), used, alone))
    return errors


def _figures(stage: str, error: np.ndarray, at_ends: float, used: float, alone: np.ndarray) -> StageError:
    """The record of a stage: absolute errors of its values, and of the logits by it alone."""
    return StageError(
        stage=stage,
        mean=error.mean(),
        max=error.max(),
        saturated=at_ends,
        used=used,
        logit_mean=alone.mean(),
        logit_max=alone.max(),
    )


def logit_error(stages: Sequence[StageError]) -> LogitError:
    """The logits' error of ``stage_errors``."""
    if not stages:
        return LogitError(mean=None, max=None, stage=None)
    most = max(stages, key=lambda row: row.logit_max)
    return LogitError(mean=stages[-1].mean, max=stages[-1].max, stage=most.stage)


def _at_ends(codes: np.ndarray, fmt: QFormat) -> float:
    return float(np.mean((codes <= fmt.min_code) | (codes >= fmt.max_code)))


# ---------------------------------------------------------------------- every value looked at
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


class _Arithmetic:
    """Real arithmetic in which some stages are computed by the integer model. It notes the results of each stage,
    the sums that are narrowed (``accumulators``) and pre-activations over the end of their table (``reach``)."""

    def __init__(self, config: AcceleratorConfig, stages: Collection[str]) -> None:
        self._float, self._fixed, self._stages = Float(config), Fixed(config), stages
        gate, state = float(config.gate_one), 2.0**config.formats.state_format.frac_bits
        self._units = {
            "product": 2.0**config.product_frac,
            "dense": 2.0**config.dense_product_frac,
            "gate": gate,
            "state": state,
            "gate x state": gate * state,
            "logit": 2.0**config.formats.logit_format.frac_bits,
        }
        self._steps = config.windows.steps
        self._noted: dict[str, list[np.ndarray]] = defaultdict(list)

    def __getattr__(self, name: str) -> Any:
        if name not in OPERATIONS:
            return getattr(self._float, name)
        stage, source, target = OPERATIONS[name]

        def operation(value: np.ndarray) -> np.ndarray:
            if stage in self._stages:
                codes = getattr(self._fixed, name)(value * self._units[source])
                result = codes / self._units[target]
            else:
                result = getattr(self._float, name)(value)
            self._noted[stage].append(result)
            if source in ("product", "dense"):
                self._noted["accumulators"].append(value)
            if name in TABLE_ENDS:
                self._noted["reach"].append(np.abs(value) / TABLE_ENDS[name])
            return result

        return operation

    def of(self, stage: str, complete: np.ndarray) -> np.ndarray:
        """All values of completed steps, flat."""
        noted = self._noted[stage]
        # the dense layer comes last: all steps at once
        whole = [noted[-1]] if stage in ("accumulators", "logits") else []
        by_step = noted[: len(noted) - len(whole)]
        a_step = len(by_step) // self._steps  # the same number of values of a stage in every step
        parts = [value[complete[:, k // a_step]].ravel() for k, value in enumerate(by_step)]
        # (touches x steps, classes), of a linear cell (steps, touches, classes)
        parts += [
            (rows.swapaxes(0, 1) if rows.ndim == 3 else rows.reshape(*complete.shape, -1))[complete].ravel()
            for rows in whole
        ]
        return np.concatenate(parts)
