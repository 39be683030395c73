"""examples/thesis: every method of it learns the scene, and one run writes a row for each."""

import importlib
import json
import os
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch

from scripts import ROOT
from tests.support.recipes import few_updates
from tests.support.result_case import ROW_KEYS
from tests.support.touch_scenes import SMALL, archived, scene


@pytest.fixture
def thesis(monkeypatch):
    """Its module ``run``."""
    monkeypatch.syspath_prepend(str(ROOT / "examples/thesis"))
    yield importlib.import_module("run")
    for name in ("run", "images", "tensor", "frames", "baselines"):
        sys.modules.pop(name, None)


@pytest.fixture(params=["in memory", pytest.param("file", marks=pytest.mark.slow)])
def seen(request, tmp_path, monkeypatch) -> Path:
    """A network for the DCNN: a random convolution with a step of 4, averages of its maps over 4 x 4 places. torch takes
    seconds to write and read its file."""
    torch.manual_seed(1)
    layers = torch.nn.Conv2d(3, 16, 5, stride=4), torch.nn.ReLU(), torch.nn.AdaptiveAvgPool2d(4)
    network, path = torch.nn.Sequential(*layers, torch.nn.Flatten()).eval(), tmp_path / "seen.pt2"
    if request.param == "in memory":
        path.touch()
        program = SimpleNamespace(module=lambda: network)
        monkeypatch.setattr(torch.export, "load", {path: program}.__getitem__)
    else:
        sides = {2: torch.export.Dim.AUTO, 3: torch.export.Dim.AUTO}
        example = (torch.zeros(1, 3, 96, 96),)
        torch.export.save(torch.export.export(network, example, dynamic_shapes=(sides,)), path)
    return path


def test_the_methods_write_the_rows_of_baselines(thesis, seen, tmp_path, monkeypatch, capsys):
    archived(scene(30, seed=3), tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(os, "cpu_count", lambda: 1)  # no processes, each of which would import torch
    monkeypatch.setattr(sys.modules["images"], "UPDATES", 30)
    monkeypatch.setattr(sys.modules["images"], "BATCH", 8)
    few_updates(monkeypatch, 100)
    monkeypatch.setattr(thesis, "PROTOCOL", replace(thesis.PROTOCOL, updates=96))
    names = "tensor-svm,tensor-rls,cnn-lstm,convlstm,dcnn,gru12-n20,gru12-n256"
    words = f"--dcnn {seen} --data data.npz --config c.json --group person --seeds 1 --folds 2 --methods {names} --out out"
    monkeypatch.setattr(sys, "argv", ["run.py", *words.split()])
    thesis.main()
    result = json.loads(Path("out/baselines.json").read_text())
    shares = {row["method"]: row["accuracy"] for row in result["rows"]}
    work = {row["method"]: row["multiplies"] for row in result["rows"]}
    assert all(set(row) >= ROW_KEYS for row in result["rows"]) and min(work.values()) > 0
    assert work["gru"] >= SMALL.windows.steps * 12 * (SMALL.inputs + 12)
    assert shares.keys() == {*names.split(",")} - {"gru12-n256"} | {"gru"}
    assert shares.pop("dcnn") > 0.3 and shares.pop("convlstm") > 0.3 and min(shares.values()) > 0.5, shares
    assert "70 frames" in result["left_out"][0]["reason"]  # 256 windows
    assert "| tensor-SVM, taxel x taxel x time | person |" in capsys.readouterr().out
