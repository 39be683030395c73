"""The Python interface behind ``import eskin`` (docs/python.md): a model that predicts, streams and
explains itself.

Only training loads torch.
"""

from __future__ import annotations

import os
import tempfile
import warnings
from collections.abc import Callable, Hashable, Sequence, Sized
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, Self, cast

import numpy as np
from numpy.typing import ArrayLike

from eskin.choose.cost import Prefer
from eskin.data import load_recordings
from eskin.data.fit import check_fit, for_model
from eskin.golden.core import PRESETS, AcceleratorConfig, InputError, Progress, Record, array_of
from eskin.golden.core.config import IMAGE_ROWS_HZ
from eskin.golden.core.images import NETWORKS
from eskin.golden.data import Recordings
from eskin.golden.data.recordings import classes_of, recordings_of
from eskin.golden.model import (
    FloatModel,
    ImageTrace,
    IntegerModel,
    Stream,
    Trace,
    float_images,
    images_of,
    load_config,
    run,
    run_images,
)
from eskin.golden.model.model import FLOAT_FILE, INTEGER_FILE
from eskin.golden.model.prototypes import forget
from eskin.training.record import training_of

if TYPE_CHECKING:
    import pandas as pd

    from eskin.cli.common import CellChoice

Frames = ArrayLike | Sequence[ArrayLike] | Recordings
"""One recording (frames, taxels), several of them, or a set of recordings."""


NO_CLASS = "none"
"""Name of the decision -1."""


class NotFittedError(InputError, AttributeError):
    """A model without the network that is asked for; ``hasattr`` is false then."""


class ClassNames(np.ndarray):
    """Names of the classes by their index; -1, which is no decision, is NO_CLASS where a plain array would
    name the last class."""

    def __getitem__(self, index: Any) -> Any:
        numbers = np.asarray(index)
        # slices, masks, no class at all
        if numbers.dtype.kind not in "iu" or ((numbers < -1) | (numbers >= len(self))).any():
            return super().__getitem__(index)
        return np.append(np.asarray(self), NO_CLASS)[index]

    def __iter__(self) -> Any:
        return iter(np.asarray(self))

    def __repr__(self) -> str:  # numpy prints by negative indices
        return repr(np.asarray(self))

    def __str__(self) -> str:
        return str(np.asarray(self))


