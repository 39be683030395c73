"""The smallest network that is enough: the rule, what it is chosen on, and what the command line fixes."""

import dataclasses
import json
from functools import partial

import numpy as np
import pytest

from eskin.choose import choose_network as choosing
from eskin.choose.choice_table import network_name
from eskin.choose.choose_front_end import cheapest, choose_front_end
from eskin.choose.choose_network import (
    Candidate,
    check_units,
    cross_validate_network,
    goes_on,
    network,
    splits_to_report,
    train_chosen,
)
from eskin.choose.cost import Cost
from eskin.golden.core import PRESETS, AcceleratorConfig, InputError
from eskin.golden.data import Recordings
from eskin.golden.model import FloatModel
from eskin.training import recipe as recipes
from eskin.training import train
from eskin.training.crossval import Terms
from eskin.training.datasets import Datasets
from eskin.training.quantise import quantise
from tests.support.gripped_scene import gripped_recordings
from tests.support.prices import priced
from tests.support.table import each_row

cheapest_network = partial(cheapest, priced=lambda config: config)

CONFIG = AcceleratorConfig.of(
    name="derived",
    taxels=12,
    sample_rate_hz=200.0,
    sample_bits=8,
    window_mode="free",
    pretrigger_frames=0,
    hop=16,
    window=32,
    steps=6,
    rest="none",
    rest_frames=0,
    onset="immediate",
    class_names=("object0", "object1", "object2"),
)


def candidate(cell: str, hidden: int | None, right: int, of: int = 100, recipe: str = "contact") -> Candidate:
    correct = np.zeros(of)
    correct[:right] = 1.0
    record = {"float_accuracy": right / of, "agreement": 1.0, "decision_time_s": 0.1, "seeds": [0]}
    made = dataclasses.replace(recipes.RECIPES["contact"], name=recipe)
    config = network(CONFIG, cell, hidden)
    return Candidate(config, made, correct, record, CONFIG, config)


@pytest.fixture(scope="module")
def gripped() -> Recordings:
    return gripped_recordings(persons=4, trials=2, rows=3, columns=4, classes=3)


def terms_of(recordings: Recordings) -> Terms:
    return Terms(recordings=recordings, groups=["person"], datasets=Datasets(recordings))


def test_what_integers_lose_names_its_stage_and_what_they_keep_none(gripped):
    config, lost = network(CONFIG, "linear", None), {"weight_bits": 2, "feature_bits": 12}
    for widths, stage in ((lost, "accumulators"), ({}, None)):
        terms = dataclasses.replace(terms_of(gripped), seeds=[0], widths=widths)
        judged = cross_validate_network(terms, config, recipes.choose_recipe(config))
        row = judged.row(True, priced())
        assert row["loses_in"] == stage and (row["float_accuracy"] - row["accuracy"] > 0.005) == bool(stage)


# ---------------------------------------------------------------------- the rule
def lost(cell: str, hidden: int | None, right: int, won: int, of: int = 100) -> Candidate:
    """``right`` in all; ``won`` that one which is right on the first 90 is not, and so many more lost."""
    made = candidate(cell, hidden, right, of)
    return dataclasses.replace(made, correct=np.roll(made.correct, 90 - right + won))


def test_the_cheapest_within_a_standard_error_of_the_paired_difference():
    """90 of 100 are right at best; what loses 3 and wins none is 1.7 standard errors behind, what loses 6 and
    wins 3 is one: 3 of sqrt(9)."""
    large, market = candidate("gru", 12, 90), priced()
    nested, won = candidate("gru", 4, 87), lost("gru", 4, 87, 3)
    assert large.standard_error == pytest.approx(np.sqrt(0.09 / 99))  # 3.0 points: unpaired, both would do
    assert cheapest_network([nested, large], market) is large
    assert cheapest_network([won, large], market) is won
    assert cheapest_network([candidate("gru", 4, 89), large], market).config.network.hidden == 4
    assert cheapest_network([lost("gru", 4, 86, 3), large], market) is large


