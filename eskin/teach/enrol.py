"""Enrolment: a trained model learns a new mounting, person or object position from a few labelled touches,
its formats unchanged.

A new mounting shifts the signal of every taxel in a way that no other mounting tells. One to five touches of
each class do. The network is trained further and keeps its configuration, formats included, so that the host
loads the new weights into the bitstream of the old model.

Weights are trained as the hardware holds them: rounded to their formats in every forward pass, gradients
straight through, the masters held within the formats' ranges. Two things keep what the network knew: the
recordings of the first training, where they are at hand (new touches are a quarter of the draws then), and a
penalty on the distance to the old weights.
"""

import dataclasses
import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch

from eskin.choose.choose_front_end import cheapest, field_of
from eskin.choose.cost import Market
from eskin.golden.core import AcceleratorConfig, Arrays, InputError, Record
from eskin.golden.data import Recordings, check_fit, grouped_folds
from eskin.golden.model import (
    Float,
    FloatModel,
    IntegerModel,
    check_model_target,
    decide_touches,
    load_config,
    load_training,
    network_formats,
    network_shapes,
    run,
    run_cell,
    with_network,
)
from eskin.golden.model.pipeline import by_recording
from eskin.golden.model.prototypes import check_teachable, taught_in_use
from eskin.golden.model.straight_through import straight_through
from eskin.training.batches import Batches, TouchPool
from eskin.training.datasets import Dataset, find_dataset, touch_rows
from eskin.training.fit import fit_networks, one_thread, post_training
from eskin.training.losses import Progress, class_loss, descend
from eskin.training.prototypes import (
    PARTS,
    by_last_step,
    dense,
    group_numbers,
    teach_recordings,
    teach_touches,
    with_prototypes,
)
from eskin.training.quantise import Masters, limits_of, merged_parameters, profile, range_records
from eskin.training.recipe import Recipe, choose_recipe

Layers = Literal["dense", "all"]
Draw = Literal["random", "first"]
DENSE = ("V", "b_y")
"""Arrays of the dense layer; of a linear cell there are no others."""


@dataclass(frozen=True, kw_only=True)
class Enrolment:
    """How a network is trained on.

    layers: the ``dense`` layer alone, the recurrent part frozen, or ``all``. updates, learning_rate: gradient
    steps and the largest rate of their one-cycle schedule, Adam. share: of the draws that are new touches,
    where old recordings are at hand. near: weight of the sum of squared distances of all trained weights to
    the old ones, beside the mean cross-entropy.
    """

    layers: Layers
    updates: int
    learning_rate: float
    share: float
    near: float


SETTINGS: dict[tuple[str, bool], Enrolment] = {
    ("all", True): Enrolment(layers="all", updates=300, learning_rate=0.01, share=0.25, near=0.0),
    ("all", False): Enrolment(layers="all", updates=150, learning_rate=0.005, share=1.0, near=0.1),
    ("dense", True): Enrolment(layers="dense", updates=300, learning_rate=0.03, share=0.5, near=0.0),
    ("dense", False): Enrolment(layers="dense", updates=150, learning_rate=0.02, share=1.0, near=0.1),
}
"""By (layers, old recordings at hand). ``all`` with the old recordings is as first thought of: a quarter of
the draws, a third of the first training's rate. The others were chosen on seeds 0 to 2 of pvdf_indent's
sequences: the share of the dense layer by what it brings (0.25 and 0.5 were tried), the penalties as the
smallest tried (0.01, 0.03, 0.1) that costs the other sequences less than half a point."""


@dataclass(frozen=True)
class Pair:
    """A network in its two forms, of one configuration: masters and the codes that the hardware holds."""

    real: FloatModel
    integer: IntegerModel


