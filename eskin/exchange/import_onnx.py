"""A network in an ONNX file: one GRU or LSTM in one direction and a dense layer, a dense layer alone, or a forest.

Cell, sizes and reset gate are read from the nodes of the file. Then its graph is computed on random
inputs and compared with the network that was read: nodes that only move values are not believed, so a readout
of another step, a transposed layout or an offset is found. Only the operators below are executed from a file.
"""

import json
import math
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import onnx
import onnxruntime
from onnx import numpy_helper

from eskin.exchange.import_network import MOST_VALUES, ROLES, TOLERANCE, Network, differences, shortfalls
from eskin.exchange.onnx_file import METADATA, ORDERS
from eskin.golden.core import AcceleratorConfig, Arrays, InputError, Record
from eskin.golden.model import Float, constants_shape, run_cell
from eskin.golden.model.forest import run_forest
from eskin.training.trees import Trees

MOST_BYTES = 64 << 20
OPSETS = (7, onnx.defs.onnx_opset_version())
ACTIVATIONS = {"Sigmoid": "sigmoid", "HardSigmoid": "hard_sigmoid"}
"""Of gates; the others are Tanh."""
FOREST = "TreeEnsembleClassifier"
STANDARD = (
    *ORDERS,
    *("Gemm", "MatMul", "Add", "ConstantOfShape", "Expand", "Gather", "Concat", "Constant", "Identity"),
    *("Cast", "Shape", "Transpose", "Squeeze", "Unsqueeze", "Reshape", "Flatten", "Slice"),
)
OPERATORS = {"": STANDARD, "ai.onnx": STANDARD, "ai.onnx.ml": (FOREST, "ZipMap")}
"""All that may stand in a file, by domain; everything else is refused by its name."""
TAKEN = (
    "one GRU or LSTM in one direction and one Gemm, or MatMul and Add, behind its last step or all of its steps, "
    "a dense layer alone, or the TreeEnsembleClassifier that skl2onnx makes of a forest alone"
)
ODD = {"direction": "forward", "clip": None, "input_forget": 0, "layout": 0, "transA": 0}
"""Attributes of a layer, and what the accelerator computes."""
STATES = "sequence lengths", "an initial state", "an initial cell state", "peepholes"
"""Inputs of a recurrent layer behind its bias."""
NODE_IDS = "tree", "node", "truenode", "falsenode", "feature"


def _text(value: Any) -> Any:
    """Letters of a file, which need not be UTF-8."""
    return value.decode(errors="replace") if isinstance(value, bytes) else value


def _first_line(error: Exception) -> str:
    return f"{str(error).strip().partition(chr(10))[0]:.160}"


def _value(attribute: onnx.AttributeProto) -> Any:
    value = onnx.helper.get_attribute_value(attribute)
    return [_text(entry) for entry in value] if isinstance(value, list) else _text(value)


def node_attributes(node: onnx.NodeProto) -> Record:
    """A node's attributes by name."""
    return {attribute.name: _value(attribute) for attribute in node.attribute}


