"""Write a model for other tools, with a check.

Example: eskin export model --to c --out controller, or eskin export model --to onnx --exact --out net
"""

from pathlib import Path
from typing import Any, Literal

import numpy as np

from eskin.cli.common import ModelOptions, integer_model, option, required, show
from eskin.exchange import plain_c
from eskin.golden.core import (
    PREFIX,
    InputError,
    Record,
    check_folder,
    check_prefix,
    prefixed,
    replacing_folder,
)
from eskin.golden.data import Recordings
from eskin.golden.model import FloatModel, IntegerModel, images_of, run_images
from eskin.training.made_up import random_images
from eskin.verbs.generate import played


class ExportRequest(ModelOptions):
    to: Literal["c", "onnx"] = required("c: integer model as C99; onnx: float network.")
    out: Path = required("Folder to write: new, or an earlier export to replace.")
    prefix: str | None = option("C: prefix of all names. Default: eskin.")
    exact: bool = option("ONNX: the integer network, to the last bit.", False, "--exact")


def command(request: ExportRequest) -> Record:
    if request.exact and request.to == "c":
        raise InputError("--exact: belongs to --to onnx, and C is exact without it; leave it out")
    if request.to == "c":
        prefix = PREFIX if request.prefix is None else request.prefix
        result = export_c(integer_model(request.model), request.out, prefix=prefix)
    elif request.prefix is not None:
        raise InputError("--prefix: belongs to --to c; leave it out")
    elif request.exact:
        result = export_exact(integer_model(request.model), request.out)
    else:
        result = export_onnx(FloatModel.load(request.model, images=True), request.out)
    show("export", to=request.to, **result)
    return result


def export_c(
    model: IntegerModel, out: Path, *, recordings: Recordings | None = None, prefix: str = PREFIX
) -> Record:
    """Write the model as plain C into ``out``, new or an earlier exported folder, whole or not at all.

    Parameters
    ----------
    recordings:
        What eskin_check plays; default: made-up ones that reach a decision, or images.
    prefix:
        Begins the names of files and of all that they declare, so that several models go into one program.

    Returns
    -------
    dict
        out, prefix, decisions (that eskin_check compares).
    """
    check_folder(out, prefixed(plain_c.HEADER, check_prefix("--prefix", prefix)))
    files = plain_c.sources(model, prefix)
    samples, lengths, calls = _vectors(model, recordings)
    files |= plain_c.check_sources(model.config, samples, lengths, calls, prefix)
    with replacing_folder(out) as folder:
        for name, text in files.items():
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_text(text)
    return {"out": str(out), "prefix": prefix, "decisions": sum(map(len, calls))}


ONNX_FILE = "model.onnx"
ONNX_LIMIT = 1e-5
"""Allowed difference, as a share of the largest logit, or of 1 if that is less: single precision in
another order."""


def export_onnx(model: FloatModel, out: Path) -> Record:
    """Write the float network as ONNX into ``out``, new or an earlier exported folder, and compare what
    onnxruntime makes of it.

    Returns
    -------
    dict
        file, parameters, touches (of random features, that are compared), difference (largest of a logit), limit,
        passed.
    """
    from eskin.exchange.onnx_file import largest_difference, write_onnx

    check_folder(out, ONNX_FILE)
    config = model.config
    features = np.random.default_rng(1).normal(size=(100, config.windows.steps, config.inputs))
    with replacing_folder(out) as folder:
        difference = largest_difference(model, write_onnx(model, folder / ONNX_FILE), features)
    limit = ONNX_LIMIT * max(1.0, float(np.abs(model.forward(features)[1]).max(initial=0.0)))
    return {
        "file": str(out / ONNX_FILE),
        "parameters": config.parameter_count,
        "touches": len(features),
        "difference": difference,
        "limit": limit,
        "passed": difference <= limit,
    }


def export_exact(model: IntegerModel, out: Path) -> Record:
    """Write the integer network as ONNX into ``out``, new or an earlier exported folder: a whole touch, a step, and
    inputs with all that the golden model makes of them. Compare what onnxruntime makes of them.

    Returns
    -------
    dict
        file, step_file, vectors, parameters, touches (with random features, some cut short), values (compared),
        different, passed.
    """
    from eskin.exchange import exact_onnx

    check_folder(out, ONNX_FILE)
    config, rng = model.config, np.random.default_rng(1)
    files = {ONNX_FILE: exact_onnx.touch_graph(model), exact_onnx.STEP_FILE: exact_onnx.step_graph(model)}
    features = config.formats.feature_format.quantise(
        rng.normal(size=(100, config.windows.steps, config.inputs))
    )
    vectors = exact_onnx.expected(model, features, rng.integers(0, config.windows.steps, 100, endpoint=True))
    with replacing_folder(out) as folder:
        for name, graph in files.items():
            (folder / name).write_bytes(graph.SerializeToString())
        np.savez(folder / exact_onnx.VECTORS_FILE, allow_pickle=False, **vectors)
        values, different = exact_onnx.differences(folder, vectors)
    return {
        "file": str(out / ONNX_FILE),
        "step_file": str(out / exact_onnx.STEP_FILE),
        "vectors": str(out / exact_onnx.VECTORS_FILE),
        "parameters": config.parameter_count,
        "touches": len(features),
        "values": values,
        "different": different,
        "passed": not different,
    }


def _vectors(model: IntegerModel, recordings: Recordings | None) -> tuple[np.ndarray, Any, Any]:
    """Samples, frames of each recording, and the expected answer to every call."""
    config = model.config
    if config.is_image:
        images = random_images(config, 8, 1) if recordings is None else images_of(recordings)
        return (
            images.reshape(len(images), -1),
            [1] * len(images),
            plain_c.expected_of_images(run_images(model, images)),
        )
    shown, trace = played(model, recordings, cut_short=True)
    return shown.samples, shown.lengths.tolist(), plain_c.expected(trace, shown)
