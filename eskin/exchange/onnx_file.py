"""The float network as an ONNX file, and what onnxruntime makes of it."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from eskin.golden.core import Arrays, InputError, Record, replacing
from eskin.golden.model import FloatModel

OPSET, IR = 14, 8
METADATA = "eskin_model"


def onnx_model(model: FloatModel) -> onnx.ModelProto:
    """Input ``features`` (batch, K, D), normalised as `FloatModel.features` gives them; output ``logits``
    (batch, K, C) of every step, of a linear cell (batch, C) of the last. Configuration and normalisation
    stand in the file's metadata.

    Raises
    ------
    InputError
        A network for images, or a readout that is not a dense layer.
    """
    config, arrays = model.config, model.arrays
    if config.is_image:
        raise InputError(
            f"model '{config.name}': is a network for images, which export --to onnx does not take; use --to c"
        )
    if config.has_prototypes:
        raise InputError(
            f"configuration '{config.name}', field readout: is 'prototypes', which ONNX does not have; export a "
            "model with readout 'dense'"
        )
    constants = {
        "dense": arrays["V"].T if config.recurrent else _columns(model).T,
        "dense_bias": arrays["b_y"],
    }
    if config.recurrent:
        nodes, more = _recurrent(model)
        constants |= more
        nodes += [
            helper.make_node("MatMul", ["states", "dense"], ["products"], "readout"),
            helper.make_node("Add", ["products", "dense_bias"], ["by_step"], "readout_bias"),
            helper.make_node("Transpose", ["by_step"], ["logits"], "steps_behind_batch", perm=[1, 0, 2]),
        ]
        shape: list[Any] = ["batch", config.windows.steps, config.classes]
    else:
        nodes = [
            helper.make_node("Flatten", ["features"], ["columns"], "windows", axis=1),
            helper.make_node("Gemm", ["columns", "dense", "dense_bias"], ["logits"], "readout"),
        ]
        shape = ["batch", config.classes]
    tensors = [numpy_helper.from_array(values.astype(np.float32), name) for name, values in constants.items()]
    if config.recurrent:
        tensors.append(numpy_helper.from_array(np.array([1], dtype=np.int64), "direction"))
    features_info = helper.make_tensor_value_info(
        "features", TensorProto.FLOAT, ["batch", config.windows.steps, config.inputs]
    )
    logits_info = helper.make_tensor_value_info("logits", TensorProto.FLOAT, shape)
    graph = helper.make_graph(nodes, "eskin", [features_info], [logits_info], tensors)
    proto = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", OPSET)], producer_name="eskin", ir_version=IR
    )
    scale = {"mean": arrays["mu"].tolist(), "std": arrays["sigma"].tolist()}
    helper.set_model_props(proto, {METADATA: json.dumps({"config": config.to_dict()} | scale)})
    onnx.checker.check_model(proto, full_check=True)
    return proto


def _columns(model: FloatModel) -> np.ndarray:
    """A linear cell's weights (C, K D): columns window by window."""
    config = model.config
    every = np.broadcast_to(model.arrays["V"], (config.windows.steps, config.classes, config.inputs))
    return every.swapaxes(0, 1).reshape(config.classes, -1)


def _recurrent(model: FloatModel) -> tuple[list[onnx.NodeProto], Arrays]:
    """Nodes from features to ``states`` (K, batch, H), and their weights."""
    arrays, network = model.arrays, model.config.network
    lstm, after = network.cell == "lstm", network.cell == "gru" and network.reset == "after"
    gates = ("i", "o", "f", "g") if lstm else ("z", "r", "n")
    stack = lambda kind: np.concatenate([arrays[f"{kind}_{gate}"] for gate in gates])
    second = stack("bh") if after else np.zeros(len(gates) * network.hidden)
    hard = network.gate_activation == "hard_sigmoid"
    options: Record = {"hidden_size": network.hidden} | ({} if lstm else {"linear_before_reset": int(after)})
    if hard:
        options |= {"activations": ["HardSigmoid", "Tanh", *["Tanh"] * lstm]}
        options |= {"activation_alpha": [0.2], "activation_beta": [0.5]}
    nodes = [
        helper.make_node("Transpose", ["features"], ["by_step_in"], "batch_behind_steps", perm=[1, 0, 2]),
        helper.make_node(
            "LSTM" if lstm else "GRU", ["by_step_in", "W", "R", "B"], ["every"], "cell", **options
        ),
        helper.make_node("Squeeze", ["every", "direction"], ["states"], "one_direction"),
    ]
    return nodes, {
        "W": stack("W")[None],
        "R": stack("U")[None],
        "B": np.concatenate([stack("b"), second])[None],
    }


def write_onnx(model: FloatModel, path: Path) -> Path:
    """Write the file whole or not at all."""
    proto = onnx_model(model)
    with replacing(path) as temporary:
        temporary.write_bytes(proto.SerializeToString())
    return path


def largest_difference(model: FloatModel, path: Path, features: np.ndarray) -> float:
    """Between onnxruntime's logits of ``features`` (n, K, D) and the model's, at most."""
    import onnxruntime

    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    (made,) = session.run(["logits"], {"features": features.astype(np.float32)})
    logits = model.forward(features)[1]
    return float(np.abs(made - (logits if model.config.recurrent else logits[:, -1])).max(initial=0.0))
