"""ONNX in and out: what torch, eskin and files made by hand hold is taken as it is, or refused with the node's
name."""

import os
import subprocess
import sys
import warnings
from functools import cache
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from onnx import TensorProto, helper, numpy_helper
from sklearn.ensemble import ExtraTreesClassifier, RandomForestClassifier
from sklearn.tree import DecisionTreeClassifier

from eskin.data import load_recordings
from eskin.exchange.exact_onnx import STEP_FILE, TOUCH_FILE, differences, expected
from eskin.exchange.import_network import import_network, measure_scaling
from eskin.exchange.onnx_file import largest_difference, onnx_model, write_onnx
from eskin.golden.core import AcceleratorConfig, QFormat
from eskin.golden.model import FloatModel, constants_shape, find_touches, float_features, run
from eskin.golden.model.forest import run_forest
from eskin.training.trees import forest_codes
from eskin.verbs.export import export_exact
from tests.support.c_played import front_end
from tests.support.c_played import model_of as model_on
from tests.support.forests import forest_file
from tests.support.random_models import random_float_model, random_integer_model
from tests.support.small_designs import TRACKED
from tests.support.table import each_row, refused
from tests.support.torch_networks import Network

CONFIG = TRACKED.replace(hidden=6, class_names=("press", "stroke", "tap"))
WIDE = {"state_format": QFormat(4, 12)}
CELLS = {
    "linear": {"cell": "linear", "decision": "last"},
    "linear, one set": {"cell": "linear", "decision": "last", "weight_sets": "one"},
    "linear, one window": {"cell": "linear", "decision": "last", "steps": 1},
    "before": {},
    "after": {"reset": "after", **WIDE},
    "lstm": {"cell": "lstm", **WIDE},
    "hard": {"gate_activation": "hard_sigmoid"},
}


def model_of(config: AcceleratorConfig) -> FloatModel:
    return random_float_model(config, 1, 0.5, 3.0, 7.0)


def taken(file, tmp_path, config=CONFIG, **options) -> FloatModel:
    import_network(file, config, out=tmp_path / "made", **{"mean": 0.0, "std": 1.0, **options})
    return FloatModel.load(tmp_path / "made")


@pytest.mark.parametrize("cell", CELLS)
def test_what_is_exported_comes_back(cell, tmp_path):
    model = model_of(CONFIG.replace(**CELLS[cell]))
    file = write_onnx(model, tmp_path / "net.onnx")
    array = CONFIG.replace(steps=model.config.windows.steps)
    again = taken(file, tmp_path, array, mean=None, std=None)  # scale, cell and sizes are the file's
    features = np.random.default_rng(2).normal(size=(7, model.config.windows.steps, 4))
    assert largest_difference(model, file, features) < 1e-5
    assert np.abs(model.forward(features)[1] - again.forward(features)[1]).max() < 1e-5
    assert again.arrays["mu"] == 3 and again.arrays["sigma"] == 7
    assert again.config.network.cell == model.config.network.cell


@pytest.mark.parametrize("kind", ["linear, all kinds", "GRU, reset before", "GRU, reset after", "LSTM"])
@pytest.mark.parametrize(
    "name", ["fabric", *(pytest.param(name, marks=pytest.mark.slow) for name in ("pvdf", "biotac"))]
)
def test_a_hundred_recordings_through_onnxruntime(name, kind, shared_data, tmp_path):
    recordings = load_recordings(next(shared_data.glob(f"{name}*/recordings.npz")))
    recordings = recordings.subset(recordings.evenly(100))
    config = model_on(front_end(name, recordings), kind).config
    mu, sigma = measure_scaling(config, recordings)
    scale = {
        "mu": np.broadcast_to(mu, constants_shape(config)),
        "sigma": np.broadcast_to(sigma, constants_shape(config)),
    }
    model = FloatModel(config, model_of(config).arrays | scale)
    features = float_features(model, find_touches(config, recordings))
    difference = largest_difference(model, write_onnx(model, tmp_path / "net.onnx"), features)
    # a linear cell's logits are sums over all windows, hundreds here
    assert len(features) >= 100 and difference < (1e-5 if config.recurrent else 1e-4)