class _Held(Masters):
    """Networks of one configuration but for their formats, as the hardware holds their weights: every forward
    pass rounds the masters."""

    def __init__(self, pairs: Sequence[Pair], trained: Sequence[str]) -> None:
        integers = [pair.integer for pair in pairs]
        super().__init__([pair.real for pair in pairs], integers, torch.float32, trained)
        of_features = [integer.config.formats.feature_format for integer in integers]
        self._feature_limits = limits_of(of_features, torch.empty(1, 1, 1, 1))
        self._begin = {name: weight.detach().clone() for name, weight in self.weights.items()}

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        """Logits (models, touches, steps, C) of real features, which saturate where their format does."""
        held = {}
        for name, weight in self.weights.items():
            rounded = torch.round(weight.detach() * self._units[name]) / self._units[name]
            held[name] = straight_through(rounded, weight) if weight.requires_grad else rounded
        features = torch.clamp(features, *self._feature_limits)
        return run_cell(Float(self.config), self.config, held, features)[1]

    def distance(self) -> torch.Tensor:
        """(models) sum of squared distances of the trained weights to those at the beginning."""
        return sum(
            ((weight - self._begin[name]) ** 2).flatten(1).sum(1)
            for name, weight in self.weights.items()
            if weight.requires_grad
        )

    def pairs(self, before: Sequence[Pair]) -> list[Pair]:
        """The networks as they are now, in the configurations and with the constants of those they came
        from."""
        arrays = {name: weight.detach().double().numpy() for name, weight in self.weights.items()}
        return [
            _pair(pair, {name: array[m] for name, array in arrays.items()}) for m, pair in enumerate(before)
        ]


def _pair(before: Pair, weights: Arrays) -> Pair:
    """The networks of other ``weights`` (real, by the integer network's names) that are else as
    ``before``."""
    shapes, old = network_shapes(before.real.config, real=True), before.integer
    # a second bias row that the hardware adds to the first is 0: the first holds the sum
    real = {
        name: np.array(weights[name]) if name in weights else np.zeros(shape)
        for name, shape in shapes.items()
    }
    constants = {name: array for name, array in before.real.arrays.items() if name not in shapes}
    formats = network_formats(old.config)
    codes = {name: formats[name].quantise(np.array(array)) for name, array in weights.items()}
    loaded = {name: array for name, array in old.arrays.items() if name not in codes}
    return Pair(
        FloatModel(before.real.config, real | constants),
        IntegerModel(old.config, codes | loaded, "enrolled model"),
    )


def load_pair(folder: str | Path) -> Pair:
    """Both forms of the model in a folder. Where the integers were trained on by themselves, they are the
    masters.

    Raises
    ------
    InputError
        The folder is no quantised model folder.
    """
    real, integer = FloatModel.load(folder), IntegerModel.load(folder)
    if load_training(folder).get("quantisation_aware"):
        formats = network_formats(integer.config)
        weights = {name: formats[name].to_real(integer.arrays[name]) for name in formats}
        return _pair(Pair(real, integer), weights)
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
    setting: Enrolment,
    seed: int,
    progress: Progress = lambda done, total: None,
) -> list[Pair]:
    """Train each network on with its new touches, all at once; deterministic by ``seed``.

    Parameters
    ----------
    pairs:
        Networks of one configuration, formats apart.
    recipe:
        Loss and augmentation, as in their first training.
    new, old:
        For each network the rows of ``data`` to enrol, and those of the old recordings; None: there are none.
    """
    with one_thread():
        generator = torch.Generator().manual_seed(seed)
        names = network_shapes(pairs[0].integer.config, real=False)
        network = _Held(pairs, DENSE if setting.layers == "dense" else list(names))
        pool = (
            TouchPool(list(new), generator)
            if old is None
            else _Mixed(list(old), list(new), setting.share, generator)
        )
        scales = [(pair.real.arrays["mu"].tolist(), pair.real.arrays["sigma"].tolist()) for pair in pairs]
        drawn = dataclasses.replace(recipe, epochs=0)  # a pass over so few touches means nothing
        batches = Batches(data, pairs[0].real.config, drawn, list(new), generator, scales=scales, pool=pool)

        def loss_of() -> torch.Tensor:
            features, labels, counts = batches.draw()
            return class_loss(recipe, network(features), labels, counts) + setting.near * network.distance()

        def after(done: int, loss: torch.Tensor) -> None:
            network.hold()
            progress(done, setting.updates)

        trained = [weight for weight in network.parameters() if weight.requires_grad]
        descend(trained, loss_of, setting.learning_rate, setting.updates, after=after)
        return network.pairs(pairs)


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


