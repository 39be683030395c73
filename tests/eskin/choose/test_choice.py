"""What is chosen and noted, what the command line fixes, and figures of folds that chose nothing: no label of
a fold is seen by what is chosen for it."""

import json
from concurrent.futures import BrokenExecutor
from contextlib import nullcontext
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from eskin.choose import choice as choosing
from eskin.choose.choice import Searched, configure, inner_folds, train_chosen, unseen
from eskin.choose.networks import SearchOptions
from eskin.golden.data import Recordings
from eskin.golden.model import FloatModel
from eskin.training import splits as splitting
from eskin.training import train
from eskin.training.integers import quantise
from eskin.training.judge import cross_validate
from eskin.training.settings import TrainingSettings
from eskin.training.splits import over_groups, split_folds
from tests.eskin.choose.test_candidate import CONFIG
from tests.support.gripped_scene import by_person, gripped_recordings
from tests.support.prices import priced
from tests.support.table import each_row, refused

FEW = {"folds": 2, "seeds": 1}


@pytest.fixture(scope="module")
def gripped() -> Recordings:
    return gripped_recordings()


def trained(recordings, asked, tmp_path, **options):
    request = TrainingSettings(out=tmp_path / "m", **{**FEW, **options})
    return train_chosen(recordings, asked, priced(), request, progress=Mock())


# ---------------------------------------------------------------------- training what was chosen
def test_everything_is_chosen_and_noted(gripped, quick, tmp_path):
    record = trained(gripped, None, tmp_path)
    rows = record.candidates
    assert [(row.cell, row.hidden) for row in rows] == [
        *[("linear", 0)] * 7,
        *[("gru", units) for units in (4, 8, 12, 16)],
    ]
    (chosen,) = (row for row in rows if row.chosen)
    best = max(rows, key=lambda row: row.accuracy)
    certain = [row for row in rows if row.accuracy == best.accuracy]
    assert chosen.energy_touch_j <= min(row.energy_touch_j for row in certain)
    assert all(row.fits == "icebreaker" for row in rows)
    # recurrent ones had 6 updates
    assert chosen.cell == "linear" == record.config["network"]["cell"] and chosen.accuracy > 0.9
    assert chosen.scan_every == chosen.front_end.scan_every
    assert chosen.multiplies_touch == chosen.front_end.steps * 12 * 3
    assert chosen.front_end.feature_kinds == record.front_end.chosen.feature_kinds
    (split,) = record.cross_validation
    assert split.groups == ["person"] and split.integer_accuracy == pytest.approx(chosen.accuracy)
    assert record.front_end.chosen.rest == "none" and record.front_end.rivals
    assert record.baselines[0].groups == ["person"] and record.baselines[0].accuracy > 0.9
    assert any("network chosen among" in reason for reason in record.reasons)
    assert record.front_end.tie.endswith("a tie goes to the least energy")
    assert [doubt.text for doubt in record.doubts] == record.warnings
    # of known persons more is known than of new ones
    assert record.same_groups.integer_accuracy >= split.nested.integer_accuracy
    nested = split.nested
    assert sum(fold.recordings for fold in nested.per_fold) == 24
    assert all(fold.front_end.rest == "none" for fold in nested.per_fold)
    assert json.loads((tmp_path / "m/training.json").read_text()) == record.plain()
    assert quantise(tmp_path / "m").config.network.cell == "linear"


def test_a_configuration_stays_and_its_cell_can_be_chosen(gripped, quick, tmp_path):
    record = trained(gripped, CONFIG, tmp_path, cell="auto")
    assert record.config["windows"] == CONFIG.to_dict()["windows"]
    assert record.config["network"]["cell"] == "linear"
    assert record.front_end is None and len(record.candidates) >= 5
    assert record.cross_validation[0].nested.integer_accuracy > 0.9


def test_a_configuration_alone_gives_what_train_gives(gripped, quick, tmp_path):
    config = CONFIG.replace(hidden=4)
    record = trained(gripped, config, tmp_path)
    train.train(gripped, config, out=tmp_path / "b")
    alone, other = (FloatModel.load(tmp_path / name) for name in "mb")
    assert all((alone.arrays[name] == other.arrays[name]).all() for name in alone.arrays)
    assert alone.config == other.config and not record.cross_validation[0].searched
    assert record.cross_validation == cross_validate(gripped, config, [[]], (0,), folds=2)
    assert not {"candidates", "front_end"} & record.plain().keys()


