"""The matrix: every verb on every kind of model ends with 0, or with 2 and a sentence that names the field.

A new verb needs a row in ROWS, a new kind of model an entry in KINDS; what is refused stands in REFUSED, from which
docs/verification.md has its table.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import json
import os
import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eskin.cli import main as command_line
from eskin.cosim.runner import locked
from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.formats import QFormat
from eskin.golden.data.load import load_recordings
from eskin.golden.model.model import IntegerModel
from eskin.golden.training import recipe
from tests.support.link_device import Device, golden_decisions

ROOT = Path(__file__).resolve().parents[1]
CLASSES = ("press", "stroke")
WIDE_STATE = QFormat(4, 12)
KINDS: dict[str, dict[str, Any]] = {
    "linear": {"cell": "linear", "feature_kinds": ("mean", "activity", "integral"), "decision": "last"},
    "gru-before": {},
    "gru-after": {"reset": "after", "state_format": WIDE_STATE},
    "lstm": {"cell": "lstm", "state_format": WIDE_STATE},
    "early": {"decision": "early", "early_steps": 1, "early_margin": 64},
    "serial": {"lanes": 1, "lane_type": "serial"},
    "rom": {"loadable": False},
    "converter": {"converter": "matrix", "rows": 2, "columns": 2},
    "image": {},
}
"""Kinds of model: the fields in which each differs from a small GRU of 4 taxels, reset before, loadable, without a converter."""

IMAGE_CONFIG = AcceleratorConfig.of_image(8, 8, ("conv 3 4", "pool", "dense 3"), ("cup", "ball", "ring"))
CONFIG = AcceleratorConfig.of(
    taxels=4,
    sample_rate_hz=2000.0,
    rest="tracked",
    rest_frames=8,
    onset="baseline",
    onset_mean_frames=4,
    onset_check_frames=4,
    onset_threshold=20,
    window_mode="free",
    pretrigger_frames=0,
    hop=8,
    window=16,
    steps=3,
    hidden=4,
    class_names=CLASSES,
    clock_hz=1e6,
    rearm_frames=16,
)

FAST = "linear"
"""The kind on which a slow row runs in every test run."""
ROWS: dict[str, str] = {
    "inspect {data} --config {config} --out {out}/picture.png": "fast",
    "convert {data} --out {out}/converted.npz": "fast",
    "train --data {data} --config {config} --out {out}/model --folds 2 --seeds 1 --group person": "fast",
    "quantise {model}": "fast",
    "quantise {model} --data {data} --logit-error 5 --group person": "slow",
    "import {weights} --config {config} --out {out}/model {scale}": "fast",
    "evaluate {model} --data {data}": "fast",
    "compare {model} --out {out}": "fast",
    "generate {model} --out {out}/design": "fast",
    "schedule {model} --out {out}": "fast",
    "schedule {model} --table": "fast",
    "schedule {model} --complexity --out {out}": "slow",
    "cosim {model} --data {data} --recordings 1 --simulator icarus": "fast",
    "cosim {model} --data {data} --recordings 1 --level netlist --target icebreaker": "slow",
    "build {model} --target icebreaker --out {out}/board": "slow",
    "build {model} --target icestick --out {out}/board": "slow",
    "replay {model} --data {data} --port {port} --baud 2000000": "fast",
    "run --data {data} --config {config} --recordings 2 --group person --seeds 1 --out {out}/result": "slow",
    "report {result}": "slow",
    "stability {model} --data {data} --no-cosim --no-defences --few 4 --jobs 1 --out {out}": "slow",
    "enrol {model} --data {data} --with {data} --out {out}/model": "fast",
    "enrol --evaluate --data {data} --config {config} --group person -k 1 --seeds 1 --jobs 1": "slow",
    "watch {model} --data {data} --terminal --speed max --once": "fast",
    "watch {model} --data {data} --simulate --terminal --speed max --once --recordings 1": "slow",
    "sweep --data {data} --config {config} --grid {grid} --group person --folds 2 --seeds 1 --jobs 1 --out {out}": "slow",
    "baselines --data {data} --config {config} --methods simple --group person --folds 2 --seeds 1 --jobs 1 --out {out}": "fast",
    "leak-check --data {data} --config {config} --group person --folds 2 --seeds 1": "fast",
    "energy {model} --data {data} --configuration icebreaker:1 --recordings 1 --out {out}": "slow",
    "asic {model} --pdk ihp-sg13g2 {liberty} --out {out}/chip": "slow",
}
"""Rows: a command line, and whether it is fast on every kind; a slow one runs on FAST alone but in ``make test-all``."""
REFUSED: dict[tuple[str, str], str] = {}


def archives(folder: Path) -> None:
    """data.npz, twelve touches of four taxels by three persons, and images.npz, 24 images of 8 x 8."""
    rng, frame, taxel = np.random.default_rng(0), np.arange(48)[:, None], np.arange(4)
    samples = rng.normal(2000, 1, (12, 80, 4))
    for index in range(12):
        samples[index, 32:] += 300 * np.exp(-((taxel - (frame / 12 if index % 2 else 1.5)) ** 2))
    labels = {"labels": np.arange(12) % 2, "class_names": CLASSES, "sample_rate_hz": 2000.0, "person": np.arange(12) // 4}
    np.savez(folder / "data.npz", samples=np.rint(samples).astype(np.uint16).reshape(-1, 4), offsets=np.arange(13) * 80, **labels)
    images = rng.integers(0, 60, (24, 8, 8)).astype(np.uint8)
    for index in range(24):
        images[index, index % 3 * 2 : index % 3 * 2 + 3, 2:6] += 150
    labels = {"labels": np.arange(24) % 3, "class_names": IMAGE_CONFIG.network.class_names, "person": np.arange(24) // 8}
    np.savez(folder / "images.npz", images=images, **labels)


def weights_of(config: AcceleratorConfig, path: Path) -> Path:
    """A network as another tool would save it: of torch, of Keras where only that has the cell, of scikit-learn."""
    import torch

    inputs, classes, units = config.inputs, config.classes, 4
    if config.is_image:
        layers = torch.nn.Sequential(torch.nn.Conv2d(1, 4, 3, padding=1), torch.nn.Linear(4 * 4 * 4, classes))
    elif config.network.cell == "linear":
        coefficients = np.random.default_rng(1).normal(size=(classes, config.windows.steps * inputs))
        np.savez(path.with_suffix(".npz"), coef_=coefficients, intercept_=np.zeros(classes))
        return path.with_suffix(".npz")
    elif config.network.cell == "gru" and config.network.reset == "before":
        shapes = ((inputs, 3 * units), (units, 3 * units), (3 * units,), (units, classes), (classes,))
        rng = np.random.default_rng(1)
        np.savez(path.with_suffix(".npz"), *(rng.normal(size=shape) for shape in shapes))
        return path.with_suffix(".npz")
    else:
        cell = torch.nn.LSTM if config.network.cell == "lstm" else torch.nn.GRU
        layers = torch.nn.ModuleDict({"cell": cell(inputs, units), "dense": torch.nn.Linear(units, classes)})
    torch.save(layers.state_dict(), path.with_suffix(".pt"))
    return path.with_suffix(".pt")


def call(words: list[str]) -> int:
    """The status with which ``eskin`` ends, in this process."""
    before, sys.argv = sys.argv, ["eskin", *words]
    try:
        command_line.main()
    except SystemExit as end:
        return int(end.code or 0)
    finally:
        sys.argv = before
    return 0


@pytest.fixture(scope="session")
def shop(tmp_path_factory) -> Path:
    """The folder, one for all processes of a session, in which models, results and simulators are kept."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "matrix"
    folder.mkdir(exist_ok=True)
    with locked(folder / "archives.lock"):
        if not (folder / "images.npz").exists():
            archives(folder)
    return folder


