"""eskin/training/widths.py: the narrowest widths that keep an error on recordings left out, and what is
refused."""

import dataclasses

import numpy as np
import pytest

from eskin.golden.core import InputError
from eskin.golden.model import (
    FloatModel,
    IntegerModel,
    decide_touches,
    find_touches,
    load_training,
    logit_error,
    stage_errors,
    with_network,
)
from eskin.training import recipe as recipes
from eskin.training.evaluate import evaluate
from eskin.training.quantise import COVERED_FEATURE, profile
from eskin.training.recipe import RECIPES
from eskin.training.train import TrainingRequest, train
from eskin.training.widths import (
    TABLES,
    WEIGHTS,
    choose_widths,
    feature_headroom,
    fold_cases,
    integers_of,
    quantise_by_error,
    with_headroom,
)
from tests.support.table import each_row
from tests.support.touch_scenes import SMALL, scene

QUICK = dataclasses.replace(RECIPES["onset"], updates=120)
E = 0.3
RESERVE = 0.5
"""Share of E that is asked for where E is judged on further recordings: the largest of more recordings is
larger."""


@pytest.fixture(scope="module")
def cases():
    return fold_cases(scene(60, seed=3), SMALL, [["person"]], recipe=QUICK)


def test_a_case_has_not_seen_what_is_left_out_of_it(cases):
    assert len(cases) == 5
    for case in cases:
        assert len(case.seen)
        assert len(case.left_out)
        assert not set(case.seen.recording) & set(case.left_out.recording)
    # 0 is never touched
    assert set(np.concatenate([case.left_out.recording for case in cases])) == set(range(1, 60))


def test_the_first_widths_that_keep_the_limit_are_chosen_and_narrower_ones_break_it(cases):
    headroom = feature_headroom(cases)
    chosen, tried = choose_widths(cases, E)
    assert tried[-1] is chosen
    assert chosen.max <= E
    assert all(rung.max > E for rung in tried[:-1])
    assert len(tried) > 1
    assert [(rung.weight_bits, rung.table_entries) for rung in tried] == [
        (w, t) for w in WEIGHTS for t in TABLES
    ][: len(tried)]
    errors = [
        logit_error(stage_errors(case.model, integers_of(case, headroom, **chosen.widths), case.left_out))[
            "max"
        ]
        for case in cases
    ]
    assert chosen.max == pytest.approx(max(errors))


def test_features_left_out_do_not_saturate_and_the_headroom_is_theirs(cases):
    case = cases[0]
    large = dataclasses.replace(
        case, left_out=dataclasses.replace(case.left_out, sums=4 * case.left_out.sums)
    )
    assert feature_headroom([case]) < 1.5 and feature_headroom([large]) > 2.5
    ranges = with_headroom(profile(case.model, case.seen), feature_headroom([large]))
    assert ranges[COVERED_FEATURE] == ranges["feature"]
    for headroom, saturates in ((1.0, True), (feature_headroom([large]), False)):
        integer = integers_of(large, headroom, weight_bits=8, feature_bits=16)
        features = stage_errors(large.model, integer, large.left_out)[0]
        assert (features.saturated > 0) == saturates, headroom


def test_an_error_that_no_width_keeps_is_refused_with_the_best_there_is(cases):
    with pytest.raises(
        InputError,
        match=r"field logit_error: 1e-05 cannot be met .* the best is 0\.\d+, with weights of 1\d bits .*: "
        r"ask for",
    ):
        choose_widths(cases[:1], 1e-5)
    dsp = [dataclasses.replace(cases[0], model=FloatModel(SMALL.with_lanes(4, "dsp"), cases[0].model.arrays))]
    with pytest.raises(
        InputError,
        match="wider weights are refused: .*field lane_type: is 'dsp', whose accumulator has 32 bits",
    ):
        choose_widths(dsp, 1e-5)


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A model folder, the recordings it was trained on, and others that neither training nor the choice of
    widths has seen."""
    folder, patch = tmp_path_factory.mktemp("widths") / "model", pytest.MonkeyPatch()
    patch.setattr(
        recipes,
        "RECIPES",
        {name: dataclasses.replace(recipe, updates=120) for name, recipe in RECIPES.items()},
    )
    recordings = scene(60, seed=5)
    train(recordings, SMALL, TrainingRequest(folds=0), out=folder)
    patch.undo()
    return folder, recordings, scene(60, seed=77)


def test_the_folders_integers_keep_the_error_on_recordings_that_nobody_saw(trained):
    folder, recordings, fresh = trained
    _, summary = quantise_by_error(folder, recordings, RESERVE * E, group=["person"])
    assert summary["max"] <= RESERVE * E
    assert summary["cases"] == 5
    assert load_training(folder)["logit_error"] == summary
    judged = evaluate(folder, fresh)
    assert 0 < judged["logit_error"]["mean"] < judged["logit_error"]["max"] <= E
    rough, _ = quantise_by_error(folder, recordings, 40 * E, group=["person"])
    assert rough.config.weight_bits < summary["weight_bits"]
    assert evaluate(folder, fresh)["logit_error"]["max"] > E


def test_a_network_trained_elsewhere_stands_for_itself(trained, tmp_path):
    folder, recordings, _ = trained
    model = FloatModel.load(folder)
    model.save(tmp_path / "model", {"config": model.config.to_dict(), "imported": {}})
    integer, summary = quantise_by_error(tmp_path / "model", recordings, 1.0)
    assert summary["max"] <= 1.0 and IntegerModel.load(tmp_path / "model").config == integer.config
    errors_of = stage_errors(model, integer, find_touches(SMALL, recordings))
    assert logit_error(errors_of)["max"] <= 1.5


def test_a_linear_cell_has_neither_gates_nor_states_and_its_widths_are_chosen_too():
    config = with_network(SMALL, cell="linear")
    cases = fold_cases(scene(30, seed=3), config, [["person"]])
    chosen, tried = choose_widths(cases, E)
    assert chosen.max <= E and {rung.table_entries for rung in tried} == {TABLES[0]}
    assert [rung.stage for rung in chosen.stages] == ["features", "accumulators", "logits"]
    for case in cases:
        integer = integers_of(case, feature_headroom(cases), **chosen.widths)
        done = np.arange(SMALL.windows.steps) < case.left_out.completed[:, None]
        ideal, exact = decide_touches(case.model, case.left_out), decide_touches(integer, case.left_out)
        error = np.abs(integer.config.formats.logit_format.to_real(exact.logits) - ideal.logits)[done]
        errors_of = {rung.stage: rung for rung in stage_errors(case.model, integer, case.left_out)}
        assert errors_of["logits"].mean == pytest.approx(error.mean()) and errors_of[
            "logits"
        ].max == pytest.approx(error.max())
        assert 0 < errors_of["accumulators"].max < errors_of["logits"].max + 1 / 512
        assert 0 < errors_of["accumulators"].used < 1


@each_row("limit", [0.0, -1.0, float("nan"), float("inf")])
def test_a_limit_that_is_none_is_refused(tmp_path, limit):
    with pytest.raises(InputError, match="field logit_error: is .*; give the largest difference"):
        quantise_by_error(tmp_path, scene(10), limit)
