"""A network in an ONNX file: one GRU or LSTM in one direction and a dense layer, or a dense layer alone.

Cell, sizes and reset gate are read from the nodes of the file. Then its graph is computed on random
inputs and compared with the network that was read: nodes that only move values are not believed, so a readout
of another step, a transposed layout or an offset is found. Only the operators below are executed from a file.
"""

import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import onnx
import onnxruntime
from onnx import numpy_helper

from eskin.exchange.network import Network, fitted
from eskin.exchange.reference import TOLERANCE, differences
from eskin.exchange.torch_files import MOST_VALUES, check_readable
from eskin.golden.core import AcceleratorConfig, Arrays, InputError, Record
from eskin.golden.model import Float, constants_shape, run_cell

METADATA = "eskin_model"
"""Entry in which an exported file keeps configuration and normalisation."""
MOST_BYTES = 64 << 20
OPSETS = (7, onnx.defs.onnx_opset_version())
GATES = {"GRU": ("z", "r", "n"), "LSTM": ("i", "o", "f", "g")}
"""In the order in which ONNX stacks them; it calls n ``h`` and g ``c``."""
ACTIVATIONS = {
    ("Sigmoid", "Tanh"): "sigmoid",
    ("Sigmoid", "Tanh", "Tanh"): "sigmoid",
    ("HardSigmoid", "Tanh"): "hard_sigmoid",
    ("HardSigmoid", "Tanh", "Tanh"): "hard_sigmoid",
}
OPERATORS = (
    *GATES,
    *("Gemm", "MatMul", "Add", "ConstantOfShape", "Expand", "Gather", "Concat", "Constant", "Identity"),
    *("Cast", "Shape", "Transpose", "Squeeze", "Unsqueeze", "Reshape", "Flatten", "Slice"),
)
"""All that may stand in a file; everything else is refused by its name."""
TAKEN = (
    "one GRU or LSTM in one direction and one Gemm, or MatMul and Add, behind its last step or all of its steps, "
    "or a dense layer alone"
)


def _text(value: Any) -> Any:
    """Letters of a file, which need not be UTF-8."""
    return value.decode(errors="replace") if isinstance(value, bytes) else value


def _first_line(error: Exception) -> str:
    return f"{str(error).strip().partition(chr(10))[0]:.160}"


def node_attributes(node: onnx.NodeProto) -> Record:
    """A node's attributes by name."""
    values = {entry.name: onnx.helper.get_attribute_value(entry) for entry in node.attribute}
    return {
        name: [_text(entry) for entry in value] if isinstance(value, list) else _text(value)
        for name, value in values.items()
    }