class Graph:
    """The nodes of a file, checked, and a way to compute them."""

    def __init__(self, path: Path) -> None:
        self.path = path
        if path.stat().st_size > MOST_BYTES:
            raise InputError(
                f"network '{path}': has over {MOST_BYTES >> 20} MB, beyond any that the accelerator takes"
            )
        content = path.read_bytes()
        try:
            model = onnx.load_model_from_string(content)
            versions = [*{entry.version for entry in model.opset_import if entry.domain in ("", "ai.onnx")}]
        except Exception:  # protobuf's errors have no common class of their own
            raise InputError(f"network '{path}': is damaged or no ONNX file; save it again") from None
        self.model, self.graph, self.producer = model, model.graph, _text(model.producer_name)
        if not self.graph.node:
            raise InputError(f"network '{path}': has no nodes; save {TAKEN}")
        if len(versions) != 1 or not OPSETS[0] <= versions[0] <= OPSETS[1]:
            shown = versions[0] if versions else "none"
            raise InputError(
                f"network '{path}': has opset {shown}; save it with one of {OPSETS[0]} to {OPSETS[1]}"
            )
        for node in self.graph.node:
            if node.op_type not in OPERATORS.get(node.domain, ()):
                self.refuse(node, f"is not supported; use {TAKEN}")
        self.constants = {tensor.name: self._array(tensor) for tensor in self.graph.initializer}
        try:
            onnx.checker.check_model(model)
            inferred = onnx.shape_inference.infer_shapes(model, data_prop=True).graph.value_info
        except Exception as error:
            if found := self._named(error):
                self.refuse(found, f"is not valid ONNX ({_first_line(error)}); save the network again")
            raise InputError(
                f"network '{path}': is not valid ONNX ({_first_line(error)}); save it again"
            ) from None
        for value in inferred:
            if math.prod(dim.dim_value or 1 for dim in value.type.tensor_type.shape.dim) > MOST_VALUES:
                raise InputError(
                    f"network '{path}', value '{value.name:.60}': is beyond any that the accelerator takes"
                )
        self.metadata = self._metadata()
        inputs = [value for value in self.graph.input if value.name not in self.constants]
        if len(inputs) != 1:
            names = ", ".join(value.name for value in inputs[:4]) or "none"
            raise InputError(
                f"network '{path}': has {len(inputs)} inputs ({names:.80}); save one that takes features alone"
            )
        for node in self.nodes(FOREST):  # labels, which may be text, are not computed
            del self.graph.output[:]
            self.graph.output.append(onnx.ValueInfoProto(name=node.output[-1]))
        self.input, self.kind = inputs[0].name, inputs[0].type.tensor_type.elem_type
        self.ends = self.input, *(value.name for value in self.graph.output[:1])
        self.dims = [dim.dim_value for dim in inputs[0].type.tensor_type.shape.dim]

    def refuse(self, node: onnx.NodeProto, why: str) -> NoReturn:
        """An InputError that names the node, or its first output where it has no name."""
        name, kind = (_text(word) for word in (node.name or next(iter(node.output), ""), node.op_type))
        raise InputError(f"network '{self.path}', node '{name:.60}' of type {kind:.40}: {why}")

    def _named(self, error: Exception) -> onnx.NodeProto | None:
        """The node that an error of ONNX's own tools names."""
        named = [node for node in self.graph.node if node.name and _text(node.name) in str(error)]
        return max(named, key=lambda node: len(node.name), default=None)

    def _array(self, tensor: Any) -> np.ndarray:
        where = f"network '{self.path}', tensor '{_text(tensor.name):.60}'"
        if tensor.data_location == onnx.TensorProto.EXTERNAL:
            raise InputError(f"{where}: lies in another file; save everything in one")
        if any(size < 0 for size in tensor.dims) or math.prod(tensor.dims) > MOST_VALUES:
            raise InputError(
                f"{where}: has shape {tuple(tensor.dims)!s:.60}, beyond any that the accelerator takes"
            )
        try:
            array = numpy_helper.to_array(tensor)
        except Exception:  # a damaged tensor can fail anywhere inside onnx
            raise InputError(f"{where}: is damaged; save the network again") from None
        if array.dtype.kind not in "fiub" or not np.isfinite(array).all():
            raise InputError(f"{where}: holds values that are not finite numbers; train the network again")
        return array.astype(np.float64) if array.dtype.kind == "f" else array

    def _metadata(self) -> Record:
        """config, mean and std of an exported file, else empty."""
        texts = [entry.value for entry in self.model.metadata_props if entry.key == METADATA]
        try:
            return {name: json.loads(text)[name] for text in texts for name in ("config", "mean", "std")}
        except (ValueError, KeyError, TypeError, RecursionError):
            raise InputError(
                f"network '{self.path}', metadata {METADATA}: is damaged; export the model again"
            ) from None

    @property
    def configuration(self) -> AcceleratorConfig | None:
        """The metadata of an exported file."""
        where = f"network '{self.path}'"
        return AcceleratorConfig.from_dict(self.metadata["config"], where) if self.metadata else None

    @property
    def last(self) -> onnx.NodeProto:
        """The node that gives the network's output."""
        return next((node for node in self.graph.node if self.ends[-1] in node.output), self.graph.node[-1])

    def nodes(self, *kinds: str) -> list[onnx.NodeProto]:
        return [node for node in self.graph.node if node.op_type in kinds]

    def values(self, node: onnx.NodeProto, *names: str) -> np.ndarray:
        """An attribute, by the first of ``names`` that the node has; empty if it has none."""
        attributes = {attribute.name: attribute for attribute in node.attribute}
        value = next((_value(attributes[name]) for name in names if name in attributes), ())
        return self._array(value) if isinstance(value, onnx.TensorProto) else np.asarray(value)

    def constant(self, node: onnx.NodeProto, place: int, role: str) -> np.ndarray:
        """The weights that a node takes as its input number ``place``."""
        name = node.input[place] if place < len(node.input) else ""
        makers = self.nodes("Constant", "Identity", "Transpose")
        maker = next((entry for entry in makers if name in entry.output), None)
        if maker and maker.op_type == "Constant":
            return self.values(maker, "value", "value_floats", "value_float")
        if maker:
            array = self.constant(maker, 0, role)
            axes = self.values(maker, "perm").tolist() or [*range(array.ndim)][::-1]
            if maker.op_type == "Identity":
                return array
            if sorted(axes) != [*range(array.ndim)]:
                self.refuse(maker, f"orders axes {axes} of shape {array.shape}; save the network again")
            return array.transpose(axes)
        if name not in self.constants:
            self.refuse(node, f"computes its {role}; save trained weights")
        return self.constants[name]

    def refuse_odd(self) -> None:
        """Refuse a node that computes what the accelerator has not."""
        for node in self.nodes(*ORDERS, "Gemm"):
            attributes = node_attributes(node)
            odd = [
                f"{name} {attributes[name]}" for name in ODD if attributes.get(name, ODD[name]) != ODD[name]
            ]
            given = dict(zip(STATES, node.input[4:], strict=False)) if node.op_type in ORDERS else {}
            for role, name in given.items():
                state = self.constants.get(name, np.zeros(1) if "state" in role else np.ones(1))
                odd += [role] if name and state.any() else []
            if odd:
                self.refuse(node, f"has {', '.join(odd):.80}, which the accelerator has not; save {TAKEN}")

    def compute(self, values: np.ndarray) -> list[np.ndarray]:
        """The outputs for one input, as onnxruntime computes them."""
        onnxruntime.set_default_logger_severity(4)  # what it says is in the error
        try:
            session = onnxruntime.InferenceSession(
                self.model.SerializeToString(), providers=["CPUExecutionProvider"]
            )
            kind = np.float64 if self.kind == onnx.TensorProto.DOUBLE else np.float32
            outputs = session.run(None, {self.input: values.astype(kind)})
        except Exception as error:  # onnxruntime's errors have no common class of their own
            why = f"cannot be computed on an input of shape {values.shape} ({_first_line(error)})"
            self.refuse(
                self._named(error) or self.last,
                f"{why}; save a network of float32 that takes one touch at a time",
            )
        return [np.asarray(output, dtype=np.float64) for output in outputs]


