"""The integer model as ONNX graphs of standard operators that compute its codes to the last bit.

docs/specification.md, sections 4 to 7, once more beside golden model, hardware and C, whose tables and formats it
takes. Codes are integers in double precision: no value passes 2**53, so every product and sum is exact in any order.
The weights stand in the files as integers, by the names of section 8.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from eskin.exchange.onnx_file import IR, METADATA, OPSET, check_exportable, session
from eskin.golden.core import Arrays, QFormat, sigmoid_table, tanh_table
from eskin.golden.model import IntegerModel
from eskin.golden.model.pipeline import decide, global_steps

TOUCH_FILE, STEP_FILE, VECTORS_FILE = "model.onnx", "step.onnx", "vectors.npz"
OF_STEPS, OF_TOUCH = ("local_cls", "local_margin"), ("cls", "margin", "step", "unsure")
DOUBLE, INTEGER, BOOL = TensorProto.DOUBLE, TensorProto.INT64, TensorProto.BOOL


class _Graph:
    """A graph in the making. A call adds a node and returns the name of its output."""

    def __init__(self, model: IntegerModel) -> None:
        self.model, self.config = model, model.config
        self._nodes: list[onnx.NodeProto] = []
        self._constants: dict[str, np.ndarray] = {}

    def __call__(self, operator: str, *inputs: Any, out: str = "", **attributes: Any) -> str:
        """``inputs``: names, or constants: floats are doubles, integers and their lists int64."""
        names = [each if isinstance(each, str) else self.constant(f"{each}", each) for each in inputs]
        out = out or f"{operator}_{len(self._nodes)}"
        outputs = [out, f"{out}_places"] if operator == "TopK" else [out]
        self._nodes.append(helper.make_node(operator, names, outputs, **attributes))
        return out

    def constant(self, name: str, value: Any) -> str:
        """A constant by its name."""
        self._constants[name] = np.asarray(value, dtype=np.float64 if isinstance(value, float) else np.int64)
        return name

    def codes(self, name: str, values: np.ndarray | None = None) -> str:
        """An array of the model, or ``values``, in double precision."""
        if name in self._constants:
            return f"{name}_real"
        constant = self.constant(name, self.model.arrays[name] if values is None else values)
        return self("Cast", constant, out=f"{name}_real", to=DOUBLE)

    def proto(self, *sizes: dict[str, Any]) -> onnx.ModelProto:
        """The file, checked: names and sizes of inputs and outputs, all int64 but ``unsure``."""
        kind = lambda name: BOOL if name == "unsure" else INTEGER
        info = helper.make_tensor_value_info
        inputs, outputs = ([info(name, kind(name), size) for name, size in names.items()] for names in sizes)
        constants = [numpy_helper.from_array(array, name) for name, array in self._constants.items()]
        graph = helper.make_graph(self._nodes, "eskin", inputs, outputs, constants)
        opset = helper.make_opsetid("", OPSET)
        proto = helper.make_model(graph, opset_imports=[opset], producer_name="eskin", ir_version=IR)
        scale = {name: self.model.arrays[name].tolist() for name in ("mean", "scale")}
        metadata = {"model_hash": self.model.model_hash, "config": self.config.to_dict()}
        helper.set_model_props(proto, {METADATA: json.dumps(metadata | scale)})
        onnx.checker.check_model(proto, full_check=True)
        return proto

    # ------------------------------------------------------------------ rows, narrowings, tables
    def narrow(self, value: str, shift: int, fmt: QFormat) -> str:
        """SAT(floor((value + half) / 2**shift))."""
        if shift:
            value = self("Floor", self("Mul", self("Add", value, 2.0 ** (shift - 1)), 2.0**-shift))
        return self("Clip", value, float(fmt.min_code), float(fmt.max_code))

    def state(self, value: str, shift: int | None = None) -> str:
        """A sum of gate x value products in the state format."""
        formats = self.config.formats
        return self.narrow(value, formats.gate_frac if shift is None else shift, formats.state_format)

    def row(self, weights: str, operand: str, addend: str, align: int = 0, shift: int = 0) -> str:
        """weights * (operand << align) + (addend << shift); the two factors are powers of two."""
        weights = self.codes(weights)
        return self("Gemm", operand, weights, addend, transB=1, alpha=2.0**align, beta=2.0**shift)

    def sigmoid(self, acc: str) -> str:
        """sig[acc], a gate."""
        return self._look_up("SIGMOID", sigmoid_table(self.config), acc, self.config.sigmoid_shift)

    def tanh(self, value: str, shift: int) -> str:
        """tanh[value], in the state format."""
        return self._look_up("TANH", tanh_table(self.config), value, shift)

    def _look_up(self, name: str, table: np.ndarray, value: str, shift: int) -> str:
        index = self("Add", self.narrow(value, shift, self.config.index_format), len(table) / 2)
        return self("Gather", self.codes(name, table), self("Cast", index, to=INTEGER))

    # ------------------------------------------------------------------ a step
    def step(self, x: str, state: tuple[str, ...], number: str | int) -> tuple[str, ...]:
        """(logits, h or sums[, c]) after the step ``number``, from 0, of features ``x``."""
        config = self.config
        if config.recurrent:
            state = (self._lstm if config.network.cell == "lstm" else self._gru)(x, *state)
            acc = self.row("V", state[0], self.codes("b_y"), shift=config.dense_bias_shift)
        else:  # the sums begin at 0: the bias is added to each logit's
            weights = self("Gather", self.codes("V"), number if config.sets > 1 else 0)
            state = (self("Gemm", x, weights, state[0], transB=1),)
            bias = self("Mul", self.codes("b_y"), 2.0**config.dense_bias_shift)
            acc = self("Add", state[0], bias)
        return self.narrow(acc, config.logit_shift, config.formats.logit_format), *state

    def _gate_row(self, gate: str, x: str, h: str) -> str:
        config = self.config
        recurrent = self.row(f"U_{gate}", h, self.codes(f"b_{gate}"), shift=config.bias_shift)
        return self.row(f"W_{gate}", x, recurrent, config.feature_align)

    def _gru(self, x: str, h: str) -> tuple[str, ...]:
        config, unit = self.config, float(self.config.gate_one)
        z, r = (self.sigmoid(self._gate_row(gate, x, h)) for gate in "zr")
        if config.network.reset == "after":
            hn = self.row("U_n", h, self.codes("bh_n"), shift=config.bias_shift)
            wx = self.row("W_n", x, self.codes("b_n"), config.feature_align, config.bias_shift)
            hn, wx = (self.state(row, config.value_shift) for row in (hn, wx))
            p = self.state(self("Add", self("Mul", r, hn), self("Mul", wx, unit)))
            n = self.tanh(p, config.state_index_shift)
        else:
            rh = self.state(self("Mul", r, h))
            n = self.tanh(self._gate_row("n", x, rh), config.tanh_shift)
        new = self("Mul", self("Sub", unit, z), n)
        return (self.state(self("Add", self("Mul", z, h), new)),)

    def _lstm(self, x: str, h: str, c: str) -> tuple[str, ...]:
        config = self.config
        i, f, o = (self.sigmoid(self._gate_row(gate, x, h)) for gate in "ifo")
        g = self.tanh(self._gate_row("g", x, h), config.tanh_shift)
        c = self.state(self("Add", self("Mul", f, c), self("Mul", i, g)))
        return self.state(self("Mul", o, self.tanh(c, config.state_index_shift))), c

    # ------------------------------------------------------------------ decisions
    def first_maximum(self, values: str) -> tuple[str, str]:
        """(index of the largest value along the last axis, lowest at a tie; its lead), int64."""
        lead = self("ReduceSum", self("Mul", self("TopK", values, [2]), [1, -1]), [-1], keepdims=0)
        return self("ArgMax", values, axis=-1, keepdims=0), lead

    def decide(self, local: str, margin: str, completed: str) -> tuple[str, str, str]:
        """(class, margin, step) of the touch; -1, 0 and -1 without a completed step."""
        network, steps = self.config.network, self.config.windows.steps
        step = self("Sub", completed, 1)
        if network.decision == "early":
            first, enough = network.early_steps - 1, self("GreaterOrEqual", margin, network.early_margin)
            part = lambda values, late: self("Slice", values, [late], [steps - first + late], [1])
            agree = part(enough, first)
            for late in range(first):
                alike = self("Equal", part(local, late), part(local, first))
                agree = self("And", agree, self("And", alike, part(enough, late)))
            agree = self("Cast", agree, to=TensorProto.INT32)
            early = self("Add", self("ArgMax", agree, axis=1, keepdims=0), first)
            is_early = self("Cast", self("ReduceMax", agree, axes=[1], keepdims=0), to=BOOL)
            step = self("Where", is_early, early, step)
        if network.decision == "vote":
            chosen = self("Equal", self("Unsqueeze", local, [2]), [*range(self.config.classes)])
            votes = self("ReduceSum", self("Cast", chosen, to=INTEGER), [1], keepdims=0)
            label, lead = self.first_maximum(votes)
            return self("Where", self("Less", step, 0), -1, label), lead, step
        at = self("Unsqueeze", self("Max", step, 0), [1])
        label, lead = (
            self("Squeeze", self("GatherElements", each, at, axis=1), [1]) for each in (local, margin)
        )
        return label, lead, step


def _state(model: IntegerModel) -> dict[str, list]:
    """Names and sizes of what goes from step to step."""
    network = model.config.network
    if not model.config.recurrent:
        return {"sums": ["batch", model.config.classes]}
    return {name: ["batch", network.hidden] for name in ("hc" if network.cell == "lstm" else "h")}


def step_graph(model: IntegerModel) -> onnx.ModelProto:
    """A step. Inputs ``features`` (batch, D), the state (``h``, of an LSTM ``c``, or a linear cell's ``sums``),
    0 at the start, and ``step``, from 0; outputs ``logits``, ``local_cls``, ``local_margin``, and each input but the
    features with ``_next``. All are codes, int64.

    Raises
    ------
    InputError
        As `check_exportable`.
    """
    check_exportable(model.config)
    graph, state, batch = _Graph(model), _state(model), ["batch"]
    real = [graph("Cast", name, to=DOUBLE) for name in ("features", *state)]
    logits, *after = graph.step(real[0], tuple(real[1:]), "step")
    for name, value in zip(("logits", *(f"{name}_next" for name in state)), (logits, *after), strict=True):
        graph("Cast", value, out=name, to=INTEGER)
    graph("Add", "step", 1, out="step_next")
    for name, value in zip(OF_STEPS, graph.first_maximum("logits"), strict=True):
        graph("Identity", value, out=name)
    inputs = {"features": ["batch", model.config.inputs]} | state | {"step": []}
    outputs = {"logits": ["batch", model.config.classes], "local_cls": batch, "local_margin": batch}
    return graph.proto(
        inputs, outputs | {f"{name}_next": size for name, size in (state | {"step": []}).items()}
    )


def touch_graph(model: IntegerModel) -> onnx.ModelProto:
    """A whole touch, step behind step without a loop. Inputs ``features`` (batch, K, D) and ``completed`` (batch),
    the windows that count, all by default; outputs ``logits`` (batch, K, C), ``local_cls`` and ``local_margin``
    (batch, K), and of the touch ``cls``, ``margin``, ``step`` and ``unsure`` (batch). Numbers are codes, int64; -1
    and 0: no decision.

    Raises
    ------
    InputError
        As `check_exportable`.
    """
    check_exportable(model.config)
    graph, config = _Graph(model), model.config
    steps, classes = config.windows.steps, config.classes
    real = graph("Cast", "features", to=DOUBLE)
    state = tuple(
        graph.codes(f"{name}_start", np.zeros((1, size))) for name, (_, size) in _state(model).items()
    )
    by_step = []
    for number in range(steps):
        logits, *after = graph.step(graph("Gather", real, number, axis=1), state, number)
        state = tuple(after)
        by_step.append(logits)
    every = graph("Reshape", graph("Concat", *by_step, axis=1), [0, steps, classes])
    logits = graph("Cast", every, out="logits", to=INTEGER)
    count = graph("Expand", "completed", graph("Slice", graph("Shape", "features"), [0], [1]))
    counts = graph("Less", [*range(steps)], graph("Unsqueeze", count, [1]))
    local, margin = graph.first_maximum(logits)
    local = graph("Where", counts, local, -1, out="local_cls")
    margin = graph("Where", counts, margin, 0, out="local_margin")
    made = graph.decide(local, margin, count)
    for name, value in zip(OF_TOUCH, made, strict=False):
        graph("Identity", value, out=name)
    graph("Less", "margin", config.network.margin_threshold, out="unsure")
    graph.constant("completed", [steps])  # an input with a value is one that may be left out
    inputs = {"features": ["batch", steps, config.inputs], "completed": ["touches"]}
    outputs = {"logits": ["batch", steps, classes]} | {name: ["batch", steps] for name in OF_STEPS}
    return graph.proto(inputs, outputs | {name: ["batch"] for name in OF_TOUCH})


def expected(model: IntegerModel, features: np.ndarray, completed: np.ndarray) -> Arrays:
    """Inputs and outputs of `touch_graph` by the golden model: codes of features (n, K, D), of which ``completed``
    (n) steps count."""
    config, logits = model.config, model.forward(features)[1]
    local, margin, label, lead = decide(config, logits, completed)
    inputs = {"features": features, "completed": completed}
    of_step = {"logits": logits, "local_cls": local, "local_margin": margin}
    step, unsure = global_steps(config, local, margin, completed), lead < config.network.margin_threshold
    return inputs | of_step | {"cls": label, "margin": lead, "step": step, "unsure": unsure}


def differences(folder: Path, vectors: Arrays) -> tuple[int, int]:
    """(values that onnxruntime computes of `expected`'s inputs from both files, how many are others)."""
    touch, step = (session(folder / name) for name in (TOUCH_FILE, STEP_FILE))
    features, inputs = vectors["features"], {name: vectors[name] for name in ("features", "completed")}
    names = [each.name for each in touch.get_outputs()]
    pairs = [(vectors[name], values) for name, values in zip(names, touch.run(names, inputs), strict=True)]
    state = {
        each.name: np.zeros([len(features), *each.shape[1:]] if each.shape else [], dtype=np.int64)
        for each in step.get_inputs()[1:]
    }
    for number in range(features.shape[1]):
        inputs = {"features": features[:, number]} | state
        logits, *after = step.run(["logits", *(f"{name}_next" for name in state)], inputs)
        state = dict(zip(state, after, strict=True))
        pairs.append((vectors["logits"][:, number], logits))
    return sum(due.size for due, _ in pairs), sum(int((due != made).sum()) for due, made in pairs)
