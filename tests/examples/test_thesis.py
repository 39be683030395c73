"""examples/thesis: every method of it learns the scene, and one run writes the rows that eskin baselines has."""

import importlib
import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from eskin.golden.core import PRESETS
from eskin.study.baselines import Scene
from tests.support.result_case import ROW_KEYS
from tests.support.touch_scenes import SMALL, archived, scene

FOLDER = Path(__file__).resolve().parents[2] / "examples/thesis"


@pytest.fixture
def thesis(monkeypatch):
    """Its module ``run``."""
    monkeypatch.syspath_prepend(str(FOLDER))
    yield importlib.import_module("run")
    for name in ("run", "images", "tensor", "frames"):
        sys.modules.pop(name, None)


def test_the_methods_write_the_rows_of_baselines(thesis, tmp_path, monkeypatch, capsys):
    archived(scene(45, seed=3), tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(os, "cpu_count", lambda: 1)  # no processes, each of which would import torch
    monkeypatch.setattr(sys.modules["images"], "UPDATES", 60)
    names = "tensor-svm,tensor-rls,cnn-lstm,convlstm,dcnn,gru12-n20,gru12-n256"
    words = f"--data data.npz --config c.json --group person --seeds 1 --folds 2 --methods {names} --out out"
    monkeypatch.setattr(sys, "argv", ["run.py", *words.split()])
    thesis.main()
    result = json.loads(Path("out/baselines.json").read_text())
    shares = {row["method"]: row["accuracy"] for row in result["rows"]}
    assert all(set(row) >= ROW_KEYS and row["multiplies"] > 0 for row in result["rows"])
    assert shares.keys() == {*names.split(",")} - {"gru12-n256"} | {"gru"}
    assert shares.pop("dcnn") > 0.3 and shares.pop("convlstm") > 0.3 and min(shares.values()) > 0.5, shares
    assert "70 frames" in result["left_out"][0]["reason"]  # 256 windows
    assert "| tensor-SVM, taxel x taxel x time | person |" in capsys.readouterr().out


def test_networks_have_the_sizes_of_table_3_1(thesis):
    sizes = [
        network.changed(PRESETS["thesis"])[0].parameter_count
        for network in thesis.RECURRENT
        if network.name in ("gru12-n20", "gru10-n20", "lstm10-n20")
    ]
    assert sizes == [1083, 843, 1113]


def test_frames_are_the_course_of_the_touch(thesis):
    touches, frames_of = Scene.of(scene(40, seed=1), SMALL), sys.modules["frames"].frames_of
    span = SMALL.last_frame
    whole = frames_of(touches, span)
    assert np.array_equal(whole[:, :20].sum(axis=1), touches.touches.sums[:, 0])  # the first window, of 20
    halves = frames_of(touches, span // 2)
    assert np.allclose(halves, (whole[:, ::2] + whole[:, 1::2]) / 2, atol=1e-4)
    assert np.allclose(frames_of(touches, 2 * span - 1)[:, ::2], whole, atol=1e-4)


def test_the_kernel_on_tensors_sees_neither_amplitude_nor_a_common_rotation(thesis):
    tensor, rng = sys.modules["tensor"], np.random.default_rng(1)
    x, y = rng.normal(size=(2, 1, 4, 4, 20))
    between = tensor.distances(tensor.subspaces(x), tensor.subspaces(y))
    turn = np.linalg.qr(rng.normal(size=(20, 20)))[0]
    for change in (lambda t: 3 * t, lambda t: t @ turn):
        assert np.allclose(
            tensor.distances(tensor.subspaces(change(x)), tensor.subspaces(change(y))), between
        )
    assert np.allclose(tensor.distances(tensor.subspaces(x), tensor.subspaces(x)), 0) and between[0, 0] > 1