EXACT = {
    "vote": {},
    "early, after": {"reset": "after", "decision": "early", "early_steps": 3, "early_margin": 64, **WIDE},
    "last, lstm": {"cell": "lstm", "decision": "last", "margin_threshold": 200, **WIDE},
    "linear": CELLS["linear"],
    "linear, one set": CELLS["linear, one set"],
}


@pytest.mark.parametrize("kind", EXACT)
def test_the_exact_network_is_golden_and_every_rounding_counts(kind, tmp_path):
    model = random_integer_model(CONFIG.replace(**EXACT[kind]), 1)
    made = export_exact(model, tmp_path / "net")
    assert made["passed"] and made["values"] > 100 * 5 * 3
    with np.load(tmp_path / "net/vectors.npz") as vectors:
        vectors = dict(vectors)
    assert {-1, 0} < {*vectors["cls"].tolist()} and len({*vectors["step"].tolist()}) > 3
    if "margin_threshold" in EXACT[kind]:
        assert {*vectors["unsure"][vectors["cls"] >= 0].tolist()} == {False, True}
    for name, broken in ((TOUCH_FILE, slice(-1, None)), (STEP_FILE, slice(None))):
        file = tmp_path / "net" / name
        sound = file.read_bytes()
        places = [n for n, node in enumerate(onnx.load_model(file).graph.node) if node.op_type == "Floor"]
        for place in places[broken]:
            made = onnx.load_model_from_string(sound)
            made.graph.node[place].op_type = "Ceil"
            file.write_bytes(made.SerializeToString())
            assert differences(tmp_path / "net", vectors)[1], (name, made.graph.node[place].output)
        file.write_bytes(sound)


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind", ["linear, all kinds", "GRU, reset before", "GRU, reset after", "LSTM", "GRU, early"]
)
@pytest.mark.parametrize("name", ["pvdf", "biotac"])
def test_every_recording_decides_the_same_in_onnxruntime(name, kind, shared_data, tmp_path):
    recordings = load_recordings(next(shared_data.glob(f"{name}*/recordings.npz")))
    config = model_on(front_end(name, recordings), kind).config
    for seed in (1, 2, 3):
        model = random_integer_model(config, seed)
        trace = run(model, recordings)
        assert export_exact(model, tmp_path / "net")["passed"]
        vectors = expected(model, trace.features, trace.touches.completed)
        assert (vectors["cls"] == trace.global_decision).all() and (vectors["unsure"] == trace.unsure).all()
        values, different = differences(tmp_path / "net", vectors)
        assert different == 0 and values > len(recordings)


class Net(Network):
    """One that torch exports."""

    def logits(self, x: np.ndarray) -> np.ndarray:
        """Of features (touches, steps, 4)."""
        x = x if self.batch_first else x.swapaxes(0, 1)
        return self(torch.from_numpy(x.astype("f4"))).detach().numpy()

    def saved(self, folder, shape=(1, 5, 4), opset=17, dynamic=False):
        """As torch writes it, with open sizes of batch and time where ``dynamic``."""
        axes = {"x": {0: "batch", 1: "steps"}} if dynamic else None
        names = {"input_names": ["x"], "output_names": ["y"], "dynamic_axes": axes}
        given = self.eval(), (torch.zeros(shape),), folder / "net.onnx"
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            torch.onnx.export(*given, dynamo=False, opset_version=opset, **names)
        return folder / "net.onnx"


@each_row("opset", [9, 13, 17])
@each_row("layer", ["GRU", "LSTM"])
@each_row("dynamic", [False, True])
def test_torch_to_onnx_to_eskin_to_onnx(layer, opset, dynamic, tmp_path):
    net = Net(layer, last=opset != 13)
    model = taken(net.saved(tmp_path, opset=opset, dynamic=dynamic), tmp_path)
    features = np.random.default_rng(2).normal(size=(3, 5, 4))
    last = net.logits(features).reshape(3, -1, 3)[:, -1]
    assert np.abs(model.forward(features)[1][:, -1] - last).max() < 1e-5
    assert model.config.network.reset == ("after" if layer == "GRU" else "before")
    assert largest_difference(model, write_onnx(model, tmp_path / "again.onnx"), features) < 1e-5


