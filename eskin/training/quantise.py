"""Quantisation: profile ranges on recordings, choose a format per signal, export the integer network, or
continue its training in integers."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch

from eskin.golden.core import PRESETS, AcceleratorConfig, Arrays, InputError, QFormat, Record
from eskin.golden.core.config import WIDEST_DSP_ACCUMULATOR
from eskin.golden.model import (
    Fixed,
    Float,
    FloatModel,
    IntegerModel,
    Touches,
    float_features,
    network_formats,
    network_shapes,
    real_by_input,
    run_cell,
)
from eskin.golden.model.preprocess import by_input, shifts_by_input
from eskin.golden.model.straight_through import straight_through
from eskin.training.formats import normaliser_constants
from eskin.training.record import SignalRange
from eskin.training.trees import forest_codes

Range = tuple[float, float]

WEIGHT_BITS, FEATURE_BITS, BIAS_BITS, LOGIT_BITS = 8, 12, 16, 16
"""Default widths; state and gates keep the configuration's."""

OPERAND_BITS = 16
"""Bits of a lane's operand, and so of the widest feature."""

LEAST_STATE_FRAC = 10
"""Fewest fraction bits of a state that gives up bits to make room on the lanes' scale for finer recurrent
weights."""

LOW_WEIGHT_BITS, LOW_BIT_STATE = 4, 12
"""With at most LOW_WEIGHT_BITS weight bits the state has LOW_BIT_STATE bits: weights with few fraction bits
leave no room for a finer state on the lanes' scale."""

FEATURE_COVERAGE = 0.999
"""Share of the features (by magnitude) that the feature format holds; rarer ones saturate."""

COVERED_FEATURE = f"feature ({FEATURE_COVERAGE:.1%})"
"""Name of that range."""

LAST_LOGIT, ROUNDING = "last logit", 1 / 512
"""Name of the range of logits at the last steps of touches. Share of their span by which the rounded weights
of a linear cell may move a logit."""
LAST_MARGIN, CLOSE = "last margin", 0.01
"""Name of the range of leads at the last steps: by how much the first class is ahead of the second. It begins at the
quantile CLOSE; the rounded weights of a linear cell may not move a logit by more than that."""

SIGNALS = {
    "feature": "feature",
    COVERED_FEATURE: "feature",
    "weight": "weight",
    "recurrent": "recurrent",
    "bias": "bias",
    "dense": "dense",
    "dense bias": "dense_bias",
    "sigmoid pre-activation": "",
    "tanh pre-activation": "",
    "state": "state",
    "logit": "logit",
    LAST_LOGIT: "logit",
    LAST_MARGIN: "logit",
}
"""Signals whose ranges are profiled, and the format that each is noted with."""

LINEAR_SIGNALS = ("feature", COVERED_FEATURE, "dense", "dense bias", "logit", LAST_LOGIT, LAST_MARGIN)
"""Signals of a linear cell."""

FOREST_SIGNALS = ("feature", COVERED_FEATURE, "logit")
"""Signals of trees."""

LOGIT_HEADROOM = 2.0
"""Logits outside the profiled recordings may be this many times larger before they saturate."""


NARROWED = {
    "sigmoid": "sigmoid pre-activation",
    "tanh": "tanh pre-activation",
    "tanh_of_state": "tanh pre-activation",
    "value": "state",
    "state": "state",
    "logit": "logit",
}
"""Operations of an arithmetic, and the signal that each narrows."""


class Profile:
    """Float arithmetic that notes the range of every signal that the hardware narrows."""

    def __init__(self, config: AcceleratorConfig) -> None:
        self._float = Float(config)
        self.ranges: dict[str, Range] = {}

    def note(self, signal: str, value: Any) -> Any:
        """Widen the signal's range to these values, and return them."""
        low, high = self.ranges.get(signal, (math.inf, -math.inf))
        self.ranges[signal] = (min(low, float(value.min())), max(high, float(value.max())))
        return value

    def __getattr__(self, name: str) -> Any:
        operation = getattr(self._float, name)
        if name not in NARROWED:
            return operation
        return lambda value: operation(self.note(NARROWED[name], value))


def signals(config: AcceleratorConfig) -> tuple[str, ...]:
    """The signals that the configured cell has."""
    if config.is_forest:
        return FOREST_SIGNALS
    return tuple(SIGNALS)[:-1] if config.recurrent else LINEAR_SIGNALS