def test_what_is_least_is_what_is_preferred_and_the_board_has_the_say():
    linear, small, large = candidate("linear", None, 90), candidate("gru", 4, 90), candidate("gru", 8, 90)
    rows = {
        linear.config: Cost(energy_touch_j=3.0, cells=30, latency_s=2.0, touch_s=1.0),
        small.config: Cost(energy_touch_j=1.0, cells=30, latency_s=3.0, touch_s=1.0),
        large.config: Cost(energy_touch_j=2.0, cells=20, latency_s=3.0, touch_s=0.5),
    }
    taken = {"energy": small, "cells": large, "latency": linear}
    for prefer, expected in taken.items():
        market = priced(cost_of=rows.__getitem__, prefer=prefer)
        assert cheapest_network([linear, small, large], market) is expected, prefer
    holds = priced(cost_of=rows.__getitem__, fits=lambda config: config == linear.config)
    assert cheapest_network([linear, small, large], holds) is linear
    nothing = priced(cost_of=rows.__getitem__, fits=lambda config: False)
    assert cheapest_network([linear, small, large], nothing) is small
    row = small.row(True, nothing)
    assert row["fits"] is None and (row["energy_touch_j"], row["cells"], row["latency_s"]) == (1.0, 30, 3.0)
    assert row["block_memories"] == 1 and row["chosen"] is True


def test_what_does_not_fit_a_named_board_is_not_judged(gripped, monkeypatch):
    def judged(terms, config, recipe, goes_on):
        return dataclasses.replace(candidate("linear", None, 90), config=config, recipe=recipe)

    monkeypatch.setattr(choosing, "cross_validate_network", judged)
    small = priced(named=True, fits=lambda config: not config.recurrent)
    rows = choosing.choose_network(terms_of(gripped), [CONFIG], small)[1]
    assert {row["cell"] for row in rows} == {"linear"} and all(row["fits"] for row in rows)
    with pytest.raises(InputError, match="no network of the candidates fits it and the board icebreaker"):
        choosing.choose_network(terms_of(gripped), [CONFIG], priced(named=True, fits=lambda config: False))


def test_a_dearer_front_end_is_tried_with_the_best_fit_and_not_behind_a_settled_one(gripped, monkeypatch):
    dear = CONFIG.replace(steps=8)
    for right, where in ((90, [CONFIG] * 3 + [dear]), (100, [CONFIG] * 3)):
        tried = []

        def judged(terms, config, recipe, goes_on, right=right, tried=tried):
            tried.append((config, recipe.name))
            return dataclasses.replace(candidate("linear", None, right), config=config, recipe=recipe)

        monkeypatch.setattr(choosing, "cross_validate_network", judged)
        monkeypatch.setattr(choosing, "GRU_UNITS", ())
        choosing.choose_network(terms_of(gripped), [CONFIG, dear], priced())
        assert [config.windows.steps for config, _ in tried] == [config.windows.steps for config in where]
        assert right == 100 or tried[-1][1] == tried[0][1]


def test_of_equal_cost_the_more_accurate_is_taken():
    plain, squares = (
        candidate("linear", None, 90, recipe="linear"),
        candidate("linear", None, 91, recipe="least squares"),
    )
    plain = dataclasses.replace(plain, correct=np.roll(squares.correct, 0) * (np.arange(100) > 2))
    market = priced()
    assert cheapest_network([plain, squares], market) is squares
    assert cheapest_network([squares, plain], market) is squares
    level = lost("linear", None, 90, 3)  # loses 4 recordings and wins 3
    level = dataclasses.replace(level, recipe=plain.recipe)
    assert cheapest_network([level, squares], market) is level
    assert cheapest_network([squares, level], market) is squares
    assert (
        network_name(squares.row(True, market)) == "linear (least squares)"
        and network_name(plain.row(False, market)) == "linear"
    )
    assert squares.multiplies_touch == 6 * 12 * 3 and candidate("gru", 8, 1).multiplies_touch == 6 * (
        3 * 8 * 20 + 16 + 24
    )


