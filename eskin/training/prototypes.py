"""Prototypes of the readout: made from the training recordings, and taught from a few touches
(docs/specification_interfaces.md, section 18)."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from sklearn.cluster import KMeans
from threadpoolctl import threadpool_limits

from eskin.data.folds import group_numbers
from eskin.golden.core import AcceleratorConfig, InputError, Record
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel, Touches, decide_touches, find_touches
from eskin.golden.model.pipeline import decide
from eskin.golden.model.prototypes import check_teachable, class_distances, narrowed, teach, trajectory_codes
from eskin.training.record import OTHER_SIGNALS, Training

PROTOTYPES, TAUGHT, CODE_BITS = 8, 3, 4
"""Default numbers: most prototypes per class, slots for taught touches per class, bits of a value."""
COVERED = 0.999
"""Share of a linear cell's logits (by magnitude) that their codes hold; larger ones saturate."""
PARTS = 5
"""Largest number of parts into which groups are divided to be left out in turn."""
HALVING_COSTS = 0.002
"""Share of the other groups' touches that halving the distances of taught ones may cost."""


def whole_touches(touches: Touches, config: AcceleratorConfig) -> np.ndarray:
    """Rows of the first touches of recordings whose steps are all complete."""
    rows = touches.first_touch()
    rows = rows[rows >= 0]
    return rows[touches.completed[rows] == config.windows.steps]


def training_groups(recordings: Recordings, record: Training, groups: Sequence[str] | None) -> Sequence[str]:
    """The group arrays whose values are left out: as requested; otherwise of the training's first
    split that has any; otherwise the first group array.

    Raises
    ------
    InputError
        A requested group array is missing.
    """
    splits = [split.groups for split in record.cross_validation]
    validated = [split for split in splits if split and recordings.groups.keys() >= set(split)]
    chosen = [list(groups)] if groups is not None else [*validated, list(recordings.groups)[:1]]
    for name in chosen[0]:
        if name not in recordings.groups:
            names = ", ".join(recordings.groups) or "none"
            raise InputError(f"`group`: recordings '{recordings.source}' have no {name}; they have {names}")
    return chosen[0]


def _centres(
    config: AcceleratorConfig, values: np.ndarray, labels: np.ndarray, most: int
) -> list[np.ndarray]:
    """Centres of the trajectories of each class's touches, codes (``most`` or fewer, K, values), by k-means.
    If the touches of a group differ, for example in speed, their mean is close to none of them."""
    centres = []
    with threadpool_limits(1):
        for label in range(config.classes - config.readout_rule.spare_classes):
            own = values[labels == label].reshape(-1, values[0].size)
            number = min(most, len(np.unique(own, axis=0)))
            clusters = KMeans(number, n_init=3, random_state=0).fit(own)
            centres.append(narrowed(config, clusters.cluster_centers_.reshape(number, *values.shape[1:])))
    return centres


def with_prototypes(
    model: IntegerModel,
    touches: Touches,
    labels: np.ndarray,
    groups: np.ndarray,
    *,
    prototypes: int = PROTOTYPES,
    taught: int = TAUGHT,
    state_code_bits: int = CODE_BITS,
    unknown_above: int = 0,
    spare_classes: int = 0,
    source: str = "recordings",
) -> IntegerModel:
    """``model`` with prototypes that decide in place of its logits.

    Parameters
    ----------
    touches, labels, groups:
        Whole touches, the class of each, and the number of its group. Groups are left out, part by part, to
        choose ``taught_shift``. It is 1, which halves the distance of taught touches, where teaching a group
        that no prototype was made of costs the others HALVING_COSTS at most.
    prototypes:
        A class at most.
    spare_classes:
        Number of last classes of ``model`` of which there are no touches.

    Raises
    ------
    InputError
        A class without a whole touch.
    """
    values_of = decide_touches(dense(model), touches)
    values = values_of.hidden if model.config.recurrent else values_of.logits
    trained = model.config.classes - spare_classes
    _check_labels(model.config, labels, trained, source)
    rule: Record = {
        "readout": "prototypes",
        "prototypes": max(1, min(prototypes, int(np.bincount(labels).max()))),
        "taught": taught,
        "state_code_bits": state_code_bits,
        "state_code_shift": code_shift(model.config, values, state_code_bits),
        "spare_classes": spare_classes,
        "unknown_above": unknown_above,
    }
    config = model.config.with_readout(**rule)

    def of(rows: np.ndarray) -> IntegerModel:
        centres = _centres(config, values[rows], labels[rows], config.readout_rule.prototypes)
        # a surplus slot repeats another prototype, which changes no distance
        shape = (config.readout_rule.prototypes, *values.shape[1:])
        stored = np.array(
            [np.resize(own, shape) for own in centres] + [np.zeros(shape, np.int64)] * spare_classes
        )
        return _filled(model, config, stored)

    codes = trajectory_codes(config, values, values)
    lost, counted = 0, 0
    for part in np.array_split(np.unique(groups), min(PARTS, len(np.unique(groups)))):
        held_out = np.isin(groups, part)
        if not all((labels[~held_out] == label).any() for label in range(trained)):
            continue
        without = of(~held_out)
        if taught:
            new = np.flatnonzero(groups == part[0])
            touches_of = [new[labels[new] == label][:taught] for label in range(trained)]
            for row in np.concatenate(touches_of):
                without = teach(without, codes[row], int(labels[row]))
            for shift, sign in ((0, -1), (1, 1)):
                shifted = IntegerModel(
                    config.with_readout(**rule, taught_shift=shift), without.arrays, source
                )
                known = codes[~held_out]
                steps = np.full(len(known), config.windows.steps)
                decided = decide(shifted.config, -class_distances(shifted, known), steps)[2]
                lost += sign * int((decided != labels[~held_out]).sum())
            counted += int((~held_out).sum())
    rule["taught_shift"] = int(counted > 0 and lost <= HALVING_COSTS * counted)
    whole = of(np.ones(len(labels), dtype=bool))
    return IntegerModel(config.with_readout(**rule), whole.arrays, whole.source)


