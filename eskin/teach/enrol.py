"""Enrolment: a trained model learns a new mounting, person or object position from a few labelled touches,
its formats unchanged.

A new mounting shifts the signal of every taxel in a way that other mountings do not predict. One to five
touches of each class do. Quantisation-aware training goes on with them: configuration and formats stay, so
that the host loads the new weights into the bitstream of the old model. Two measures preserve what the
network has learned: the recordings of the first training, if available (new touches are then a quarter of the
draws), and a penalty on the distance to the old weights. A model whose readout is prototypes is taught: touches are
stored.
"""

import dataclasses
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from eskin.data.fit import for_model
from eskin.golden.core import AcceleratorConfig, Arrays, InputError, Record
from eskin.golden.data import Recordings
from eskin.golden.model import (
    FloatModel,
    IntegerModel,
    check_model_target,
    decide_touches,
    load_config,
    load_training,
    network_formats,
    network_shapes,
    run,
)
from eskin.golden.model.pipeline import by_recording
from eskin.golden.model.prototypes import check_teachable, taught_in_use
from eskin.training.batches import Batches, TouchPool
from eskin.training.datasets import Dataset, find_dataset, touch_rows
from eskin.training.fit import Loss, train_integers
from eskin.training.losses import Progress, class_loss
from eskin.training.prototypes import teach_recordings
from eskin.training.quantise import IntegerNetwork, profile, range_records
from eskin.training.recipe import Recipe, noted_recipe


@dataclass(frozen=True, kw_only=True)
class Enrolment:
    """Settings of training on.

    updates, learning_rate: gradient steps and the largest rate of their one-cycle schedule, Adam. share: of
    the draws that are new touches, where old recordings are at hand. near: weight of the sum of squared
    distances of all weights to the old ones, beside the mean cross-entropy.
    """

    updates: int
    learning_rate: float
    share: float
    near: float


SETTINGS: dict[bool, Enrolment] = {
    True: Enrolment(updates=300, learning_rate=0.01, share=0.25, near=0.0),
    False: Enrolment(updates=150, learning_rate=0.005, share=1.0, near=0.1),
}
"""By whether old recordings are at hand. With them it is as first thought of: a quarter of the draws, a third of
the first training's rate. The penalty without them was chosen on seeds 0 to 2 of pvdf_indent's sequences, as
the smallest tried (0.01, 0.03, 0.1) that costs the other sequences less than half a point."""


@dataclass(frozen=True)
class Pair:
    """A network in its two forms, of one configuration: masters and the codes that the hardware holds."""

    real: FloatModel
    integer: IntegerModel


def _of_weights(before: FloatModel, weights: Arrays) -> FloatModel:
    """The float network of other ``weights`` (by the integer network's names) that is else as ``before``."""
    # a second bias row that the hardware adds to the first is 0: the first holds the sum
    shapes = network_shapes(before.config, real=True)
    real = {name: weights[name] if name in weights else np.zeros(shape) for name, shape in shapes.items()}
    return FloatModel(before.config, {**before.arrays, **real})


def load_pair(folder: str | Path) -> Pair:
    """Both forms of the model in a folder. If the integers were trained themselves
    (quantisation-aware), training continues from them, otherwise from the float weights.

    Raises
    ------
    InputError
        The folder is not a quantised model folder.
    """
    real, integer = FloatModel.load(folder), IntegerModel.load(folder)
    if load_training(folder).get("quantisation_aware"):
        formats = network_formats(integer.config)
        weights = {name: formats[name].to_real(integer.arrays[name]) for name in formats}
        real = _of_weights(real, weights)
    return Pair(real, integer)


class _Mixed(TouchPool):
    """Draws a fixed share of every batch from the new touches, the rest from the old ones."""

    def __init__(
        self, old: list[np.ndarray], new: list[np.ndarray], share: float, generator: torch.Generator
    ) -> None:
        super().__init__(old, generator)
        self._new, self._share = TouchPool(new, generator), share

    def draw(self, batch: int, *, in_order: bool) -> torch.Tensor:
        fresh = max(1, round(batch * self._share))
        return torch.cat(
            [self._new.draw(fresh, in_order=False), super().draw(batch - fresh, in_order=False)], dim=-1
        )