def _check_touches(few: Recordings, rows: np.ndarray, labels: np.ndarray, config: AcceleratorConfig) -> None:
    """Refuse to enrol without a touch of each class: what the network then says of the class is anything."""
    counts = np.bincount(labels[rows], minlength=config.classes)
    for name, count in zip(config.network.class_names, counts, strict=True):
        if not count:
            raise InputError(
                f"recordings '{few.source}': show no touch of class {name}; enrolment needs 1 to 5 of each "
                "class, so record some "
                "(and look at their onsets with 'eskin inspect')"
            )


# ---------------------------------------------------------------------- the verb
MOST_SATURATED = 0.05
"""Share of the new touches' features, and of the logits of all touches, that may stand at a limit of their
formats."""

MAX_LOSS = 0.01
"""Accuracy on the old recordings that enrolment may cost."""


def check_other_folder(model_dir: str | Path, out: str | Path) -> None:
    """Refuse (InputError) to write a model over the one it comes from."""
    if Path(out).resolve() == Path(model_dir).resolve():
        raise InputError(
            f"model '{out}': is the model to start from, which stays as it is; name another folder"
        )


def enrol(
    model_dir: str | Path,
    few: Recordings,
    out: str | Path,
    *,
    layers: Layers = "all",
    old: Recordings | None = None,
    seed: int = 0,
    progress: Progress = lambda done, total: None,
) -> Record:
    """Train the model in ``model_dir`` on with ``few`` touches of a new mounting, and write it to ``out``;
    config.json stays as it is.

    Parameters
    ----------
    few:
        Recordings of the new mounting, 1 to 5 touches of each class; the first touch of each recording
        counts.
    old:
        Recordings that the model was trained on, to be remembered.

    Returns
    -------
    What training.json keeps in ``enrolments``: layers, data, old_data, seed, touches (class name -> number),
    setting, before and after (share of the new recordings decided as labelled, which the network has now been
    trained on), old_before and old_after (of the old ones; None without), largest_change (of a weight),
    saturated: {feature, logit} (shares), wall_s, passed (no fewer of the new recordings right than before,
    and at most MAX_LOSS of the old ones lost).

    Raises
    ------
    InputError
        Recordings of another sensor, an unknown class, a class without a touch, a folder that must not be
        written, or signals of the new mounting that the formats cannot hold.
    """
    begin = time.perf_counter()
    check_other_folder(model_dir, out)
    check_model_target(out)
    if load_config(model_dir).has_prototypes:
        raise InputError(
            f"model '{model_dir}', field readout: is 'prototypes', which weights trained on would not fit; "
            "give --teach in place of --data, or quantise it without --readout first"
        )
    pair, record = load_pair(model_dir), load_training(model_dir)
    config = pair.integer.config
    few = few.of_classes(config.network.class_names, "the model")
    for recordings in (few, old):
        if recordings is not None:
            check_fit(recordings, config)
    recipe = _recipe_of(record, config)
    everything = joined(few, old)
    data = find_dataset(everything, config, recipe)
    is_new = np.arange(len(everything)) < len(few)
    new, former = (touch_rows(data, np.flatnonzero(part)) for part in (is_new, ~is_new))
    labels = everything.labels[data.touches.recording]
    _check_touches(few, new, labels, config)
    if old is not None and not len(former):
        raise InputError(
            f"recordings '{old.source}': show no touch; leave --with out, or look at their onsets with "
            "'eskin inspect'"
        )
    setting = SETTINGS[_layers(config, layers), old is not None]
    (enrolled,) = fit([pair], data, recipe, [new], None if old is None else [former], setting, seed, progress)
    if enrolled.integer.config != config:
        # the bitstream in use would be another design's
        raise AssertionError("enrolment changed the configuration")
    saturated = _saturated(enrolled, data, new, former, few.source)

    def right(of: Pair, part: np.ndarray) -> float | None:
        return accuracy(of.integer, data, np.flatnonzero(part)) if part.any() else None

    result: Record = {
        "layers": setting.layers,
        "data": str(few.source),
        "old_data": None if old is None else str(old.source),
        "seed": seed,
        "touches": {name: int(np.sum(labels[new] == c)) for c, name in enumerate(config.network.class_names)},
        "setting": dataclasses.asdict(setting),
        "before": right(pair, is_new),
        "after": right(enrolled, is_new),
        "old_before": right(pair, ~is_new),
        "old_after": right(enrolled, ~is_new),
        "largest_change": _largest_change(pair, enrolled),
        "saturated": saturated,
        "wall_s": time.perf_counter() - begin,
    }
    harmless = old is None or result["old_after"] >= result["old_before"] - MAX_LOSS
    result["passed"] = bool(harmless and result["after"] >= result["before"])
    record["enrolments"] = [*record.get("enrolments", []), result]
    ranges = profile(enrolled.real, data.touches)
    for entry in record.get("ranges", []):  # of the old recordings, which may not be at hand
        if entry["signal"] in ranges and entry["signal"] in (
            "feature",
            "state",
            "logit",
            "sigmoid pre-activation",
            "tanh pre-activation",
        ):
            low, high = ranges[entry["signal"]]
            ranges[entry["signal"]] = (min(low, entry["min"]), max(high, entry["max"]))
    record |= {"ranges": range_records(config, ranges), "quantisation_aware": False}
    enrolled.real.save(out, json.loads(json.dumps(record)), enrolled.integer)
    return result


