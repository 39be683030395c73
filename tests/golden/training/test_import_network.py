"""Networks trained elsewhere: torch's own forward pass, Keras's equations, every refusal, and the way on to
the integer model."""

from __future__ import annotations

import json
import os
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from eskin.cli.main import app
from eskin.golden.core.config import PRESETS, AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.golden.data.recordings import Recordings
from eskin.golden.data.scene import synthetic_recordings
from eskin.golden.model.model import FloatModel, IntegerModel
from eskin.golden.model.preprocess import find_touches, real_features
from eskin.golden.training.datasets import find_dataset, touch_rows
from eskin.golden.training.fit import fit_networks
from eskin.golden.training.import_network import import_network, read_layers
from eskin.golden.training.quantise import quantise
from eskin.golden.training.recipe import Recipe
from tests.support.table import each_row

SYNTHETIC = PRESETS["synthetic"]
SCALE = {"mean": -3.5, "std": 140.0}


class Network(torch.nn.Module):
    """A layer of torch and a Linear, as somebody would write it."""

    def __init__(
        self, cell: type, taxels: int = 16, hidden: int = 10, classes: int = 3, seed: int = 1
    ) -> None:
        super().__init__()
        torch.manual_seed(seed)
        more = {"batch_first": True} if cell in (torch.nn.GRU, torch.nn.LSTM) else {}
        self.recurrent = cell(taxels, hidden, **more)
        self.head = torch.nn.Linear(hidden, classes)

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        if isinstance(self.recurrent, (torch.nn.GRU, torch.nn.LSTM)):
            return self.head(self.recurrent(features)[0])
        state, logits = None, []
        for step in features.unbind(1):
            state = self.recurrent(step, state)
            logits.append(self.head(state[0] if isinstance(state, tuple) else state))
        return torch.stack(logits, dim=1)


def saved(path: Path, state: dict) -> Path:
    torch.save(state, path)
    return path


def keras_arrays(
    gates: int, bias_rows: int, *, taxels: int = 16, hidden: int = 7, classes: int = 3, seed: int = 2
) -> list[np.ndarray]:
    """kernel, recurrent, bias, dense kernel, dense bias; no bias is 0."""
    rng = np.random.default_rng(seed)
    width = gates * hidden
    bias = rng.uniform(0.2, 1.0, (bias_rows, width)) * rng.choice([-1, 1], (bias_rows, width))
    return [
        rng.normal(0, 0.4, (taxels, width)),
        rng.normal(0, 0.4, (hidden, width)),
        bias[0] if bias_rows == 1 else bias,
        rng.normal(0, 0.5, (hidden, classes)),
        rng.uniform(0.2, 1.0, classes),
    ]


def keras_logits(arrays: list[np.ndarray], features: np.ndarray) -> np.ndarray:
    """Keras's GRU (one bias row: reset_after=False, two: True) or LSTM, and Dense, written from its
    documentation, one step at a time."""
    kernel, recurrent, bias, dense, dense_bias = arrays
    units = len(recurrent)
    sigmoid = lambda v: 1 / (1 + np.exp(-v))
    h = c = np.zeros((len(features), units))
    logits = []
    for x in features.transpose(1, 0, 2):
        if kernel.shape[1] == 4 * units:
            i, f, g, o = np.split(x @ kernel + h @ recurrent + bias, 4, axis=1)
            c = sigmoid(f) * c + sigmoid(i) * np.tanh(g)
            h = sigmoid(o) * np.tanh(c)
        elif bias.ndim == 1:
            xz, xr, xh = np.split(x @ kernel + bias, 3, axis=1)
            uz, ur, uh = np.split(recurrent, 3, axis=1)
            z, r = sigmoid(xz + h @ uz), sigmoid(xr + h @ ur)
            h = z * h + (1 - z) * np.tanh(xh + (r * h) @ uh)
        else:
            (xz, xr, xh), (hz, hr, hh) = (
                np.split(x @ kernel + bias[0], 3, axis=1),
                np.split(h @ recurrent + bias[1], 3, axis=1),
            )
            z, r = sigmoid(xz + hz), sigmoid(xr + hr)
            h = z * h + (1 - z) * np.tanh(xh + r * hh)
        logits.append(h @ dense + dense_bias)
    return np.stack(logits, axis=1)


