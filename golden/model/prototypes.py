"""The prototype readout: a touch gets the class of the nearest stored trajectory, and is taught by storing
its trajectory (docs/specification_interfaces.md, section 18).

A trajectory is the hidden state (linear cell: the logits) after each step of a touch, rounded to a few bits.
"""

import numpy as np

from eskin.golden.core import AcceleratorConfig, InputError
from eskin.golden.model.model import FloatModel, IntegerModel


def trajectory_codes(config: AcceleratorConfig, hidden: np.ndarray, logits: np.ndarray) -> np.ndarray:
    """Codes (..., K, values), int64: ``narrow(value, state_code_shift, state_code_format)`` of hidden states,
    or of a linear cell's logits."""
    return narrowed(config, hidden if config.recurrent else logits)


def narrowed(config: AcceleratorConfig, values: np.ndarray) -> np.ndarray:
    """State codes of ``values`` at the scale of states (of a linear cell: logits), which may lie between
    codes."""
    fmt, shift = config.state_code_format, config.readout_rule.state_code_shift
    rounded = np.floor(np.asarray(values) / 2.0**shift + 0.5)
    return np.clip(rounded, fmt.min_code, fmt.max_code).astype(np.int64)


def real_trajectory(config: AcceleratorConfig, hidden: np.ndarray, logits: np.ndarray) -> np.ndarray:
    """Trajectory (..., K, values) of a float network, in units of a state code and not rounded:
    `trajectory_codes` without formats."""
    lsb = 2.0 ** (config.readout_rule.state_code_shift - config.trajectory_format.frac_bits)
    return (hidden if config.recurrent else logits) / lsb


def class_distances(model: IntegerModel, codes: np.ndarray) -> np.ndarray:
    """Distance of each class's nearest prototype after each step.

    Parameters
    ----------
    codes:
        (n, K, values), from `trajectory_codes`, or from `real_trajectory`, where the sums are rounded once.

    Returns
    -------
    numpy.ndarray
        int64 (n, K, C): sums of absolute differences over the values of a step, or with any decision but
        ``vote`` over all steps so far. The sum of a taught touch loses its ``taught_shift`` lowest bits. Each
        class has the smallest sum over its prototypes and its slots in use; a spare class without any has the
        largest distance that `score_format` holds.
    """
    config, arrays = model.config, model.arrays
    steps = codes.shape[-2]  # may be fewer than a touch has
    nearest = []
    in_use = taught_in_use(model)
    trained, furthest = config.classes - config.readout_rule.spare_classes, -1 - config.score_format.min_code
    for label in range(config.classes):
        stored = own = arrays["prototypes"][label, : None if label < trained else 0]
        if in_use[label]:
            stored = np.concatenate([own, arrays["taught"][label, : in_use[label]]])
        if not len(stored):
            nearest.append(np.full(codes.shape[:-1], furthest))
            continue
        apart = np.stack([np.abs(codes - place[:steps]).sum(axis=-1) for place in stored])
        if config.network.decision != "vote":
            apart = apart.cumsum(axis=-1)
        apart = np.rint(apart).astype(np.int64)  # for real trajectories; sums of codes are whole
        # shifted after the steps were added up: one rounding, not one a step
        apart[len(own) :] >>= config.readout_rule.taught_shift
        nearest.append(apart.min(axis=0))
    return np.stack(nearest, axis=-1)


def taught_in_use(model: IntegerModel | FloatModel) -> np.ndarray:
    """(C) number of slots of each class that hold a taught touch."""
    taught = model.config.readout_rule.taught
    counts = model.arrays["taught_count"] if taught else np.zeros(model.config.classes, dtype=np.int64)
    return np.minimum(counts, taught)


def check_teachable(config: AcceleratorConfig) -> None:
    """Raise InputError for a model that cannot be taught.

    Raises
    ------
    InputError
        Logits decide, or there is no slot for a taught touch.
    """
    if not config.has_prototypes:
        raise InputError(
            f"model '{config.name}', field readout: is 'dense', which cannot be taught; quantise it "
            "with `readout` prototypes first, or enrol without `teach`"
        )
    if not config.readout_rule.taught:
        raise InputError(
            f"model '{config.name}', field taught: is 0, so there is no slot for a touch; quantise it with "
            "`taught` 3"
        )


def teach(model: IntegerModel, codes: np.ndarray, label: int | str) -> IntegerModel:
    """The model with one more touch of class ``label``, in the next slot of the class or, if all are in use,
    in the slot of its oldest touch.

    Parameters
    ----------
    codes:
        (K, values), from `trajectory_codes`, of a whole touch.

    Raises
    ------
    InputError
        As `check_teachable`; or ``label`` is not a class.
    """
    check_teachable(model.config)
    label = class_index(model.config, label)
    places = model.config.readout_rule.taught
    taught, counts = model.arrays["taught"].copy(), model.arrays["taught_count"].copy()
    taught[label, counts[label] % places] = codes
    # The count of a full class goes on in places .. 2 places - 1: it shows both that all places are in use
    # and which one is the oldest.
    counts[label] = counts[label] + 1 if counts[label] < 2 * places - 1 else places
    return IntegerModel(
        model.config, {**model.arrays, "taught": taught, "taught_count": counts}, model.source
    )


def forget(model: IntegerModel, label: int | str | None = None) -> IntegerModel:
    """The model without the taught touches of class ``label``; None: without the taught touches of every class.

    Raises
    ------
    InputError
        As `teach`.
    """
    check_teachable(model.config)
    counts = model.arrays["taught_count"].copy()
    counts[slice(None) if label is None else class_index(model.config, label)] = 0
    return IntegerModel(model.config, {**model.arrays, "taught_count": counts}, model.source)


def class_index(config: AcceleratorConfig, label: object) -> int:
    """The index of a class that is given by its index or its name.

    Raises
    ------
    InputError
        It is not a class.
    """
    names = config.network.class_names
    if isinstance(label, str) and label in names:
        return names.index(label)
    number = isinstance(label, (int, float, np.integer, np.floating)) and not isinstance(label, bool)
    if number and label in range(len(names)):
        return int(label)  # type: ignore[call-overload]
    raise InputError(
        f"class {label!r:.60}: is none of the model's; give 0 to {len(names) - 1}, or a name of {', '.join(names)}"
    )