def edited(change, tmp_path, cell="after"):
    """An exported file, changed: ``change`` gets the model."""
    made = onnx_model(model_of(CONFIG.replace(**CELLS[cell])))
    del made.metadata_props[:]
    change(made)
    (tmp_path / "net.onnx").write_bytes(made.SerializeToString())
    return tmp_path / "net.onnx"


def node(made, name):
    return next(node for node in made.graph.node if node.name == name)


def first_step(made):
    del made.graph.node[-1]
    made.graph.initializer.append(numpy_helper.from_array(np.array(0), "zero"))
    made.graph.node.append(helper.make_node("Gather", ["by_step", "zero"], ["logits"], "first", axis=0))


def biased_twice(made):
    made.graph.node.insert(-1, helper.make_node("Add", ["by_step", "dense_bias"], ["again"], "again"))
    node(made, "steps_behind_batch").input[0] = "again"


def start(made):
    made.graph.initializer.append(numpy_helper.from_array(np.ones((1, 1, 6), np.float32), "h0"))
    node(made, "cell").input.extend(["", "h0"])


def bomb(made):
    made.graph.initializer.append(numpy_helper.from_array(np.array([10**6, 10**6]), "much"))
    made.graph.node.insert(0, helper.make_node("ConstantOfShape", ["much"], ["zeros"], "bomb"))


def wide(made):
    made.graph.initializer.append(TensorProto(name="huge", data_type=TensorProto.FLOAT, dims=[1 << 40]))


def external(made):
    tensor = made.graph.initializer[0]
    tensor.data_location = TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value="../../etc/passwd")


def odd_activations(made):
    node(made, "cell").attribute.append(helper.make_attribute("activations", 3))


def attributed(name, value):
    return lambda made: node(made, "cell").attribute.append(helper.make_attribute(name, value))


def lengths(made):
    made.graph.initializer.append(numpy_helper.from_array(np.array([3], np.int32), "lengths"))
    node(made, "cell").input.append("lengths")


def computed_weights(made):
    """Recurrent weights behind a Transpose, a bias behind an Identity, a dense bias of Python's numbers."""
    tensors = {tensor.name: tensor for tensor in made.graph.initializer}
    weights, bias = (tensors[name] for name in node(made, "cell").input[2:4])
    turned = numpy_helper.to_array(weights).transpose(0, 2, 1)
    weights.CopyFrom(numpy_helper.from_array(np.ascontiguousarray(turned), "turned"))
    dense = tensors["dense_bias"]
    values = helper.make_node(
        "Constant", [], ["dense_bias"], value_floats=numpy_helper.to_array(dense).tolist()
    )
    made.graph.initializer.remove(dense)
    moved = helper.make_node("Transpose", ["turned"], ["again"], perm=[0, 2, 1])
    same = helper.make_node("Identity", [bias.name], ["same"])
    for number, entry in enumerate((values, moved, same)):
        made.graph.node.insert(number, entry)
    node(made, "cell").input[2:4] = ["again", "same"]


def not_numbers(made):
    made.graph.initializer[0].raw_data = np.full(18, np.nan, np.float32).tobytes()