# ---------------------------------------------------------------------- the same function as where it came from
@each_row("prefix", ["", "module.net."])
@each_row("name", ["GRU", "LSTM", "GRUCell", "LSTMCell"])
def test_torch_network_computes_the_same(tmp_path, name, prefix):
    network = Network(getattr(torch.nn, name)).double()
    file = saved(tmp_path / "net.pt", {prefix + key: value for key, value in network.state_dict().items()})
    cell, reset = ("gru", "after") if "GRU" in name else ("lstm", None)
    record = import_network(file, SYNTHETIC, out=tmp_path / "model", cell=cell, reset=reset, **SCALE)
    model = FloatModel.load(tmp_path / "model")
    features = np.random.default_rng(3).normal(0, 1.5, (20, 20, 16))
    with torch.no_grad():
        wanted = network(torch.from_numpy(features)).numpy()
    assert np.abs(wanted).max() > 0.3 and np.abs(model.forward(features)[1] - wanted).max() < 1e-12
    assert (
        (model.config.network.cell, model.config.network.hidden) == (cell, 10)
        and model.arrays["mu"] == -3.5
        and model.arrays["sigma"] == 140
    )
    assert json.loads(json.dumps(record)) == json.loads((tmp_path / "model" / "training.json").read_text())
    assert (
        record["imported"]["file"] == str(file)
        and record["imported"]["arrays"]["dense"] == prefix + "head.weight"
    )
    assert record["parameters"] == model.parameter_count == model.config.parameter_count


@each_row(
    "gates, bias_rows, cell, reset", [(3, 1, "gru", "before"), (3, 2, "gru", "after"), (4, 1, "lstm", None)]
)
def test_keras_network_computes_the_same(tmp_path, gates, bias_rows, cell, reset):
    arrays = keras_arrays(gates, bias_rows)
    np.savez(tmp_path / "keras.npz", *arrays)
    import_network(tmp_path / "keras.npz", SYNTHETIC, out=tmp_path / "model", cell=cell, reset=reset, **SCALE)
    model = FloatModel.load(tmp_path / "model")
    features = np.random.default_rng(4).normal(0, 1.5, (20, 20, 16))
    wanted = keras_logits(arrays, features)
    assert np.abs(model.forward(features)[1] - wanted).max() < 1e-12 and model.config.network.hidden == 7
    assert np.abs(model.arrays["b_y"] - arrays[4]).max() == 0


def test_sizes_formats_and_old_files(tmp_path):
    """float16, the serialisation before zip, other sizes; an earlier model is replaced."""
    config = SYNTHETIC.replace(taxels=9, class_names=("a", "b", "c", "d", "e"))
    for hidden, dtype, zipped in ((4, torch.float16, True), (32, torch.bfloat16, False)):
        network = Network(torch.nn.GRU, 9, hidden, 5).to(dtype)
        torch.save(network.state_dict(), tmp_path / "net.pth", _use_new_zipfile_serialization=zipped)
        import_network(tmp_path / "net.pth", config, out=tmp_path / "model", reset="after", **SCALE)
        model = FloatModel.load(tmp_path / "model")
        assert model.config.network.hidden == hidden
        assert np.array_equal(
            model.arrays["U_r"], network.recurrent.weight_hh_l0.detach().double().numpy()[:hidden]
        )


# ---------------------------------------------------------------------- refusals
def refused(tmp_path: Path, file: Path, match: str, config: AcceleratorConfig = SYNTHETIC, **options) -> None:
    """One sentence that says so, and no folder."""
    with pytest.raises(InputError, match=match) as error:
        import_network(file, config, out=tmp_path / "model", **({"reset": "after"} | SCALE | options))
    assert "\n" not in str(error.value) and str(error.value).count(". ") == 0
    assert not (tmp_path / "model").exists()
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


