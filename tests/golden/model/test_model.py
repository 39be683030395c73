"""golden/model/model.py: parameter counts, model folders, and words of refusals."""

import json
import os

import numpy as np
import torch

from eskin.golden.core import PRESETS
from eskin.golden.model import FloatModel, IntegerModel, load_config, normalise
from eskin.training.formats import normaliser_constants, with_network
from eskin.training.network import RecurrentClassifier
from eskin.training.record import training_of
from tests.support.folder import contents
from tests.support.random_models import random_float_model, random_integer_model
from tests.support.small_designs import TRACKED
from tests.support.table import each_row, refused
from tests.support.touch_scenes import SMALL

FLOAT = random_float_model(SMALL, 1)


# ---------------------------------------------------------------------- counts
@each_row(
    "network, count",
    [
        ({"hidden": 12}, 1083),
        ({"hidden": 10}, 843),
        ({"hidden": 12, "reset": "after"}, 1119),
        ({"hidden": 10, "cell": "lstm"}, 1113),
    ],
)
def test_parameter_counts_of_the_thesis(network, count):
    config = with_network(PRESETS["thesis"], **network)
    module = RecurrentClassifier(config, generator=torch.Generator())
    assert sum(weight.numel() for weight in module.parameters()) == count
    assert config.parameter_count == count
    arrays = random_float_model(config, 1).arrays
    assert sum(array.size for name, array in arrays.items() if name not in ("mu", "sigma")) == count


# ---------------------------------------------------------------------- folders
def test_both_networks_and_the_record_come_back_from_their_folder(tmp_path):
    folder, model = tmp_path / "model", random_integer_model(SMALL, 3)
    FLOAT.save(folder, {"seed": 4, "list": [1.5]})
    before = contents(folder)
    model.save(folder)
    after = contents(folder)
    assert {str(name) for name in after} == {"config.json", "float.npz", "training.json", "weights.npz"}
    assert all(after[name] == before[name] for name in before if str(name) != "config.json")
    assert json.loads((folder / "training.json").read_text()) == {"seed": 4, "list": [1.5]}
    back = IntegerModel.load(folder)
    assert back.config == model.config == load_config(folder)
    for name, array in model.arrays.items():
        np.testing.assert_array_equal(back.arrays[name], array)
    with np.load(folder / "weights.npz", allow_pickle=False) as archive:
        assert all(archive[name].dtype.kind == "i" for name in archive.files)
    FLOAT.save(folder, {})  # training anew drops the integers of the old network
    assert not (folder / "weights.npz").exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["model"]  # nothing temporary is left


@each_row("content", ["notes.txt", "model and notes"])
def test_a_folder_of_something_else_is_not_replaced(tmp_path, content):
    folder = tmp_path / "precious"
    if content == "model and notes":
        FLOAT.save(folder, {})
    else:
        folder.mkdir()
    (folder / "notes.txt").write_text("months of work")
    before = contents(tmp_path)
    with refused(r"precious.*notes\.txt.*name a new folder"):
        FLOAT.save(folder, {})
    assert contents(tmp_path) == before


# ---------------------------------------------------------------------- damaged and foreign models
def save_arrays(folder, change):
    random_integer_model(SMALL, 3).save(folder)
    with np.load(folder / "weights.npz") as archive:
        arrays = {name: archive[name] for name in archive.files}
    change(arrays)
    np.savez(folder / "weights.npz", **arrays)


@each_row(
    "change, words",
    [
        (
            lambda a: a.pop("U_r"),
            r"weights\.npz, array U_r: is missing.*use weights and config\.json of one model",
        ),
        (lambda a: a.update(W_q=a["W_z"]), r"weights\.npz, array W_q: is unknown"),
        (lambda a: a.update(W_z=a["W_z"].T), r"weights\.npz, array W_z: has shape \(4, 6\).*needs \(6, 4\)"),
        (lambda a: a.update(V=a["V"].astype(float)), r"weights\.npz, array V: holds float64, not integers"),
        (
            lambda a: a.update(b_y=a["b_y"] * 0 + 10**6),
            r"weights\.npz, array b_y: holds 1000000\.\.1000000, outside",
        ),
        (lambda a: a.update(scale=a["scale"] * 0), r"weights\.npz, array scale: holds 0\.\.0, outside 1"),
        (lambda a: a.update(W_n=a["W_n"].astype(object)), r"weights\.npz: is damaged"),
    ],
)
def test_damaged_weights_are_named(tmp_path, change, words):
    save_arrays(tmp_path / "model", change)
    before = contents(tmp_path)
    with refused(words):
        IntegerModel.load(tmp_path / "model")
    assert contents(tmp_path) == before