@each_row(
    ("right", "larger"),
    [
        ((95, 80, 85, 88), True),
        ((80, 80, 85, 90), True),
        ((80, 85, 88, 89), False),
        ((90, 80, 86, 88), False),
    ],
)
def test_gru_16_is_tried_where_12_is_not_level(right, larger):
    linear, *units = right
    assert (
        goes_on(
            [
                candidate("linear", None, linear),
                *(candidate("gru", 4 * (k + 1), n) for k, n in enumerate(units)),
            ]
        )
        is larger
    )


def test_a_linear_cell_decides_by_its_last_step_and_others_as_they_did():
    assert network(CONFIG, "linear", None).network.decision == "last"
    assert network(CONFIG, "gru", 8).network.decision == CONFIG.network.decision == "vote"


def test_units_of_a_cell_that_has_none_are_refused():
    for cell in ("auto", "linear"):
        with pytest.raises(InputError, match=f"--hidden 8: --cell {cell} takes no number of units"):
            check_units(cell, 8)
    check_units("gru", 8)
    check_units(None, 8)


def test_the_split_of_the_choice_is_reported_beside_those_of_the_sensor(gripped):
    assert splits_to_report(gripped, CONFIG, ["person"]) == [["person"]]
    count = len(gripped)
    pvdf = dataclasses.replace(
        gripped,
        samples=gripped.samples[:, :8] + 29000,
        sample_bits=16,
        sample_rate_hz=2000.0,
        groups={name: np.arange(count) % 4 for name in ("seq", "speed", "trial")},
    )
    derived = PRESETS["pvdf"].replace(name="derived")
    assert splits_to_report(pvdf, derived, ["seq"]) == [["trial"], ["speed"], ["seq"]]
    assert splits_to_report(pvdf, derived, []) == [["trial"], ["speed"], ["seq"], []]


def test_no_error_in_the_recordings_is_not_a_standard_error_of_nothing():
    """Laplace: n of n right is estimated as (n + 1) / (n + 2)."""
    share = 101 / 102
    assert choosing.least_error(100) == pytest.approx(np.sqrt(share * (1 - share) / 100))
    perfect, near, behind = (
        candidate("gru", 12, 1000, 1000),
        candidate("linear", None, 9995, 10000),
        candidate("linear", None, 998, 1000),
    )
    assert perfect.standard_error == choosing.least_error(1000) == pytest.approx(0.00099800, rel=1e-3)
    assert cheapest_network([perfect, behind], priced()) is perfect
    one = candidate("linear", None, 999, 1000)
    assert cheapest_network([perfect, one], priced()) is one  # one lost of so many is exactly one
    assert choosing.settled(near) is False and choosing.settled(perfect)


def test_what_cannot_be_taken_is_judged_with_one_seed(gripped, monkeypatch):
    """Far behind, or larger than one that no other can beat by a standard error."""

    def seeds_of(right: dict[tuple[str, int], int]) -> dict[tuple[str, int], int]:
        def judged(terms, config, recipe, goes_on):
            at = (config.network.cell, config.network.hidden if config.recurrent else 0)
            first = candidate(at[0], at[1] or None, right[at], 400)
            seeds = terms.seeds if goes_on(first) else [0]
            return dataclasses.replace(first, record=first.record | {"seeds": list(seeds)})

        monkeypatch.setattr(choosing, "cross_validate_network", judged)
        rows = choosing.choose_network(terms_of(gripped), [CONFIG], priced())[1]
        return {(row["cell"], row["hidden"]): row["seeds"] for row in rows}

    linear, four, eight, twelve, sixteen = ("linear", 0), ("gru", 4), ("gru", 8), ("gru", 12), ("gru", 16)
    for right, seeds in (
        ({linear: 400, four: 399, eight: 400, twelve: 400}, [3, 1, 1, 1]),
        ({linear: 380, four: 200, eight: 370, twelve: 388, sixteen: 388}, [3, 1, 3, 3, 3]),
        ({linear: 380, four: 200, eight: 250, twelve: 300, sixteen: 320}, [3, 1, 1, 1, 1]),
    ):
        assert seeds_of(right) == dict(zip(right, seeds, strict=True))