@each_row(
    "change, said",
    [
        (first_step, r"node '.+' of type \w+: gives output 'logits', which is not the dense layer"),

        (biased_twice, r"node '.+' of type \w+: gives output 'logits', which is not the dense layer"),

        (lambda made: setattr(made.opset_import[0], "version", 3), "has opset 3"),

        (lambda made: setattr(node(made, "cell"), "domain", "mine"), "node 'cell' of type GRU: is not supported"),

        (lambda made: node(made, "cell").attribute.append(helper.make_attribute("activations", ["Tanh", "Relu"])), "activations Tanh, Relu"),

        (odd_activations, "is not valid ONNX"),

        (lambda made: node(made, "readout_bias").input.append("features"), "is not valid ONNX"),



        (start, "node 'cell' of type GRU: has an initial state, which the accelerator has not"),

        (lengths, "node 'cell' of type GRU: has sequence lengths"),

        (attributed("direction", "reverse"), "node 'cell' of type GRU: has direction reverse"),

        (attributed("clip", 1.0), "node 'cell' of type GRU: has clip 1.0"),

        (attributed("layout", 1), "node 'cell' of type GRU: has layout 1"),

        (computed_weights, None),

        (external, "lies in another file"),

        (bomb, "value 'zeros': is beyond any"),

        (wide, "beyond any that the accelerator takes"),

        (not_numbers, "not finite numbers"),

        (lambda made: node(made, "steps_behind_batch").attribute[0].ints.__setitem__(0, 2), "steps_behind_batch"),

        (lambda made: setattr(made.graph.input[0].type.tensor_type.shape.dim[1], "dim_value", 9), None),

        (lambda made: made.graph.input[0].type.tensor_type.shape.dim.pop(), "has shape"),
    ],
)  # fmt: skip
def test_what_is_something_else_is_refused_by_name(change, said, tmp_path):
    file = edited(change, tmp_path)
    if said is None:
        assert taken(file, tmp_path).config.network.hidden == 6
        return
    with refused(said) as refusal:
        taken(file, tmp_path)
    assert len(str(refusal.value)) - len(str(tmp_path)) < 400 and not (tmp_path / "made").exists()


@each_row("kind", ["GRU", "LSTM"])
def test_layouts_of_a_converter_of_keras(kind, tmp_path):
    """Batch first by a Transpose, the last of all states by Squeeze and a Gather of -1, an Identity behind all."""
    rng, rows = np.random.default_rng(7), 18 if kind == "GRU" else 24
    sizes = {"W": (1, rows, 4), "R": (1, rows, 6), "B": (1, 2 * rows), "D": (6, 3), "d": (3,)}
    arrays = {name: rng.normal(0, 0.5, size).astype("f4") for name, size in sizes.items()}
    nodes = [
        ("Transpose", "x", "by_step", dict(perm=[1, 0, 2])),
        (kind, "by_step W R B", "y", dict(hidden_size=6)),
        ("Squeeze", "y", "states", dict(axes=[1])),
        ("Gather", "states last", "state", dict(axis=0)),
        ("MatMul", "state D", "product", {}),
        ("Add", "product d", "sum", {}),
        ("Identity", "sum", "out", {}),
    ]
    info = helper.make_tensor_value_info
    graph = helper.make_graph(
        [helper.make_node(kind, given.split(), [made], made, **more) for kind, given, made, more in nodes],
        "k",
        [info("x", 1, ["N", 5, 4])],
        [info("out", 1, ["N", 3])],
        [numpy_helper.from_array(np.array(array), name) for name, array in (arrays | {"last": -1}).items()],
    )
    file, features = tmp_path / "net.onnx", rng.normal(size=(3, 5, 4))
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 12)], ir_version=8), file)
    session = onnxruntime.InferenceSession(file, providers=["CPUExecutionProvider"])
    (logits,) = session.run(None, {"x": features.astype("f4")})
    assert np.abs(taken(file, tmp_path).forward(features)[1][:, -1] - logits).max() < 1e-5


# ---------------------------------------------------------------------- forests
LABELS = {2: ("press", "stroke"), 3: ("tap", "press", "stroke")}