class Model:
    """A network that names touches, in integers as the hardware computes, and in real numbers as it was
    trained.

    Load one (`Model.load`), or train one (`fit`). It keeps to what scikit-learn calls things: `fit`, `predict`,
    `decision_function`, `score`, `classes_`. A sample there is a recording here; the class of a recording is the
    decision of its first touch. There is none where there is no touch, or none that completes a window: a
    loaded model says -1 then, and a fitted one, whose answers are members of `classes_`, its most frequent
    class.

    Parameters
    ----------
    config : str, path, Config or None
        For `fit`: a preset's name, a file or a configuration; None: a front end is chosen by evidence.
    cell : {"auto", "gru", "lstm", "linear", "trees"}, for images {"tactnet", "tactnet-half", "four", "four-lean"}, or
    None
        For `fit`: the cell; None as "auto", the smallest network that is enough, where neither `config` nor
        `hidden` is given.
    hidden : int or None
        For `fit`: hidden units.
    groups : sequence of str, str or None
        For `fit`: group arrays that stay on one side of a split; None: the archive's first group that can be
        left out.
    folds : int
        For `fit`: folds of the cross-validation, 0 for none.
    seed : int
        For `fit`: of the model that is kept.
    prefer : {"energy", "cells", "latency"}
        For `fit`: the cost to minimise among candidates level with the best.
    fits : str or None
        For `fit`: the board that has to hold it; None: the icebreaker where anything level fits it.
    sample_rate_hz : float or None
        For `fit`: frames a second of lists of arrays; None: the configuration's, where one is given.

    Attributes
    ----------
    classes_ : numpy.ndarray
        Of a loaded model the class names, into which `predict` gives indices; the name of -1, no decision, is
        "none". Of a fitted one the classes as `fit` was given them, sorted: `predict` gives these.
    config : Config
        Front end, network and formats.
    training_ : dict
        How the model came about: front ends and networks compared, cross-validated accuracy.
    integer, real : IntegerModel, FloatModel
        The golden models behind it.

    Examples
    --------
    >>> import eskin
    >>> model = eskin.Model.load("model")                             # doctest: +SKIP
    >>> model.classes_[model.predict(frames)]                         # doctest: +SKIP
    """

    def __init__(
        self,
        config: str | Path | AcceleratorConfig | None = None,
        *,
        cell: CellChoice | None = None,
        hidden: int | None = None,
        groups: Sequence[str] | str | None = None,
        folds: int = 5,
        seed: int = 0,
        prefer: Prefer = "energy",
        fits: str | None = None,
        sample_rate_hz: float | None = None,
    ) -> None:
        self._parameters = {name: value for name, value in locals().items() if name != "self"}
        self._integer: IntegerModel | None = None
        self._real: FloatModel | None = None
        self._training: Record = {}
        self._fitted: tuple[np.ndarray, np.ndarray] | None = None  # of each class: label, share

    def _asked(self) -> tuple[AcceleratorConfig | None, Record]:
        """(configuration, fields of `TrainingSettings`) that the parameters ask for."""
        values = self._parameters
        config, groups = values["config"], values["groups"]
        words = [groups] if isinstance(groups, str) else groups if isinstance(groups, (list, tuple)) else []
        for name, right, needed in (
            ("config", config is None or isinstance(config, str | Path | AcceleratorConfig), "a preset, file or Config"),
            ("groups", groups is None or (words and all(isinstance(word, str) for word in words)), "names of group arrays"),
            *((name, isinstance(values[name], int | np.integer) and values[name] >= 0, "a number from 0 on") for name in ("folds", "seed")),
        ):  # fmt: skip
            if not right:
                raise InputError(f"model, {name}: is {values[name]!r:.60}; give {needed}")
        if isinstance(config, str | Path):
            config = AcceleratorConfig.load(config)
        names = ("cell", "hidden", "folds", "seed", "prefer", "fits")
        return config, {name: values[name] for name in names} | {"group": ",".join(words) or None}

    # ------------------------------------------------------------------ what scikit-learn's tools ask for
    def get_params(self, deep: bool = True) -> Record:
        """The parameters as they were given; ``deep`` says nothing here: no parameter has parameters."""
        return dict(self._parameters)

    def set_params(self, **parameters: Any) -> Self:
        """Other parameters for the next `fit`.

        Raises
        ------
        InputError
            One that there is not; all are as before then. `fit` refuses wrong values.
        """
        if unknown := sorted(set(parameters) - set(self._parameters)):
            raise InputError(
                f"model: has no parameter '{unknown[0]}'; it has {', '.join(sorted(self._parameters))}"
            )
        self._parameters = self._parameters | parameters
        return self

    def __sklearn_tags__(self) -> Any:
        """A classifier of recordings of any length, which a two-dimensional array of features is not."""
        from sklearn.utils import ClassifierTags, InputTags, Tags, TargetTags

        return Tags(
            estimator_type="classifier",
            target_tags=TargetTags(required=True),
            classifier_tags=ClassifierTags(),
            input_tags=InputTags(two_d_array=False, three_d_array=True),
            no_validation=True,
        )

    def __sklearn_is_fitted__(self) -> bool:
        """Is there a network?"""
        return self._integer is not None or self._real is not None

    # ------------------------------------------------------------------ where models come from and go to
    @classmethod
    def load(cls, folder: str | Path) -> Model:
        """The model of a folder that `eskin train`, `eskin import`, `eskin quantise` or `save` wrote.

        Raises
        ------
        InputError
            The folder is not a model, or is damaged.
        """
        if not isinstance(folder, str | os.PathLike):
            raise InputError(
                f"model: is of type {type(folder).__name__}; name the folder that 'eskin train' wrote"
            )
        model = cls(load_config(folder))
        if (Path(folder) / FLOAT_FILE).exists() or not (Path(folder) / INTEGER_FILE).exists():
            model._real = FloatModel.load(folder, images=True)
        if (Path(folder) / INTEGER_FILE).exists():
            model._integer = IntegerModel.load(folder, images=True)
        model._training = training_of(folder).plain()
        return model

    def save(self, folder: str | Path) -> None:
        """Write a model folder, new or in place of an earlier model's, for the command line and for
        `load`."""
        self.real.save(folder, self.training_, self._integer)

    def fit(
        self,
        recordings: str | Path | Recordings | Sequence[ArrayLike] | Any,
        labels: ArrayLike | None = None,
        *,
        sample_rate_hz: float | None = None,
        progress: Progress | None = None,
        callback: Callable[[int, dict[str, float]], None] | None = None,
    ) -> Model:
        """Choose what was not asked for, cross-validate, train on all recordings, and make integers of it;
        needs the extra ``train``.

        Parameters
        ----------
        recordings : Recordings, str, path, DataFrame, or list of arrays
            What ``--data`` takes, loaded or by its name; one long table, whose labels are the classes then;
            or arrays (frames, taxels) of codes, then with the next two; or images, as `predict` takes them.
        labels : array of int or str
            The class of each recording, of Recordings and tables in place of theirs; with a configuration a name of its
            classes, or an index.
        sample_rate_hz : float
            Of a list of arrays: frames a second; None: the model's parameter, or its configuration's.
        progress : callable
            Called with (what, done, total).
        callback : callable
            Called with (epoch, figures) while the network that is kept is trained: figures is {"loss": ...}
            at each epoch of a recurrent cell, and of every cell at the end {"accuracy": ...} on what it was
            trained on. An exception that it raises ends the training.

        Returns
        -------
        Model
            Itself.

        Raises
        ------
        InputError
            A parameter of a wrong value; the recordings break a rule, or do not fit the configuration that was
            asked for.
        """
        from eskin.choose.choice import train_chosen
        from eskin.training.integers import quantise
        from eskin.training.settings import TrainingSettings
        from eskin.verbs.cost import cost_model

        asked, options = self._asked()
        members: np.ndarray | None = None
        names: Sequence[str] = ()
        if labels is not None:
            members, names, labels = _targets(labels, asked)
        if isinstance(recordings, str | Path) or type(recordings).__name__ == "DataFrame":
            recordings = load_recordings(recordings, config=asked)
        if isinstance(recordings, Recordings):
            if labels is not None:
                arrays = {"labels": np.asarray(labels), "class_names": np.array(names)}
                classes, labels = classes_of(arrays, len(recordings), _refuse)
                recordings = replace(recordings, labels=labels, class_names=classes)
        else:
            rate = self._parameters["sample_rate_hz"] if sample_rate_hz is None else sample_rate_hz
            rate = rate or (asked.sensor.sample_rate_hz if asked else None)
            if labels is None:
                raise InputError("fit: arrays have no classes; give labels, or Recordings")
            if (asked and asked.is_image) or self._parameters["cell"] in NETWORKS:
                recordings = _of_images(recordings, labels, names, rate or IMAGE_ROWS_HZ)
            elif rate is None:
                raise InputError("fit: arrays have no rate; give sample_rate_hz, or Recordings")
            else:
                recordings = Recordings.of(recordings, labels, sample_rate_hz=rate, class_names=names)
        with tempfile.TemporaryDirectory() as work:
            folder = Path(work) / "model"
            prices = cost_model(self._parameters["prefer"], self._parameters["fits"])
            wanted = TrainingSettings(out=folder, **options)
            train_chosen(recordings, asked, prices, wanted, progress=progress, callback=callback)
            quantise(folder, recordings if load_config(folder).has_prototypes else None)
            fitted = Model.load(folder)
        self._integer, self._real, self._training = fitted._integer, fitted._real, fitted._training
        names = self.config.network.class_names
        counts = recordings.with_classes(names, "the model").class_counts + 1  # a share of 0 has no logarithm
        members = np.array(names) if members is None else members
        order = np.argsort(members)
        usual = members[order[counts[order].argmax()]]
        self._fitted = np.append(members, usual), counts / counts.sum()  # what -1 is given comes last
        return self

    # ------------------------------------------------------------------ what there is
    @property
    def integer(self) -> IntegerModel:
        """The integer network, whose every value is the hardware's."""
        if self._integer is None:
            raise NotFittedError("model: has no integers; fit it, or run 'eskin quantise' on its folder")
        return self._integer

    @property
    def real(self) -> FloatModel:
        """The float network, as it was trained."""
        if self._real is None:
            raise NotFittedError("model: has no float network; fit it, or load a folder that holds float.npz")
        return self._real

    @property
    def training_(self) -> Record:
        """Training record: front ends and networks compared, cross-validated accuracy."""
        return self._training

    @property
    def config(self) -> AcceleratorConfig:
        """Front end, network and formats."""
        if self._integer is not None:
            return self._integer.config
        return self.real.config

    @property
    def classes_(self) -> np.ndarray:
        """Of a fitted model what `predict` gives, sorted; of a loaded one the class names in the order of the
        class indices, whose -1 is "none"."""
        if self._fitted is not None:
            return np.sort(self._fitted[0][:-1])
        return np.array(self.config.network.class_names).view(ClassNames)

    def __repr__(self) -> str:
        if self._integer is None and self._real is None:
            return "Model(not fitted)"
        rest = "" if self._integer is not None else ", not quantised"
        return f"Model({self.config.name}, {self.config.classes} classes{rest})"

    # ------------------------------------------------------------------ decisions
    def predict(self, frames: Frames, *, integer: bool = True) -> np.ndarray:
        """The class of each recording.

        Parameters
        ----------
        frames : array (frames, taxels), list of arrays, Recordings, or DataFrame
            A/D codes, each recording from its first frame on; or real samples, for a model that was trained
            on such.
        integer : bool
            The integer network, which is the hardware's; False: the float one.

        Returns
        -------
        numpy.ndarray
            (recordings): of a loaded model class indices, int64, -1 where no touch was found or none completed
            a window; of a fitted one members of `classes_`, there its most frequent class, with a warning.

        Raises
        ------
        InputError
            Frames of another array, rate or code range.
        """
        decision, _ = self._decided(frames, integer)
        if self._fitted is None:
            return decision
        named, _ = self._fitted
        if undecided := int((decision < 0).sum()):
            warnings.warn(
                f"predict: {undecided} of {len(decision)} recordings have no decision and get {named[-1]}, the most "
                "frequent class; trace tells which",
                stacklevel=2,
            )
        return named[decision]

    def decision_function(self, frames: Frames, *, integer: bool = True) -> np.ndarray:
        """Scores whose largest `predict` takes: logits of the deciding step (with prototypes, negative
        distances), or the number of votes where steps vote.

        Parameters
        ----------
        frames, integer
            As for `predict`.

        Returns
        -------
        numpy.ndarray
            float64 (recordings, classes); logits as real values. NaN where `predict` says -1. Largest minus
            second largest is the margin. Of a fitted model in the order of `classes_`, of two classes the
            second's less the first's, (recordings,); without a decision what makes `predict_proba` the classes'
            shares of the training.
        """
        scores = self._scores(frames, integer)
        return scores if self._fitted is None or scores.shape[1] != 2 else scores[:, 1] - scores[:, 0]

    def _scores(self, frames: Frames, integer: bool) -> np.ndarray:
        """Scores (recordings, classes) in the order of `classes_`."""
        decision, scores = self._decided(frames, integer)
        if self._fitted is None:
            return scores
        named, shares = self._fitted
        scores[decision < 0] = shares if self._votes else np.log(shares)
        return scores[:, np.argsort(named[:-1])]

    def _decided(self, frames: Frames, integer: bool) -> tuple[np.ndarray, np.ndarray]:
        """(decision, scores (recordings, classes)), both by class index; -1 and NaN where there is none."""
        if self.config.is_image:
            image = self.image_trace(frames, integer=integer)
            to_real = self.config.formats.logit_format.to_real
            return image.decision, to_real(image.logits) if integer else image.logits
        trace = self.trace(frames, integer=integer)
        if self._votes:
            scores = (trace.local[..., None] == np.arange(self.config.classes)).sum(axis=1).astype(np.float64)
        else:
            step = np.maximum(trace.global_step, 0)
            scores = trace.scores[np.arange(len(step)), step].astype(np.float64)
            scores /= 2.0**self.config.score_format.frac_bits if integer else 1.0
        scores_of_decisions = np.full((len(trace.first), self.config.classes), np.nan)
        decided = trace.decision >= 0
        scores_of_decisions[decided] = scores[trace.first[decided]]
        if self._votes:  # of steps that tie the network takes one class
            place = np.flatnonzero(decided), trace.decision[decided]
            scores_of_decisions[place] = np.nextafter(scores_of_decisions[place], np.inf)
        return trace.decision, scores_of_decisions

    @property
    def _votes(self) -> bool:
        """Do steps vote?"""
        return not self.config.is_image and self.config.network.decision == "vote"

    def predict_proba(self, frames: Frames, *, integer: bool = True) -> np.ndarray:
        """Shares of the classes: exp of `decision_function` over the sum of all, or the shares of the votes
        where steps vote. Nobody calibrated them: 0.9 does not mean right nine times in ten.

        Returns
        -------
        numpy.ndarray
            float64 (recordings, classes), in the order of `classes_`; rows add up to 1. Without a decision
            equal shares, of a fitted model the shares in the training.
        """
        return probabilities(self._scores(frames, integer), votes=self._votes)

    def score(self, frames: Frames, labels: ArrayLike | None = None, *, integer: bool = True) -> float:
        """Share of recordings that are decided rightly; no decision counts as wrong, also where `predict` of a
        fitted model gives the class.

        Parameters
        ----------
        labels : array of int, or of str
            The classes, as `fit` was given them, by index or by name; of Recordings and DataFrames their own
            by default. A class that `fit` was not given, as folds of scikit-learn may have it, counts as wrong, with a
            warning.

        Raises
        ------
        InputError
            As `predict`; labels that are not classes of the model, of a fitted one none of them, or not one a recording.
        """
        frames = self._of_table(frames)
        decision, _ = self._decided(frames, integer)
        return float(np.mean(decision == self._labels(decision, frames, labels, "score")))

    def _labels(self, each: Sized, frames: Frames, labels: ArrayLike | None, verb: str) -> np.ndarray:
        """Class indices, one for ``each`` recording: ``labels``, or those that the recordings have."""
        if labels is None:
            if not isinstance(frames, Recordings):
                raise InputError(f"{verb}: arrays have no classes; give labels, or Recordings")
            frames = frames.with_classes(self.config.network.class_names, "the model")
            labels = frames.labels
        indices = self._places(labels, verb)
        if indices.shape not in ((len(each),), (len(each), 1)):
            raise InputError(
                f"{verb}: labels of shape {indices.shape} for {len(each)} recordings; give one per recording"
            )
        return indices.ravel()

    def teach(self, frames: Frames, labels: ArrayLike | None = None) -> Model:
        """Store touches as prototypes of their classes, beside those there are; nothing is trained. Needs a
        model quantised with ``--readout prototypes``. The first touch of each recording is stored, in order.
        If all places of a class are in use, its oldest touch is replaced.

        Parameters
        ----------
        labels : array of int, or of str
            The classes, by index or by name; of Recordings and DataFrames their own by default.

        Returns
        -------
        Model
            Itself.

        Raises
        ------
        InputError
            As `score`; a model that cannot be taught; no whole touch.
        """
        from eskin.training.prototypes import teach_recordings

        self._reads_recordings()
        recordings = self.recordings(frames := self._of_table(frames))
        classes = self._labels(recordings, frames, labels, "teach")
        names = self.config.network.class_names
        self._integer, _ = teach_recordings(
            self.integer, replace(recordings, labels=classes, class_names=names)
        )
        return self

    def forget(self, label: int | str | None = None) -> Model:
        """Forget the touches that a class was taught; None: of every class.

        Raises
        ------
        InputError
            A class that is not there; a model that cannot be taught.
        """
        self._integer = forget(
            self.integer, None if label is None else int(self._places([label], "forget")[0])
        )
        return self

    def _places(self, labels: ArrayLike, verb: str) -> np.ndarray:
        """Indices of labels, which are names, or the classes that `fit` was given; where these are names, or
        were not given, indices; -2 for no class, where `score` counts it. One label alone is a list of it."""
        names = self.config.network.class_names
        numbers = list(range(len(names)))
        if self._fitted is not None and self._fitted[0].dtype.kind not in "USO":
            numbers = self._fitted[0][:-1].tolist()
        array = array_of([labels] if isinstance(labels, str) else labels, "labels")
        place: dict[Hashable, int] = {label: index for index, label in enumerate(numbers)}
        place |= {name: index for index, name in enumerate(names)}
        flat, truths = array.ravel().tolist(), isinstance(numbers[0], bool)
        indices = [
            place.get(label, -2) if isinstance(label, Hashable) and isinstance(label, bool) <= truths else -2
            for label in flat
        ]
        if -2 in indices:
            label = flat[indices.index(-2)]
            if self._fitted is None or verb != "score" or set(indices) == {-2}:
                raise InputError(
                    f"{verb}: label {label!r} is not a class; there are {', '.join(names)}, or "
                    f"{', '.join(map(str, numbers))}"
                )
            warnings.warn(
                f"score: {label!r} is no class that fit was given, and counts as wrong", stacklevel=4
            )
        return np.array(indices, dtype=np.int64).reshape(array.shape)

    def stream(self, *, integer: bool = True) -> Stream:
        """A stream that takes frames one by one and gives decisions as the hardware does, with the frame that
        brings each.

        ``push`` takes frames of a recording, ``finish`` ends it, and ``arm`` begins the next one.
        """
        self._reads_recordings()
        return Stream(self.integer if integer else self.real)

    def trace(
        self, frames: Frames, *, integer: bool = True, progress: Callable[[int, int], None] | None = None
    ) -> Trace:
        """Every stage between frames and decisions: onsets, windowed sums, features, hidden states, logits,
        decisions of each step.

        Parameters
        ----------
        frames, integer
            As for `predict`.
        progress : callable
            Called with (recordings done, recordings in all).
        """
        self._reads_recordings()
        recordings = self.recordings(frames)
        return run(self.integer if integer else self.real, recordings, progress=progress)

    def image_trace(self, images: Frames, *, integer: bool = True) -> ImageTrace:
        """Every map, logits and decision of a network for images.

        Parameters
        ----------
        images : array (n, height, width) or (height, width), list of arrays, or Recordings
            Pixels 0..255, or real ones from 0 to 1.

        Raises
        ------
        InputError
            Images of another size; or a model of recordings.
        """
        if not self.config.is_image:
            raise InputError("image_trace: the model reads recordings; use trace")
        recordings = self.recordings(images)
        return (
            run_images(self.integer, images_of(recordings))
            if integer
            else float_images(self.real, images_of(recordings))
        )

    def _reads_recordings(self) -> None:
        if self.config.is_image:
            raise InputError(
                "model: is a network for images, which takes them whole; use image_trace or predict"
            )

    def _of_table(self, frames: Frames | pd.DataFrame) -> Frames:
        """Recordings of one long table; anything else as it is."""
        return load_recordings(frames, config=self.config) if type(frames).__name__ == "DataFrame" else frames

    def recordings(self, frames: Frames) -> Recordings:
        """Frames as a set of recordings of this model's array, their classes unknown (all 0) unless they are
        Recordings.

        Raises
        ------
        InputError
            They do not fit the model's array.
        """
        names, frames = self.config.network.class_names, self._of_table(frames)
        if isinstance(frames, Recordings):
            unlabelled = replace(frames, labels=np.zeros(len(frames), dtype=np.int64), class_names=names)
            fitting = for_model(unlabelled, self.config, warnings.warn)
            return replace(
                fitting, labels=frames.labels, class_names=frames.class_names
            )  # maybe not the model's
        sensor, array = self.config.sensor, cast(Any, frames)
        if getattr(array, "ndim", 0) == 3 and array.shape[2] != sensor.taxels == array[0].size:
            frames = [array]  # one recording of rows and columns
        if sensor.taxels == 1 and isinstance(array, list | tuple):  # a vector is a recording
            frames = [np.asarray(part)[:, None] if getattr(part, "ndim", 0) == 1 else part for part in array]
        if self.config.is_image:
            recordings = _of_images(frames, None, names, sensor.sample_rate_hz)
        else:
            scale = sensor.volt_per_code or None
            recordings = Recordings.of(
                frames, class_names=names, sample_rate_hz=sensor.sample_rate_hz, scale=scale, source="frames"
            )
            if recordings.volt_per_code and scale is None:
                raise InputError(
                    "frames: hold real numbers, not integers, and the model was trained on codes; give the A/D "
                    "codes"
                )
        check_fit(recordings, self.config)
        return recordings