def profile(model: FloatModel, touches: Touches) -> dict[str, Range]:
    """Smallest and largest value of every signal while the float model runs over touches, and of every kind
    of weight.

    Returns
    -------
    signal -> (min, max), real values, of ``signals(model.config)``.

    Raises
    ------
    InputError
        When no touch has a completed step.
    """
    config, profiler = model.config, Profile(model.config)
    if not touches.completed.any():
        raise InputError(
            "quantisation: the recordings hold no completed step to profile ranges on; use recordings with "
            "touches"
        )
    complete = touches.complete(config.windows.steps)
    features = float_features(model, touches)[:, : config.windows.steps]
    features[~complete] = 0.0
    profiler.note("feature", features)
    covered = float(np.quantile(np.abs(features[complete]), FEATURE_COVERAGE))
    if config.is_forest:
        profiler.note("logit", model.forward(features)[1])
        return profiler.ranges | {COVERED_FEATURE: (-covered, covered)}
    if config.recurrent:
        parameters = {name: torch.tensor(array, dtype=torch.float64) for name, array in model.arrays.items()}
        with torch.no_grad():
            run_cell(profiler, config, parameters, torch.from_numpy(features))
    else:  # without a function of a sum numpy does the same in half the time
        logits = run_cell(profiler, config, model.arrays, features)[1]
        begun = touches.completed > 0
        last = logits[begun, np.minimum(touches.completed[begun], features.shape[1]) - 1]
        profiler.ranges[LAST_LOGIT] = (float(last.min()), float(last.max()))
        lead = np.diff(np.sort(last, axis=1)[:, -2:], axis=1)
        profiler.ranges[LAST_MARGIN] = (float(np.quantile(lead, CLOSE)), float(lead.max()))
    kinds = {"W": "weight", "U": "recurrent", "b": "bias", "bh": "bias"}
    for name, array in merged_parameters(model).items():
        profiler.note({"V": "dense", "b_y": "dense bias"}.get(name) or kinds[name.partition("_")[0]], array)
    return profiler.ranges | {COVERED_FEATURE: (-covered, covered)}


def merged_parameters(model: FloatModel) -> Arrays:
    """The float network under the integer network's names: the second bias rows of z and r are added to the
    first."""
    merged = {name: np.array(model.arrays[name]) for name in network_shapes(model.config, real=False)}
    for gate in model.config.gates:
        if f"bh_{gate}" in model.arrays and f"bh_{gate}" not in merged:
            merged[f"b_{gate}"] += model.arrays[f"bh_{gate}"]
    return merged


def covering_format(
    values: Range, bits: int, *, max_frac: int | None = None, headroom: float = 1.0
) -> QFormat:
    """The signed ``bits``-wide format with the most fraction bits that holds ``values`` times ``headroom``,
    rounded, unsaturated.

    ``max_frac`` limits the fraction bits; the width stays.
    """
    low, high = min(values[0], 0.0) * headroom, max(values[1], 0.0) * headroom
    frac = 2 * bits if max_frac is None else min(2 * bits, max_frac)
    # half an LSB beyond the ends still rounds to them
    while high * 2.0**frac > 2 ** (bits - 1) - 0.5 or low * 2.0**frac < -(2 ** (bits - 1)) - 0.5:
        frac -= 1
    return QFormat(bits - frac, frac)


def closest_range(values: np.ndarray, bits: int) -> Range:
    """The range whose covering ``bits``-wide format represents ``values`` with the least mean squared error
    of rounding and saturation.

    With few bits it is better to saturate a few large values than to have a coarse step.
    """
    widest = covering_format((float(values.min()), float(values.max())), bits)

    def loss(fmt: QFormat) -> float:
        return float(np.mean((fmt.to_real(fmt.quantise(values)) - values) ** 2))

    best = min((QFormat(bits - frac, frac) for frac in range(widest.frac_bits, 2 * bits + 1)), key=loss)
    return float(best.to_real(best.min_code)), float(best.to_real(best.max_code))


def _closest_ranges(model: FloatModel, bits: int) -> dict[str, Range]:
    kinds = {"weight": "W_", "recurrent": "U_", "dense": "V"}
    return {
        kind: closest_range(
            np.concatenate([array.ravel() for name, array in model.arrays.items() if name.startswith(start)]),
            bits,
        )
        for kind, start in kinds.items()
        if any(name.startswith(start) for name in model.arrays)
    }