def test_a_linear_cell_is_fitted_to_touches_as_recorded_too_where_the_recipe_augments(gripped, monkeypatch):
    recipes = []

    def judged(terms, config, recipe, goes_on):
        recipes.append(recipe)
        return dataclasses.replace(candidate("linear", None, 98), recipe=recipe)

    monkeypatch.setattr(choosing, "cross_validate_network", judged)
    monkeypatch.setattr(choosing, "GRU_UNITS", ())
    choosing.choose_network(terms_of(gripped), [CONFIG], priced())
    assert [recipe.name for recipe in recipes] == ["linear", "weak penalty", "least squares"] and not any(
        recipe.augments for recipe in recipes
    )
    recipes.clear()
    touched = CONFIG.replace(
        onset="baseline",
        rest="tracked",
        rest_frames=13,
        onset_mean_frames=8,
        onset_check_frames=2,
        rearm_frames=32,
    )
    choosing.choose_network(terms_of(gripped), [touched], priced())
    assert [(recipe.squares, recipe.augments) for recipe in recipes] == [
        (False, True),
        (False, False),
        (False, False),
        (True, True),
        (True, False),
    ]
    assert [recipe.penalty for recipe in recipes] == [1.0, 1.0, choosing.WEAK_PENALTY, 1.0, 1.0]
    assert [recipe.name for recipe in recipes[1:3]] == ["not augmented", "not augmented, weak penalty"]


# ---------------------------------------------------------------------- training what was chosen
def test_everything_is_chosen_and_noted(gripped, quick, tmp_path):
    record = train_chosen(gripped, None, priced(), out=tmp_path / "m", folds=2, seeds=1)
    rows = record["candidates"]
    assert [(row["cell"], row["hidden"]) for row in rows][:6] == [
        *[("linear", 0)] * 3,
        ("gru", 4),
        ("gru", 8),
        ("gru", 12),
    ]
    (chosen,) = (row for row in rows if row["chosen"])
    best = max(rows, key=lambda row: row["accuracy"])
    certain = [row for row in rows if row["accuracy"] == best["accuracy"]]
    assert chosen["energy_touch_j"] <= min(row["energy_touch_j"] for row in certain)
    assert all(row["fits"] == "icebreaker" for row in rows)
    # recurrent ones had 6 updates
    assert chosen["cell"] == "linear" == record["config"]["network"]["cell"] and chosen["accuracy"] > 0.9
    assert [split["groups"] for split in record["cross_validation"]] == [["person"]]
    assert record["cross_validation"][0]["integer_accuracy"] == pytest.approx(chosen["accuracy"])
    assert record["front_end"]["chosen"]["rest"] == "none" and record["front_end"]["rivals"]
    assert record["baselines"][0]["groups"] == ["person"] and record["baselines"][0]["accuracy"] > 0.9
    assert any("network chosen among" in reason for reason in record["reasons"])
    assert json.loads((tmp_path / "m/training.json").read_text()) == record
    assert quantise(tmp_path / "m").config.network.cell == "linear"


def test_cell_and_units_fix_the_network_and_the_front_end_is_chosen(gripped, quick, tmp_path):
    record = train_chosen(gripped, None, priced(), out=tmp_path / "m", hidden=5, folds=2, seeds=1)
    assert "candidates" not in record and (
        record["config"]["network"]["cell"],
        record["config"]["network"]["hidden"],
    ) == ("gru", 5)
    assert record["front_end"]["chosen"]["rest"] == "none"
    assert any("try --cell auto" in sentence for sentence in record["warnings"])  # 6 updates teach it nothing


def test_steps_change_the_front_end_that_was_chosen(gripped, quick, tmp_path):
    record = train_chosen(gripped, None, priced(), out=tmp_path / "m", hidden=4, steps=3, folds=2, seeds=1)
    assert record["config"]["windows"]["steps"] == 3 != record["front_end"]["chosen"]["steps"]