def _layers(config: AcceleratorConfig, asked: Layers) -> Layers:
    """What is trained: a cell without a recurrent part is its dense layer."""
    return "dense" if set(network_shapes(config, real=False)) <= set(DENSE) else asked


def _recipe_of(record: Mapping[str, Any], config: AcceleratorConfig) -> Recipe:
    """The recipe of the first training: its loss and augmentation hold for what is added; that of the
    configuration where none is noted."""
    try:
        return Recipe(**record["recipe"])
    except (KeyError, TypeError):
        return choose_recipe(config)


def _largest_change(before: Pair, after: Pair) -> float:
    old, new = merged_parameters(before.real), merged_parameters(after.real)
    return max(float(np.abs(new[name] - old[name]).max()) for name in old)


def _saturated(pair: Pair, data: Dataset, new: np.ndarray, rest: np.ndarray, source: str) -> dict[str, float]:
    """Shares of the new touches' features and of all touches' logits, of completed steps, at a limit of their
    formats.

    Raises
    ------
    InputError
        More than MOST_SATURATED.
    """
    config, shares = pair.integer.config, {}
    for signal, rows, fmt in (
        ("feature", new, config.formats.feature_format),
        ("logit", np.concatenate([new, rest]), config.formats.logit_format),
    ):
        touches = data.touches.take(rows)
        decided = decide_touches(pair.integer, touches)
        codes = {"feature": decided.features, "logit": decided.logits}[signal]
        complete = np.arange(codes.shape[1]) < touches.completed[:, None]
        shares[signal] = float(np.mean((codes[complete] == fmt.min_code) | (codes[complete] == fmt.max_code)))
        if shares[signal] > MOST_SATURATED:
            raise InputError(
                f"recordings '{source}': {shares[signal]:.0%} of their {signal}s stand at the limits of "
                f"{signal}_format, {fmt}, and "
                "another format would be another bitstream; train a model on these recordings together with "
                "the old ones"
            )
    return shares


def accuracy(model: IntegerModel, data: Dataset, recordings: np.ndarray) -> float:
    """Share of ``recordings`` (indices) decided as labelled; no decision counts as wrong."""
    rows = data.index[recordings]
    placed = np.where(rows >= 0, np.cumsum(rows >= 0) - 1, -1)
    decided = decide_touches(model, data.touches.take(rows[rows >= 0]))
    return float(np.mean(by_recording(decided.decision, placed) == data.labels[recordings]))


def _right(network: IntegerModel, data: Dataset) -> Callable[[IntegerModel], np.ndarray]:
    """Of ``network``, or of it with prototypes, (R) bool: what `accuracy` is the mean of. Its states are computed
    once."""
    dense_run = decide_touches(dense(network), data.touches)

    def right(model: IntegerModel) -> np.ndarray:
        decided = decide_touches(model, data.touches, forward=lambda *_: (dense_run.hidden, dense_run.logits))
        return by_recording(decided.decision, data.index) == data.labels

    return right


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
    check_model_target(out)
    model, record = IntegerModel.load(model_dir), load_training(model_dir)
    check_teachable(model.config)
    few = few.of_classes(model.config.network.class_names, "the model")
    check_fit(few, model.config)
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
    FloatModel.load(model_dir).save(out, json.loads(json.dumps(record)), after)
    return result


