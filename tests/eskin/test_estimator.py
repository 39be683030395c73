"""A model in scikit-learn's hands: clones, cross-validation, grids, pipelines on lists of recordings; callbacks."""

import dataclasses
import pickle
import warnings
from unittest.mock import Mock

import numpy as np
import pandas as pd
import pytest
from sklearn.calibration import CalibratedClassifierCV
from sklearn.metrics import accuracy_score
from sklearn.model_selection import GridSearchCV, cross_val_score
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer
from sklearn.utils import InputTags
from sklearn.utils.estimator_checks import check_estimator
from sklearn.utils.validation import validate_data

import eskin
from eskin.api import probabilities
from eskin.golden.core import PRESETS
from scripts import ROOT
from tests.support.recipes import few_updates
from tests.support.table import each_row, refused
from tests.support.touch_scenes import SMALL, scene

LINEAR = SMALL.replace(cell="linear", decision="last")


@pytest.fixture(scope="module")
def lists():
    """(recordings as a list of arrays of several lengths, labels)."""
    recordings = scene(40)
    return [recordings.recording(index) for index in range(len(recordings))], recordings.labels


@pytest.fixture(scope="module")
def fitted(lists):
    return eskin.Model(LINEAR, folds=0).fit(*lists)


def test_shares_add_up_and_follow_the_decision(fitted, lists, tmp_path):
    fitted.save(tmp_path / "model")
    loaded = eskin.Model.load(tmp_path / "model")
    shares, decision = loaded.predict_proba(lists[0]), loaded.predict(lists[0])
    assert np.allclose(shares.sum(axis=1), 1) and (shares > 0).all()
    decided = decision >= 0
    assert (shares[decided].argmax(axis=1) == decision[decided]).all() and not decided.all()
    assert np.ptp(shares[~decided], axis=1).max() == 0
    logits = loaded.decision_function(lists[0])[decided]
    ratio = np.exp(logits[:, 0] - logits[:, 1])
    assert np.allclose(shares[decided][:, 0] / shares[decided][:, 1], ratio)
    votes = probabilities(np.array([[3.0, 1, 0], [np.nan] * 3]), votes=True)
    assert np.allclose(votes, [[0.75, 0.25, 0], [1 / 3] * 3])
    assert loaded.classes_[decision].tolist()[0] == "none"


KINDS: dict[str, list] = {
    "names out of order": ["wool", "felt", "silk"],
    "numbers that are no indices": [11, -3, 7],
    "indices from 1": [1.0, 2.0, 3.0],
    "truths": [True, False, True],
}
"""Labels of the scene's three classes."""


@pytest.mark.filterwarnings("ignore:predict:UserWarning")
@each_row("kind, decision", zip(KINDS, ("vote", "last") * 2, strict=True))
def test_answers_of_a_fitted_model_are_labels_as_they_were_given(lists, monkeypatch, kind, decision):
    monkeypatch.setitem(PRESETS, "small", LINEAR.replace(decision=decision))
    given = np.array(KINDS[kind])[lists[1]]
    model = eskin.Model("small", folds=0, sample_rate_hz=1000.0).fit(lists[0], given)
    answers = model.predict(lists[0])
    assert model.classes_.tolist() == sorted(set(KINDS[kind])) and accuracy_score(given, answers) > 0.6
    scores, shares = model.decision_function(lists[0]), model.predict_proba(lists[0])
    assert (model.classes_[shares.argmax(axis=1)] == answers).all()
    columns = (scores > 0).astype(int) if scores.ndim == 1 else scores.argmax(axis=1)
    assert (scores.ndim == 1) == (kind == "truths") and (model.classes_[columns] == answers).all()
    # without a decision: the most frequent class, which counts as wrong
    undecided = model.trace(lists[0]).decision < 0
    values, counts = np.unique(given, return_counts=True)
    assert undecided.any() and set(answers[undecided]) == {values[counts.argmax()]}
    assert model.score(lists[0], given) == np.mean((answers == given) & ~undecided)
    with refused("is not a class; there are"):
        model.score(lists[0], np.full(len(given), 99))
    # a class that the training fold lacks, and a column of labels
    few = np.where(np.arange(len(given)) > 1, given, "new" if given.dtype.kind in "US" else 99)
    with pytest.warns(UserWarning, match="is no class that fit was given"):
        assert model.score(lists[0], few[:, None]) == np.mean((answers == few) & ~undecided)