@cache
def grown(kind=RandomForestClassifier, classes=3, **options):
    """Features (touches, K, D) that are codes, and a forest fitted on them with names as labels."""
    rng, of_trees = np.random.default_rng(6), {} if kind is DecisionTreeClassifier else {"n_estimators": 8}
    codes = rng.integers(-30, 30, (200, 5, 4))
    sums = codes[:, 1, 0] + rng.normal(0, 2, 200)
    labels = np.array(LABELS[classes])[np.digitize(sums, [0, 10][: classes - 1])]
    features = codes / 2.0**CONFIG.formats.feature_format.frac_bits
    return features, kind(**{"max_features": None} | of_trees | options, random_state=1).fit(
        features.reshape(200, -1), labels
    )


@each_row("classes, options", [(2, {}), (3, {}), (2, {"max_depth": 3}), (2, {"min_samples_leaf": 9})])
@each_row("kind", [RandomForestClassifier, ExtraTreesClassifier, DecisionTreeClassifier])
def test_a_forest_decides_as_in_onnxruntime(kind, classes, options, tmp_path):
    """Float and integer model, on features that are codes: leaves have one class or there are two."""
    features, forest = grown(kind, classes, **options)
    flat = features.reshape(200, -1).astype(np.float32)
    file, shares = forest_file(forest, tmp_path / "net.onnx"), forest.predict_proba(flat)
    np.savez(tmp_path / "reference.npz", inputs=flat, outputs=shares)
    config = CONFIG.replace(class_names=LABELS[classes], logit_format=QFormat(6, 10))
    record = import_network(
        file, config, out=tmp_path / "made", mean=0.0, std=1.0, check=tmp_path / "reference.npz"
    )
    assert record["check"]["touches"] == 200 and record["check"]["difference"] < 1e-9
    assert len(record["imported"]["notes"]) == 1
    model = FloatModel.load(tmp_path / "made")
    assert model.config.network.class_names == tuple(forest.classes_) == tuple(sorted(LABELS[classes]))
    labels = onnxruntime.InferenceSession(file).run(["label"], {"X": flat})[0]
    sized, integers = forest_codes(model.config, model.arrays)
    codes = (features * 2**sized.formats.feature_format.frac_bits).astype(int)
    margin = np.diff(np.sort(shares, axis=1)[:, -2:])[:, 0]
    for logits, least in (
        (model.forward(features)[1], 1e-6),
        (run_forest(sized, integers, codes)[1], 2**-6 if options else 1e-6),  # votes have eight bits
    ):
        clear = margin > least
        assert clear.sum() > 150
        assert np.array_equal(forest.classes_[logits[clear, -1].argmax(axis=1)], labels[clear])


def test_leaves_of_several_classes_are_told_and_a_reference_finds_them(tmp_path):
    features, forest = grown(max_depth=3, max_features=1)
    file = forest_file(forest, tmp_path / "net.onnx")
    np.savez(
        tmp_path / "reference.npz", inputs=features, outputs=forest.predict_proba(features.reshape(200, -1))
    )
    record = import_network(
        file, CONFIG, out=tmp_path / "made", mean=0.0, std=1.0, check=tmp_path / "reference.npz"
    )
    assert not record["passed"] and record["check"]["difference"] > 1e-3 and not (tmp_path / "made").exists()
    assert "% of random touches are decided as by the file" in record["imported"]["notes"][-1]
    decided = taken(file, tmp_path).forward(features)[1][:, -1].argmax(axis=1)
    assert 0.7 < (forest.classes_[decided] == forest.predict(features.reshape(200, -1))).mean() < 1


def preceded(kind, domain, **attributes):
    """A node between the input and the forest."""

    def change(made):
        made.graph.node[0].input[0] = "x"
        made.graph.node.insert(0, helper.make_node(kind, ["X"], ["x"], kind, domain=domain, **attributes))

    return change


def mirrored(made):
    made.graph.initializer.append(numpy_helper.from_array(np.arange(20)[::-1].copy(), "backwards"))
    preceded("Gather", "", axis=1)(made)
    made.graph.node[0].input.append("backwards")


def twice(made):
    made.graph.node.append(made.graph.node[0])
    made.graph.node[-1].name, made.graph.node[-1].output[:] = "again", ["l", "s"]