class Graph:
    """The nodes of a file, checked, and a way to compute them."""

    def __init__(self, path: Path) -> None:
        self.path = path
        check_readable(path)
        if path.stat().st_size > MOST_BYTES:
            raise InputError(
                f"network '{path}': has over {MOST_BYTES >> 20} MB, beyond any that the accelerator takes"
            )
        try:
            model = onnx.load_model_from_string(path.read_bytes())
            versions = [entry.version for entry in model.opset_import if entry.domain in ("", "ai.onnx")]
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
            if node.domain not in ("", "ai.onnx") or node.op_type not in OPERATORS:
                self.refuse(node, f"is not supported; use {TAKEN}")
        self.constants = {tensor.name: self._array(tensor) for tensor in self.graph.initializer}
        try:
            onnx.checker.check_model(model)
            inferred = onnx.shape_inference.infer_shapes(model, data_prop=True).graph.value_info
        except Exception as error:
            raise InputError(
                f"network '{path}': is not valid ONNX ({_first_line(error)}); save it again"
            ) from None
        for value in inferred:
            if math.prod(dim.dim_value or 1 for dim in value.type.tensor_type.shape.dim) > MOST_VALUES:
                raise InputError(
                    f"network '{path}', value '{value.name:.60}': is beyond any that the accelerator takes"
                )
        self.metadata = {entry.key: entry.value for entry in model.metadata_props}
        inputs = [value for value in self.graph.input if value.name not in self.constants]
        if len(inputs) != 1:
            names = ", ".join(value.name for value in inputs[:4]) or "none"
            raise InputError(
                f"network '{path}': has {len(inputs)} inputs ({names:.80}); save one that takes features alone"
            )
        self.input = inputs[0].name
        self.ends = self.input, *(value.name for value in self.graph.output[:1])
        self.dims = [dim.dim_value for dim in inputs[0].type.tensor_type.shape.dim]

    def refuse(self, node: onnx.NodeProto, why: str) -> NoReturn:
        """An InputError that names the node, or its first output where it has no name."""
        name, kind = (_text(word) for word in (node.name or next(iter(node.output), ""), node.op_type))
        raise InputError(f"network '{self.path}', node '{name:.60}' of type {kind:.40}: {why}")

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

    def nodes(self, *kinds: str) -> list[onnx.NodeProto]:
        return [node for node in self.graph.node if node.op_type in kinds]

    def constant(self, node: onnx.NodeProto, place: int, role: str) -> np.ndarray:
        """The weights that a node takes as its input number ``place``."""
        name = node.input[place] if place < len(node.input) else ""
        by_node = {output: entry for entry in self.nodes("Constant") for output in entry.output}
        if name in by_node:
            value = node_attributes(by_node[name]).get("value")
            return self._array(value) if isinstance(value, onnx.TensorProto) else np.asarray(value)
        if name not in self.constants:
            self.refuse(node, f"computes its {role}; save trained weights")
        return self.constants[name]

    def compute(self, values: np.ndarray) -> list[np.ndarray]:
        """The outputs for one input, as onnxruntime computes them."""
        onnxruntime.set_default_logger_severity(4)  # what it says is in the error
        try:
            session = onnxruntime.InferenceSession(
                self.model.SerializeToString(), providers=["CPUExecutionProvider"]
            )
            outputs = session.run(None, {self.input: values.astype(np.float32)})
        except Exception as error:  # onnxruntime's errors have no common class of their own
            raise InputError(
                f"network '{self.path}': cannot be computed on an input of shape {values.shape} ({_first_line(error)}); "
                "save a network that takes one touch at a time"
            ) from None
        return [np.asarray(output, dtype=np.float64) for output in outputs]


# ---------------------------------------------------------------------- what the nodes say
@dataclass(frozen=True)
class OnnxNetwork(Network):
    """Also the graph, and the metadata of an exported file, else empty."""

    graph: Graph
    metadata: Record = field(default_factory=dict)

    def scale(self, config: AcceleratorConfig) -> Record | None:
        """mean, std and their source as an exported file keeps them; None where it keeps none of this
        configuration's."""
        if not self.metadata:
            return None
        try:
            values = {name: np.asarray(self.metadata[name], dtype=np.float64) for name in ("mean", "std")}
        except (ValueError, TypeError, OverflowError):
            raise InputError(
                f"network '{self.path}', metadata {METADATA}: is damaged; export the model again"
            ) from None
        shape = constants_shape(config)
        return (
            values | {"source": "the file"}
            if all(value.shape == shape for value in values.values())
            else None
        )


def embedded_configuration(path: str | Path) -> AcceleratorConfig | None:
    """The configuration that an exported file keeps; None where it keeps none."""
    values = read_onnx(path).metadata
    return AcceleratorConfig.from_dict(values["config"], f"network '{path}'") if values else None