@each_row(
    "cell, said, match",
    [
        (
            torch.nn.GRU,
            ("gru", "before"),
            "has two bias rows, so its reset gate stands after the product: use --reset after",
        ),
        (
            torch.nn.GRU,
            ("lstm", "before"),
            "has 3 gates for each of 10 units, so the network is a GRU: use --cell gru --reset after",
        ),
        (
            torch.nn.LSTM,
            ("gru", "after"),
            "has 4 gates for each of 10 units, so the network is an LSTM: use --cell lstm",
        ),
        (
            torch.nn.RNN,
            ("gru", "after"),
            r"weight_hh_l0: has shape \(10, 10\), neither \(3 x hidden, hidden\) of a GRU nor \(4 x hidden",
        ),
    ],
)
def test_torch_file_of_another_variant(tmp_path, cell, said, match):
    file = saved(tmp_path / "net.pt", Network(cell).state_dict())
    refused(tmp_path, file, match, cell=said[0], reset=said[1])


@each_row(
    "gates, rows, said, match",
    [
        (
            3,
            1,
            ("gru", "after"),
            "array arr_2: has one bias row, so its reset gate stands before the product: use --reset before",
        ),
        (
            3,
            2,
            ("gru", "before"),
            "array arr_2: has two bias rows, so its reset gate stands after the product: use --reset after",
        ),
        (3, 1, ("lstm", "before"), "so the network is a GRU: use --cell gru --reset before"),
        (3, 2, ("lstm", "before"), "so the network is a GRU: use --cell gru --reset after"),
        (4, 1, ("gru", "before"), "so the network is an LSTM: use --cell lstm"),
    ],
)
def test_keras_file_of_another_variant(tmp_path, gates, rows, said, match):
    np.savez(tmp_path / "k.npz", *keras_arrays(gates, rows))
    refused(tmp_path, tmp_path / "k.npz", match, cell=said[0], reset=said[1])


def test_without_a_word_the_configuration_speaks(tmp_path):
    """Options left out: cell and reset of the configuration are what the file is checked against."""
    file = saved(tmp_path / "net.pt", Network(torch.nn.GRU).state_dict())
    refused(tmp_path, file, "use --reset after", reset=None)
    import_network(file, SYNTHETIC.replace(reset="after"), out=tmp_path / "model", **SCALE)


def test_sizes_that_do_not_fit_the_configuration(tmp_path):
    file = saved(tmp_path / "net.pt", Network(torch.nn.GRU, 8, 10, 3).state_dict())
    refused(
        tmp_path, file, "weight_ih_l0: takes 8 inputs and configuration 'synthetic', field taxels, has 16"
    )
    file = saved(tmp_path / "net.pt", Network(torch.nn.GRU, 16, 10, 5).state_dict())
    refused(
        tmp_path,
        file,
        "head.weight: decides between 5 classes and configuration 'synthetic', field class_names, has 3",
    )
    file = saved(tmp_path / "net.pt", Network(torch.nn.GRU, 16, 33, 3).state_dict())
    refused(tmp_path, file, "field hidden: is 33; it must lie in 4..32")
    file = saved(tmp_path / "net.pt", Network(torch.nn.GRU).state_dict())
    refused(tmp_path, file, "torch's gates are sigmoids", SYNTHETIC.replace(gate_activation="hard_sigmoid"))