# ---------------------------------------------------------------------- how much it brings
DRAWS = 10
"""Which touches are taught is drawn so often, and figures are means; training on is done once."""
SET_ASIDE = 5
"""Of so many recordings of a class in a group one is set aside, and judges what enrolment costs on the other
groups."""


CHOICES = 5
"""Front ends chosen at most, each without a part of the values: one a value took most of the time."""


@dataclass(frozen=True)
class Question:
    """What ``judge`` answers for one seed: how good a network is on each value of ``groups`` that it was not
    trained on, before and after k touches a class of it are enrolled, for each of ``ks``. old: with the old
    recordings. draw: which touches are enrolled, drawn at random by the seed or the first ones in the
    archive. configs: for each value, in the order of ``group_values``. readout: ``dense``, trained on with
    them; or ``prototypes``, taught them: of k = 0, too. new_class: not values are left out, but classes, each in
    turn (`judge_classes`)."""

    groups: tuple[str, ...]
    ks: tuple[int, ...]
    layers: Layers
    old: bool
    draw: Draw
    configs: tuple[AcceleratorConfig, ...]
    seed: int
    readout: str = "dense"
    new_class: bool = False


def front_ends_without(
    recordings: Recordings, values: Arrays, groups: Sequence[str], market: Market, **network: Any
) -> list[AcceleratorConfig]:
    """For each value of ``groups`` the front end that is chosen without its recordings, with the network
    asked for (`with_network`).

    Values are dealt to CHOICES parts; what is chosen without a part serves all of its values, and their
    networks train at once. The other values are left out in turn where there are two at least.
    """
    field = field_of(recordings)
    parts = [list(values)[first::CHOICES] for first in range(min(CHOICES, len(values)))]
    chosen: dict[str, AcceleratorConfig] = {}
    for part in parts:
        rows = np.flatnonzero(~np.isin(field.numbers, np.concatenate([values[value] for value in part])))
        with one_thread():
            (judged,) = field.judged(rows, groups)
        chosen |= dict.fromkeys(part, with_network(cheapest(judged, market).config, **network))
    return [chosen[value] for value in values]


def group_values(recordings: Recordings, groups: Sequence[str], ks: Sequence[int]) -> dict[str, np.ndarray]:
    """The recordings of each value of ``groups``, by its name.

    Raises
    ------
    InputError
        An unknown group, one with a single value, or a value with too few recordings of a class; a class
        without any is left out of that value (`lacking`).
    """
    if not groups:
        raise InputError(
            "--group: is missing; name the group array whose values are mountings, persons or positions"
        )
    of_value = {}
    for members in grouped_folds(recordings, groups, max(2, len(recordings)), None):
        name = " ".join(str(recordings.groups[group][members[0]]) for group in groups)
        of_value[name] = members
        counts = np.bincount(recordings.labels[members], minlength=len(recordings.class_names))
        label = int(np.argmin(np.where(counts, counts, len(members) + 1)))
        if counts[label] <= max(ks):
            raise InputError(
                f"recordings '{recordings.source}', group {' and '.join(groups)}: value {name} has "
                f"{counts[label]} recordings of class "
                f"{recordings.class_names[label]}, and enrolling {max(ks)} leaves none to judge; use a "
                "smaller k or another group"
            )
    return of_value


def lacking(recordings: Recordings, members: np.ndarray) -> list[str]:
    """Classes without a recording among ``members``: nobody can enrol them, and they are not judged."""
    present = np.unique(recordings.labels[members])
    return [name for label, name in enumerate(recordings.class_names) if label not in present]


def set_aside(recordings: Recordings, values: Arrays) -> np.ndarray:
    """(R) bool: the recordings that no network of the evaluation is trained on, one in SET_ASIDE of each
    class of each value, in the archive's order, beginning with the third."""
    aside = np.zeros(len(recordings), dtype=bool)
    for members in values.values():
        for label in range(len(recordings.class_names)):
            aside[members[recordings.labels[members] == label][2::SET_ASIDE]] = True
    return aside