def read_onnx(path: str | Path) -> OnnxNetwork:
    """The network of a file, its nodes and sizes checked; `agree` checks what it computes.

    Raises
    ------
    InputError
        The file is damaged, or holds something else; the sentence names the node.
    """
    graph = Graph(Path(path))
    weights, bias, names = _dense(graph)
    layers = graph.nodes("GRU", "LSTM")
    if len(layers) > 1:
        graph.refuse(layers[1], "is a second recurrent layer; the accelerator has one in one direction")
    metadata = _metadata(graph)
    if not layers:
        arrays = {"V": weights, "b_y": bias}
        classes, columns = weights.shape
        linear = ("linear", "before", "sigmoid", 0, classes, columns)
        return OnnxNetwork(graph.path, *linear, arrays, names, graph, metadata)
    node = layers[0]
    attributes, order = node_attributes(node), GATES[node.op_type]
    activations = tuple(attributes.get("activations", ("Sigmoid", "Tanh")))
    slopes = (attributes.get("activation_alpha") or [0.2])[:1] + (attributes.get("activation_beta") or [0.5])[
        :1
    ]
    if activations not in ACTIVATIONS or (
        activations[0] == "HardSigmoid" and not np.allclose(slopes, (0.2, 0.5))
    ):
        shown = ", ".join(map(str, activations))
        graph.refuse(
            node,
            f"has activations {shown:.60}; the accelerator has Sigmoid (or HardSigmoid of slope 0.2) and Tanh",
        )
    w, r = graph.constant(node, 1, "weights"), graph.constant(node, 2, "recurrent weights")
    hidden = r.shape[-1] if r.ndim == 3 else 0
    rows = len(order) * hidden
    b = graph.constant(node, 3, "bias") if len(node.input) > 3 and node.input[3] else np.zeros((1, 2 * rows))
    shaped = hidden and w.ndim == 3 and w.shape[:2] == (1, rows) and r.shape == (1, rows, hidden)
    if not shaped or b.shape != (1, 2 * rows) or not w.shape[2]:
        graph.refuse(
            node,
            f"has weights of shapes {w.shape}, {r.shape}, {b.shape}, which do not match; save one direction, whole",
        )
    if weights.shape[1] != hidden:
        graph.refuse(
            graph.nodes("Gemm", "MatMul")[0],
            f"takes {weights.shape[1]} values and the recurrent layer has {hidden} units; it must follow one step",
        )
    after = bool(attributes.get("linear_before_reset", 0))
    arrays = {"V": weights, "b_y": bias}
    for k, gate in enumerate(order):
        part = slice(k * hidden, (k + 1) * hidden)
        first, second = b[0, :rows][part], b[0, rows:][part]
        arrays |= {f"W_{gate}": w[0, part], f"U_{gate}": r[0, part]}
        arrays |= {f"b_{gate}": first, f"bh_{gate}": second} if after else {f"b_{gate}": first + second}
    names |= {"input": node.input[1], "recurrent": node.input[2]} | (
        {"bias": node.input[3]} if len(node.input) > 3 else {}
    )
    reset = "after" if after else "before"
    sizes = hidden, len(weights), w.shape[2]
    of_nodes = (node.op_type.lower(), reset, ACTIVATIONS[activations], *sizes)
    return OnnxNetwork(graph.path, *of_nodes, arrays, names, graph, metadata)


def _dense(graph: Graph) -> tuple[np.ndarray, np.ndarray, dict[str, str]]:
    """Weights (C, columns) and bias (C) of the one dense layer."""
    layers = graph.nodes("Gemm", "MatMul")
    if len(layers) != 1:
        node = layers[1] if layers else graph.graph.node[-1]
        graph.refuse(node, f"is one of {len(layers)} layers in place of a dense layer; save {TAKEN}")
    node, additions = layers[0], graph.nodes("Add")
    weights, attributes = graph.constant(node, 1, "weights"), node_attributes(node)
    names = {"dense": node.input[1]}
    if node.op_type == "Gemm":
        if additions or attributes.get("alpha", 1.0) != 1.0 or attributes.get("beta", 1.0) != 1.0:
            graph.refuse(
                additions[0] if additions else node,
                "scales or adds to the logits; save plain weights and bias",
            )
        weights = weights if attributes.get("transB", 0) else weights.T
        bias = graph.constant(node, 2, "bias") if len(node.input) > 2 else np.zeros(len(weights))
        names |= {"dense bias": node.input[2]} if len(node.input) > 2 else {}
    else:
        weights = weights.T
        if len(additions) > 1:
            graph.refuse(additions[1], "is a second addition; the dense layer has one bias")
        bias = np.zeros(len(weights) if weights.ndim else 0)
        if additions:
            place = 1 if node.output[0] == additions[0].input[0] else 0
            bias = graph.constant(additions[0], place, "bias")
            names = names | {"dense bias": additions[0].input[place]}
    if weights.ndim != 2 or not weights.size or bias.size != len(weights):
        graph.refuse(
            node, f"has weights of shape {weights.shape} and {bias.size} biases; save one dense layer, whole"
        )
    return np.asarray(weights, dtype=np.float64), np.asarray(bias, dtype=np.float64).ravel(), names