def test_torch_arrays_that_do_not_make_one_network(tmp_path):
    state, file = Network(torch.nn.GRU).state_dict(), tmp_path / "net.pt"
    for name in state:
        without = {key: value for key, value in state.items() if key != name}
        match = (
            "has 0 dense layers"
            if name == "head.weight"
            else "is there 0 times"
            if "weight_ih" in name
            else f"{name}: is missing"
        )
        refused(tmp_path, saved(file, without), match)
    refused(
        tmp_path,
        saved(file, state | {"recurrent.weight_ih_l1": torch.ones(30, 10)}),
        "l1: belongs to a second layer",
    )
    refused(
        tmp_path,
        saved(file, state | {"recurrent.weight_ih_l0_reverse": torch.ones(30, 16)}),
        "reverse: belongs to a second layer",
    )
    refused(tmp_path, saved(file, state | {"b.weight_ih_l0": torch.ones(30, 16)}), "is there 2 times")
    refused(tmp_path, saved(file, state | {"two.weight": torch.ones(3, 3)}), "has 2 dense layers")
    refused(
        tmp_path,
        saved(file, state | {"norm.weight": torch.ones(10)}),
        "norm.weight: belongs to neither the recurrent layer nor",
    )
    for name, shape in (
        ("recurrent.weight_ih_l0", (33, 16)),
        ("recurrent.weight_ih_l0", (30,)),
        ("recurrent.bias_hh_l0", (33,)),
        ("head.weight", (3, 11)),
        ("head.bias", (3, 1)),
    ):
        refused(tmp_path, saved(file, state | {name: torch.ones(shape)}), f"{name}.*: has shape")
    refused(
        tmp_path,
        saved(file, state | {"head.bias": torch.ones(4)}),
        "head.bias: has 4 values for 3 classes of head.weight",
    )
    refused(
        tmp_path,
        saved(file, state | {"head.bias": torch.ones(3).to_sparse()}),
        "head.bias: is no plain array of numbers",
    )
    refused(
        tmp_path,
        saved(file, {"state_dict": state, "epoch": 3}),
        "holds other things than tensors; save only the weights",
    )
    refused(tmp_path, saved(file, []), "holds other things than tensors")
    for value in (float("nan"), float("inf")):
        spoiled = {key: tensor.clone() for key, tensor in state.items()}
        spoiled["recurrent.weight_hh_l0"][3, 2] = value
        refused(tmp_path, saved(file, spoiled), "weight_hh_l0: holds values that are no finite numbers")


def test_keras_arrays_that_do_not_make_one_network(tmp_path):
    file, good = tmp_path / "k.npz", keras_arrays(3, 2)

    def replaced(index: int, array) -> Path:
        np.savez(file, *[array if i == index else part for i, part in enumerate(good)])
        return file

    np.savez(file, *good[:4])
    refused(tmp_path, file, "array arr_4: is missing; save the five arrays")
    np.savez(file, kernel=good[0])
    refused(tmp_path, file, "array arr_0: is missing")
    np.savez(file, *good, good[0])
    refused(tmp_path, file, "array arr_5: is one too many")
    refused(
        tmp_path,
        replaced(1, good[1].T),
        r"array arr_1: has shape \(21, 7\), neither \(hidden, 3 x hidden\) of a GRU nor",
    )
    refused(
        tmp_path,
        replaced(0, good[0].T),
        r"array arr_0: has shape \(21, 16\), which does not go with a GRU of 7 units \(arr_1\)",
    )
    refused(tmp_path, replaced(2, good[2].ravel()), "array arr_2: has shape .1, 42., which does not go with")
    refused(tmp_path, replaced(2, np.ones((3, 21))), "array arr_2: has shape")
    refused(tmp_path, replaced(2, np.float64(1)), "array arr_2: has shape")
    refused(tmp_path, replaced(3, np.ones((8, 3))), r"array arr_3: has shape \(8, 3\)")
    refused(tmp_path, replaced(4, np.ones(4)), "array arr_4: has 4 values for 3 classes of arr_3")
    refused(
        tmp_path,
        replaced(0, np.full((16, 21), np.nan)),
        "array arr_0: holds values that are no finite numbers",
    )
    refused(tmp_path, replaced(0, np.full((16, 21), "x")), "array arr_0: holds <U1, not numbers")
    refused(
        tmp_path, replaced(0, np.full((16, 21), None)), "arr_0: holds Python objects, which need a pickle"
    )
    np.savez(file, *keras_arrays(4, 2))
    refused(tmp_path, file, r"array arr_2: has shape \(2, 28\), which does not go with an LSTM", cell="lstm")