def by_last_step(model: IntegerModel) -> IntegerModel:
    """``model`` with decisions by its last step, whatever the margin, for evaluating the readout."""
    config = model.config.replace(decision="last", margin_threshold=0)
    return IntegerModel(config, model.arrays, model.source)


def _check_labels(config: AcceleratorConfig, labels: np.ndarray, trained: int, source: str) -> None:
    """Refuse touches that lack one of the ``trained`` classes, or belong to a spare one."""
    names = config.network.class_names
    for label, name in enumerate(names[:trained]):
        if not (labels == label).any():
            raise InputError(
                f"{source}: have no whole touch of class {name}, which a prototype needs; {OTHER_SIGNALS}"
            )
    if (labels >= trained).any():
        name = names[int(labels.max())]
        raise InputError(
            f"{source}: show class {name}, and the last {len(names) - trained} classes are spare; leave its "
            "recordings out, or give a smaller `spare_classes`"
        )


def dense(model: IntegerModel) -> IntegerModel:
    """The same network, decided by its logits."""
    arrays = {
        name: array
        for name, array in model.arrays.items()
        if name not in ("prototypes", "taught", "taught_count")
    }
    return IntegerModel(model.config.with_readout(), arrays, model.source)


def _filled(model: IntegerModel, config: AcceleratorConfig, stored: np.ndarray) -> IntegerModel:
    """The model with these prototypes and nothing taught."""
    arrays = {**dense(model).arrays, "prototypes": stored}
    if config.readout_rule.taught:
        arrays["taught"] = np.zeros((config.classes, config.readout_rule.taught, *stored.shape[2:]), np.int64)
        arrays["taught_count"] = np.zeros(config.classes, dtype=np.int64)
    return IntegerModel(config, arrays, model.source)


def code_shift(config: AcceleratorConfig, values: np.ndarray, bits: int) -> int:
    """Bits of a value that its code drops: for a state, which lies in -1..1, all but the sign and bits - 1
    below the point; for a logit as many as keep a share COVERED of the logits in range."""
    fmt = config.trajectory_format
    if config.recurrent:
        return max(0, fmt.frac_bits - (bits - 1))
    largest = float(np.quantile(np.abs(values), COVERED))
    return min(max(0, int(np.ceil(np.log2(max(largest, 1.0)))) - (bits - 1)), fmt.width - 1)


def prototypes_from_recordings(
    model: IntegerModel, recordings: Recordings, groups: Sequence[str], **options: Any
) -> IntegerModel:
    """`with_prototypes` of the first touch of each recording."""
    touches = find_touches(model.config, recordings)
    rows = whole_touches(touches, model.config)
    where = touches.recording[rows]
    return with_prototypes(
        model,
        touches.take(rows),
        recordings.labels[where],
        group_numbers(recordings, groups)[where],
        source=f"recordings '{recordings.source}'",
        **options,
    )


# ---------------------------------------------------------------------- teaching
def teach_recordings(model: IntegerModel, few: Recordings) -> tuple[IntegerModel, np.ndarray]:
    """(``model`` taught with the first touch of each recording in order, (classes) number of touches taught):
    only whole touches are taught.

    Raises
    ------
    InputError
        A model that cannot be taught; recordings without a whole touch.
    """
    config = model.config
    check_teachable(config)
    touches = find_touches(config, few)
    rows = whole_touches(touches, config)
    if not len(rows):
        raise InputError(
            f"recordings '{few.source}': have no whole touch of {config.windows.steps} steps, and a part cannot be taught; "
            + OTHER_SIGNALS
        )
    labels = few.labels[touches.recording[rows]]
    taught = teach_touches(model, touches.take(rows), labels)
    return taught, np.bincount(labels, minlength=config.classes)


def teach_touches(model: IntegerModel, touches: Touches, labels: np.ndarray) -> IntegerModel:
    """``model`` after it was taught whole touches one by one, each with its class from ``labels``."""
    decided = decide_touches(model, touches)
    for codes, label in zip(
        trajectory_codes(model.config, decided.hidden, decided.logits), labels, strict=True
    ):
        model = teach(model, codes, int(label))
    return model