@dataclass(frozen=True)
class Case:
    """What is there of one kind; models and results are made when they are first asked for, once."""

    shop: Path
    kind: str

    @property
    def config(self) -> AcceleratorConfig:
        return IMAGE_CONFIG if self.kind == "image" else CONFIG.replace(name=self.kind, **KINDS[self.kind])

    @property
    def data(self) -> Path:
        return self.shop / ("images.npz" if self.kind == "image" else "data.npz")

    def made(self, name: str, make: Callable[[Path], None]) -> Path:
        path = self.shop / f"{self.kind}-{name}"
        with locked(path.with_suffix(".lock")):
            if not path.exists():
                make(path)
        return path

    def config_file(self) -> Path:
        return self.made("config.json", lambda path: path.write_text(self.config.to_json()))

    def model(self) -> Path:
        def train(path: Path) -> None:
            new = path.with_name(f"{path.name}.new")
            options = ["--data", str(self.data), "--config", str(self.config_file())]
            assert call(["train", *options, "--folds", "0", "--out", str(new)]) == 0 == call(["quantise", str(new)])
            new.rename(path)

        return self.made("model", train)

    def result(self) -> Path:
        row = next(row for row in ROWS if row.startswith("run "))

        def run(path: Path) -> None:
            words = row.format(data=self.data, config=self.config_file(), out=path).split()
            assert call(words) == 0
            
        return self.made("result", run) / "result"


def cells() -> list[Any]:
    """Every row on every kind, slow ones marked."""
    return [
        pytest.param(row, kind, id=f"{row}-{kind}", marks=[pytest.mark.slow] if speed == "slow" and kind != FAST else [])
        for (row, speed), kind in itertools.product(ROWS.items(), KINDS)
    ]


@pytest.mark.timeout(900)
@pytest.mark.parametrize(("row", "kind"), cells())
def test_every_verb_takes_every_kind_of_model_or_says_why_not(row, kind, shop, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(shop)
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setitem(recipe.RECIPES, "onset", dataclasses.replace(recipe.RECIPES["onset"], updates=100))
    case = Case(shop, kind)
    fields: dict[str, Any] = {"data": case.data, "out": tmp_path, "config": case.config_file()}
    made = {
        "model": case.model,
        "result": case.result,
        "weights": lambda: weights_of(case.config, tmp_path / "weights"),
        "scale": lambda: "--mean 0 --std 255" if kind == "image" else f"--data {case.data}",
        "grid": lambda: grid(case, tmp_path),
        "liberty": lambda: " ".join(f"--liberty {path}" for path in sorted((ROOT.parent / "shared/pdk/ihp-sg13g2").glob("*.lib"))),
    }
    fields |= {name: make() for name, make in made.items() if f"{{{name}}}" in row}
    if row.startswith("quantise"):
        fields["model"] = shutil.copytree(fields["model"], tmp_path / "model")
    capsys.readouterr()
    if "{port}" in row:
        model = IntegerModel.load(fields["model"], images=True)
        with Device(model.config, golden_decisions(model, load_recordings(case.data))) as device:
            status = call(row.format(**fields, port=device.port).split())
    else:
        status = call(row.format(**fields).split())
    out, err = capsys.readouterr()
    print(out[-1500:], err)
    if (row, kind) in REFUSED:
        assert status == 2 and err.count("\n") == 1 and REFUSED[row, kind] in err, err
    else:
        assert status == 0, err


def grid(case: Case, folder: Path) -> Path:
    fields = {"layers": list(IMAGE_CONFIG.image.layers)} if case.kind == "image" else {"steps": [3]}
    (folder / "grid.json").write_text(json.dumps(fields))
    return folder / "grid.json"