def fit(
    pairs: Sequence[Pair],
    data: Dataset,
    recipe: Recipe,
    new: Sequence[np.ndarray],
    old: Sequence[np.ndarray] | None,
    seed: int,
    progress: Progress = lambda done, total: None,
) -> list[Pair]:
    """Train each network on with its new touches, in integer arithmetic; those of the same formats at once;
    deterministic by ``seed``.

    Parameters
    ----------
    recipe:
        Loss and augmentation, as in their first training.
    new, old:
        For each network the rows of ``data`` to enrol, and those of the old recordings; None: there are none.
    """
    setting = SETTINGS[old is not None]
    drawn = dataclasses.replace(recipe, epochs=0)  # a pass over so few touches means nothing

    def batches_of(config: AcceleratorConfig, members: list[int]) -> Batches:
        generator, fresh = torch.Generator().manual_seed(seed), [new[number] for number in members]
        pool = TouchPool(fresh, generator)
        if old is not None:
            pool = _Mixed([old[number] for number in members], fresh, setting.share, generator)
        real = [pairs[number].real.arrays for number in members]
        scales = [(arrays["mu"].tolist(), arrays["sigma"].tolist()) for arrays in real]
        return Batches(data, config, drawn, fresh, generator, scales=scales, pool=pool)

    def loss_of(network: IntegerNetwork) -> Loss:
        begin = {name: weight.detach().clone() for name, weight in network.weights.items()}

        def loss(features: torch.Tensor, labels: torch.Tensor, counts: torch.Tensor) -> torch.Tensor:
            of_labels = class_loss(recipe, network(network.feature_codes(features)), labels, counts)
            if not setting.near:
                return of_labels
            return of_labels + setting.near * sum(
                ((weight - begin[name]) ** 2).flatten(1).sum(1) for name, weight in network.weights.items()
            )

        return loss

    models, integers = [pair.real for pair in pairs], [pair.integer for pair in pairs]
    trained = train_integers(
        models, integers, batches_of, loss_of, setting.updates, setting.learning_rate, progress
    )
    return [
        Pair(_of_weights(model, weights), integer)
        for model, (integer, weights) in zip(models, trained, strict=True)
    ]


# ---------------------------------------------------------------------- recordings
def joined(few: Recordings, old: Recordings | None) -> Recordings:
    """``few``, and after them ``old``, as one set without groups."""
    if old is None:
        return few
    return dataclasses.replace(
        few,
        samples=np.concatenate([few.samples, old.samples]),
        offsets=np.concatenate([few.offsets, few.frames + old.offsets[1:]]),
        labels=np.concatenate([few.labels, old.labels]),
        groups={},
    )


# ---------------------------------------------------------------------- the verb
MAX_LOSS = 0.01
"""Accuracy on the old recordings that enrolment may cost."""


OF_RECORDINGS = ("feature", "state", "logit", "sigmoid pre-activation", "tanh pre-activation")
"""Signals whose ranges depend on the recordings, not on the weights alone."""


def check_other_folder(model_dir: str | Path, out: str | Path) -> None:
    """Refuse (InputError) to write a model over the one it comes from, or over another folder."""
    if Path(out).resolve() == Path(model_dir).resolve():
        raise InputError(
            f"model '{out}': is the model to start from, which enrol does not change; name another folder"
        )
    check_model_target(out)