# ---------------------------------------------------------------------- what the nodes say
def scale_of(graph: Graph, config: AcceleratorConfig) -> Record | None:
    """mean, std and their source as the file keeps them; None where it keeps none."""
    if not (metadata := graph.metadata):
        return None
    try:
        values = {name: np.asarray(metadata[name], dtype=np.float64) for name in ("mean", "std")}
    except (ValueError, TypeError, OverflowError):
        raise InputError(
            f"network '{graph.path}', metadata {METADATA}: is damaged; export the model again"
        ) from None
    fit = all(value.shape == constants_shape(config) for value in values.values())
    return values | {"source": "the file"} if fit else None


def shown(
    network: Network, config: AcceleratorConfig, arrays: Arrays
) -> tuple[AcceleratorConfig, str, list[str]]:
    """``config`` with the decision that the file keeps; what shows how a touch is decided
    (`eskin.exchange.import_network.SHOWS`); sentences about what was taken. A graph that computes something else than
    ``arrays`` is refused (InputError)."""
    if network.forest:
        return config, "last", _forest_agrees(network.graph, network.forest, config, arrays)
    shows, steps = _agree(network.graph, config, arrays)
    if (own := network.graph.configuration) is not None:
        rules = {name: getattr(own.network, name) for name in ("decision", "early_margin", "early_steps")}
        shows, config = "metadata", config.replace(**rules)
    notes = []
    if network.cell == "gru":
        flag = int(network.reset == "after")
        notes.append(
            f"reset gate {network.reset} the recurrent product, as linear_before_reset is {flag} in the file"
        )
        if network.graph.producer == "pytorch" and not flag:
            notes.append(
                "every GRU of torch has linear_before_reset 1; its newer exporter is known to drop it: compare with --check, "
                "and if that fails save with torch.onnx.export(.., dynamo=False)"
            )
    if steps != config.windows.steps:
        notes.append(
            f"the file is for touches of {steps} steps, configuration '{config.name}' has {config.windows.steps}"
        )
    return config, shows, notes


