"""`eskin compare` on networks for images: layer by layer, signal by signal, from the command line to the
page."""

import json

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

from eskin.cli.main import app
from eskin.golden.core import AcceleratorConfig
from eskin.golden.data import save_archive
from eskin.golden.model import FloatModel, IntegerModel, float_images, images_of, run_images
from eskin.training.evaluate import compare_stages
from eskin.training.quantise import quantise
from eskin.training.train_images import ImageNetwork
from tests.support.image_scenes import SHAPES, shapes

LAYERS = ("conv 3 4", "pool", "conv 3 6", "dense 3")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("compare")
    scene = shapes(12, 0)
    torch.manual_seed(2)
    config = AcceleratorConfig.of_image(8, 8, LAYERS, SHAPES, name="shapes")
    FloatModel(config, ImageNetwork(config, 0.0).folded()).save(out / "model", {})
    quantise(out / "model", scene)
    save_archive(scene, out / "images.npz")
    return out, scene


def test_every_layer_and_every_signal_is_judged(folder):
    out, scene = folder
    result = compare_stages(out / "model", scene)
    assert [entry["stage"] for entry in result["stages"]] == ["0 conv 3 4", "2 conv 3 6", "3 dense 3"]
    names = [entry["signal"] for entry in result["signals"]]
    assert len(names) == 9
    assert names[-1] == "logits"
    assert names[:3] == ["0 conv 3 4: weights", "0 conv 3 4: biases", "0 conv 3 4: map"]
    model, real = IntegerModel.load(out / "model", images=True), FloatModel.load(out / "model", images=True)
    ideal, trace = float_images(real, images_of(scene)), run_images(model, images_of(scene))
    error = np.abs(model.config.formats.logit_format.to_real(trace.logits) - ideal.logits)
    assert result["logit_error"]["max"] == pytest.approx(error.max()) and error.max() > 0
    fmt = model.config.image.map_formats[1]
    assert result["signals"][5]["error_max"] == pytest.approx(
        np.abs(fmt.to_real(trace.maps[2]) - ideal.maps[2]).max()
    )
    # biases are rounded to a step of their own layer's sums, not to that of weights
    for entry in result["signals"]:
        assert entry["error_max"] <= (entry["step"] / 2 + 1e-12 if "biases" in entry["signal"] else 1.0)


def test_the_command_line_writes_page_and_json(folder, monkeypatch):
    out, _ = folder
    monkeypatch.chdir(out)
    run = CliRunner()
    told = run.invoke(app, ["compare", "model", "--data", "images.npz", "--out", "page", "--json", "c.json"])
    assert told.exit_code == 0 and "0 conv 3 4: map" in told.output, told.output
    assert "0 conv 3 4: map" in (out / "page/compare.html").read_text()
    assert json.loads((out / "c.json").read_text())["steps"] == 36
    assert run.invoke(app, ["compare", "model", "--out", "page"]).exit_code == 0  # made-up images