class IntegerNetwork(torch.nn.Module):
    """Integer networks of the same formats as a torch module: real master weights, forward in codes,
    straight-through gradients.

    The forward pass is the integer model: ``forward`` gives the logits of ``IntegerModel.forward`` of the
    models that ``export`` returns, bit for bit.

    Parameters
    ----------
    models:
        N float networks from which the master weights come.
    starts:
        Their integer models, all of one configuration: formats and normaliser constants.
    """

    def __init__(self, models: Sequence[FloatModel], starts: Sequence[IntegerModel]) -> None:
        super().__init__()
        self.config = starts[0].config
        merged, formats = [merged_parameters(model) for model in models], network_formats(self.config)
        self.weights, self._units, self._limits = torch.nn.ParameterDict(), {}, {}
        for name, fmt in formats.items():
            self.weights[name] = torch.nn.Parameter(torch.tensor(np.stack([each[name] for each in merged])))
            self._units[name] = 2.0**fmt.frac_bits
            self._limits[name] = [float(fmt.to_real(code)) for code in (fmt.min_code, fmt.max_code)]
        self.hold()
        self._constants = [{name: start.arrays[name] for name in ("mean", "scale")} for start in starts]
        names = network_shapes(self.config, real=True)
        self._teacher = {
            name: torch.tensor(np.stack([model.arrays[name] for model in models])).float() for name in names
        }
        self._scaling = [
            torch.tensor(np.stack([real_by_input(self.config, model.arrays[name]) for model in models]))
            .double()
            .view(len(models), 1, 1, -1)
            for name in ("mu", "sigma")
        ]
        self._arithmetic = Fixed(self.config)

    @torch.no_grad()
    def hold(self) -> None:
        """Clip the weights to the ranges of their formats."""
        for name, weight in self.weights.items():
            weight.clamp_(*self._limits[name])

    def codes(self) -> dict[str, torch.Tensor]:
        """Codes (N, ...) of the master weights: rounded half to even, as an exported constant is, and
        saturated."""
        codes = {}
        for name, weight in self.weights.items():
            scaled, unit = weight * self._units[name], self._units[name]
            rounded = straight_through(scaled.detach().round(), scaled)
            codes[name] = rounded.clamp(*(limit * unit for limit in self._limits[name]))
        return codes

    def feature_codes(self, features: torch.Tensor) -> torch.Tensor:
        """Feature codes (N, touches, K, D) of real features: of the nearest window sums, through
        the integer normaliser of section 3."""
        config = self.config
        lengths = list(config.length_index)
        units = torch.tensor(config.feature_units).view(-1, config.kinds)[lengths]
        units = units[:, list(config.input_kinds)] if config.kinds > 1 else units
        mu, sigma = self._scaling
        # back to whole window sums: augmented features lie between those that hardware can see
        sums = torch.round((features.double() * sigma + mu) * units)
        mean, scale = (
            torch.tensor(
                np.stack([by_input(config, constants[name])[lengths] for constants in self._constants])
            ).double()[:, None]
            for name in ("mean", "scale")
        )
        shift = 2.0 ** -torch.tensor(shifts_by_input(config)[lengths]).double()
        centred = torch.floor((sums - mean * 2.0**-config.mean_frac) * shift).clamp(
            config.centred_format.min_code, config.centred_format.max_code
        )
        centred[..., list(config.input_mask)] = 0.0
        codes = torch.floor(centred * scale * 2.0**-config.formats.gate_frac + 0.5)
        return codes.clamp(config.formats.feature_format.min_code, config.formats.feature_format.max_code)

    def forward(self, codes: torch.Tensor) -> torch.Tensor:
        """Real logits (N, touches, K, C) of feature codes: the logit codes over 2**frac."""
        logits = run_cell(self._arithmetic, self.config, self.codes(), codes)[1]
        return logits / 2.0**self.config.formats.logit_format.frac_bits

    @torch.no_grad()
    def teach(self, features: torch.Tensor) -> torch.Tensor:
        """Logits (N, touches, K, C) that the original float networks give for real features."""
        return run_cell(Float(self.config), self.config, self._teacher, features)[1]

    def export(self) -> list[IntegerModel]:
        """The N integer models."""
        codes = {name: code.detach().numpy().astype(np.int64) for name, code in self.codes().items()}
        return [
            IntegerModel(
                self.config,
                {name: code[m] for name, code in codes.items()} | constants,
                "quantisation-aware model",
            )
            for m, constants in enumerate(self._constants)
        ]


