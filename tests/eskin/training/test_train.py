"""eskin/training/train.py: determinism, splits, learning, the record; and the accuracy on the real
recordings (slow in full)."""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
import torch

from eskin.data import load_recordings
from eskin.golden.core import FEATURE_KINDS, PRESETS
from eskin.golden.model import FloatModel, IntegerModel, network_formats, normalise, real_features, run
from eskin.training import batches as batching
from eskin.training import datasets
from eskin.training import fit as fitting
from eskin.training import judge as judging
from eskin.training import recipe as recipes
from eskin.training.formats import with_network
from eskin.training.judge import NetworkLearner, cross_validate, folds_of, judge
from eskin.training.quantise import IntegerNetwork, profile
from eskin.training.recipe import RECIPES
from eskin.training.splits import default_splits, split_folds
from eskin.training.train import train
from tests.golden.model.test_cells import CELLS
from tests.support.table import each_row, refused
from tests.support.touch_scenes import SMALL, scene

QUICK = replace(RECIPES["onset"], updates=200)


def few(updates: int, recipe=QUICK, **changes):
    """The recipe with so many updates."""
    return replace(recipe, updates=updates, **changes)


def touches_of(recordings, config=SMALL, recipe=QUICK):
    """(data set, its rows)."""
    data = datasets.find_dataset(recordings, config, recipe)
    return data, datasets.touch_rows(data, np.arange(len(recordings)))


def fit(data, parts, recipe, config=SMALL, told=lambda *_: None):
    return fitting.fit_networks(data, config, recipe, parts, 0, told)


# ---------------------------------------------------------------------- learning and repeating


def test_the_seed_alone_decides_and_torch_is_left_as_it_was(tmp_path, quick):
    """Not what torch drew before; and folds of one seed give one cross-validation."""
    recordings, threads, state = scene(30, seed=4), torch.get_num_threads(), torch.get_rng_state()
    first, second = (cross_validate(recordings, SMALL, [[]], (5,), folds=2) for _ in range(2))
    for name, seed in (("a", 5), ("b", 5), ("c", 6)):
        train(recordings, SMALL, seed=seed, out=tmp_path / name)
    a, b, c = (FloatModel.load(tmp_path / name).arrays for name in "abc")
    assert all((a[name] == b[name]).all() for name in a)
    assert any((a[name] != c[name]).any() for name in a)
    assert first == second and len(first)
    assert torch.get_num_threads() == threads and (torch.get_rng_state() == state).all()


# ---------------------------------------------------------------------- quantisation-aware
WIDTHS = [
    {"weight_bits": 8},
    {"weight_bits": 4, "state_bits": 12, "gate_bits": 8, "table_entries": 128},
    {"weight_bits": 2, "state_bits": 12, "feature_bits": 8, "table_entries": 64},
    {"weight_bits": 3, "state_bits": 16, "gate_bits": 14, "feature_bits": 6},
]


@each_row("cell, reset, widths", [(*CELLS[number % 3], widths) for number, widths in enumerate(WIDTHS)])
def test_the_forward_pass_of_a_training_step_is_the_integer_model(monkeypatch, cell, reset, widths):
    """Every batch of a fine-tuning run: features, then logits, against numpy and IntegerModel.forward of what
    is exported then."""
    config = with_network(SMALL, cell=cell, reset=reset)
    forward, seen = IntegerNetwork.forward, []

    def checked(network, codes):
        logits = forward(network, codes)
        for model, code, logit in zip(network.export(), codes, logits.detach(), strict=True):
            _, exact = model.forward(code.numpy().astype(np.int64))
            np.testing.assert_array_equal(model.config.formats.logit_format.quantise(logit.numpy()), exact)
            np.testing.assert_array_equal(model.config.formats.logit_format.to_real(exact), logit.numpy())
            seen.append({name: array.copy() for name, array in model.arrays.items()})
        return logits

    monkeypatch.setattr(IntegerNetwork, "forward", checked)
    monkeypatch.setattr(fitting, "FINE_TUNING_UPDATES", 6)
    monkeypatch.setattr(fitting, "FINE_TUNING_RATE", 0.1)
    recipe = replace(RECIPES["onset"], updates=10, batch=16)
    data, part = touches_of(scene(30, seed=4), config, recipe)
    parts = [part[::2], part[1::2]]
    fitting.fine_tune(data, recipe, parts, fit(data, parts, recipe, config), 0, widths, lambda *_: None)
    assert len(seen) == 12
    assert any(
        (seen[0][name] != seen[-1][name]).any()
        for name in ("W_" + config.gates[0], "U_" + config.gates[-1], "V")
    )