def _metadata(graph: Graph) -> Record:
    if METADATA not in graph.metadata:
        return {}
    try:
        values = json.loads(graph.metadata[METADATA])
        return {"config": values["config"], "mean": values["mean"], "std": values["std"]}
    except (ValueError, KeyError, TypeError, RecursionError):
        raise InputError(
            f"network '{graph.path}', metadata {METADATA}: is damaged; export the model again"
        ) from None


# ---------------------------------------------------------------------- into a model
def convert_onnx(
    network: OnnxNetwork, config: AcceleratorConfig, cell: str | None, reset: str | None
) -> tuple[AcceleratorConfig, dict[str, np.ndarray], str, list[str]]:
    """``config`` with cell and sizes of the file, and the decision that its metadata keep; the float network's
    arrays; which logits the file gives, of the ``last`` or of ``every`` step, or ``metadata``; sentences about what
    was taken. ``cell`` and ``reset``: as for `fitted`.

    Raises
    ------
    InputError
        It is another network than said, of another array or task, or the graph computes something else.
    """
    config, arrays = fitted(network, config, cell, reset)
    shows, steps = _agree(network, config, arrays)
    if network.metadata:
        where = f"network '{network.path}'"
        shows, own = "metadata", AcceleratorConfig.from_dict(network.metadata["config"], where).network
        kept = {name: getattr(own, name) for name in ("decision", "early_margin", "early_steps")}
        try:
            config = config.replace(**kept)
        except InputError as error:
            raise InputError(f"{where}: {error}") from None
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
    return config, arrays, shows, notes


def _agree(network: OnnxNetwork, config: AcceleratorConfig, arrays: Arrays) -> tuple[str, int]:
    """The kind of the file's outputs, logits of the ``last`` or of ``every`` step, and the steps on which
    they were computed, by random touches. Refuses a graph that computes other logits than the arrays."""
    graph, inputs, steps = network.graph, config.inputs, config.windows.steps
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
        batch, taken = size.get("batch", 1), size.get("steps", steps)
        if batch * taken * inputs > MOST_VALUES:
            raise InputError(
                f"network '{graph.path}': takes {batch} touches of {taken} steps at once; save one for a single touch of {steps}"
            )
        features = rng.normal(0.0, 1.0, (2, batch, taken, inputs))
        shown = features if config.recurrent or config.sets > 1 else features.sum(axis=2)
        if layout[0] == "steps":
            shown = shown.swapaxes(1, 2)
        try:
            computed = [graph.compute(touches.reshape([size[axis] for axis in layout])) for touches in shown]
        except InputError as error:
            failed.append(error)
            continue
        logits = run_cell(Float(config), config, arrays, features)[1]
        found = [_shown(outputs, own) for outputs, own in zip(computed, logits, strict=True)]
        if None not in found:
            return str(found[0]), taken
    if len(failed) == len(fitting):
        raise failed[0]
    raise InputError(
        f"network '{graph.path}', output '{graph.ends[-1]:.60}': is not the dense layer behind the last step, or behind every "
        f"step, of a network that begins at 0; save {TAKEN}"
    )


def _shown(outputs: list[np.ndarray], logits: np.ndarray) -> str | None:
    """``every`` where an output has the logits of every step, else ``last``; None where none has them."""
    alike = {
        shows
        for output in outputs
        for shows, difference in differences(output, logits).items()
        if difference <= TOLERANCE
    }
    return min(alike, default=None)