def check_widths(config: AcceleratorConfig, widths: Record) -> None:
    """Refuse widths that no network can have, before any work. widths: parameters of `choose_formats`.

    Raises
    ------
    InputError
        Naming the field and the widths it can have.
    """
    for name, lowest in (("weight", 2), ("feature", 4), ("state", 6)):
        bits = widths.get(f"{name}_bits")
        if bits is not None and not lowest <= bits <= 16:
            raise InputError(
                f"quantisation, field {name}_format: {bits} bits were requested; use {lowest} to 16"
            )
    fields = {"gate_frac": widths.get("gate_bits"), "table_entries": widths.get("table_entries")}
    given = {name: value for name, value in fields.items() if value is not None}
    config.replace(feature_shift=(), **given)


def choose_formats(
    config: AcceleratorConfig,
    ranges: Mapping[str, Range],
    *,
    weight_bits: int | None = None,
    state_bits: int | None = None,
    feature_bits: int | None = None,
    gate_bits: int | None = None,
    table_entries: int | None = None,
    feature_frac_limit: int = 16,
    lean: bool = False,
    plain: bool = False,
) -> AcceleratorConfig:
    """``config`` with a format for every signal, from profiled ranges; widths in bits. ``weight_bits`` None:
    WEIGHT_BITS, of a linear cell more where rounding them moves logits by more than ROUNDING of their span or than
    the leads of close decisions, as far as an accumulator of DSP lanes goes.

    State: SQ(2, .) for GRU reset before, SQ(4, .) for LSTM and reset after (``state_bits`` changes the
    fraction only; where it is None, weights of at most LOW_WEIGHT_BITS bits bring a state of LOW_BIT_STATE,
    and where recurrent weights would be coarser for want of room on the lanes' scale, the state, and gates
    with it, give up bits down to LEAST_STATE_FRAC of fraction). Weights: the finest format that holds every
    weight, then coarser where products would not share one scale on 16-bit operands
    (``AcceleratorConfig.feature_align``, ``operand_bits``). Features: FEATURE_BITS for all but the rarest,
    and bits on top for those, as far as recurrent weights do not get coarser; of ``feature_bits`` exactly,
    the rarest may saturate. Logits: with headroom. ``gate_bits`` are fraction bits of a gate, its sign and
    unit bit apart. ``feature_frac_limit``: fraction bits beyond which features would be finer than the window
    sums they come from. ``lean``: formats that need the fewest logic cells: features on the products' own
    scale, where 16 bits hold that, so that they are not shifted, and logits so wide that no weights saturate
    them. ``plain``: no bits on top for the rarest features, and states and gates keep their width, as the
    presets have had it from the beginning.

    Raises
    ------
    InputError
        When no format of these widths works.
    """
    if not config.recurrent:
        feature = covering_format(ranges[COVERED_FEATURE], feature_bits or FEATURE_BITS)
        feature = QFormat(
            _whole_bits(feature, feature_frac_limit), min(feature.frac_bits, feature_frac_limit)
        )
        gate_frac = config.formats.gate_frac if gate_bits is None else gate_bits
        if config.is_forest:
            if weight_bits:
                raise InputError(
                    f"quantisation, field dense_format: {weight_bits} bits were requested, and trees have no weights; leave "
                    "them out"
                )
            return config.replace(
                gate_frac=gate_frac, feature_format=feature, feature_shift=(), aligned_means=False
            )
        return _linear_formats(config.replace(gate_frac=gate_frac), ranges, weight_bits, feature, lean, plain)
    weight_bits = weight_bits or WEIGHT_BITS
    state_int = 4 if config.network.cell == "lstm" or config.network.reset == "after" else 2
    if state_bits is None and weight_bits <= LOW_WEIGHT_BITS:
        state_bits = min(LOW_BIT_STATE, state_int + config.formats.state_format.frac_bits)
    state = QFormat(
        state_int, config.formats.state_format.frac_bits if state_bits is None else state_bits - state_int
    )
    weight = covering_format(ranges["weight"], weight_bits)
    feature = covering_format(ranges[COVERED_FEATURE], OPERAND_BITS if lean else feature_bits or FEATURE_BITS)
    feature = QFormat(_whole_bits(feature, feature_frac_limit), feature.frac_bits)
    # Integer bits of features and fraction bits of states share what a 16-bit operand leaves when recurrent
    # weights are as fine as they can be.
    shared = weight.frac_bits + OPERAND_BITS - covering_format(ranges["recurrent"], weight_bits).frac_bits
    least = min(
        state.frac_bits, LEAST_STATE_FRAC if state_int == 2 else max(LEAST_STATE_FRAC, config.tanh_frac + 1)
    )
    if state_bits is not None or plain:
        least = state.frac_bits
    if feature_bits is None and not lean and not plain:
        whole = covering_format(ranges["feature"], FEATURE_BITS).int_bits
        # no wider than that: the precision of the recurrent weights matters more
        whole = max(feature.int_bits, min(whole, shared - least))
        feature = QFormat(whole, min(feature.frac_bits, OPERAND_BITS - whole))
    given_up = state.frac_bits - min(state.frac_bits, max(shared - feature.int_bits, least))
    state = QFormat(state_int, state.frac_bits - given_up)
    # gates give up as many bits: while they have one more than states, one table serves both
    if gate_bits is None:
        gate_bits = config.formats.gate_frac - given_up
    # W x and U h products share one scale: an aligned feature must fit 16 bits, ...
    room = weight.frac_bits + 16 - state.frac_bits - feature.int_bits
    recurrent = covering_format(ranges["recurrent"], weight_bits, max_frac=room)
    # the narrowing to a value needs a fraction bit to drop, even where the largest weights then saturate
    recurrent = QFormat(weight_bits - max(recurrent.frac_bits, 1), max(recurrent.frac_bits, 1))
    products = recurrent.frac_bits + state.frac_bits
    # ... and a feature must not be finer than the products
    feature = QFormat(
        feature.int_bits, min(feature.frac_bits, products - weight.frac_bits, feature_frac_limit)
    )
    dense = covering_format(ranges["dense"], weight_bits)
    dense_products = dense.frac_bits + state.frac_bits
    return _with_logits(
        config,
        ranges,
        lean,
        dense_products,
        state_format=state,
        feature_format=feature,
        weight_format=weight,
        recurrent_format=recurrent,
        dense_format=dense,
        bias_format=covering_format(ranges["bias"], BIAS_BITS, max_frac=products),
        gate_frac=gate_bits,
        table_entries=table_entries or config.formats.table_entries,
    )