@each_row(
    "config",
    [
        SMALL,
        SMALL.replace(feature_kinds=FEATURE_KINDS, activity_block=2, integral_knee=4, feature_scale="taxel"),
    ],
)
def test_training_features_are_those_of_integers(config):
    data, part = touches_of(scene(30, seed=4), config)
    models = fit(data, [part, part[::2]], few(2), config)
    starts = [fitting.post_training(model, data, part, {}) for model in models]
    network = IntegerNetwork(models, [starts[0], IntegerModel(starts[0].config, starts[1].arrays)])
    began = network.export()[0].arrays
    assert all((began[name] == array).all() for name, array in starts[0].arrays.items()), "its own weights"
    real = np.stack([model.features(real_features(config, data.touches.sums)) for model in models])
    codes = network.feature_codes(torch.tensor(real)).numpy()
    done = data.touches.completed == config.windows.steps
    for model, start, code in zip(models, starts, codes, strict=True):
        exact = normalise(
            starts[0].config,
            data.touches.sums,
            data.touches.completed,
            start.arrays["mean"],
            start.arrays["scale"],
        )
        np.testing.assert_array_equal(code[done], exact[done])
        assert np.ptp(exact) > 100 and (model.arrays["sigma"] > (1 if config is SMALL else 0.5)).all()


@pytest.mark.slow
def test_quantisation_aware_training_wins_back_what_few_bits_lose(monkeypatch):
    monkeypatch.setattr(fitting, "FINE_TUNING_UPDATES", 80)
    recordings, few_bits = scene(60, seed=1), {"weight_bits": 2}
    data, _ = touches_of(recordings)
    tests = split_folds(recordings, ["person"], 2, None)
    parts = [datasets.touch_rows(data, np.setdiff1d(np.arange(60), test)) for test in tests]
    models = fit(data, parts, QUICK)

    def accuracy(integers) -> float:
        of_fold = (run(one, recordings.subset(test)) for one, test in zip(integers, tests, strict=True))
        right = [trace.accuracy(recordings.labels[test]) for trace, test in zip(of_fold, tests, strict=True)]
        return float(np.mean(right))

    rounded = [fitting.post_training(*each, few_bits) for each in zip(models, [data] * 2, parts, strict=True)]
    tuned = fitting.fine_tune(data, QUICK, parts, models, 0, few_bits, lambda *_: None)
    assert accuracy(tuned) > accuracy(rounded) + 0.05


def test_weights_trained_as_integers_stay_within_their_formats():
    """A loss that draws every weight upwards ends at the largest value of each format."""
    data, part = touches_of(scene(20, seed=4))
    with refused("fields onset_threshold and window: a training part has no touch"):
        fit(data, [part[:0]], QUICK)
    (model,) = fit(data, [part], few(5))
    start = fitting.post_training(model, data, part, {"weight_bits": 4})

    def batches_of(config, members):
        return batching.Batches(data, config, QUICK, [part], torch.Generator().manual_seed(0))

    def loss_of(network):
        return lambda *_: -sum(weight.flatten(1).sum(1) for weight in network.weights.values())

    ((_, weights),) = fitting.train_integers([model], [start], batches_of, loss_of, 60, 1.0, lambda *_: None)
    for name, fmt in network_formats(start.config).items():
        assert weights[name].min() == weights[name].max() == fmt.to_real(fmt.max_code)