class Code:
    """Runs a command when it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self):
        return os.system, (f"touch '{self.mark}'",)


def test_code_in_a_file_is_never_run(tmp_path):
    mark, file = tmp_path / "ran.pt", tmp_path / "net.pt"
    state = Network(torch.nn.GRU).state_dict()
    for zipped in (True, False):
        torch.save(state | {"head.bias": Code(mark)}, file, _use_new_zipfile_serialization=zipped)
        refused(tmp_path, file, "holds pickled code, which is never run; save only the weights")
    torch.save(Network(torch.nn.GRU), file)
    refused(tmp_path, file, "holds pickled code, which is never run; save only the weights")
    np.savez(tmp_path / "k.npz", *keras_arrays(3, 2)[:4], np.array(Code(mark), dtype=object))
    refused(tmp_path, tmp_path / "k.npz", "holds Python objects, which need a pickle")
    assert not mark.exists()
    torch.load(file, weights_only=False)  # the trap works where somebody falls into it
    torch.save(Code(mark), file)
    torch.load(file, weights_only=False)
    assert mark.exists()


@each_row("kind", ["zipped.pt", "old.pth", "keras.npz"])
def test_damaged_files(tmp_path, kind):
    file = tmp_path / kind
    if kind == "keras.npz":
        np.savez(file, *keras_arrays(3, 2))
    else:
        torch.save(
            Network(torch.nn.GRU).state_dict(), file, _use_new_zipfile_serialization=kind == "zipped.pt"
        )
    whole = file.read_bytes()
    for size in (0, 1, 10, 100, len(whole) // 2, len(whole) - 4):
        file.write_bytes(whole[:size])
        refused(
            tmp_path,
            file,
            "is (damaged or no torch file|damaged or incomplete|no .npz archive|a single array)",
        )
    file.write_bytes(b"a note to myself\n")
    refused(
        tmp_path, file, "is (damaged or no torch file|damaged or incomplete|no .npz archive|a single array)"
    )


def test_a_changed_bit_is_seen(tmp_path):
    """In the values: torch itself reads over it."""
    for file, save in (
        (tmp_path / "net.pt", lambda path: torch.save(Network(torch.nn.GRU).state_dict(), path)),
        (tmp_path / "k.npz", lambda path: np.savez(path, *keras_arrays(3, 2))),
    ):
        save(file)
        raw = bytearray(file.read_bytes())
        with zipfile.ZipFile(file) as archive:
            member = max(archive.infolist(), key=lambda info: info.file_size)
        raw[member.header_offset + 512] ^= 1
        file.write_bytes(raw)
        refused(tmp_path, file, "is damaged")


def test_files_of_other_kinds(tmp_path):
    refused(tmp_path, tmp_path / "net.onnx", "is neither .pt, .pth nor .npz")
    refused(tmp_path, tmp_path / "none.pt", "is no file")
    (tmp_path / "folder.pt").mkdir()
    refused(tmp_path, tmp_path / "folder.pt", "is no file")
    np.save(tmp_path / "one.npy", np.ones(3))
    (tmp_path / "one.npy").rename(tmp_path / "one.npz")
    (tmp_path / "folder.pt").rmdir()
    refused(tmp_path, tmp_path / "one.npz", "is a single array, not an .npz archive")


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    where=st.floats(0, 1), value=st.integers(0, 255), kind=st.sampled_from(["net.pt", "old.pth", "keras.npz"])
)
def test_any_changed_byte_is_refused_or_harmless(tmp_path_factory, where, value, kind):
    """Never anything but an InputError, whatever byte changes."""
    file = tmp_path_factory.mktemp("byte") / kind
    if kind == "keras.npz":
        np.savez(file, *keras_arrays(3, 1))
    else:
        torch.save(Network(torch.nn.GRU).state_dict(), file, _use_new_zipfile_serialization=kind == "net.pt")
    raw = bytearray(file.read_bytes())
    raw[min(int(where * len(raw)), len(raw) - 1)] = value
    file.write_bytes(raw)
    try:
        layers = read_layers(file)
    except InputError:
        return
    assert layers.arrays["recurrent"].shape[0] == 3 * layers.arrays["recurrent"].shape[1]


def test_normalisation_must_be_known(tmp_path):
    file = saved(tmp_path / "net.pt", Network(torch.nn.GRU).state_dict())
    refused(
        tmp_path,
        file,
        "does not say how its inputs were normalised; give --mean and --std .codes., or --data",
        mean=None,
        std=None,
    )
    refused(tmp_path, file, "--std: is missing; give both", std=None)
    refused(tmp_path, file, "--mean: is missing; give both", mean=None)
    refused(tmp_path, file, "--std 0: is no spread above 0", std=0.0)
    refused(tmp_path, file, "--std nan: is no spread above 0", std=float("nan"))
    refused(tmp_path, file, "--mean inf: is no finite number", mean=float("inf"))


def test_a_folder_that_is_no_model_stays(tmp_path):
    file = saved(tmp_path / "net.pt", Network(torch.nn.GRU).state_dict())
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.txt").write_text("years of work")
    with pytest.raises(InputError, match="holds 'thesis.txt', which is no part of a model"):
        import_network(file, SYNTHETIC, out=tmp_path / "out", reset="after", **SCALE)
    assert (tmp_path / "out" / "thesis.txt").read_text() == "years of work"


# ---------------------------------------------------------------------- on to the integer model
@pytest.fixture(scope="module")
def scene() -> Recordings:
    """A few touches at 500 Hz."""
    return synthetic_recordings(persons=4, trials=2, sample_rate_hz=500.0)


SLOW = SYNTHETIC.replace(
    sample_rate_hz=500.0,
    hop=51,
    window=103,
    touch_frames=1024,
    pretrigger_frames=8,
    onset_mean_frames=16,
    onset_check_frames=4,
    rest_frames=16,
    decision="last",
)


def test_measured_normalisation_is_that_of_training(tmp_path, scene):
    """The same mean and deviation as a training on the same recordings writes."""
    file = saved(tmp_path / "net.pt", Network(torch.nn.GRU).state_dict())
    record = import_network(file, SLOW, out=tmp_path / "model", reset="after", recordings=scene)
    data = find_dataset(scene, SLOW, Recipe(name="one"))
    everything = [touch_rows(data, np.arange(len(scene)))]
    (trained,) = fit_networks(data, SLOW, Recipe(name="one", updates=1), everything, 0, lambda *_: None)
    model = FloatModel.load(tmp_path / "model")
    assert model.arrays["mu"] == trained.arrays["mu"] and model.arrays["sigma"] == trained.arrays["sigma"] > 1
    assert record["normalisation"] == {
        "mean": float(model.arrays["mu"]),
        "std": float(model.arrays["sigma"]),
        "source": "synthetic scene",
    }
    touches = find_touches(SLOW, scene)
    features = model.features(real_features(SLOW, touches.sums))[touches.completed == SLOW.windows.steps]
    assert abs(features.mean()) < 0.05 and abs(features.std() - 1) < 0.05


def test_no_touch_to_measure_on(tmp_path, make_recordings):
    file = saved(tmp_path / "net.pt", Network(torch.nn.GRU).state_dict())
    quiet = make_recordings(lengths=[2000] * 3, taxels=16, classes=3)
    refused(
        tmp_path,
        file,
        "hold no touch to measure mean and deviation on",
        SLOW,
        mean=None,
        std=None,
        recordings=quiet,
    )


def trained_outside(scene: Recordings, cell: type, mean: float, std: float) -> Network:
    """Trained by torch alone on the window means, in one thread."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    touches = find_touches(SLOW, scene)
    features = torch.from_numpy((real_features(SLOW, touches.sums) - mean) / std).float()
    labels = torch.from_numpy(scene.labels[touches.recording])
    network = Network(cell, hidden=12)
    optimiser = torch.optim.Adam(network.parameters(), lr=0.02)
    for _ in range(60):
        optimiser.zero_grad()
        torch.nn.functional.cross_entropy(network(features)[:, -1], labels).backward()
        optimiser.step()
    torch.set_num_threads(threads)
    return network