def _whole_bits(feature: QFormat, limit: int) -> int:
    """Integer bits of features of at most ``limit`` fraction bits. Features that are 0 in every training touch have no
    range; a format keeps at least 4 bits."""
    return max(feature.int_bits, 4 - min(feature.frac_bits, limit))


def _linear_formats(
    config: AcceleratorConfig,
    ranges: Mapping[str, Range],
    weight_bits: int | None,
    feature: QFormat,
    lean: bool,
    plain: bool,
) -> AcceleratorConfig:
    """As `choose_formats`, for a linear cell, which only multiplies features by weights."""

    def with_weight_bits(bits: int) -> AcceleratorConfig:
        dense = covering_format(ranges["dense"], bits)
        formats = {"feature_format": feature, "dense_format": dense}
        return _with_logits(config, ranges, lean, dense.frac_bits + feature.frac_bits, **formats)

    chosen = with_weight_bits(weight_bits or WEIGHT_BITS)
    low, high = ranges.get(LAST_LOGIT, (-math.inf, math.inf))  # without one the span is infinite: no finer
    lead, _ = ranges.get(LAST_MARGIN, (math.inf, math.inf))
    while not (weight_bits or plain) and _rounding(chosen) > min(ROUNDING * (high - low), lead):
        finer = with_weight_bits(chosen.weight_bits + 1)
        if finer.weight_bits > OPERAND_BITS or finer.accumulator_bits > WIDEST_DSP_ACCUMULATOR:
            break
        chosen = finer
    return chosen


