"""A file that left the project is known by its numbers: a weight that differs by one, in the model or in the file, is
named, whatever the file says of itself."""

import json
import re
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import numpy_helper

from eskin.exchange import certificate
from eskin.exchange.onnx_file import write_onnx
from eskin.golden.model import IntegerModel
from eskin.rtl.fpga.generate import contents, generate, write_contents
from eskin.verbs.export import export_c, export_exact
from tests.eskin.exchange.test_onnx_file import CONFIG, EXACT
from tests.eskin.exchange.test_onnx_file import model_of as float_model
from tests.eskin.exchange.test_plain_c import IMAGES
from tests.support.image_scenes import random_image_model
from tests.support.random_models import random_integer_model
from tests.support.table import each_row, refused

KINDS = EXACT | {"trees": {"cell": "trees", "decision": "last"}}
MODEL = random_integer_model(CONFIG, 1)
certify = partial(certificate.certify, contents=contents)


def export(model: IntegerModel, folder: Path) -> None:
    """Every file by which the model is known, on two lanes."""
    if not (model.config.is_image or model.config.network.cell == "trees"):  # which ONNX does not have
        export_exact(model, folder / "onnx")
    export_c(model, folder / "c", prefix="mine")
    config = model.config.with_lanes(2)
    generate(config, model.arrays, folder / "design")
    (folder / "board").mkdir()
    write_contents(folder / "board", contents(config, model.arrays))
    (folder / "board" / "build.json").write_text(json.dumps({"model_hash": model.model_hash}))
    model.save(folder / "model")


def known_files(folder: Path) -> list[Path]:
    """The files that `export` wrote."""
    known = (".onnx", "_model.h", "_model.c", "build.json", "config.json")
    board = folder / "board" / "config.json"
    return [path for path in sorted(folder.rglob("*")) if path.name.endswith(known) and path != board]


@pytest.fixture(scope="module")
def exports(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("exports")
    export(MODEL, folder)
    return folder


@pytest.fixture
def exported(exports, tmp_path) -> Path:
    """The files of MODEL, to be damaged."""
    return shutil.copytree(exports, tmp_path / "exported")


@pytest.mark.parametrize("kind", [*KINDS, "images"])
def test_a_model_is_known_and_a_weight_more_is_named(kind, tmp_path, monkeypatch):
    for name in ("Accelerator", "verilog"):  # no number is read from Verilog
        monkeypatch.setattr(f"eskin.rtl.fpga.generate.{name}", lambda *_: "")
    model = (
        random_image_model(IMAGES, 1)
        if kind == "images"
        else random_integer_model(CONFIG.replace(**KINDS[kind]), 1)
    )
    export(model, tmp_path)
    files = known_files(tmp_path)
    assert len(files) == 7 - 2 * (kind in ("images", "trees"))
    for file in files:
        same = certify(model, file)
        assert same.passed and not same.differences and same.values > 20, (file, same)
    names = [*model.arrays]
    for number, name in enumerate(names + [names[-1]] * (len(files) - len(names))):
        file, values = files[number % len(files)], model.arrays[name]
        place = tuple(np.random.default_rng(2).integers(0, values.shape)) if values.shape else ()
        if name == "vote":  # of a leaf
            place = tuple(np.argwhere(model.arrays["child"] < 0)[0])
        changed = np.array(values)
        changed[place] += -1 if values[place] > 0 else 1
        found = certify(replace(model, arrays=model.arrays | {name: changed}), file)
        assert not found.passed and found.model_hash != model.model_hash
        # the hash, and the value's own place
        assert len(found.differences) > 1 and "there and" in found.differences[-1], (file, name, found)


def test_a_weight_of_the_file_is_named(exported):
    """Each file is changed in one number, its line of the hash is left as it is."""
    for file in known_files(exported):
        if file.suffix == ".c":
            continue
        numbers = file.with_name("load.hex")
        if file.suffix == ".onnx":
            proto = onnx.load(file)
            weights = next(each for each in proto.graph.initializer if each.name == "W_z")
            values = np.array(numpy_helper.to_array(weights))
            values[1, 2] += 1
            weights.CopyFrom(numpy_helper.from_array(values, "W_z"))
            onnx.save(proto, file)
            expected = r"W_z\[1, 2\]: is -?\d+ there and -?\d+ in the model"
        elif file.suffix == ".h":  # its tables stand in the source beside it
            source = file.with_suffix(".c")
            flipped = lambda found: f"{found[1]}{int(found[2]) ^ 1}"
            source.write_text(re.sub(r"( W\[.*\n[^-\d]*)(-?\d+)", flipped, source.read_text(), count=1))
            expected = r"W\[\d+\]: is"
        elif numbers.exists():
            lines = numbers.read_text().split()
            numbers.write_text("\n".join([*lines[:4], f"{int(lines[4], 16) ^ 1:06x}", *lines[5:]]))
            expected = r"load.hex, word\[4\]: is"
        else:
            arrays = MODEL.arrays | {"V": MODEL.arrays["V"] ^ 1}
            np.savez(file.with_name("weights.npz"), **arrays)
            expected = r"V\[0, 0\]: is"
        found = certify(MODEL, file)
        assert not found.passed and re.match(expected, found.differences[0]), (file, found)


def test_lines_nodes_and_fields_count(exported):
    board = exported / "board" / "build.json"
    board.write_text(json.dumps({"model_hash": "0" * 32}))
    assert certify(MODEL, board).differences[0].startswith("model_hash: is 000")
    other = replace(MODEL, config=MODEL.config.replace(margin_threshold=7))
    for file in (exported / "onnx" / "model.onnx", exported / "design" / "config.json"):
        assert "field margin_threshold: is 0 there and 7 in the model" in certify(other, file).differences
    source = exported / "c" / "mine_model.c"
    source.write_text(source.read_text().replace(">", ">=", 1))
    assert "line" in certify(MODEL, source).differences[0]
    file = exported / "onnx" / "model.onnx"
    proto = onnx.load(file)
    next(node for node in proto.graph.node if node.op_type == "Floor").op_type = "Ceil"
    onnx.save(proto, file)
    assert "nodes" in certify(MODEL, file).differences[0]


@each_row(
    "name, sentence",
    [
        ("nothing.onnx", "is not a file"),
        ("some/readme.txt", "known by"),
        ("net.onnx", "the float network"),
        ("bad/model.onnx", "not an ONNX file of eskin"),
        ("bad/build.json", "build.json: cannot be read"),
    ],
)
def test_other_files_are_refused(name, sentence, tmp_path):
    for folder in ("some", "bad"):
        (tmp_path / folder).mkdir()
    for file in ("some/readme.txt", "bad/model.onnx", "bad/build.json"):
        (tmp_path / file).write_text("no")
    (tmp_path / "bad" / "config.json").write_text(CONFIG.to_json())
    write_onnx(float_model(CONFIG), tmp_path / "net.onnx")
    with refused(sentence):
        certify(MODEL, tmp_path / name)