def imported(tmp_path: Path, scene: Recordings, cell: type) -> tuple[Network, Path]:
    """A network trained by torch alone, and the model folder that the command line made of its file."""
    network = trained_outside(scene, cell, 20.0, 250.0)
    file = saved(tmp_path / "net.pt", network.state_dict())
    (tmp_path / "config.json").write_text(SLOW.to_json())
    said = ["--cell", "gru", "--reset", "after"] if cell is torch.nn.GRU else ["--cell", "lstm"]
    said += ["--config", str(tmp_path / "config.json"), "--mean", "20", "--std", "250"]
    result = CliRunner().invoke(app, ["import", str(file), "--out", str(tmp_path / "model"), *said])
    assert result.exit_code == 0, result.output
    return network.double(), tmp_path / "model"


@each_row("cell", [torch.nn.GRU, torch.nn.LSTM])
def test_from_torch_to_codes_at_the_command_line(tmp_path, scene, cell):
    """Imported with --mean and --std, quantised with --data: the integer model decides as the network did
    where it was trained."""
    network, folder = imported(tmp_path, scene, cell)
    model, touches = FloatModel.load(folder), find_touches(SLOW, scene)
    features = model.features(real_features(SLOW, touches.sums))
    with torch.no_grad():
        wanted = network(torch.from_numpy(features)).numpy()
    assert np.abs(wanted).max() > 1 and np.abs(model.forward(features)[1] - wanted).max() < 1e-12
    with pytest.raises(
        InputError, match="has no ranges noted at training; give the recordings it was trained on .--data."
    ):
        quantise(folder)
    data, run = tmp_path / "scene.npz", CliRunner()
    np.savez(
        data,
        samples=scene.samples.astype(np.uint16),
        offsets=scene.offsets,
        labels=scene.labels,
        class_names=np.array(scene.class_names),
        sample_rate_hz=scene.sample_rate_hz,
    )
    assert run.invoke(app, ["quantise", str(folder), "--data", str(data)]).exit_code == 0
    said = run.invoke(app, ["evaluate", str(folder), "--data", str(data), "--json", str(tmp_path / "e.json")])
    figures = json.loads((tmp_path / "e.json").read_text())
    assert said.exit_code == 0 and figures["float_accuracy"] > 0.9 and figures["agreement"] >= 0.98
    assert IntegerModel.load(folder).config.network.hidden == 12