def changed(name, place, value):
    def change(made):
        (entry,) = (each for each in made.graph.node[0].attribute if each.name == name)
        values = next(each for each in (entry.ints, entry.floats, entry.strings) if each)
        values[place] = value

    return change


NO_FOREST = "Tree.*: does not add up shares of classes .*; convert one RandomForestClassifier, "


@each_row(
    "options, attributes, change, words",
    [
        ({}, {}, changed("nodes_modes", 0, b"BRANCH_LT"), "node 'trees' .*: has modes beside BRANCH_LEQ"),
        ({}, {"post_transform": "LOGISTIC"}, None, NO_FOREST),
        ({}, {"base_values": [0.1, 0.2, 0.3]}, None, NO_FOREST),
        ({}, {}, changed("class_weights", 0, -0.1), NO_FOREST),
        ({}, {}, changed("class_weights", 0, 0.9), NO_FOREST),
        ({}, {}, mirrored, NO_FOREST),
        ({}, {}, preceded("Scaler", "ai.onnx.ml", offset=[0.0], scale=[1.0]), "node 'Scaler' .* is not supported"),
        ({}, {}, twice, NO_FOREST),
        ({}, {}, changed("nodes_truenodeids", 0, 0), NO_FOREST),
        ({}, {}, changed("nodes_truenodeids", 0, 5000), NO_FOREST),
        ({}, {}, changed("nodes_nodeids", 1, 0), NO_FOREST),
        ({}, {}, changed("nodes_featureids", 0, 20), NO_FOREST),
        ({}, {}, changed("nodes_values", 0, np.inf), NO_FOREST),
        ({}, {}, changed("class_ids", 0, -1), NO_FOREST),
        ({}, {"nodes_values": [0.5]}, None, NO_FOREST),
        ({}, {"nodes_treeids": None}, None, NO_FOREST),
        ({}, {"nodes_modes": ["LEAF"]}, None, NO_FOREST),
        ({}, {}, lambda made: setattr(made.graph.input[0].type.tensor_type.shape.dim[1], "dim_value", 0), NO_FOREST),
        ({}, {}, lambda made: setattr(made.graph.input[0].type.tensor_type.shape.dim[0], "dim_value", 1 << 40), NO_FOREST),
        ({"n_estimators": 256, "max_depth": 1}, {}, None, r"field trees: is 256; it must lie in 1\.\.255, so fit fewer"),
        ({"n_estimators": 255, "max_features": 1, "max_depth": 16}, {}, None, r"field nodes: is \d+; it must lie in 1\.\.8192, so"),
        ({}, {"classlabels_strings": ["a"] * 200_000}, None, "is beyond any that the accelerator takes; fit fewer"),
        ({}, {"classlabels_strings": ["a", "b", "c"]}, None, "has classes a, b, c and .* fit it with these as labels, or"),
        ({}, {"classlabels_strings": None, "classlabels_int64s": [1, 2, 3]}, None, "has classes 1, 2, 3 and"),
    ],
)  # fmt: skip
def test_a_forest_that_is_none_of_the_accelerator_is_refused(options, attributes, change, words, tmp_path):
    file = forest_file(grown(**options)[1], tmp_path / "net.onnx", **attributes)
    if change:
        made = onnx.load_model(file)
        change(made)
        onnx.save(made, file)
    with refused(words):
        taken(file, tmp_path)
    assert not (tmp_path / "made").exists()


def test_a_forest_of_another_array_or_of_too_many_levels_is_refused_and_one_of_doubles_is_not(tmp_path):
    file = forest_file(grown()[1], tmp_path / "net.onnx")
    for other, inputs in (({"steps": 4}, 16), ({"taxels": 20}, 100)):
        with refused(f"has 20 inputs and configuration .* asks for {inputs};"):
            taken(file, tmp_path, CONFIG.replace(**other))
    made = onnx.load(file)
    made.graph.input[0].type.tensor_type.elem_type = TensorProto.DOUBLE
    onnx.save(made, file)
    assert taken(file, tmp_path).config.forest.trees == 8
    levels = np.arange(40.0)[:, None]
    ladder = DecisionTreeClassifier(max_leaf_nodes=40).fit(
        np.repeat(levels, 20, axis=1), np.arange(40) % 3, sample_weight=1e6 ** -levels[:, 0].clip(0, 40)
    )
    with refused(r"field depth: is \d\d; it must lie in 1\.\.16, so fit fewer trees or smaller ones"):
        taken(forest_file(ladder, file), tmp_path)


