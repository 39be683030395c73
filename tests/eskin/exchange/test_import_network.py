"""Networks trained elsewhere: torch's own forward pass, every refusal, and the way on to
the integer model."""

import json
import os
import pickle
from pathlib import Path

import numpy as np
import torch

from eskin.exchange.import_network import import_network
from eskin.golden.core import PRESETS, AcceleratorConfig
from eskin.golden.model import FloatModel, find_touches, real_features
from eskin.training.datasets import find_dataset, touch_rows
from eskin.training.fit import fit_networks
from eskin.training.recipe import Recipe
from tests.support.table import each_row, refused
from tests.support.torch_networks import Network
from tests.support.touch_scenes import SMALL, scene

SYNTHETIC = PRESETS["synthetic"]
SCALE = {"mean": -3.5, "std": 140.0}
SIZES = 16, 10
"""Inputs and units."""


def saved(path: Path, state: dict) -> Path:
    torch.save(state, path)
    return path


@each_row("prefix, steps", [("", 20), ("module.net.", 1)])
@each_row("name", ["GRU", "LSTM", "GRUCell", "LSTMCell"])
def test_torch_network_computes_the_same(tmp_path, name, prefix, steps):
    network = Network(name, *SIZES).double()
    file = saved(tmp_path / "net.pt", {prefix + key: value for key, value in network.state_dict().items()})
    cell, reset = ("gru", "after") if "GRU" in name else ("lstm", None)
    config = SYNTHETIC.replace(steps=steps)
    record = import_network(file, config, out=tmp_path / "model", cell=cell, reset=reset, **SCALE)
    model = FloatModel.load(tmp_path / "model")
    features = np.random.default_rng(3).normal(0, 1.5, (20, steps, 16))
    with torch.no_grad():
        expected = network(torch.from_numpy(features)).numpy()
    assert np.abs(expected).max() > 0.3 and np.abs(model.forward(features)[1] - expected).max() < 1e-12
    assert (model.config.network.cell, model.config.network.hidden) == (cell, 10)
    assert model.arrays["mu"] == -3.5
    assert model.arrays["sigma"] == 140
    assert json.loads(json.dumps(record)) == json.loads((tmp_path / "model" / "training.json").read_text())
    assert record["imported"]["file"] == str(file)
    assert record["imported"]["arrays"]["dense"] == prefix + "head.weight"
    assert record["parameters"] == model.config.parameter_count


# ---------------------------------------------------------------------- refusals
def not_imported(
    tmp_path: Path, file: Path, match: str, config: AcceleratorConfig = SYNTHETIC, **options
) -> None:
    """One sentence that says so, and no folder."""
    with refused(match) as error:
        import_network(file, config, out=tmp_path / "model", **({"reset": "after"} | SCALE | options))
    assert str(error.value).count(". ") == 0
    assert not (tmp_path / "model").exists()
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def torch_file(tmp_path: Path, cell: str = "GRU", *sizes: int, **arrays: torch.Tensor | None) -> Path:
    """A file of a network with other ``arrays`` (None: without it); ``__`` in a name stands for a dot."""
    state = Network(cell, *(sizes or SIZES)).state_dict() | {
        name.replace("__", "."): a for name, a in arrays.items()
    }
    return saved(tmp_path / "net.pt", {name: array for name, array in state.items() if array is not None})


@each_row(
    "file, arguments, cell, reset, match",
    [
        (torch_file, [], "gru", "before", "has reset after, not before; use --reset after"),
        (torch_file, [], "lstm", "before", "has cell gru, not lstm; use --cell gru"),
        (torch_file, ["LSTM"], "gru", "after", "has cell lstm, not gru; use --cell lstm"),
        (torch_file, ["RNN"], "gru", "after", r"weight_hh_l0: has shape \(10, 10\), neither \(3 x hidden"),
        (torch_file, [], None, None, "use --reset after"),  # the configuration speaks
        (torch_file, [], "linear", None, "is to have cell linear, which is read from ONNX"),
    ],
)
def test_a_file_of_another_variant(tmp_path, file, arguments, cell, reset, match):
    not_imported(tmp_path, file(tmp_path, *arguments), match, cell=cell, reset=reset)


ONES, SPOILED = torch.ones, Network("GRU", *SIZES).state_dict()["recurrent.weight_hh_l0"].clone()
SPOILED[3, 2] = float("nan")
ELSE = "holds objects other than tensors"


@each_row(
    "arrays, match",
    [
        ({"recurrent__weight_ih_l0": None}, "occurs 0 times"),
        ({"head__weight": None}, "has 0 dense layers"),
        ({"recurrent__weight_ih_l0_reverse": ONES(30, 16)}, "reverse: belongs to a second layer"),
        ({"b__weight_ih_l0": ONES(30, 16)}, "occurs 2 times"),
        ({"norm__weight": ONES(10)}, "norm.weight: belongs to neither the recurrent layer nor"),
        ({"recurrent__bias_hh_l0": ONES(33)}, r"bias_hh_l0: has shape \(33,\)"),
        ({"head__bias": ONES(4)}, r"head.bias: has shape \(4,\), which does not match a GRU of 10 units"),
        ({"epoch": 3}, f"{ELSE}; save only the weights"),
    ],
)
def test_torch_arrays_that_do_not_make_one_network(tmp_path, arrays, match):
    not_imported(tmp_path, torch_file(tmp_path, **arrays), match)


class Code:
    """Runs a command when it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self):
        return os.system, (f"touch '{self.mark}'",)


def test_code_in_a_file_is_never_run(tmp_path):
    mark, file = tmp_path / "ran.pt", tmp_path / "net.pt"
    state = Network("GRU", *SIZES).state_dict()
    for zipped in (True, False):
        torch.save(state | {"head.bias": Code(mark)}, file, _use_new_zipfile_serialization=zipped)
        not_imported(tmp_path, file, "holds pickled code, which is never run; save only the weights")
    (tmp_path / "forest.joblib").write_bytes(pickle.dumps(Code(mark)))
    not_imported(tmp_path, tmp_path / "forest.joblib", "a forest of scikit-learn with skl2onnx.to_onnx")
    torch.save(Network("GRU"), file)
    not_imported(tmp_path, file, "holds pickled code, which is never run; save only the weights")
    assert not mark.exists()
    torch.load(file, weights_only=False)  # the trap works where somebody falls into it
    torch.save(Code(mark), file)
    torch.load(file, weights_only=False)
    assert mark.exists()


# ---------------------------------------------------------------------- on to the integer model
def test_measured_normalisation_is_that_of_training(tmp_path):
    """The same mean and deviation as a training on the same recordings writes."""
    recordings, file, recipe = (scene(30), torch_file(tmp_path, "GRU", 4, 6), Recipe(name="one", updates=1))
    record = import_network(file, SMALL, out=tmp_path / "model", reset="after", recordings=recordings)
    data = find_dataset(recordings, SMALL, recipe)
    everything = [touch_rows(data, np.arange(len(recordings)))]
    (trained,) = fit_networks(data, SMALL, recipe, everything, 0, lambda *_: None)
    model, touches = FloatModel.load(tmp_path / "model"), find_touches(SMALL, recordings)
    mu, sigma = (float(model.arrays[name]) for name in ("mu", "sigma"))
    assert (mu, sigma) == (trained.arrays["mu"], trained.arrays["sigma"]) and sigma > 1
    assert record["normalisation"] == {"mean": mu, "std": sigma, "source": "scene"}
    features = model.features(real_features(SMALL, touches.sums))[touches.completed == SMALL.windows.steps]
    assert abs(features.mean()) < 0.05 and abs(features.std() - 1) < 0.05