def judge(
    recordings: Recordings, question: Question, progress: Progress = lambda done, total: None
) -> list[Record]:
    """For each value left out and each k: value, k, before, after (integer accuracy on the recordings of that
    value that no k enrols), others_before, others_after (on recordings of the other values that were set
    aside from both trainings; None: there are none), recordings, others (how many judge), lacking (classes
    that the value has no recording of).

    Touches enrolled with a smaller k are among those of a larger, and the same recordings judge every k.
    """
    if question.new_class:
        return judge_classes(recordings, question, progress)
    values = group_values(recordings, question.groups, question.ks)
    aside = set_aside(recordings, values)
    configs: dict[AcceleratorConfig, list[str]] = {}
    for value, config in zip(values, question.configs, strict=True):
        configs.setdefault(config, []).append(value)
    rows = []
    for config, chosen in configs.items():
        rows += _judge_values(
            recordings, config, {value: values[value] for value in chosen}, aside, question, progress
        )
    order = list(values)
    return sorted(rows, key=lambda row: (row["k"], order.index(row["value"])))


FALSE_ALARMS = 0.05
"""Share of known touches, of left out groups, that may be called unknown where new classes are judged."""


def judge_classes(
    recordings: Recordings, question: Question, progress: Progress = lambda done, total: None
) -> list[Record]:
    """As `judge`, ``value`` being a class that neither network nor prototypes were trained on. It is taught k
    touches, each of another value of the groups.

    before and after are of the class's recordings that are not taught, others of the other classes'
    recordings that were set aside. Two more figures are taken before it is taught. unknown: share of its
    whole touches that are unsure, by a threshold that FALSE_ALARMS of the touches of left out groups exceed.
    false_alarms: the same share of the others. unknown_here and false_alarms_here: by a threshold from left
    out recordings, not groups, which holds where the prototypes were recorded.
    """
    values = group_values(recordings, question.groups, (0,))
    aside, config = set_aside(recordings, values), question.configs[0]
    recipe, names = choose_recipe(config), recordings.class_names
    data, labels = find_dataset(recordings, config, recipe), recordings.labels
    remembered = [np.flatnonzero(~aside & (labels != label)) for label in range(len(names))]
    parts = [touch_rows(data, members) for members in remembered]
    models = fit_networks(data, config, recipe, parts, question.seed, progress)
    groups, where = group_numbers(recordings, question.groups), data.touches.recording
    whole = data.touches.completed == config.windows.steps
    rows = []
    for label, (name, model, part) in enumerate(zip(names, models, parts, strict=True)):
        network = by_last_step(_with_last(post_training(model, data, part, {}), label))
        # the new class becomes the last one, which is the spare one
        place = np.argsort([*(set(range(len(names))) - {label}), label])
        shown = part[whole[part]]
        seen = where[shown]

        ready, present = (
            with_prototypes(
                network,
                data.touches.take(shown),
                place[labels[seen]],
                left_out[seen],
                taught=max(question.ks),
                unknown=FALSE_ALARMS,
                spare_classes=1,
                source=f"recordings '{recordings.source}'",
            )
            for left_out in (groups, np.arange(len(labels)) % PARTS)
        )
        relabelled = dataclasses.replace(data, labels=place[labels])
        right, generator = _right(network, relabelled), np.random.default_rng([question.seed, *name.encode()])
        own, foreign = np.flatnonzero(labels == label), np.flatnonzero(aside & (labels != label))
        row = {"value": name, "recordings": len(own), "others": len(foreign), "lacking": []}
        row |= {"before": 0.0, "others_before": float(right(dense(network))[foreign].mean())}
        for kind, untaught in (("", ready), ("_here", present)):
            for figure, judged in (("unknown", own), ("false_alarms", foreign)):
                touched = touch_rows(data, judged)
                decided = decide_touches(untaught, data.touches.take(touched[whole[touched]]))
                row[figure + kind] = float(decided.unsure.mean())
        figures: dict[int, list[tuple[float, float]]] = {k: [] for k in sorted({0, *question.ks})}
        for _ in range(DRAWS):
            one_each: list[int] = []  # a recording of each value, in any order
            for members in values.values():
                of_value = np.intersect1d(members[data.index[members] >= 0], own)
                of_value = of_value[whole[data.index[of_value]]]
                one_each += [int(generator.choice(of_value))] if len(of_value) else []
            drawn = generator.permutation(np.array(one_each, dtype=np.int64))[: max(question.ks)]
            if len(drawn) < max(question.ks):
                raise InputError(
                    f"recordings '{recordings.source}': class {name} has whole touches of {len(drawn)} values of "
                    f"{' and '.join(question.groups)}, and {max(question.ks)} are to be taught; use a smaller k"
                )
            for k, of_draws in figures.items():
                touched = touch_rows(data, drawn[:k])
                taught = right(
                    teach_touches(ready, data.touches.take(touched), place[labels[where[touched]]])
                )
                of_draws.append((taught[np.setdiff1d(own, drawn)].mean(), taught[foreign].mean()))
        for k, of_draws in figures.items():
            after, others_after = np.mean(of_draws, axis=0).tolist()
            rows.append(row | {"k": k, "after": after, "others_after": others_after})
    return sorted(rows, key=lambda row: row["k"])


