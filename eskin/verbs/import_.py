"""Convert a network of another tool to a model folder. Quantise it with --data afterwards.

Example: eskin import weights.pt --out model --config c.json --cell gru --reset after --mean 0 --std 40
"""

from pathlib import Path

import numpy as np

from eskin.cli.common import Cell, Options, argument, load_data, option, recordings_for, required, show, warn
from eskin.golden.core import AcceleratorConfig, InputError, Record
from eskin.golden.core.groups import Reset
from eskin.golden.data import Recordings
from eskin.golden.model import check_model_target
from eskin.training.derive import derive_config


class ImportRequest(Options):
    file: Path = argument(
        "A torch state_dict (.pt, .pth), or an .onnx file, also of a forest of scikit-learn."
    )
    out: Path = required("Model folder: new, or an earlier model to replace.")
    config: str | None = option("Configuration of the training: a preset or a JSON file.")
    cell: Cell | None = option("Cell. Default: the .onnx file's, otherwise the configuration's.")
    reset: Reset | None = option("GRU: reset gate before or after the recurrent product.")
    mean: float | None = option("Codes subtracted from every window mean in its training.")
    std: float | None = option("Codes by which its training divided.")
    data: str | None = option("Measure mean and std on these recordings.")
    check: Path | None = option("Reference inputs and outputs (.npz) that the model must reproduce.")


def command(request: ImportRequest) -> Record:
    from eskin.exchange.import_network import ONNX_SUFFIX, import_network

    check_model_target(request.out)
    recordings: Recordings | None = None
    chosen = None if request.config is None else AcceleratorConfig.load(request.config)
    if chosen is None and request.file.suffix == ONNX_SUFFIX:
        from eskin.exchange.import_onnx import Graph

        chosen = Graph(request.file).configuration
    if chosen is None:
        if request.data is None:
            raise InputError(
                f"--config: is missing, and '{request.file}' does not define the array; give it, or --data to derive one"
            )
        recordings, _ = load_data(request.data)
        chosen, reasons = derive_config(recordings)
        for reason in reasons:
            warn(f"configuration: {reason}")
    elif request.data is not None and request.mean is None:
        recordings = recordings_for(request.data, chosen)
    record = import_network(
        request.file,
        chosen,
        out=request.out,
        cell=request.cell,
        reset=request.reset,
        mean=request.mean,
        std=request.std,
        recordings=recordings,
        check=request.check,
    )
    scale = {
        name: ", ".join(f"{value:.6g}" for value in np.atleast_1d(record["normalisation"].get(name, ())))
        for name in ("mean", "std")
    }
    show("import", **{"check": None, "passed": True} | record, **scale, out=request.out)
    return record