def read_onnx(path: str | Path) -> Network:
    """The network of a file, its nodes and sizes checked; `shown` checks what it computes.

    Raises
    ------
    InputError
        The file is damaged, or holds something else; the sentence names the node.
    """
    graph = Graph(Path(path))
    if graph.nodes(FOREST):
        return _read_forest(graph)
    weights, bias, names = _dense(graph)
    layers = graph.nodes("GRU", "LSTM")
    if len(layers) > 1:
        graph.refuse(layers[1], "is a second recurrent layer; the accelerator has one in one direction")
    if not layers:
        arrays = {"V": weights, "b_y": bias}
        classes, columns = weights.shape
        return Network(graph.path, "linear", "before", "sigmoid", 0, classes, columns, arrays, names, graph)
    node = layers[0]
    attributes = node_attributes(node)
    gates, *others = attributes.get("activations") or ("Sigmoid", "Tanh")
    if gates not in ACTIVATIONS or {*others} != {"Tanh"}:
        shown = ", ".join(map(str, (gates, *others)))
        why = "the accelerator has Sigmoid (or HardSigmoid of slope 0.2) and Tanh"
        graph.refuse(node, f"has activations {shown:.60}; {why}")
    w, r = graph.constant(node, 1, "weights"), graph.constant(node, 2, "recurrent weights")
    if w.ndim != 3 or r.ndim != 3 or {len(w), len(r)} != {1}:
        graph.refuse(node, f"has weights of shapes {w.shape}, {r.shape}; save one direction, whole")
    order, given = ORDERS[node.op_type], dict(zip(ROLES, node.input[1:4], strict=False))
    both = graph.constant(node, 3, "bias") if given.get("bias") else np.zeros(2 * r.shape[1])
    roles = dict(zip(ROLES, (w[0], r[0], *np.array_split(both.ravel(), 2), weights, bias), strict=True))
    return Network.of_layers(
        graph.path,
        roles,
        names | given,
        {len(order): order},
        reset="after" if attributes.get("linear_before_reset", 0) else "before",
        gate_activation=ACTIVATIONS[gates],
        graph=graph,
    )