def _with_last(model: IntegerModel, label: int) -> IntegerModel:
    """The same network, class ``label`` behind the others."""
    names = model.config.network.class_names
    order = [*(number for number in range(len(names)) if number != label), label]
    config = model.config.replace(class_names=tuple(names[number] for number in order))
    arrays = {
        **model.arrays,
        "V": model.arrays["V"].take(order, axis=-2),
        "b_y": model.arrays["b_y"].take(order, axis=-1),
    }
    return IntegerModel(config, arrays, model.source)


def _judge_values(
    recordings: Recordings,
    config: AcceleratorConfig,
    values: Arrays,
    aside: np.ndarray,
    question: Question,
    progress: Progress,
) -> list[Record]:
    recipe = choose_recipe(config)
    data = find_dataset(recordings, config, recipe)
    everything, most = np.arange(len(recordings)), max(question.ks)
    remembered = [np.setdiff1d(everything[~aside], members) for members in values.values()]
    bystanders = [np.setdiff1d(everything[aside], members) for members in values.values()]
    parts = [touch_rows(data, members) for members in remembered]
    models = fit_networks(data, config, recipe, parts, question.seed, progress)
    before = [
        Pair(model, post_training(model, data, rows, {})) for model, rows in zip(models, parts, strict=True)
    ]
    setting = SETTINGS[_layers(config, question.layers), question.old]
    jobs: list[tuple[int, int, np.ndarray]] = []  # value, k, rows to enrol
    judged, of_value = [], []  # recordings that judge: of each job, how many of each value
    by_prototypes = question.readout == "prototypes"
    ks = tuple(sorted({0, *question.ks})) if by_prototypes else question.ks
    for number, (value, members) in enumerate(values.items()):
        generator = np.random.default_rng([question.seed, *value.encode()])
        for _ in range(DRAWS if by_prototypes and question.draw == "random" else 1):
            drawn = _draw(recordings, data, members, most, value, question, generator)
            for k in ks:
                jobs.append((number, k, touch_rows(data, np.concatenate([own[:k] for own in drawn]))))
                judged.append(np.setdiff1d(members, np.concatenate(drawn)))
        of_value.append(len(judged[-1]))
    if by_prototypes:
        after = _taught(recordings, question, data, parts, [pair.integer for pair in before], jobs)
    else:
        old = [parts[number] for number, _, _ in jobs] if question.old else None
        pairs = [before[number] for number, _, _ in jobs]
        new = [new for *_, new in jobs]
        fitted = fit(pairs, data, recipe, new, old, setting, question.seed, progress)
        after = [pair.integer for pair in fitted]
    right = [_right(pair.integer, data) for pair in before]
    at_first = [of(pair.integer) for of, pair in zip(right, before, strict=True)]
    figures: dict[tuple[int, int], list[list[float]]] = {}
    for (number, k, _), which, model in zip(jobs, judged, after, strict=True):
        later = right[number](model) if by_prototypes else _right(model, data)(model)
        figures.setdefault((number, k), []).append(
            [
                float(of[where].mean()) if len(where) else np.nan
                for where in (which, bystanders[number])
                for of in (at_first[number], later)
            ]
        )
    rows = []
    for (number, k), of_draws in figures.items():
        value = list(values)[number]
        own, own_after, *of_others = np.mean(of_draws, axis=0).tolist()
        row = {"value": value, "k": k, "before": own, "after": own_after}
        for name, share in zip(("others_before", "others_after"), of_others, strict=True):
            row[name] = share if len(bystanders[number]) else None
        row |= {"recordings": of_value[number], "others": len(bystanders[number])}
        rows.append(row | {"lacking": lacking(recordings, values[value])})
    return rows