def _rounding(config: AcceleratorConfig) -> float:
    """Standard deviation by which rounded weights move the logits of a linear cell.

    Features have a standard deviation of 1. Where one set of weights serves all windows, its errors are the
    same in each and add up.
    """
    # 1/12: variance of a rounding error, in LSBs squared
    steps = config.windows.steps
    return (
        math.sqrt(config.inputs * steps * (steps // config.sets) / 12)
        / 2**config.formats.dense_format.frac_bits
    )


def _with_logits(
    config: AcceleratorConfig, ranges: Mapping[str, Range], lean: bool, products: int, **formats: Any
) -> AcceleratorConfig:
    """``config`` with ``formats`` and formats of the dense layer's bias and of the logits; ``products``:
    fraction bits of its products."""
    chosen = config.replace(
        **formats,
        feature_shift=(),
        aligned_means=False,
        dense_bias_format=covering_format(ranges["dense bias"], BIAS_BITS, max_frac=products),
        logit_format=covering_format(
            ranges["logit"], LOGIT_BITS, max_frac=products - 1, headroom=LOGIT_HEADROOM
        ),
    )
    while lean and not chosen.logit_proven:
        logit = chosen.formats.logit_format
        chosen = chosen.replace(logit_format=QFormat(logit.int_bits + 1, logit.frac_bits - 1))
    return chosen


def quantise_model(model: FloatModel, ranges: Mapping[str, Range], **widths: Any) -> IntegerModel:
    """The integer network of a float one, from its profiled ranges; ``widths`` are parameters of
    ``choose_formats``. Pure: no files.

    ``lean`` also aligns the normaliser's constants (`normaliser_constants`), where one pair serves all
    inputs.

    A model of a preset has ``plain`` formats, unless bits of a feature are asked for. Windows of few levels
    (codes of 0 and 1) have features finer than a count, by means with fraction bits (``feature_shift`` below
    0). Weights of fewer than WEIGHT_BITS bits get the formats of ``closest_range``: their largest values may
    saturate.
    """
    check_widths(model.config, widths)
    mu, sigma = model.arrays["mu"], model.arrays["sigma"]
    bits = widths.get("weight_bits") or WEIGHT_BITS
    if bits < WEIGHT_BITS and not model.config.is_forest:
        ranges = dict(ranges) | _closest_ranges(model, bits)
    # presets keep their formats bit for bit: published figures were made with them
    plain = model.config.name in PRESETS and widths.get("feature_bits") is None
    limit = _feature_frac_limit(model.config, sigma, widths)
    # bits beyond the bits of the sums: means with fraction bits resolve them
    limit += 0 if plain or widths.get("lean") else model.config.most_mean_frac
    # prototypes are made of the quantised network's states, so logits decide until then
    logits_decide = model.config.with_readout()
    config = choose_formats(logits_decide, ranges, feature_frac_limit=limit, plain=plain, **widths)
    config, mean, scale = normaliser_constants(
        config, mu, sigma, aligned=widths.get("lean", False) and config.constants == 1
    )
    arrays = merged_parameters(model)
    if config.is_forest:
        config, arrays = forest_codes(config, arrays)
    else:
        formats = network_formats(config)
        arrays = {name: formats[name].quantise(array) for name, array in arrays.items()}
    return IntegerModel(config, arrays | {"mean": mean, "scale": scale}, "quantised model")


def check_given(config: AcceleratorConfig, feature_bits: int | None) -> None:
    """Refuse bits of a feature that no format could use."""
    fmt = config.formats.feature_format
    if feature_bits is not None and fmt.width != feature_bits:
        raise InputError(
            f"quantisation, field feature_format: {feature_bits} bits are too many, because {fmt} is as fine as "
            f"the {'products' if config.recurrent else 'windows'} of this network can use; give at most "
            f"{fmt.width} feature bits"
        )


def _feature_frac_limit(config: AcceleratorConfig, sigma: np.ndarray, widths: Record) -> int:
    """Fraction bits at which the largest normaliser scale (usually of the shortest window) fills 16 bits
    without a shift."""
    gate_frac = config.formats.gate_frac if widths.get("gate_bits") is None else widths["gate_bits"]
    spread = np.broadcast_to(sigma, (config.constants,))
    units = (
        np.array(config.feature_units)
        .reshape(-1, config.kinds)
        .min(axis=0)[np.arange(config.constants) % config.kinds]
    )
    return math.floor(math.log2(config.scale_format.max_code * float((units * spread).min()))) - gate_frac


def range_records(config: AcceleratorConfig, ranges: Mapping[str, Range]) -> list[SignalRange]:
    """Ranges for training.json and the report."""
    sigmoid, tanh = (f"{config.formats.table_entries} entries over +-{span}" for span in (8, 4))
    noted = {signal: getattr(config.formats, f"{name}_format", None) for signal, name in SIGNALS.items()}
    noted |= {"sigmoid pre-activation": sigmoid, "tanh pre-activation": tanh}
    return [
        SignalRange(signal=s, min=ranges[s][0], max=ranges[s][1], format=str(noted[s]))
        for s in signals(config)
        if s in ranges
    ]