# ---------------------------------------------------------------------- what the file shows, and a reference
@each_row("last, batch_first, layer", [(True, True, "LSTM"), (True, False, "GRU"), (False, True, "GRU")])
def test_a_fixed_batch_is_no_number_of_steps_and_the_decision_is_the_files(
    last, batch_first, layer, tmp_path
):
    net = Net(layer, last=last, batch_first=batch_first)
    # eight touches of five steps: CONFIG has five
    file = net.saved(tmp_path, (8, 5, 4) if batch_first else (5, 8, 4))
    assert CONFIG.network.decision == "vote"
    record = import_network(file, CONFIG, out=tmp_path / "made", mean=0.0, std=1.0)
    model = FloatModel.load(tmp_path / "made")
    assert model.config.network.decision == ("last" if last else "vote")
    assert not any("is for touches of" in note for note in record["imported"]["notes"])
    x = np.random.default_rng(4).normal(size=(7, 5, 4))
    made = model.forward(x)[1]
    assert np.abs((made[:, -1] if last else made) - net.logits(x)).max() < 1e-5
    early = CONFIG.replace(decision="early", early_steps=2)  # nobody has that by default: it is a wish
    assert taken(file, tmp_path, early).config.network.decision == "early"


def test_a_reset_that_torchs_exporter_dropped_is_told_and_found_by_the_reference(tmp_path, monkeypatch, call):
    net = Net("GRU")
    made = onnx.load_model(net.saved(tmp_path))
    x = np.random.default_rng(4).normal(size=(9, 5, 4))
    logits = net.logits(x)
    np.savez(tmp_path / "last.npz", inputs=x, outputs=logits[:, -1])
    np.savez(tmp_path / "own.npz", x=x, y=logits)
    options = {"mean": 0.0, "std": 1.0}
    for name, decision in (("last", "last"), ("own", "vote")):  # two forms of a reference
        out = tmp_path / name
        record = import_network(
            tmp_path / "net.onnx", CONFIG, out=out, check=tmp_path / f"{name}.npz", **options
        )
        assert record["passed"] and record["check"]["touches"] == 9
        assert FloatModel.load(out).config.network.decision == decision
        assert not any("newer exporter" in note for note in record["imported"]["notes"])
    (gru,) = (one for one in made.graph.node if one.op_type == "GRU")
    gru.attribute.remove(next(entry for entry in gru.attribute if entry.name == "linear_before_reset"))
    onnx.save(made, tmp_path / "dropped.onnx")
    (tmp_path / "c.json").write_text(CONFIG.to_json())
    monkeypatch.chdir(tmp_path)
    asked = "import dropped.onnx --out dropped --config c.json --mean 0 --std 1".split()
    status, out, err = call(*asked, "--check", "last.npz")
    assert status == 1 and not Path("dropped").exists(), out + err
    assert all(said in out + err for said in ("linear_before_reset is 0", "none written", "newer exporter"))
    assert call(*asked)[0] == 0


def test_nothing_is_reported_of_a_users_model(tmp_path):
    """onnxruntime keeps its reports in the home folder until they are sent."""
    code = "import eskin.exchange.import_onnx as reader; reader.onnxruntime.SessionOptions()"
    unset = {name: value for name, value in os.environ.items() if name not in ("CI", "ORT_DISABLE_TELEMETRY")}
    subprocess.run([sys.executable, "-c", code], check=True, timeout=300, env=unset | {"HOME": str(tmp_path)})
    assert not [*tmp_path.rglob("*onnxruntime*")]