def _refuse(field: str, why: str) -> NoReturn:
    raise InputError(f"fit, {field}: {why}")


def _of_images(
    frames: ArrayLike | Sequence[ArrayLike], labels: ArrayLike | None, names: Sequence[str], rows_hz: float
) -> Recordings:
    """Images (n, height, width), or one of them; without labels of class 0."""
    images = array_of(frames, "images", "give images of one size, (images, height, width)")
    images = images[None] if images.ndim == 2 else images
    arrays = {
        "images": images,
        "labels": np.zeros(len(images), dtype=np.int64) if labels is None else np.asarray(labels),
        "class_names": np.array(names),
        "sample_rate_hz": np.array(rows_hz),
    }
    return recordings_of(arrays, "images")


def probabilities(scores: np.ndarray, *, votes: bool) -> np.ndarray:
    """Shares of ``scores`` (n, C) that add up to 1: of votes their shares, else exp(score) over the sum of
    all; rows that are not a number give equal shares."""
    finite = np.where(np.isnan(scores), 0.0, scores)
    if votes:
        shares = finite + (finite.sum(axis=1, keepdims=True) == 0)
    else:
        shares = np.exp(finite - finite.max(axis=1, keepdims=True))
    return shares / shares.sum(axis=1, keepdims=True)


def _targets(
    labels: ArrayLike, config: AcceleratorConfig | None
) -> tuple[np.ndarray, Sequence[str], np.ndarray]:
    """(classes by their index, their names, the labels as `Recordings.of` takes them) of a list of arrays. A
    preset has no classes; a configuration's stay in its order, and numbers are their indices."""
    from sklearn.utils import column_or_1d
    from sklearn.utils.multiclass import check_classification_targets

    try:
        targets = column_or_1d(array_of(labels, "labels"), warn=True)
        if {type(label) for label in targets.tolist()} in ({bool}, {int}):  # in an array of objects, too
            targets = np.array(targets.tolist())
        check_classification_targets(targets)
    except (ValueError, TypeError) as error:
        raise InputError(f"fit, labels: {error}") from None
    text = targets.dtype.kind in "USO"
    if config is not None and config != PRESETS.get(config.name):
        names = config.network.class_names
        return np.array(names) if text else np.arange(len(names)), names, targets
    members, indices = np.unique(targets, return_inverse=True)
    if len(members) < 2:
        raise InputError(f"fit, labels: are of one class, {members[0]}; give recordings of two or more")
    return members, [str(label) if text else f"class{label}" for label in members], indices