@each_row("lives", [True, False])
def test_few_sessions_promise_less_of_a_new_one_than_of_those_that_are_known(
    quick, monkeypatch, tmp_path, lives
):
    """In each of three sessions the sensor sits elsewhere: three classes are told apart there, and one session
    tells little of the next. The choice inside folds runs in another process, or here if that
    process dies."""
    monkeypatch.setattr(choosing, "BESIDE", 0)
    if lives:
        monkeypatch.setattr(choosing, "judge", None)
    else:
        monkeypatch.setattr(choosing, "beside", lambda *_: nullcontext(Mock(side_effect=BrokenExecutor)))
    rng = np.random.default_rng(7)
    labels, session = np.tile(np.arange(3), 18), np.repeat(np.arange(3), 18)
    patterns = rng.normal(0, 40, (3, 5)) + rng.normal(0, 80, (3, 3, 5))
    samples = 1000 + patterns[session, labels][:, None] + rng.normal(0, 12, (54, 60, 5))
    recordings = Recordings.of(np.rint(samples), labels, sample_rate_hz=100, groups={"session": session})
    record = trained(recordings, None, tmp_path, folds=3, cell="linear")
    (split,) = record.cross_validation
    assert split.groups == ["session"] and len(split.nested.per_fold) == 3
    assert record.same_groups.integer_accuracy > 0.95
    assert split.nested.integer_accuracy < 0.85


def test_without_folds_nothing_is_compared_and_the_network_is_the_usual_one(gripped, quick, tmp_path):
    record = trained(gripped, None, tmp_path, folds=0)
    network = record.config["network"]
    assert (network["cell"], network["hidden"], record.cross_validation) == ("gru", 12, [])
    with refused("`cell` auto: needs cross-validation"):
        trained(gripped, None, tmp_path / "n", folds=0, cell="auto")


# ---------------------------------------------------------------------- folds that chose nothing
@pytest.mark.parametrize(
    "options",
    [
        SearchOptions(cell="linear"),
        *(
            pytest.param(options, marks=pytest.mark.slow)
            for options in (SearchOptions(cell="gru"), SearchOptions(open=True))
        ),
    ],
)
def test_no_label_of_a_fold_is_seen_by_what_is_chosen_for_it(gripped, quick, options):
    """Front end and network of a fold stay as they are when the fold's labels change."""

    def chosen(recordings):
        plan = configure(recordings, None, priced())
        settings = by_person(recordings, [0])
        return Searched(plan, settings, options).choose([np.setdiff1d(np.arange(len(recordings)), test)])

    test, *_ = split_folds(gripped, ["person"], 5, None)
    labels = gripped.labels.copy()
    labels[test] = (labels[test] + 1) % 3
    assert chosen(replace(gripped, labels=labels)) == chosen(gripped)


def test_inner_folds_keep_a_group_together_where_the_one_asked_for_has_one_value(gripped):
    part = gripped.subset(np.flatnonzero(gripped.groups["trial"] == gripped.groups["trial"][0]))
    folds, persons = inner_folds(part, ["trial"]), part.groups["person"]
    assert sorted(np.concatenate(folds)) == list(range(len(part)))
    assert len(folds) == 4 and all(len(set(persons[fold])) == 1 for fold in folds)
    alone = replace(part, groups={"trial": part.groups["trial"]})
    assert any(len(set(persons[fold])) > 1 for fold in inner_folds(alone, ["trial"]))


def test_a_fold_is_judged_by_what_was_chosen_without_it(gripped, quick, monkeypatch):
    """The candidate of each fold is trained on the rest and judged on the fold."""
    settings = by_person(gripped, [0, 1])
    judge = Mock(wraps=choosing.judge)
    monkeypatch.setattr(choosing, "judge", judge)
    plan = configure(gripped, CONFIG, priced())
    record = unseen(plan, settings, SearchOptions(cell="linear"), ["person"])
    learner, folds = judge.call_args.args[:2]
    assert isinstance(learner, Searched)
    for fold, test in zip(folds, 2 * split_folds(gripped, ["person"], 5, None), strict=True):
        assert (fold.test == test).all() and (fold.part == np.setdiff1d(np.arange(24), test)).all()
    assert record.seeds == [0, 1] and [fold.recordings for fold in record.per_fold] == [6] * 4
    assert [*record.range] == [f([fold.integer_accuracy for fold in record.per_fold]) for f in (min, max)]


def test_recordings_of_one_group_are_one_draw_and_a_fold_of_several_hides_the_worst(gripped, monkeypatch):
    """Of four persons one is right in every recording: a mean of four draws of 1, 0, 0 and 0."""
    right = (gripped.groups["person"] == gripped.groups["person"][0]).astype(float)
    monkeypatch.setattr(splitting, "LEAST_ALONE", 6)  # recordings of a person
    splits: list[list[str]] = [["person"], [], ["label", "person"]]
    of_persons, single, of_both = (over_groups(gripped, groups, [right >= 0], right) for groups in splits)
    alone = right.std(ddof=1) / np.sqrt(len(right))
    assert (of_persons["standard_error"], single["standard_error"]) == pytest.approx((0.25, alone))
    assert of_both["standard_error"] > alone
    ranges = [(each["range"], each["range_of"]) for each in (of_persons, single, of_both)]
    assert ranges == [([0, 1], "4 groups"), ([0.25, 0.25], "1 folds"), ([0.25, 0.25], "1 folds")]
