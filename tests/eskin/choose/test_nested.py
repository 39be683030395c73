"""Figures of folds that chose nothing: no label of a fold is seen by what is chosen for it, and noise stays
at chance."""

import dataclasses

import numpy as np
import pytest

from eskin.choose import nested as nesting
from eskin.choose.choice_table import unseen
from eskin.choose.choose_front_end import TRIED_RECURRENT, Field, configure, field_of, inner_folds
from eskin.choose.choose_network import train_chosen
from eskin.choose.nested import SHUFFLES, Nested, fixed_network, shuffles
from eskin.golden.core import InputError
from eskin.golden.data import Recordings
from eskin.golden.model import with_network
from eskin.training.crossval import Terms
from eskin.training.datasets import Datasets
from eskin.training.splits import split_folds
from tests.support.gripped_scene import gripped_recordings
from tests.support.prices import priced


@pytest.fixture(scope="module")
def gripped() -> tuple[Recordings, Field]:
    made = gripped_recordings(persons=4, trials=2, rows=3, columns=4, classes=3)
    return made, field_of(made)


def nested_of(recordings: Recordings, field: Field, *cells: str) -> Nested:
    networks = [fixed_network(lambda on, cell=cell: with_network(on, cell=cell), "default") for cell in cells]
    terms = Terms(recordings=recordings, groups=["person"], datasets=Datasets(recordings), seeds=[0])
    return Nested(terms, field, networks, priced())


@pytest.mark.parametrize(
    "cells",
    [("linear",), *(pytest.param(cells, marks=pytest.mark.slow) for cells in (("gru",), ("linear", "gru")))],
)
def test_no_label_of_a_fold_is_seen_by_what_is_chosen_for_it(gripped, quick, monkeypatch, cells):
    """Front end, network and training part of every fold stay as they are when the fold's labels change."""
    monkeypatch.setattr(nesting, "FEW", 0)
    recordings, field = gripped
    trained: list = []

    def decided(self, pieces):
        trained.append([(piece.config, piece.recipe, piece.train.tolist()) for piece in pieces])
        return judge_pieces(self, pieces)

    judge_pieces = Nested._decided
    monkeypatch.setattr(Nested, "_decided", decided)
    nested_of(recordings, field, *cells).record(["person"])
    before = trained[-1]
    for fold, test in list(enumerate(split_folds(recordings, ["person"], 5, None)))[:2]:
        labels = recordings.labels.copy()
        labels[test] = (labels[test] + 1) % 3
        other = dataclasses.replace(recordings, labels=labels)
        trained.clear()
        nested_of(other, dataclasses.replace(field, recordings=other.subset(field.numbers)), *cells).record(
            ["person"]
        )
        assert trained[-1][fold] == before[fold] and not set(before[fold][2]) & set(test.tolist())


def test_inside_folds_a_recurrent_network_stands_on_the_front_ends_of_the_choice(gripped):
    recordings, field = gripped
    part = np.arange(len(field.numbers))[4:]
    luck = np.random.default_rng(0).permuted(field.recordings.labels)[None]
    judged = field.judged(part, ["person"], luck)[0]
    tried = nested_of(recordings, field, "linear", "gru")._tried(judged)
    recurrent = [config for config, _ in tried if config.recurrent]
    gates = {(config.rest_level.rest, config.onset_rule.onset) for config in recurrent}
    assert 1 < len(recurrent) <= TRIED_RECURRENT and len(gates) > 1
    assert not tried[0][0].recurrent
    asked = nested_of(recordings, field, "gru")._tried(judged)
    assert asked == tried[-len(recurrent) :]
    assert len(nested_of(recordings, field, "linear")._tried(judged)) == 1


def test_inner_folds_keep_a_group_together_where_the_one_asked_for_has_one_value(gripped):
    recordings, _ = gripped
    part = recordings.subset(np.flatnonzero(recordings.groups["trial"] == recordings.groups["trial"][0]))
    folds, persons = inner_folds(part, ["trial"]), part.groups["person"]
    assert sorted(np.concatenate(folds)) == list(range(len(part)))
    assert len(folds) == 4 and all(len(set(persons[fold])) == 1 for fold in folds)
    alone = dataclasses.replace(part, groups={"trial": part.groups["trial"]})
    assert any(len(set(persons[fold])) > 1 for fold in inner_folds(alone, ["trial"]))


