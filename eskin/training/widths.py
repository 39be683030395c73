"""Widths by error: the narrowest weights whose logits, on recordings left out of the training, stay close to
those in float."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from eskin.golden.core import AcceleratorConfig, InputError, Record
from eskin.golden.data import Recordings
from eskin.golden.model import (
    FloatModel,
    IntegerModel,
    Touches,
    decide_touches,
    find_touches,
    float_features,
    logit_error,
    stage_errors,
)
from eskin.golden.model.stage_error import StageError
from eskin.training.crossval import Folds
from eskin.training.quantise import (
    COVERED_FEATURE,
    OPERAND_BITS,
    Range,
    profile,
    quantise_model,
    range_records,
)
from eskin.training.recipe import RECIPES, Recipe, choose_recipe
from eskin.training.splits import default_splits
from eskin.training.trained import load_trained, written_by

WEIGHTS, TABLES = tuple(range(4, 17)), (512, 1024)
"""Bits of a weight and entries of a table that are tried, in the order of what they cost: weights first."""

FOLDS = 5
"""Groups are dealt to so many folds where there are more of them."""


@dataclass(frozen=True)
class LeftOut:
    """A float network, the touches that its ranges are profiled on, and touches that it has not seen."""

    model: FloatModel
    seen: Touches
    left_out: Touches

    @cached_property
    def ranges(self) -> dict[str, Range]:
        """What was seen of every signal."""
        return profile(self.model, self.seen)

    @cached_property
    def ideal(self) -> np.ndarray:
        """Float logits of all steps left out."""
        return decide_touches(self.model, self.left_out).logits

    def errors(self, integer: IntegerModel) -> np.ndarray:
        """How far the logits of all completed steps left out are from float ones, flat."""
        complete = np.arange(self.ideal.shape[1]) < self.left_out.completed[:, None]
        logits = integer.config.formats.logit_format.to_real(decide_touches(integer, self.left_out).logits)
        return np.abs(logits - self.ideal)[complete].ravel()


@dataclass(frozen=True)
class Tried:
    """Widths and what they did to the recordings left out of all cases: mean and max of the logits' error,
    the stage that alone brings about the largest, and all stages as ``stage_errors`` gives them, both of the
    case that has the largest. refused: why no format of these widths works; the figures are infinite then."""

    weight_bits: int
    table_entries: int
    mean: float
    max: float
    stage: str | None
    stages: tuple[StageError, ...] = ()
    refused: str = ""

    @property
    def figures(self) -> Record:
        """What training.json says of them."""
        names = ("weight_bits", "table_entries", "mean", "max", "stage")
        return {name: getattr(self, name) for name in names}

    @property
    def widths(self) -> dict[str, int]:
        """By the names of ``choose_formats``. Features have the lanes' operand for themselves: bits that are
        there cost no cell."""
        return {
            "weight_bits": self.weight_bits,
            "table_entries": self.table_entries,
            "feature_bits": OPERAND_BITS,
        }


def fold_cases(
    recordings: Recordings,
    config: AcceleratorConfig,
    splits: Sequence[Sequence[str]],
    *,
    recipe: Recipe | None = None,
    seed: int = 0,
    folds: int = FOLDS,
    model: FloatModel | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> list[LeftOut]:
    """A case for each fold of each split: a network trained without the fold, and the fold.

    Parameters
    ----------
    splits:
        Group names for each split, as ``cross_validate`` takes them.
    model:
        A network that was trained elsewhere: it stands in for all of them, and only ranges are profiled
        without the fold.

    Raises
    ------
    InputError
        When a fold has no touch with a completed step.
    """
    work = Folds(recordings, config, recipe or choose_recipe(config), splits, [seed], folds)
    models = [model] * len(work.parts) if model is not None else work.fit(progress)
    cases = []
    for network, rows, test in zip(models, work.parts, work.tests, strict=True):
        unseen = work.data.index[test]
        left_out = work.data.touches.take(unseen[unseen >= 0])
        if left_out.completed.any():
            cases.append(LeftOut(network, work.data.touches.take(rows), left_out))
    if not cases:
        raise InputError(
            f"recordings '{recordings.source}': no recording left out has a completed step; use recordings "
            "with touches"
        )
    return cases


def _reach(model: FloatModel, touches: Touches) -> float:
    complete = np.arange(model.config.windows.steps) < touches.completed[:, None]
    return float(np.abs(float_features(model, touches)[:, : model.config.windows.steps][complete]).max())


def feature_headroom(cases: Sequence[LeftOut]) -> float:
    """How many times larger than any feature seen the largest feature left out is: the worst case's, at least
    1."""
    return max(
        1.0, *(_reach(case.model, case.left_out) / max(_reach(case.model, case.seen), 1e-9) for case in cases)
    )


def with_headroom(ranges: Mapping[str, Range], headroom: float) -> dict[str, Range]:
    """Ranges with features ``headroom`` times larger, the rarest included: none saturates."""
    low, high = ranges["feature"]
    wide = (min(low, 0.0) * headroom, max(high, 0.0) * headroom)
    return dict(ranges) | {"feature": wide, COVERED_FEATURE: wide}


def integers_of(case: LeftOut, headroom: float, **widths: Any) -> IntegerModel:
    """The integer network of a case: formats from what was seen, with ``headroom`` for features."""
    return quantise_model(case.model, with_headroom(case.ranges, headroom), **widths)


def measure(cases: Sequence[LeftOut], headroom: float, weight_bits: int, table_entries: int) -> Tried:
    """Widths on the recordings left out of every case."""
    tried = Tried(weight_bits, table_entries, math.inf, math.inf, None)
    try:
        integers = [integers_of(case, headroom, **tried.widths) for case in cases]
    except InputError as error:
        return Tried(weight_bits, table_entries, math.inf, math.inf, None, refused=str(error))
    errors = [case.errors(integer) for case, integer in zip(cases, integers, strict=True)]
    k = max(range(len(cases)), key=lambda k: errors[k].max())
    stages = stage_errors(cases[k].model, integers[k], cases[k].left_out)
    mean = float(np.concatenate(errors).mean())
    return Tried(
        weight_bits, table_entries, mean, float(errors[k].max()), logit_error(stages)["stage"], tuple(stages)
    )


def ladder(
    cases: Sequence[LeftOut],
    headroom: float,
    weights: Sequence[int] = WEIGHTS,
    tables: Sequence[int] = TABLES,
) -> Iterator[Tried]:
    """Widths after widths, the cheapest first."""
    recurrent = cases[0].model.config.recurrent
    for weight_bits in weights:
        for table_entries in tables if recurrent else tables[:1]:  # a linear cell reads no table
            yield measure(cases, headroom, weight_bits, table_entries)


def choose_widths(
    cases: Sequence[LeftOut],
    limit: float,
    headroom: float | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> tuple[Tried, list[Tried]]:
    """(the first widths of the ladder whose largest logit error on every case's left-out recordings is at
    most ``limit``, all tried).

    Raises
    ------
    InputError
        When none is, with the smallest error there is and where it arises.
    """
    tried: list[Tried] = []
    headroom = feature_headroom(cases) if headroom is None else headroom
    for rung in ladder(cases, headroom):
        tried.append(rung)
        if progress:
            progress("widths", len(tried), len(WEIGHTS) * len(TABLES))
        if rung.max <= limit:
            return rung, tried
    best = min(tried, key=lambda rung: rung.max)
    if math.isinf(best.max):
        raise InputError(f"quantisation, field logit_error: no width works here: {tried[-1].refused}")
    wider = [rung.refused for rung in tried if rung.refused and rung.weight_bits > best.weight_bits]
    refused = f"; wider weights are refused: {wider[0]}" if wider else ""
    raise InputError(
        f"quantisation, field logit_error: {limit:g} cannot be met on recordings left out; the best is "
        f"{best.max:.3g}, with weights of "
        f"{best.weight_bits} bits and tables of {best.table_entries} entries, most of all by {best.stage}: "
        f"ask for that or more{refused}"
    )


def quantise_by_error(
    model_dir: str | Path,
    recordings: Recordings,
    limit: float,
    *,
    group: Sequence[str] | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> tuple[IntegerModel, Record]:
    """Write the integer model into a model folder, in the narrowest widths that keep logits of recordings
    left out within ``limit``.

    Networks are trained again, each without a fold of the recordings (an imported network stands for itself),
    quantised with ranges of what they saw, and judged on the fold. Only then is the folder's own network
    quantised, with ranges profiled on all ``recordings`` and the headroom for features that the folds called
    for.

    Parameters
    ----------
    recordings:
        The training data.
    limit:
        Largest difference of an integer logit from the float one, any completed step of any recording left
        out.
    group:
        Group names of one split; None: the splits of the training's cross-validation, or those of the
        configuration.

    Returns
    -------
    (integer model, {limit, splits, cases, headroom, weight_bits, table_entries, mean, max, stage, tried});
    training.json has it as ``logit_error``.

    Raises
    ------
    InputError
        A limit that is not positive or cannot be met; a folder that is no model folder.
    """
    if not (math.isfinite(limit) and limit > 0):
        raise InputError(
            f"quantisation, field logit_error: is {limit:g}; give the largest difference of a logit, 0.5 say"
        )
    trained = load_trained(model_dir)
    model, record = trained.model, trained.record
    if model.config.has_prototypes:
        raise InputError(
            f"model '{model_dir}', field readout: is 'prototypes', and logit_error is of logits; quantise it with "
            "--readout dense first"
        )
    config = model.config
    splits = [split["groups"] for split in record.get("cross_validation", [])] or default_splits(
        recordings, config
    )
    splits = splits if group is None else [list(group)]
    trained_here = "recipe" in record
    cases = fold_cases(
        recordings,
        config,
        splits,
        recipe=Recipe(**record["recipe"]) if trained_here else RECIPES["onset"],
        seed=int(record.get("seed", 0)),
        model=None if trained_here else model,
        progress=progress,
    )
    headroom = feature_headroom(cases)
    chosen, tried = choose_widths(cases, limit, headroom, progress)
    ranges = with_headroom(profile(model, find_touches(config, recordings)), headroom)
    integer = quantise_model(model, ranges, **chosen.widths)
    summary = {
        "limit": limit,
        "splits": [list(names) for names in splits],
        "cases": len(cases),
        "headroom": headroom,
        **chosen.figures,
        "tried": [rung.figures for rung in tried if not rung.refused],
    }
    record |= {
        "quantisation_aware": False,
        "widths": chosen.widths,
        "ranges": range_records(integer.config, ranges),
        "logit_error": summary,
        **written_by(model.config, integer),
    }
    trained.check_kept(integer.config, {})
    integer.save(model_dir, training=record, unchanged=trained.files)
    return integer, summary