# ---------------------------------------------------------------------- splits
def test_no_group_is_on_both_sides(monkeypatch):
    """What is trained on, profiled and judged, as cross_validate really uses them."""
    recordings, noted = scene(60, seed=5), {}
    for name in ("fit_networks", "post_training"):
        noted[name] = Mock(wraps=getattr(judging, name))
        monkeypatch.setattr(judging, name, noted[name])
    judged = []

    def decide(network, rows, decide=judging.FittedNetwork.decide):
        judged.append(set(rows))
        return decide(network, rows)

    monkeypatch.setattr(judging.FittedNetwork, "decide", decide)
    results = cross_validate(recordings, SMALL, [["person"], []], (0, 1), recipe=few(1))
    data, _, _, parts, *_ = noted["fit_networks"].call_args.args
    profiled = [call.args[2] for call in noted["post_training"].call_args_list]
    assert noted["fit_networks"].call_count == 1 and [r.folds for r in results] == [5, 5]
    assert len(parts) == len(profiled) == len(judged) == 2 * (5 + 5)
    person, everyone = recordings.groups["person"], set(range(60))
    for number, (rows, test) in enumerate(zip(parts, judged, strict=True)):
        part = set(data.touches.recording[rows])
        assert part == set(data.touches.recording[profiled[number]]) and not part & test
        assert part | test >= everyone - {0}  # all but the recording without a touch
        assert number >= 5 or not {person[i] for i in part} & {person[i] for i in test}
    for first in (0, 10):
        assert sorted(i for test in judged[first : first + 5] for i in test) == sorted(everyone)


def test_default_splits_are_those_the_recordings_can_make():
    recordings = scene(30, seed=8)
    assert default_splits(recordings, SMALL) == [[]]
    assert default_splits(recordings, PRESETS["synthetic"]) == [["person"]]
    assert default_splits(recordings, PRESETS["pvdf"]) == [[]]
    some = replace(recordings, groups={"trial": recordings.labels, "seq": recordings.labels})
    assert default_splits(some, PRESETS["pvdf"]) == [["trial"], ["seq"]]


def drawn(config=SMALL, **changes) -> tuple[np.ndarray, tuple[float, float]]:
    """Features of one touch, drawn 400 times and changed as a recipe says, and their scale."""
    recipe = recipes.Recipe(name="plain", batch=400, **changes)
    data, part = touches_of(scene(30, seed=4), config, recipe)
    batches = batching.Batches(data, config, recipe, [part[:1]], torch.Generator().manual_seed(1))
    return batches.draw()[0][0].numpy(), batches.scales[0]


def test_a_lost_taxel_is_masked_or_rests_for_the_whole_touch():
    same, (lost, (mu, sigma)) = drawn()[0], drawn(channel_dropout=0.4)
    masked, at_rest = (
        (lost == level).all(axis=1) for level in (0, np.float32(-mu / sigma))
    )  # (touches, taxels)
    assert np.array_equal(lost == same, np.broadcast_to(~(masked | at_rest)[:, None], same.shape))
    assert 0.16 < masked.mean() < 0.24 and 0.16 < at_rest.mean() < 0.24
    assert np.corrcoef(masked.T)[0, 1:].max() < 0.3


@each_row("kind", ["mean", "highest"])
def test_offsets_move_one_taxel_and_all_and_drift(kind):
    config = SMALL.replace(feature_kinds=(kind,))
    same, moved = drawn(config)[0], drawn(config, offset=1.0)[0]
    moves = moved - same  # in deviations of the only kind of feature
    of_all = np.median(moves, axis=2)
    assert np.isclose(np.diff(of_all, axis=1).std(), batching.DRIFT / same.shape[1], rtol=0.1)
    assert np.isclose(of_all[:, 0].std(), batching.COMMON, rtol=0.1)
    own = np.abs(moves - of_all[..., None]).max(axis=1)
    assert ((own > 1e-4).sum(axis=1) <= 1).all() and np.isclose(
        np.sqrt((own**2).sum(axis=1).mean()), batching.OFFSET, rtol=0.1
    )


@each_row("kind, limits", [("mean", [-100, 100]), ("lowest", [-100, 0])])
def test_a_taxel_that_fails_in_training_sticks_and_is_masked_three_windows_later(kind, limits):
    config = SMALL.replace(clip=100, feature_kinds=(kind,))
    (same, (mu, sigma)), (failing, _) = drawn(config), drawn(config, taxel_failure=0.3)
    limits = (np.array(limits) - mu) / sigma
    changed = (failing != same).any(axis=1)  # (touches, taxels)
    assert 0.22 < changed.mean() < 0.34
    lengths = set()
    for touch, taxel in np.argwhere(changed):
        course = failing[touch, :, taxel]
        moved = course != same[touch, :, taxel]
        at_limit = moved & np.isclose(course[:, None], limits, rtol=1e-4).any(axis=1)
        first = int(np.flatnonzero(moved)[0])
        assert not course[first + 3 :].any() and at_limit.sum() <= 3
        assert course[moved].max() <= max(limits.max(), 0.0) + 1e-3
        lengths.add(int(at_limit[first + 1 : first + 3].sum()))
    assert 2 in lengths and np.all(np.isclose(failing, same) | changed[:, None])