@each_row("name", ["config.json", "float.npz", "training.json", "weights.npz"])
def test_a_pipe_in_a_model_folder_is_refused(tmp_path, name):
    FLOAT.save(tmp_path / "m", {})
    random_integer_model(SMALL, 3).save(tmp_path / "m")
    (tmp_path / "m" / name).unlink()
    os.mkfifo(tmp_path / "m" / name)
    with refused(f"{name}: is not a regular file|has no {name}|cannot be read .is not a regular"):
        IntegerModel.load(tmp_path / "m"), FloatModel.load(tmp_path / "m"), training_of(tmp_path / "m")


# ---------------------------------------------------------------------- constants and random models
@each_row("config", [*PRESETS.values(), SMALL])
def test_normaliser_constants_give_the_feature(config):
    """Codes within 1 LSB of the real feature and, where bits are dropped, off by nothing on average; scales
    where centred resolves one to two bits more."""
    gate, fmt, steps = config.formats.gate_frac, config.formats.feature_format, config.windows.steps
    filled, mean, scale = normaliser_constants(config, 7.3, 80.0)
    for shift, code in zip(filled.features.feature_shift, scale, strict=True):
        assert 2 ** (gate - 2) <= code and (shift == 0 or code <= 2 ** (gate - 1))
    real = np.random.default_rng(1).uniform(-8.8, 8.8, (50, steps, config.inputs))
    lengths = np.array([config.window_lengths[q] for q in config.length_index])[:, None]
    sums = np.rint((real * 80.0 + 7.3) * lengths).astype(np.int64)
    codes = normalise(filled, sums, np.full(50, steps), mean, scale)
    ideal = np.clip((sums / lengths - 7.3) / 80.0 * 2.0**fmt.frac_bits, fmt.min_code, fmt.max_code)
    # two roundings and scale's own half LSB
    assert (np.abs(codes - ideal) <= 1.0 + np.abs(ideal) / 2 ** (gate - 1)).all()
    assert min(filled.features.feature_shift) < 5 or abs((codes - ideal).mean()) < 0.03


def test_a_spread_too_small_for_the_scale_is_refused():
    config = SMALL.replace(hop=4, window=8)
    fmt, top = config.formats.feature_format, config.scale_format.max_code
    least = 2.0 ** (fmt.frac_bits + config.formats.gate_frac) / (config.feature_units[0] * top)
    filled, _, scale = normaliser_constants(config, 0.0, least)
    assert (*filled.features.feature_shift, *scale) == (0, top), "the largest code is one"
    with refused("feature_format.*fewer feature bits"):
        normaliser_constants(config, 0.0, 0.0005)


def test_sums_far_from_the_mean_saturate_before_they_are_scaled():
    config, none = TRACKED.replace(feature_shift=(0,)), np.zeros(1, dtype=np.int64)
    sums = np.array([1 << 20, -1 << 20, 1, 0])
    codes = normalise(
        config, sums.reshape(1, 1, 4), np.ones(1), none, none + 256
    )  # far smaller than a fitted one
    assert codes.tolist() == [[[1024, -1024, 0, 0]]]


# ---------------------------------------------------------------------- changes of the network
def test_with_network_moves_the_state_format_and_the_windows():
    lstm = with_network(PRESETS["thesis"], cell="lstm", hidden=10)
    assert str(lstm.formats.state_format) == "SQ(4,12)" and lstm.network.hidden == 10
    assert str(with_network(lstm, cell="gru").formats.state_format) == "SQ(2,12)"
    assert with_network(PRESETS["pvdf"]) == PRESETS["pvdf"]
    finer = with_network(PRESETS["thesis"], steps=50)
    assert (finer.windows.hop, finer.windows.window, finer.windows.steps) == (122, 245, 50)
    assert with_network(PRESETS["pvdf"], steps=10).windows.hop == PRESETS["pvdf"].windows.hop
    for name in ("thesis", "pvdf"):
        with refused("field steps"):
            with_network(PRESETS[name], steps=0)


def test_masked_taxels_do_not_reach_the_float_network():
    config = SMALL.replace(masked_taxels=(1,))
    model = random_float_model(config, 1)
    means = np.random.default_rng(2).normal(0, 50, (3, 6, 4))
    broken = means.copy()
    broken[..., 1] = 1e6
    np.testing.assert_array_equal(model.features(means), model.features(broken))