def test_one_set_of_weights_for_all_windows_on_request(gripped, quick, tmp_path):
    record = train_chosen(
        gripped, CONFIG, priced(), out=tmp_path / "m", cell="linear", weight_sets="one", folds=2, seeds=1
    )
    assert record["config"]["network"]["weight_sets"] == "one" and record["parameters"] == 12 * 3 + 3
    assert FloatModel.load(tmp_path / "m").arrays["V"].shape == (1, 3, 12)
    for options in (dict(cell="gru"), dict(hidden=4), {}):  # CONFIG's own cell is a GRU
        with pytest.raises(InputError, match="--weight-sets one: only a linear cell has them"):
            train_chosen(
                gripped, CONFIG, priced(), out=tmp_path / "n", weight_sets="one", folds=2, seeds=1, **options
            )
    assert not (tmp_path / "n").exists()


def test_a_configuration_stays_and_its_cell_can_be_chosen(gripped, quick, tmp_path):
    record = train_chosen(gripped, CONFIG, priced(), out=tmp_path / "m", cell="auto", folds=2, seeds=1)
    assert (
        record["config"]["windows"] == CONFIG.to_dict()["windows"]
        and record["config"]["network"]["cell"] == "linear"
    )
    assert "front_end" not in record and len(record["candidates"]) >= 5


def test_a_configuration_alone_gives_what_train_gives(gripped, quick, tmp_path):
    config = CONFIG.replace(hidden=4)
    record = train_chosen(gripped, config, priced(), out=tmp_path / "a", folds=2, seeds=1)
    plain = train.train(gripped, config, train.TrainingRequest(folds=2, seeds=1), out=tmp_path / "b")
    alone, other = (FloatModel.load(tmp_path / name) for name in "ab")
    assert (
        all((alone.arrays[name] == other.arrays[name]).all() for name in alone.arrays)
        and alone.config == other.config
    )
    assert (
        record["cross_validation"] == plain["cross_validation"]
        and "candidates" not in record
        and "front_end" not in record
    )


def test_without_folds_nothing_is_compared_and_the_network_is_the_usual_one(gripped, quick, tmp_path):
    record = train_chosen(gripped, None, priced(), out=tmp_path / "m", folds=0)
    assert (
        record["config"]["network"]["cell"] == "gru"
        and record["config"]["network"]["hidden"] == 12
        and record["cross_validation"] == []
    )
    with pytest.raises(InputError, match="--cell auto: needs folds"):
        train_chosen(gripped, None, priced(), out=tmp_path / "n", cell="auto", folds=0)


def test_a_recurrent_network_may_stand_on_another_front_end(gripped, monkeypatch):
    """The linear classifier's choice stays unless a rival is better by more than a tie."""
    other = CONFIG.replace(rest="initial", rest_frames=13)
    right = {CONFIG: 60, other: 90}

    def judged(terms, config, recipe):
        judged = candidate("gru", 12, right[config])
        return dataclasses.replace(
            judged, config=config, correct=np.roll(judged.correct, 5 * (config == other))
        )

    monkeypatch.setattr(choosing, "cross_validate_network", judged)
    taken, rows = choosing.recurrent_front_end(terms_of(gripped), [CONFIG, other], priced())
    assert taken == other and [row["chosen"] for row in rows] == [False, True]
    right |= {CONFIG: 90, other: 91}  # 5 recordings are lost and 6 won
    assert choosing.recurrent_front_end(terms_of(gripped), [CONFIG, other], priced())[0] == CONFIG


def test_rivals_are_of_other_gates_and_the_record_follows_the_choice(gripped):
    front_end = choose_front_end(gripped, priced())
    for rival in front_end.rivals:
        assert (rival.rest_level.rest, rival.onset_rule.onset) != (
            front_end.config.rest_level.rest,
            front_end.config.onset_rule.onset,
        )
        moved = front_end.with_chosen(rival)
        assert moved.config == rival and moved.record["chosen"]["rest"] == rival.rest_level.rest
        assert (
            len(moved.record["rivals"]) == len(front_end.record["rivals"])
            and moved.record["chosen"] not in moved.record["rivals"]
        )
    assert front_end.with_chosen(front_end.config) is front_end