def _dense(graph: Graph) -> tuple[np.ndarray, np.ndarray, dict[str, str]]:
    """Weights (C, columns) and bias (C) of the single dense layer."""
    layers = graph.nodes("Gemm", "MatMul")
    if len(layers) != 1:
        node = layers[1] if layers else graph.graph.node[-1]
        graph.refuse(node, f"is one of {len(layers)} layers in place of a dense layer; save {TAKEN}")
    node, additions = layers[0], graph.nodes("Add")
    weights = graph.constant(node, 1, "weights")
    weights = weights if node_attributes(node).get("transB", 0) else weights.T
    holder, place = node, 2
    if additions:
        holder, place = additions[0], int(node.output[0] == additions[0].input[0])
    names = dict(zip(ROLES[4:], (node.input[1], *holder.input[place : place + 1]), strict=False))
    bias = graph.constant(holder, place, "bias") if names.get("dense bias") else np.zeros(weights.shape[:1])
    if weights.ndim != 2 or not weights.size or bias.size != len(weights):
        graph.refuse(
            node, f"has weights of shape {weights.shape} and {bias.size} biases; save one dense layer, whole"
        )
    return np.asarray(weights, dtype=np.float64), np.asarray(bias, dtype=np.float64).ravel(), names


def _agree(graph: Graph, config: AcceleratorConfig, arrays: Arrays) -> tuple[str, int]:
    """The kind of the file's outputs, logits of the ``last`` or of ``every`` step, and the steps on which
    they were computed, by random touches. Refuses a graph that computes other logits than the arrays."""
    inputs, steps = config.inputs, config.windows.steps
    sizes = {
        "batch": 1,
        "steps": steps,
        "inputs": inputs,
        "columns": inputs * (steps if config.sets > 1 else 1),
    }
    layouts: list[tuple[str, ...]] = [("batch", "columns")]
    if config.recurrent or config.sets > 1 or steps == 1:
        by_step = [("batch", "steps", "inputs"), ("steps", "batch", "inputs"), ("steps", "inputs")]
        layouts = by_step if config.recurrent else [*by_step, *layouts]
    # a recurrent network takes as many steps as the file fixes, and any network its batch
    free = ("batch", "steps") if config.recurrent else ("batch",)
    fitting = [
        (layout, {axis: dim or sizes[axis] for axis, dim in zip(layout, graph.dims, strict=True)})
        for layout in layouts
        if len(layout) == len(graph.dims)
        and all(axis in free or dim in (0, sizes[axis]) for axis, dim in zip(layout, graph.dims, strict=True))
    ]
    if not fitting:
        shapes = " or ".join(
            f"({', '.join(f'{sizes[axis]} {axis}' for axis in layout)})" for layout in layouts
        )
        raise InputError(
            f"network '{graph.path}', input '{graph.input:.60}': has shape {graph.dims}; it must be {shapes}, 0 where "
            "it is open"
        )
    rng = np.random.default_rng(1)
    failed: list[InputError] = []
    for layout, size in fitting:
        batch, touch_steps = size.get("batch", 1), size.get("steps", steps)
        if batch * touch_steps * inputs > MOST_VALUES:
            raise InputError(
                f"network '{graph.path}': takes {batch} touches of {touch_steps} steps at once; save one for a single touch of {steps}"
            )
        features = rng.normal(0.0, 1.0, (batch, touch_steps, inputs))
        given = features if config.recurrent or config.sets > 1 else features.sum(axis=1)
        if layout[0] == "steps":
            given = given.swapaxes(0, 1)
        try:
            outputs = graph.compute(given.reshape([size[axis] for axis in layout]))
        except InputError as error:
            failed.append(error)
            continue
        logits = run_cell(Float(config), config, arrays, features)[1]
        found = [differences(output, logits) for output in outputs]
        alike = [shows for far in found for shows, value in far.items() if value <= TOLERANCE]
        if alike:
            return min(alike), touch_steps
    graph.refuse_odd()
    if len(failed) == len(fitting):
        raise failed[0]
    graph.refuse(
        graph.last,
        f"gives output '{graph.ends[-1]:.60}', which is not the dense layer behind the last step, or behind every step, of "
        f"a network that begins at 0; save {TAKEN}",
    )


# ---------------------------------------------------------------------- a forest
OF_SHARES = (
    "does not add up shares of classes of (touches, inputs), as trees of scikit-learn do; convert one "
    "RandomForestClassifier, ExtraTreesClassifier or DecisionTreeClassifier alone"
)