def test_steps_that_tie_have_their_class_in_front(lists):
    """The configuration's order of classes, in which ties are decided, is not the order of columns."""
    config = SMALL.replace(cell="linear", decision="vote", class_names=("wool", "felt", "silk"))
    model = eskin.Model(config, folds=0).fit(lists[0], np.array(["wool", "felt", "silk"])[lists[1]])
    trace = model.trace(lists[0])
    votes = np.sort((trace.local[..., None] == np.arange(3)).sum(axis=1))
    assert (votes[:, -1] == votes[:, -2])[trace.first[trace.decision >= 0]].any()
    decided, shares = trace.decision >= 0, model.predict_proba(lists[0])
    assert (model.classes_[shares.argmax(axis=1)] == np.array(config.network.class_names)[trace.decision])[
        decided
    ].all()


def test_labels_beside_recordings_take_the_place_of_theirs():
    recordings = scene(40)
    other = np.array(["soft", "hard"])[recordings.labels % 2]
    config = LINEAR.replace(class_names=("hard", "soft"))
    model = eskin.Model(config, folds=0).fit(recordings, other)
    assert model.classes_.tolist() == ["hard", "soft"] and model.score(recordings, other) > 0.7
    with refused("fit, labels: "):
        eskin.Model(config, folds=0).fit(recordings, other[1:])


def test_images_as_arrays(monkeypatch):
    few_updates(monkeypatch, 2)
    pixels = np.random.default_rng(1).integers(0, 256, (12, 8, 8), dtype=np.uint8)
    config = eskin.Config.of_image(8, 8, ("conv 3 4", "pool", "dense 2"), ("cup", "ball"))
    labels = np.array(["ball", "cup"] * 6)
    model = eskin.Model(config, folds=0).fit(pixels, labels)
    assert set(model.predict([*pixels])) <= {"cup", "ball"}
    assert np.isfinite(cross_val_score(eskin.Model(config, folds=0), pixels, labels, cv=2)).all()


def test_without_a_network_there_are_no_classes(fitted, lists, tmp_path):
    assert not hasattr(eskin.Model(), "classes_") and not hasattr(eskin.Model(), "config")
    fitted.save(tmp_path / "model")
    assert str(eskin.Model.load(tmp_path / "model").classes_) == str(np.array(LINEAR.network.class_names))


@pytest.mark.filterwarnings("ignore:predict:UserWarning")
def test_scores_and_calibration_of_scikit_learn(lists):
    """The configuration's order of the classes is not the alphabet's; columns of a score are."""
    names = ("wool", "felt", "silk")
    given = np.array(names)[lists[1]]
    model = eskin.Model(LINEAR.replace(class_names=names), folds=0)
    for scoring in ("accuracy", "f1_macro", "roc_auc_ovr"):
        scores = cross_val_score(model, lists[0], given, cv=2, scoring=scoring, error_score="raise")
        assert scores.min() > 0.6
    calibrated = CalibratedClassifierCV(model, cv=2).fit(lists[0], given)
    assert accuracy_score(given, calibrated.predict(lists[0])) > 0.6


def test_of_recordings_the_answers_are_names():
    recordings = scene(40)
    model, due = eskin.Model(LINEAR, folds=0).fit(recordings), np.array(SMALL.network.class_names)
    with pytest.warns(UserWarning, match="no decision"):
        assert accuracy_score(due[recordings.labels], model.predict(recordings)) > 0.6
    assert model.score(recordings) == model.score(recordings, due[recordings.labels])


@pytest.mark.slow
def test_a_grid_over_a_pipeline_of_lists_here_and_in_processes(fitted, lists):
    again = pickle.loads(pickle.dumps(fitted))
    assert np.array_equal(again.predict(lists[0]), fitted.predict(lists[0]))
    louder = FunctionTransformer(lambda recordings: [array + 1 for array in recordings], validate=False)
    pipeline = make_pipeline(louder, eskin.Model(LINEAR, folds=0))
    options = {"param_grid": {"model__seed": [4]}, "cv": 2, "error_score": "raise"}
    here, there = (GridSearchCV(pipeline, **options, n_jobs=jobs).fit(*lists) for jobs in (1, 2))
    assert here.best_params_["model__seed"] == 4 and here.best_score_ == there.best_score_ > 0.7
    assert here.score(*lists) > 0.7 and here.predict(lists[0]).shape == (len(lists[0]),)


