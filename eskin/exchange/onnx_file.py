"""The float network as an ONNX file, and what onnxruntime makes of it."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import helper, numpy_helper

from eskin.golden.core import AcceleratorConfig, Arrays, InputError, replacing
from eskin.golden.model import FloatModel

OPSET, IR = 14, 8
METADATA = "eskin_model"
"""Entry in which an exported file keeps configuration and normalisation."""
ORDERS = {"GRU": ("z", "r", "n"), "LSTM": ("i", "o", "f", "g")}
"""Gates in the order in which ONNX stacks them; it calls n ``h`` and g ``c``."""


def check_exportable(config: AcceleratorConfig) -> None:
    """Refuse what ONNX does not take.

    Raises
    ------
    InputError
        A network for images, trees, or a readout that is not a dense layer.
    """
    if config.is_image:
        raise InputError(
            f"model '{config.name}': is a network for images, which export --to onnx does not take; use --to c"
        )
    if config.is_forest:
        raise InputError(
            f"configuration '{config.name}', field cell: is 'trees', which export --to onnx does not take; use --to c"
        )
    if config.has_prototypes:
        raise InputError(
            f"configuration '{config.name}', field readout: is 'prototypes', which ONNX does not have; export a "
            "model with readout 'dense'"
        )


def onnx_model(model: FloatModel) -> onnx.ModelProto:
    """Input ``features`` (batch, K, D), normalised as `FloatModel.features` gives them; output ``logits``
    (batch, K, C) of every step, of a linear cell (batch, C) of the last. Configuration and normalisation
    stand in the file's metadata.

    Raises
    ------
    InputError
        As `check_exportable`.
    """
    config, arrays = model.config, model.arrays
    check_exportable(config)
    recurrent, steps = config.recurrent, config.windows.steps
    constants = _constants(model)
    dims = f"batch, {steps}, {config.classes}" if recurrent else f"batch, {config.classes}"
    graph = onnx.parser.parse_graph(
        f"eskin (float[batch, {steps}, {config.inputs}] features) => (float[{dims}] logits) {{\n"
        + "\n".join(_recurrent(config) if recurrent else LINEAR)
        + "}"
    )
    graph.initializer.extend(numpy_helper.from_array(values, name) for name, values in constants.items())
    proto = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", OPSET)], producer_name="eskin", ir_version=IR
    )
    scale = {"mean": arrays["mu"].tolist(), "std": arrays["sigma"].tolist()}
    helper.set_model_props(proto, {METADATA: json.dumps({"config": config.to_dict()} | scale)})
    onnx.checker.check_model(proto, full_check=True)
    return proto


LINEAR = (
    "[windows] columns = Flatten <axis = 1> (features)",
    "[readout] logits = Gemm (columns, dense, dense_bias)",
)


def _recurrent(config: AcceleratorConfig) -> Iterator[str]:
    """The nodes of a recurrent network, in ONNX's textual form: [name] output = operator <attributes> (inputs)."""
    network = config.network
    kind, lstm = network.cell.upper(), network.cell == "lstm"
    options = f"hidden_size = {network.hidden}"
    if not lstm:
        options += f", linear_before_reset = {int(network.reset == 'after')}"
    if network.gate_activation == "hard_sigmoid":
        others = ', "Tanh"' * (1 + lstm)
        options += (
            f', activations = ["HardSigmoid"{others}], activation_alpha = [0.2], activation_beta = [0.5]'
        )
    yield "[batch_behind_steps] by_step_in = Transpose <perm = [1, 0, 2]> (features)"
    yield f"[cell] every = {kind} <{options}> (by_step_in, W, R, B)"
    yield "[one_direction] states = Squeeze (every, direction)"  # (K, batch, H)
    yield "[readout] products = MatMul (states, dense)"
    yield "[readout_bias] by_step = Add (products, dense_bias)"
    yield "[steps_behind_batch] logits = Transpose <perm = [1, 0, 2]> (by_step)"


def _constants(model: FloatModel) -> Arrays:
    """Weights by the names that the nodes have for them."""
    config, network, arrays = model.config, model.config.network, model.arrays
    dense = arrays["V"]
    if not config.recurrent:  # columns window by window
        every = np.broadcast_to(dense, (config.windows.steps, config.classes, config.inputs))
        dense = every.swapaxes(0, 1).reshape(config.classes, -1)
    constants = {"dense": dense.T, "dense_bias": arrays["b_y"]}
    if config.recurrent:
        gates = ORDERS[network.cell.upper()]
        w, u, b = (np.concatenate([arrays[f"{kind}_{gate}"] for gate in gates])[None] for kind in "WUb")
        after = network.cell == "gru" and network.reset == "after"
        second = [arrays[f"bh_{gate}"] if after else np.zeros(network.hidden) for gate in gates]
        constants |= {"W": w, "R": u, "B": np.concatenate([*b, *second])[None]}
    floats = {name: values.astype(np.float32) for name, values in constants.items()}
    return floats | ({"direction": np.array([1], dtype=np.int64)} if config.recurrent else {})


def write_onnx(model: FloatModel, path: Path) -> Path:
    """Write the file whole or not at all."""
    proto = onnx_model(model)
    with replacing(path) as temporary:
        temporary.write_bytes(proto.SerializeToString())
    return path


def session(path: Path) -> Any:
    """onnxruntime, with the file, on this processor."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3  # errors: it warns of inputs that may be left out
    return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])


def largest_difference(model: FloatModel, path: Path, features: np.ndarray) -> float:
    """Between onnxruntime's logits of ``features`` (n, K, D) and the model's, at most."""
    (made,) = session(path).run(["logits"], {"features": features.astype(np.float32)})
    logits = model.forward(features)[1]
    return float(np.abs(made - (logits if model.config.recurrent else logits[:, -1])).max(initial=0.0))
