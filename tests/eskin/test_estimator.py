"""A model in scikit-learn's hands: clones, cross-validation, grids, pipelines on lists of recordings; callbacks."""

import dataclasses
import pickle
import re
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer
from sklearn.utils import InputTags
from sklearn.utils.estimator_checks import check_estimator

import eskin
from eskin.api import probabilities
from tests.support.table import refused
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


def test_shares_add_up_and_follow_the_decision(fitted, lists):
    shares, decision = fitted.predict_proba(lists[0]), fitted.predict(lists[0])
    assert np.allclose(shares.sum(axis=1), 1) and (shares > 0).all()
    decided = decision >= 0
    assert (shares[decided].argmax(axis=1) == decision[decided]).all() and not decided.all()
    assert np.ptp(shares[~decided], axis=1).max() == 0
    logits = fitted.decision_function(lists[0])[decided]
    ratio = np.exp(logits[:, 0] - logits[:, 1])
    assert np.allclose(shares[decided][:, 0] / shares[decided][:, 1], ratio)
    votes = probabilities(np.array([[3.0, 1, 0], [np.nan] * 3]), votes=True)
    assert np.allclose(votes, [[0.75, 0.25, 0], [1 / 3] * 3])


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
    assert of_table.predict(table).shape == (20,) and of_table.score(table) > 0.7
    numbers = table.assign(label=table["label"].map({"hold": 3, "tap": 11}))
    with refused("has recordings of 11, and the model knows hold, tap"):
        of_table.score(numbers)


def test_scikit_learns_own_checks_pass_or_are_listed():
    """As it stands the model says that it takes no arrays of two dimensions, and few are tried; of one that says it
    does, those that fail are those of docs/figures.md."""

    class OfRows(eskin.Model):
        def __sklearn_tags__(self):
            rows = {"input_tags": InputTags(two_d_array=True), "no_validation": False}
            return dataclasses.replace(super().__sklearn_tags__(), **rows)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        own = check_estimator(eskin.Model(LINEAR, folds=0), on_skip=None)
        forced = check_estimator(OfRows(LINEAR, folds=0), on_fail=None, on_skip=None)
    assert {check["status"] for check in own} == {"passed"}
    missed = {check["check_name"] for check in forced if check["status"] == "failed"}
    listed = set(re.findall(r"`(check_\w+)`", Path("docs/figures.md").read_text()))
    assert missed == listed - {"check_estimator"}


def test_the_callback_gets_epochs_and_figures_and_may_end_it(lists):
    seen: list[tuple[int, dict]] = []
    eskin.Model(SMALL, folds=0).fit(*lists, callback=lambda *told: seen.append(told))
    assert [epoch for epoch, _ in seen] == list(range(1, 22))
    losses = [figures["loss"] for _, figures in seen[:-1]]
    assert losses[-1] < 0.7 * losses[0] and 0.7 < seen[-1][1]["accuracy"] <= 1

    class Enough(Exception):
        pass

    def end(epoch: int, figures: dict[str, float]) -> None:
        raise Enough

    with pytest.raises(Enough):
        eskin.Model(LINEAR, folds=0).fit(*lists, callback=end)
