"""Formats and constants of a configuration that do not depend on weights: the normaliser's integers, and the
changes for another cell or number of steps. No torch."""

import numpy as np

from eskin.golden.core import AcceleratorConfig, InputError, QFormat, Record
from eskin.golden.model import constants_shape

SCALE_ROOM = 2
"""Bits by which a shift may be smaller than the loudest taxel requires. A centred feature still fits, and the
quietest taxel may have a scale four times as small.
"""


def normaliser_constants(
    config: AcceleratorConfig, mu: float | np.ndarray, sigma: float | np.ndarray, *, aligned: bool = False
) -> tuple[AcceleratorConfig, np.ndarray, np.ndarray]:
    """Integer constants of feature = (d / unit - mu) / sigma, for every distinct window length.

    unit: ``config.feature_unit``; d: a window's value. mu, sigma: scalars or (constants). The feature code is
    ``(d - unit mu) * ratio`` with ``ratio = 2**feature_frac / (unit sigma)``. The shift, one for each length
    and kind, drops as many bits as leave ``scale = ratio 2**(shift + gate_frac)`` in
    2**(gate_frac-2)..2**(gate_frac-1): centred then resolves one to two bits more than the feature, and a
    full-scale feature takes at most 2 bits more than the feature's width. With one scale per taxel this is
    true of the taxel that moves most, and the shift is up to SCALE_ROOM smaller if the scale of the quietest
    taxel would not fit 16 bits. Half of 2**shift is taken off the mean, which turns the floor of the declared
    narrowing into a rounding. At shift 0 scale may be larger. Only if it would not fit 16 bits even so does a
    shift go below 0 (``mean_frac``); this happens for sums of few levels, which features must resolve.
    ``aligned``: all lengths have the shift of the largest window, so hardware need not choose one, and means
    end in as many zeros (``aligned_means``); only if one pair serves all inputs.

    Returns
    -------
    (config with feature_shift, mean, scale), the arrays int64, (lengths) or (lengths, constants).

    Raises
    ------
    InputError
        When sigma is so small that scale exceeds 16 bits at the lowest shift.
    """
    shifts, means, scales = [], [], []
    lengths, many = len(config.window_lengths), config.constants
    mu, sigma = (np.broadcast_to(np.asarray(value, dtype=np.float64), (many,)) for value in (mu, sigma))
    kind_of = np.arange(many) % config.kinds  # a constant a kind, or a constant an input
    units = np.array(config.feature_units).reshape(lengths, config.kinds)
    unit_code = 2.0**config.formats.feature_format.frac_bits
    # 2: a full-scale centred feature has up to two bits more than the feature
    spare = max(config.formats.feature_format.width + 2 - config.centred_format.width, 0)
    for row in units:
        ratio = unit_code / (row[kind_of] * sigma)
        for kind in range(config.kinds):
            of_kind = unit_code / (units * sigma[0]).ravel() if aligned else ratio[kind_of == kind]
            # the least shift at which ratio 2**shift of the loudest input is 1/4 or more
            shift = min(max(0, int(np.ceil(np.log2(0.25 / of_kind.min()))) + spare), config.sum_bits)
            room = SCALE_ROOM if config.features.feature_scale == "taxel" else 0
            lowest = max(shift - room, -config.most_mean_frac) if shift else -config.most_mean_frac
            while (
                shift > lowest
                and np.rint(of_kind.max() * 2.0 ** (shift + config.formats.gate_frac))
                > config.scale_format.max_code
            ):
                shift -= 1
            shifts.append(shift)
    filled = config.replace(feature_shift=tuple(shifts), aligned_means=aligned)
    frac = filled.mean_frac
    for q, length in enumerate(config.window_lengths):
        unit = units[q, kind_of]
        ratio = unit_code / (unit * sigma)
        by = np.array(shifts[q * config.kinds :][: config.kinds])[kind_of]
        scale = np.rint(ratio * 2.0 ** (by + config.formats.gate_frac))
        largest = config.scale_format.max_code
        if scale.max() > largest or scale.min() < 1:
            worst = int(np.argmax(scale)) if scale.max() > largest else int(np.argmin(scale))
            raise InputError(
                f"configuration '{config.name}', field feature_format: {config.formats.feature_format} "
                f"needs a scale of {scale[worst]:.0f} for windows of {length} frames with a spread of "
                f"{sigma[worst]:.3g} codes, outside 1..{largest}; use fewer feature bits"
            )
        step, half = (1 << by + frac) if aligned else np.ones_like(by), (1 << by + frac) >> 1
        middle = mu * unit * 2.0**frac
        means.append(np.rint((middle - half) / step) * step if aligned else np.rint(middle) - half)
        scales.append(scale)
    shape = (lengths, *constants_shape(config))
    mean = QFormat(filled.mean_format.width, 0).quantise(np.array(means)).reshape(shape)
    return filled, mean, np.array(scales).astype(np.int64).reshape(shape)


def with_network(
    config: AcceleratorConfig,
    *,
    cell: str | None = None,
    reset: str | None = None,
    hidden: int | None = None,
    steps: int | None = None,
) -> AcceleratorConfig:
    """``config`` with another cell, reset, hidden size or number of steps; formats and feature_shift return
    to the initial ones of the cell.

    A thesis-mode configuration keeps its touch length: hop = floor(touch_frames / steps), window = 2 hop + 1.
    If the configuration counted votes, a linear cell decides by its last step instead, which includes every
    window.

    Raises
    ------
    InputError
        For a linear cell or trees with hidden units or a reset gate.
    """
    if (cell or config.network.cell) in ("linear", "trees"):
        for field, value in (("hidden", hidden), ("reset", reset)):
            if value is not None:
                raise InputError(
                    f"configuration '{config.name}', field {field}: is {value} and cell {cell or config.network.cell} has none; "
                    "leave it out"
                )
    fields = {"cell": cell, "reset": reset, "hidden": hidden}
    changes: Record = {field: value for field, value in fields.items() if value is not None}
    if steps is not None and steps != config.windows.steps:
        changes |= {"steps": steps, "feature_shift": ()}
        if config.windows.window_mode == "touch" and steps > 0:
            hop = config.windows.touch_frames // steps
            changes |= {"hop": hop, "window": 2 * hop + 1}
    if cell in ("linear", "trees") and config.network.decision == "vote":
        changes["decision"] = "last"
    changed = config.replace(**changes)
    if not changed.recurrent:
        return changed
    # an LSTM's cell state and a reset-after row are not limited to +-1 as h is
    wide = changed.network.cell == "lstm" or changed.network.reset == "after"
    integer_bits = 4 if wide else 2
    if (cell or reset) and changed.formats.state_format.int_bits != integer_bits:
        changed = changed.replace(state_format=QFormat(integer_bits, changed.formats.state_format.frac_bits))
    return changed


def describe_formats(config: AcceleratorConfig) -> dict[str, str]:
    """Every number format of the configured cell as text, by signal, for reports."""
    if config.is_image:
        outputs = (*config.image.map_formats, config.formats.logit_format)
        stages = zip(
            config.weighted_stages, config.image.weight_formats, outputs, config.layer_shifts, strict=True
        )
        return {
            f"{stage.number} {stage.layer}": f"weights {weight}, gives {behind}, shift {shift}"
            for stage, weight, behind, shift in stages
        }
    linear = ("feature_format", "dense_format", "dense_bias_format", "logit_format")
    names = [name for name in config.fields() if name.endswith("_format")]
    names = names if config.recurrent else [name for name in names if name in linear]
    return {name.removesuffix("_format"): str(config.value(name)) for name in names}