def _read_forest(graph: Graph) -> Network:
    """The trees of a TreeEnsembleClassifier.

    ``nodes_missing_value_tracks_true``, which scikit-learn sets in any forest, counts for nothing: no feature is missing.
    """
    node, *others = graph.nodes(FOREST)
    ids = lambda *names: [graph.values(node, f"{name}ids") for name in names]
    weights, threshold = (
        graph.values(node, f"{name}_as_tensor", name) for name in ("class_weights", "nodes_values")
    )
    modes = graph.values(node, "nodes_modes")
    labels = tuple(map(str, graph.values(node, "classlabels_int64s", "classlabels_strings")))
    if {*modes} - {"BRANCH_LEQ", "LEAF"}:
        graph.refuse(
            node,
            "has modes beside BRANCH_LEQ, and the accelerator compares feature <= threshold alone; use it",
        )
    if len(modes) * len(labels) > 4 * MOST_VALUES:
        graph.refuse(node, "is beyond any that the accelerator takes; fit fewer trees or smaller ones")
    columns = math.prod(graph.dims[1:])
    try:
        tree, number, *sides, feature = np.stack(ids(*(f"nodes_{name}" for name in NODE_IDS)))
        place = {pair: row for row, pair in enumerate(zip(tree, number, strict=True))}
        find = lambda *pairs: [place[pair] for pair in zip(*pairs, strict=True)]
        rows, compares = np.arange(len(tree)), modes != "LEAF"
        children = np.stack([rows, rows], axis=1)
        children[compares] = np.stack([find(tree[compares], side[compares]) for side in sides], axis=1)
        (classes,), leaves = ids("class_"), find(*ids("class_tree", "class_node"))
        shares = np.zeros((len(tree), len(labels)))
        np.add.at(shares, (leaves, [range(len(labels)).index(each) for each in classes]), weights)
        roots = np.unique(tree, return_index=True)[1]
        if len(labels) == 2 and len({*classes}) == 1:  # of the second class, whichever is named
            shares = np.abs([1 / len(roots), 0] - shares.sum(axis=1, keepdims=True))
        sound = (
            not others
            and len(place) == len(tree) == len(threshold)
            and np.isfinite(threshold).all()
            and (children[compares] > rows[compares, None]).all()
            and np.allclose(len(roots) * shares[~compares].sum(axis=1), 1, atol=TOLERANCE)
            and columns * max(1, *graph.dims) <= MOST_VALUES
            and {*feature} <= {*range(columns)}
        )
    except (LookupError, ValueError):
        sound = False
    if not sound:
        graph.refuse(node, OF_SHARES)
    shares[compares] = 1
    forest = Trees(roots, feature, feature, threshold, children, shares)
    sizes = "trees", "before", "sigmoid", 0, len(labels), columns
    return Network(graph.path, *sizes, {}, {"trees": node.output[-1]}, graph, forest, labels)


def _forest_agrees(graph: Graph, trees: Trees, config: AcceleratorConfig, arrays: Arrays) -> list[str]:
    """A sentence about leaves of several classes. Refuses a graph whose scores of random touches are not the sums of the
    shares in its leaves."""
    threshold, size = arrays["threshold"], [graph.dims[0] or 256, *graph.dims[1:]]
    given = np.random.default_rng(1).normal(threshold.mean(), 1 + threshold.std(), size).astype(np.float32)
    features, (scores, *_) = given.reshape(size[0], -1), graph.compute(given)
    row = np.tile(trees.roots, (len(features), 1))
    for _ in range(config.forest.depth):
        values = np.take_along_axis(features, trees.feature[row], axis=1)
        row = trees.children[row, (values > trees.threshold[row]).astype(int)]
    if differences(scores, trees.shares[row].sum(axis=1)[:, None]).get("every", 1) > TOLERANCE:
        graph.refuse(graph.last, OF_SHARES)
    logits = run_forest(config, arrays, features[:, None])[1][:, 0]
    alike = (shortfalls(scores, logits) <= TOLERANCE).mean()
    why = "leaves vote for their most frequent class alone"
    return [f"{why}: {alike:.1%} of random touches are decided as by the file"] if alike < 1 else []