def test_of_two_fits_of_one_linear_network_inner_folds_decide(gripped, quick, monkeypatch):
    monkeypatch.setattr(nesting, "FEW", 0)
    recordings, field = gripped
    linear = lambda on: with_network(on, cell="linear")
    weightless = fixed_network(linear, "default", penalty=1e-12)
    squares = fixed_network(linear, "default", squares=True, name="squares")
    nested = nested_of(recordings, field, "gru")
    nested = dataclasses.replace(nested, networks=[weightless, squares, *nested.networks])
    taken = {fold["network"] for fold in nested.record(["person"])["per_fold"]}
    assert taken == {"linear (squares)"}


@pytest.mark.slow
def test_noise_stays_at_chance_and_what_was_chosen_on_it_does_not(tmp_path):
    rng = np.random.default_rng(5)
    samples = rng.integers(1990, 2010, (60 * 200, 8)).astype(np.int32)
    noise = Recordings(
        samples,
        np.arange(0, 12001, 200),
        np.arange(60) % 2,
        ("a", "b"),
        1000.0,
        {"person": np.arange(60) % 5},
    )
    record = train_chosen(noise, None, priced(), out=tmp_path / "m", cell="linear")
    (split,) = record["cross_validation"]
    nested, chosen = split["nested"], record["front_end"]["chosen"]["accuracy"]
    assert chosen > 0.65 and split["integer_accuracy"] > 0.6 and nested["integer_accuracy"] < 0.6
    assert {
        "groups",
        "folds",
        "seeds",
        "float_accuracy",
        "agreement",
        "standard_error",
        "per_fold",
        "wall_s",
    } <= set(nested)
    assert sum(fold["recordings"] for fold in nested["per_fold"]) == 60 and all(
        fold["network"] == "linear" for fold in nested["per_fold"]
    )
    shuffled = nested["shuffled"]
    assert shuffled["count"] == SHUFFLES and abs(shuffled["mean"] - 0.5) < 0.07 and shuffled["largest"] < 0.9
    assert shuffled["as_good"] > 0.05 and any(
        "that may be luck" in sentence for sentence in record["warnings"]
    )
    assert any("on the folds it was chosen on" in sentence for sentence in record["warnings"])


def test_where_nothing_is_chosen_the_figure_is_as_it_was(gripped, quick, tmp_path):
    recordings, _ = gripped
    asked = with_network(configure(recordings, None, priced()).config, cell="linear")
    (split,) = train_chosen(
        recordings, asked, priced(), out=tmp_path / "m", group=["person"], folds=2, seeds=1
    )["cross_validation"]
    assert "nested" not in split


def test_without_a_figure_the_choice_is_not_called_unseen(gripped, quick, monkeypatch, tmp_path):
    def failing(self, split):
        raise InputError("no room")

    monkeypatch.setattr(Nested, "record", failing)
    record = train_chosen(gripped[0], None, priced(), out=tmp_path / "m", cell="linear", folds=2, seeds=1)
    (split,) = record["cross_validation"]
    assert split["nested"] is None and unseen(split) is split
    assert "leaving out person, there is no figure of folds that chose nothing: no room" in record["warnings"]


def test_labels_are_shuffled_within_groups_or_between_whole_ones():
    labels, person = np.arange(24) % 3, np.arange(24) // 6
    made = shuffles(labels, [person])
    assert (
        made.shape == (1 + SHUFFLES, 24)
        and (made[0] == labels).all()
        and (made[1:] != labels).any(axis=1).all()
    )
    for group in range(4):
        assert (np.sort(made[:, person == group], axis=1) == np.sort(labels[person == group])).all()
    of_session = np.repeat([0, 0, 1, 1], 6)  # each session is of one class
    made = shuffles(of_session, [person])
    assert all(len(np.unique(row[person == group])) == 1 for row in made for group in range(4))
    assert (np.sort(made[:, ::6], axis=1) == [0, 0, 1, 1]).all()
    assert nesting.shuffles(labels, []).shape == made.shape