def enrol(
    model_dir: str | Path,
    few: Recordings,
    out: str | Path,
    *,
    old: Recordings | None = None,
    seed: int = 0,
    progress: Progress = lambda done, total: None,
) -> Record:
    """Continue training the model in ``model_dir`` with ``few`` touches of a new mounting, and write it to
    ``out``; config.json does not change.

    Parameters
    ----------
    few:
        Recordings of the new mounting, 1 to 5 touches of each class; the first touch of each recording
        counts.
    old:
        Recordings that the model was trained on, to be remembered.

    Returns
    -------
    What training.json keeps in ``enrolments``: data, old_data, seed, touches (class name -> number),
    setting, before and after (share of the new recordings decided as labelled, which the network has now been
    trained on), old_before and old_after (of the old ones; None without), wall_s, passed (no fewer of the new recordings right than before,
    and at most MAX_LOSS of the old ones lost).

    Raises
    ------
    InputError
        Recordings of another sensor, an unknown class, a class without a touch, or a folder that must not be
        written.
    """
    begin = time.perf_counter()
    check_other_folder(model_dir, out)
    if load_config(model_dir).has_prototypes:
        raise InputError(
            f"model '{model_dir}', field readout: is 'prototypes', which would not fit the new weights; "
            "give --teach in place of --data, or quantise it without --readout first"
        )
    pair, record = load_pair(model_dir), load_training(model_dir)
    config = pair.integer.config
    few = for_model(few, config)
    old = None if old is None else for_model(old, config)
    recipe = noted_recipe(record, config)
    everything = joined(few, old)
    data = find_dataset(everything, config, recipe)
    is_new = np.arange(len(everything)) < len(few)
    new, former = (touch_rows(data, np.flatnonzero(part)) for part in (is_new, ~is_new))
    counts = np.bincount(everything.labels[data.touches.recording][new], minlength=config.classes)
    touches = dict(zip(config.network.class_names, counts.tolist(), strict=True))
    for name, count in touches.items():
        if not count:  # the network's outputs for this class would be undefined
            raise InputError(
                f"recordings '{few.source}': have no touch of class {name}; enrolment needs 1 to 5 of each class, "
                "so record some (and check their onsets with 'eskin inspect')"
            )
    if old is not None and not len(former):
        raise InputError(
            f"recordings '{old.source}': have no touch; leave --with out, or check their onsets with 'eskin inspect'"
        )
    (enrolled,) = fit([pair], data, recipe, [new], None if old is None else [former], seed, progress)

    def share(of: Pair, part: np.ndarray) -> float | None:
        return float(right(of.integer, data)[part].mean()) if part.any() else None

    result: Record = {
        "data": str(few.source),
        "old_data": None if old is None else str(old.source),
        "seed": seed,
        "touches": touches,
        "setting": dataclasses.asdict(SETTINGS[old is not None]),
        "before": share(pair, is_new),
        "after": share(enrolled, is_new),
        "old_before": share(pair, ~is_new),
        "old_after": share(enrolled, ~is_new),
        "wall_s": time.perf_counter() - begin,
    }
    harmless = old is None or result["old_after"] >= result["old_before"] - MAX_LOSS
    result["passed"] = bool(harmless and result["after"] >= result["before"])
    record["enrolments"] = [*record.get("enrolments", []), result]
    ranges = profile(enrolled.real, data.touches)
    for entry in record.get("ranges", []):  # of the old recordings, which may not be at hand
        if (signal := entry["signal"]) in OF_RECORDINGS and signal in ranges:
            low, high = ranges[signal]
            ranges[signal] = (min(low, entry["min"]), max(high, entry["max"]))
    record |= {"ranges": range_records(config, ranges), "quantisation_aware": False}
    enrolled.real.save(out, record, enrolled.integer)
    return result


def right(model: IntegerModel, data: Dataset) -> np.ndarray:
    """(R) bool: which recordings are decided as labelled; no decision is wrong."""
    return by_recording(decide_touches(model, data.touches).decision, data.index) == data.labels


def teach_folder(model_dir: str | Path, few: Recordings, out: str | Path) -> Record:
    """Teach the model in ``model_dir`` the touches of ``few`` and write it to ``out``; config.json and all
    weights stay.

    Returns
    -------
    What training.json keeps in ``taught``: data, touches and in_use (class name -> number), before and after
    (share of ``few`` decided as labelled, of which the model has now been taught), wall_s, passed (no fewer
    right than before).

    Raises
    ------
    InputError
        As `teach_recordings`; recordings of another sensor, a folder that must not be written.
    """
    begin = time.perf_counter()
    check_other_folder(model_dir, out)
    model, record = IntegerModel.load(model_dir), load_training(model_dir)
    check_teachable(model.config)
    few = for_model(few, model.config)
    after, counts = teach_recordings(model, few)
    names = model.config.network.class_names
    result: Record = {
        "data": str(few.source),
        "touches": dict(zip(names, counts.tolist(), strict=True)),
        "in_use": dict(zip(names, taught_in_use(after).tolist(), strict=True)),
        "places": model.config.readout_rule.taught,
        "before": run(model, few).accuracy(few.labels),
        "after": run(after, few).accuracy(few.labels),
        "wall_s": time.perf_counter() - begin,
    }
    result["passed"] = bool(result["after"] >= result["before"])
    record["taught"] = [*record.get("taught", []), result]
    FloatModel.load(model_dir).save(out, record, after)
    return result