def test_labels_by_name_and_of_a_table(lists):
    names = np.array(["tap", "hold"])[lists[1] % 2]
    config = LINEAR.replace(class_names=("hold", "tap"))
    model = eskin.Model(config, folds=0).fit(lists[0], names)
    assert model.classes_.tolist() == ["hold", "tap"] and model.score(lists[0], names) > 0.7
    assert repr(eskin.Model()) == "Model(not fitted)"
    with refused("sample_rate_hz"):  # a configuration would say it
        eskin.Model(cell="linear", folds=0).fit(*lists)
    with refused("holds 'push', which is not in class_names"):
        eskin.Model(config, folds=0).fit(lists[0], np.where(names == "tap", "push", names))
    parts = {
        number: pd.DataFrame(array, columns=list("abcd")).assign(
            label=names[number], time=np.arange(len(array)) / 500.0
        )
        for number, array in enumerate(lists[0][:20])
    }
    table = pd.concat(parts, names=["recording"]).reset_index("recording")
    of_table = eskin.Model(cell="linear", folds=0).fit(table)
    assert sorted(of_table.classes_.tolist()) == ["hold", "tap"]
    assert of_table.predict(table[table["recording"] > 0]).shape == (19,) and of_table.score(table) > 0.7
    numbers = table.assign(label=table["label"].map({"hold": 3, "tap": 11}))
    with refused("has recordings of 11, and the model knows hold, tap"):
        of_table.score(numbers)


class OfRows(eskin.Model):
    """The model of a row of features, which scikit-learn's checks bring: a recording whose touch is the row."""

    def __sklearn_tags__(self):
        rows = {"input_tags": InputTags(two_d_array=True), "no_validation": False}
        return dataclasses.replace(super().__sklearn_tags__(), **rows)

    def fit(self, rows, labels=None):
        return super().fit(self.of_rows(rows, True), labels)

    def score(self, rows, y):
        return super().score(rows, y)

    def recordings(self, frames):
        return super().recordings(self.of_rows(frames, False))

    def of_rows(self, rows, first):
        rows = validate_data(self, rows, reset=first)
        features = 20 * rows[:, np.arange(4) % rows.shape[1]].clip(-10, 10)
        rest = np.repeat(2 * np.sin(np.arange(40)), 4).reshape(40, 4)
        return [np.rint(1000 + np.concatenate([rest, np.tile(row, (80, 1))])).astype(int) for row in features]


CANNOT_HOLD = {
    "check_estimators_unfitted": "it wants scikit-learn's NotFittedError, and a loaded model needs no scikit-learn",
    "check_fit_score_takes_y": "it wants the name `y`; tools give labels by place",
    "check_requires_y_none": "it wants its own words about missing labels",
}
"""Reasons by check; docs/python.md has them."""


def test_scikit_learns_own_checks_hold_or_are_listed(monkeypatch):
    """As it stands the model says that it takes no arrays of two dimensions, and none is tried."""
    monkeypatch.setitem(PRESETS, "small", LINEAR)
    few_updates(monkeypatch, 8)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = OfRows("small", folds=0, sample_rate_hz=1000.0)
        checks = check_estimator(model, expected_failed_checks=CANNOT_HOLD, on_skip=None)
    status = {check["check_name"]: check["status"] for check in checks}
    assert {name for name, result in status.items() if result == "xfail"} == set(CANNOT_HOLD)
    assert "check_classifiers_train" in status and len(status) > 45
    page = " ".join((ROOT / "docs/python.md").read_text().split())
    assert [
        f"`{name}`: {reason}" for name, reason in CANNOT_HOLD.items() if f"`{name}`: {reason}" not in page
    ] == []


def test_the_callback_gets_epochs_and_figures_and_may_end_it(lists, monkeypatch):
    seen: list[tuple[int, dict]] = []
    few_updates(monkeypatch, 200)
    eskin.Model(SMALL, folds=0).fit(*lists, callback=lambda *told: seen.append(told))
    assert [epoch for epoch, _ in seen] == list(range(1, 22))
    losses = [figures["loss"] for _, figures in seen[:-1]]
    assert losses[-1] < 0.7 * losses[0] and 0.7 < seen[-1][1]["accuracy"] <= 1

    with pytest.raises(KeyError):
        eskin.Model(LINEAR, folds=0).fit(*lists, callback=Mock(side_effect=KeyError))