@pytest.mark.slow
@pytest.mark.parametrize("cell", [torch.nn.GRU, torch.nn.LSTM])
def test_imported_network_in_hardware(tmp_path, scene, cell):
    """torch.nn.GRU(16, 12) and Linear(12, 3), trained outside: bit-exact in co-simulation."""
    from eskin.verbs.flow import cosimulate

    _, folder = imported(tmp_path, scene, cell)
    few = scene.subset(scene.evenly(3))
    result = cosimulate(quantise(folder, scene), few, lanes=4, work=tmp_path / "work")
    assert (
        result["bit_exact"]
        and result["steps"] == 3 * SLOW.windows.steps
        and result["decisions"] == 3 * (SLOW.windows.steps + 1)
    )


def test_command_line_refuses_with_status_2(tmp_path, monkeypatch, capsys):
    from eskin.cli import main as command_line

    file = saved(tmp_path / "net.pt", Network(torch.nn.GRU).state_dict())
    options = [
        "--out",
        str(tmp_path / "m"),
        "--config",
        "synthetic",
        "--cell",
        "gru",
        "--reset",
        "before",
        "--mean",
        "0",
        "--std",
        "1",
    ]
    monkeypatch.setattr("sys.argv", ["eskin", "import", str(file), *options])
    with pytest.raises(SystemExit) as end:
        command_line.main()
    assert end.value.code == 2 and capsys.readouterr().err.count("\n") == 1 and not (tmp_path / "m").exists()