def _taught(
    recordings: Recordings,
    question: Question,
    data: Dataset,
    parts: Sequence[np.ndarray],
    networks: Sequence[IntegerModel],
    jobs: Sequence[tuple[int, int, np.ndarray]],
) -> list[IntegerModel]:
    """Of each job the network with prototypes of what it was trained on, taught the job's touches."""
    groups, labels = group_numbers(recordings, question.groups), recordings.labels
    where, ready = data.touches.recording, []
    for network, part in zip(networks, parts, strict=True):
        whole = part[data.touches.completed[part] == network.config.windows.steps]
        options: Record = {"taught": max(1, *question.ks), "source": f"recordings '{recordings.source}'"}
        rows = where[whole]
        ready.append(
            with_prototypes(
                by_last_step(network), data.touches.take(whole), labels[rows], groups[rows], **options
            )
        )
    return [
        teach_touches(ready[number], data.touches.take(rows), labels[where[rows]]) for number, _, rows in jobs
    ]


def _draw(
    recordings: Recordings,
    data: Dataset,
    members: np.ndarray,
    most: int,
    value: str,
    question: Question,
    generator: np.random.Generator,
) -> list[np.ndarray]:
    """Of each class that is among ``members`` ``most`` recordings to enrol, such as show a touch: a user would
    see it and touch again."""
    drawn, lacks = [], lacking(recordings, members)
    for label, name in enumerate(recordings.class_names):
        if name in lacks:
            continue
        of_class = members[(recordings.labels[members] == label) & (data.index[members] >= 0)]
        least = (
            1 if question.readout == "dense" else data.touches.sums.shape[1]
        )  # part of a touch teaches nothing
        of_class = of_class[data.touches.completed[data.index[of_class]] >= least]
        if len(of_class) < most:
            raise InputError(
                f"recordings '{recordings.source}': of value {value} only {len(of_class)} recording(s) of "
                f"class {name} show a touch, and "
                f"{most} are to be enrolled; use a smaller k, or another front end (--config)"
            )
        drawn.append((generator.permutation(of_class) if question.draw == "random" else of_class)[:most])
    return drawn


def summary(
    group: Sequence[str],
    layers: Layers,
    old: bool,
    by_seed: Sequence[Sequence[Mapping[str, Any]]],
    readout: str = "dense",
) -> Record:
    """The result of ``enrol --evaluate`` from the rows of ``judge`` for each seed.

    Returns
    -------
    rows: {group, value, k, layers, old, before, after, others_before, others_after, recordings, others,
    lacking, spread: {the four}, by_seed: {the four}}, means over seeds; mean: k -> the four over all values,
    weighted by their recordings, and spread: the standard deviation of that mean over seeds (None: one seed).
    """
    figures = ["before", "after", "others_before", "others_after"]
    figures += [
        name
        for name in ("unknown", "false_alarms", "unknown_here", "false_alarms_here")
        if name in by_seed[0][0]
    ]

    def means(of_seeds: Mapping[str, np.ndarray | None]) -> Record:
        spread = {
            name: float(values.std(ddof=1)) if len(values) > 1 else None
            for name, values in of_seeds.items()
            if values is not None
        }
        mean = {name: None if values is None else float(values.mean()) for name, values in of_seeds.items()}
        return mean | {"spread": spread}

    rows: list[Record] = []
    mean = {}
    for same in zip(*by_seed, strict=True):
        runs = {name: [row[name] for row in same] for name in figures}
        head = {"group": " and ".join(group), "layers": layers, "old": old, "readout": readout}
        head |= {name: same[0][name] for name in ("value", "k", "recordings", "others", "lacking")}
        of_seeds = {name: None if None in values else np.array(values) for name, values in runs.items()}
        rows.append(head | means(of_seeds) | {"by_seed": runs})
    for k in sorted({row["k"] for row in rows}):
        of_k = [row for row in rows if row["k"] == k]
        overall: dict[str, np.ndarray | None] = {}
        for name in figures:
            of_others = name.startswith("others") or name.startswith("false_alarms")
            weight = [row["others" if of_others else "recordings"] for row in of_k]
            whole = all(row[name] is not None for row in of_k)
            values = [row["by_seed"][name] for row in of_k]
            overall[name] = np.average(values, axis=0, weights=weight) if whole else None
        mean[str(k)] = means(overall)
    return {"rows": rows, "mean": mean}