# ---------------------------------------------------------------------- real recordings


@pytest.mark.slow
@pytest.mark.parametrize(
    "name, shares, agreement",
    [("pvdf_indent", {"trial": 0.99, "speed": 0.97, "seq": 0.70}, 0.995), ("fabric_slide", {"": 0.94}, 0.99)],
)
def test_accuracy_on_real_recordings(shared_data, name, shares, agreement):
    recordings, config = load_recordings(shared_data / name / "recordings.npz"), PRESETS[name.split("_")[0]]
    splits = [[group] for group in shares if group] or default_splits(recordings, config)
    results = cross_validate(recordings, config, splits, (0, 1, 2))
    for result, share in zip(results, shares.values(), strict=True):
        assert result.integer_accuracy >= share and result.agreement >= agreement


# ---------------------------------------------------------------------- the fault detector's masks
DETECTING = SMALL.replace(fault_frames=16, fault_activity=17)


def test_folds_judge_as_the_pipeline_runs_with_a_fault_detector():
    """Decisions, float and integer, of every fold: those of eskin.golden.model.pipeline on the same
    recordings."""
    recordings = scene(40, seed=3)
    folds = split_folds(recordings, ["person"], 5, None)
    learner = NetworkLearner(datasets.Datasets(recordings), DETECTING, few(15))
    every = folds_of(folds, [0], np.arange(len(recordings)))
    trained = [network for _, network in judge(learner, every, recordings.labels).fitted]
    faults = learner.data.touches.faults
    assert faults.any() and not faults.all()
    for network, test in zip(trained, folds, strict=True):
        judged = network.decide(test)
        for trace, decision, local in (
            (run(network.integer, recordings), judged.integer, judged.local_integer),
            (run(network.real, recordings), judged.real, judged.local_real),
        ):
            np.testing.assert_array_equal(decision, trace.decision[test])
            np.testing.assert_array_equal(local, trace.first_local()[test])
    (record,) = cross_validate(recordings, DETECTING, [["person"]], (0,), recipe=few(15))
    for fold, network, test in zip(record.per_fold, trained, folds, strict=True):
        own = run(network.integer, recordings.subset(test)).accuracy(recordings.labels[test])
        assert fold.integer_accuracy == pytest.approx(own)


def test_networks_are_trained_and_profiled_on_what_the_fault_detector_leaves():
    plain = recipes.Recipe(name="plain", batch=400, warp=1.5)
    data, part = touches_of(scene(40, seed=3), DETECTING, plain)
    faults = data.touches.faults
    row = next(row for row in part if 0 < faults[row].any(axis=0).sum() < 4)
    batches = batching.Batches(data, DETECTING, plain, [part[part == row]], torch.Generator().manual_seed(1))
    features, _, counts = (value[0].numpy() for value in batches.draw())
    failed, whole = faults[row].any(axis=0), faults[row].all(axis=0)
    assert (features[..., failed][:, -1] == 0).any() and (features[..., whole] == 0).all()
    assert (features[..., ~failed][counts] != 0).all()
    # mean and deviation, and the ranges, do not know what a masked taxel reads
    loud = replace(
        data,
        means=np.where(data.faults, 1e6, data.means),
        touches=replace(data.touches, sums=np.where(faults, 10**9, data.touches.sums)),
    )
    (one,), (other,) = (fit(given, [part], few(3, plain), DETECTING) for given in (data, loud))
    assert profile(one, data.touches) == profile(other, loud.touches)
    assert all((one.arrays[name] == other.arrays[name]).all() for name in one.arrays)
    with refused("field fault_activity: is 17.*masks every taxel"):
        datasets.scaling(
            DETECTING,
            data.means[part, : SMALL.windows.steps],
            data.touches.completed[part],
            np.ones_like(faults[part]),
        )
