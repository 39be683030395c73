"""The matrix: every verb on every kind of model ends with 0, or with 2 and a sentence that names the field.

A new verb needs an entry in ROWS, a new kind of model one in KINDS. What is refused stands in REFUSED, and
docs/figures.md shows it.
"""

import itertools
import json
import os
import shutil
import signal
import socket
import sys
import threading
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from string import Formatter
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from sklearn.ensemble import RandomForestClassifier

from eskin.cli import main as command_line
from eskin.cli.common import VERBS
from eskin.data import load_recordings, turns
from eskin.data.archive import save_archive
from eskin.golden.core import FEATURE_KINDS, AcceleratorConfig, QFormat
from eskin.golden.core.files import locked
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel, load_config
from eskin.verbs import energy
from scripts import ROOT
from tests.support.forests import forest_file
from tests.support.link_device import Device, golden_decisions
from tests.support.recipes import few_updates
from tests.support.small_designs import TRACKED
from tests.support.table import each_row
from tests.support.tiny_cells import liberty_files

IMAGES = AcceleratorConfig.of_image(8, 8, ("conv 3 4", "pool", "dense 3"), ("cup", "ball", "ring"))
TOUCHES = TRACKED.replace(sample_rate_hz=2000.0, steps=3, clock_hz=1e6)
WIDE = {"state_format": QFormat(4, 12)}
KINDS: dict[str, dict[str, Any]] = {
    "linear": {
        "cell": "linear",
        "feature_kinds": FEATURE_KINDS,
        "feature_scale": "taxel",
        "decision": "last",
    },
    "trees": {"cell": "trees", "decision": "last", "trees": 3, "depth": 3, "nodes": 3},
    "gru-before": {},
    "gru-after": {"reset": "after", **WIDE},
    "lstm": {"cell": "lstm", **WIDE},
    "early": {"decision": "early", "early_steps": 1, "early_margin": 64},
    "rom": {"loadable": False},
    "converter": {"converter": "matrix", "rows": 2, "columns": 2},
    "scanned": {
        "scan_every": 2,
        "hop": 4,
        "window": 8,
        "rest_frames": 4,
        "onset_mean_frames": 2,
        "onset_check_frames": 2,
    },
    "following": {
        "cell": "linear",
        "decision": "last",
        "window_mode": "whole",
        "store_per_window": 2,
        "touch_frames": 48,
    },
    "prototypes": {},
    "image": {},
    "chosen": {},
}
"""Kinds of model: the fields in which each differs from TOUCHES; ``image`` is IMAGES, ``chosen`` what the main job
itself makes of the synthetic scene, of which a verb is tried in one row alone."""

JUDGED = "--data {data} --config {config} --group person --seeds 1"
ROWS: dict[str, tuple[str, tuple[str, ...]]] = {
    "inspect": ("inspect {data} --out {out}/picture.png", ("linear", "image")),
    "convert": ("convert {data} --out {out}/converted.npz", ("linear", "image")),
    "train": (f"train {JUDGED} --folds 2 --out {{out}}/model", ("lstm",)),
    "train --fits": (
        f"train {JUDGED} --folds 2 --prefer latency --fits ulx3s --out {{out}}/model",
        ("linear",),
    ),
    "train --stress": (
        f"train {JUDGED} --folds 2 --cell auto --stress on --out {{out}}/model",
        ("linear", "image"),
    ),
    "import": (
        "import {weights} --config {config} {scale} --out {out}/model",
        ("linear", "gru-before", "gru-after", "image"),
    ),
    "quantise": ("quantise {model}", ("linear", "image")),
    "quantise --quantisation-aware": (
        "quantise {model} --data {data} --quantisation-aware --weight-bits 4",
        ("gru-before", "image"),
    ),
    "quantise --readout": (
        "quantise {model} --data {data} --readout prototypes --group person",
        ("linear", "lstm", "image"),
    ),
    "evaluate": ("evaluate {model} --data {data}", ("trees", "early", "image")),
    "evaluate --against": (
        "evaluate {model} --against {model}/config.json",
        ("following", "prototypes", "image"),
    ),
    "compare": ("compare {model}", ("gru-after", "image")),
    "generate": ("generate {model} --out {out}/design", ("rom", "prototypes")),
    "generate --bus": ("generate {model} --bus axi4lite --out {out}/design", ("image",)),
    "generate --streams": ("generate {model} --bus wishbone --streams axis --out {out}/design", ()),
    "export --to c": (
        "export {model} --to c --out {out}/c",
        ("linear", "trees", "scanned", "following", "image"),
    ),
    "export --to onnx": (
        "export {model} --to onnx --out {out}/onnx",
        ("trees", "lstm", "following", "image"),
    ),
    "export --exact": ("export {model} --to onnx --exact --out {out}/onnx", ("early", "following")),
    "import onnx": ("import {onnx} --out {out}/model", ("linear", "gru-after", "image")),
    "import forest": ("import {forest} --config {config} {scale} --out {out}/model", ("trees", "image")),
    "schedule": ("schedule {model} --out {out}", ("trees", "gru-before", "image")),
    "cosim": ("cosim {model} --data {data} --recordings 1 --simulator icarus", ("linear", "trees")),
    "cosim netlist": (
        "cosim {model} --data {data} --recordings 1 --level netlist --target icebreaker",
        ("converter",),
    ),
    "run": (f"run {JUDGED} --recordings 1 --out {{out}}/result", ()),
    "report": ("report {result}", ()),
    "build": ("build {model} --target icebreaker --out {out}/board", ()),
    "build --standalone": (
        "build {model} --target icebreaker --converter ads7953 --standalone --out {out}/board",
        ("image",),
    ),
    "replay": ("replay {model} --data {data} --port {port}", ("early", "scanned", "image")),
    "watch": ("watch {model} --data {data} --host-port {free}", ("rom", "image")),
    "watch --simulate": ("watch {model} --data {data} --simulate --host-port {free}", ()),
    "enrol": ("enrol {model} --data {data} --with {data} --out {out}/model", ("lstm", "image")),
    "enrol --teach": ("enrol {model} --teach {data} --out {out}/model", ("linear", "prototypes", "image")),
    "enrol --evaluate --readout": (
        f"enrol --evaluate --readout prototypes {JUDGED} -k 1",
        ("prototypes", "image"),
    ),
    "enrol --evaluate": (f"enrol --evaluate {JUDGED} -k 1", ("image",)),
    "stability": (
        "stability {model} --data {data} --no-cosim --no-defences --few 4 --out {out}",
        ("trees", "image"),
    ),
    "energy": (
        "energy {model} --data {data} --configuration icebreaker:{lanes} --recordings 1 --touches 6 --out {out}",
        (),
    ),
    "asic": ("asic {model} --pdk ihp-sg13g2 {liberty} --out {out}/chip", ("image",)),
}
"""A command line, and the kinds that differ for it, on which every test run tries it; ``make test-all`` tries
it on all."""

REFUSED: list[tuple[tuple[str, ...], tuple[str, ...], str]] = [
    (
        ("import",),
        tuple(
            kind
            for kind in KINDS
            if kind not in ("linear", "following", "trees", "gru-after", "lstm", "image", "chosen")
        ),
        "has reset after, not before; use --reset after",
    ),
    (("import",), ("linear", "following", "trees"), "which is read from ONNX; export it as .onnx"),
    (
        ("export --to onnx", "export --exact"),
        ("trees",),
        "field cell: is 'trees', which export --to onnx does not take",
    ),
    (("schedule",), ("trees",), "field cell: is 'trees', which walk in a fixed order without a schedule"),
    (
        ("enrol", "enrol --evaluate"),
        ("trees",),
        "field cell: is 'trees', which have no weights to train further",
    ),
    (("quantise --quantisation-aware",), ("trees",), "4 bits were requested, and trees have no weights"),
    (
        ("quantise --readout", "enrol --evaluate --readout"),
        ("trees",),
        "field readout: is 'prototypes', and trees have no trajectory",
    ),
    (("train --fits",), ("image",), "--fits: networks for images have none"),
    (
        ("generate --streams",),
        ("converter",),
        "--streams: frames come from the converter 'matrix'; leave it out",
    ),
    (
        ("quantise --readout", "enrol --evaluate --readout"),
        ("rom",),
        "field loadable: is false, but the host must fill the memory of prototypes",
    ),
    (
        ("cosim netlist",),
        ("converter",),
        "--converter: is matrix, which goes with the design's own Verilog and clock",
    ),
    (
        ("build --standalone",),
        ("image",),
        "field interface: has a converter or position, which images do not have",
    ),
    (
        ("enrol --teach",),
        tuple(kind for kind in KINDS if kind not in ("prototypes", "image", "chosen")),
        "field readout: is 'dense', which cannot be taught",
    ),
    (
        ("export --to onnx", "export --exact"),
        ("image",),
        "is a network for images, which export --to onnx does not take",
    ),
    (
        ("export --to onnx", "export --exact"),
        ("prototypes",),
        "field readout: is 'prototypes', which ONNX does not have",
    ),
    (("export --to c",), ("prototypes",), "field readout: is 'prototypes', which C does not have"),
    (("import onnx",), ("trees", "prototypes", "image"), "--config: is missing"),
    (
        ("enrol", "quantise --quantisation-aware"),
        ("prototypes",),
        "field readout: is 'prototypes', which would not fit the new weights",
    ),
    (("quantise --readout",), ("early",), "field early_margin: is 64 in config.json, of logits"),
    (("quantise",), ("prototypes",), "field readout: is 'prototypes', which are made of the recordings"),
    (("quantise --readout",), ("image",), "--readout: models for images have none"),
    (
        ("quantise --quantisation-aware",),
        ("image",),
        "--quantisation-aware: is for networks that read recordings",
    ),
    (
        ("enrol", "enrol --teach", "energy", "asic", "stability", "import", "import forest", "watch"),
        ("image",),
        "is a network for images, which this verb does not take",
    ),
    (
        ("enrol --evaluate", "enrol --evaluate --readout"),
        ("image",),
        "array images: holds images, which this verb does not take",
    ),
]
"""Rows, kinds, and what the sentence says with which they end."""

MISSED = {"run": "FAILED", "stability": "FAILED"}
"""Rows that check something which a tiny model may miss, and what is said then; they end with 1."""


def archives(folder: Path) -> None:
    """data.npz, twelve touches of four taxels by three persons, and images.npz, 24 images of 8 x 8."""
    rng, frame, taxel = np.random.default_rng(0), np.arange(48)[:, None], np.arange(4)
    samples = rng.normal(2000, 1, (12, 80, 4))
    for index in range(12):
        samples[index, 32:] += 300 * np.exp(-((taxel - (frame / 12 if index % 2 else 1.5)) ** 2))
    names, person = TOUCHES.network.class_names, {"person": np.arange(12) // 4}
    codes = np.rint(samples).astype(int)
    touches = Recordings.of(codes, np.arange(12) % 2, sample_rate_hz=2000, class_names=names, groups=person)
    save_archive(touches, folder / "data.npz")
    images = rng.integers(0, 60, (24, 8, 8)).astype(np.uint8)
    for index in range(24):
        images[index, index % 3 * 2 : index % 3 * 2 + 3, 2:6] += 150
    names, person = IMAGES.network.class_names, np.arange(24) // 8
    np.savez(folder / "images.npz", images=images, labels=np.arange(24) % 3, class_names=names, person=person)


def weights_of(config: AcceleratorConfig, path: Path) -> Path:
    """A network as torch saves it."""
    import torch

    inputs, classes, units = config.inputs, config.classes, config.network.hidden
    if config.network.cell == "linear":
        network: torch.nn.Module = torch.nn.Linear(inputs, classes)
    elif config.is_image:
        network = torch.nn.Sequential(torch.nn.Conv2d(1, 4, 3), torch.nn.Linear(64, classes))
    else:
        cell = torch.nn.LSTM if config.network.cell == "lstm" else torch.nn.GRU
        network = torch.nn.ModuleList([cell(inputs, units), torch.nn.Linear(units, classes)])
    torch.save(network.state_dict(), path)
    return path


def call(*words: str) -> int:
    """The status with which ``eskin`` ends, in this process."""
    before, sys.argv = sys.argv, ["eskin", *words]
    try:
        command_line.main()
    except SystemExit as end:
        return int(end.code or 0)
    finally:
        sys.argv = before
    return 0


@contextmanager
def interrupted(port: str) -> Iterator[None]:
    """Ctrl-C once the page on ``port`` is served."""
    over = threading.Event()

    def work() -> None:
        while not over.wait(0.05):
            with suppress(OSError), urllib.request.urlopen(f"http://127.0.0.1:{port}"):
                os.kill(os.getpid(), signal.SIGINT)
                return

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


@dataclass(frozen=True)
class Case:
    """What there is of one kind. Models and results are made when a row first asks for them, once a
    session."""

    shop: Path
    kind: str
    out: Path

    @property
    def configuration(self) -> AcceleratorConfig:
        if self.kind == "chosen":
            return load_config(self.job() / "model")
        return IMAGES if self.kind == "image" else TOUCHES.replace(name=self.kind, **KINDS[self.kind])

    def made(self, name: str, make: Callable[[Path], None]) -> Path:
        path = self.shop / f"{self.kind}-{name}"
        with locked(path.with_suffix(".lock")):
            if not path.exists():
                new = path.with_name(f"new-{path.name}")
                make(new)
                new.rename(path)
        return path

    def data(self) -> Path:
        if self.kind == "chosen":
            scene = turns.turn_recordings(persons=2, trials=2)
            return self.made("scene.npz", lambda path: save_archive(scene, path))
        return self.shop / ("images.npz" if self.kind == "image" else "data.npz")

    def job(self) -> Path:
        """Result of the main job."""

        def run(path: Path) -> None:
            words = "--group", "person", "--seeds", "1", "--recordings", "1"
            words = words if self.kind == "chosen" else ("--config", f"{self.config()}", *words)
            assert call("run", "--data", f"{self.data()}", *words, "--out", f"{path}") in (
                0,
                1,
            )  # the row judges

        return self.made("run", run)

    def config(self) -> Path:
        return self.made("config.json", lambda path: path.write_text(self.configuration.to_json()))

    def model(self) -> Path:
        if self.kind == "chosen":
            return Path(shutil.copytree(self.job() / "model", self.out / "trained"))

        def train(path: Path) -> None:
            options = "--data", f"{self.data()}", "--config", f"{self.config()}", "--folds", "0"
            assert call("train", *options, "--out", f"{path}") == 0
            made_of = f"--data {self.data()} --readout prototypes --group person"
            assert call("quantise", f"{path}", *made_of.split() * (self.kind == "prototypes")) == 0

        return Path(shutil.copytree(self.made("model", train), self.out / "trained"))

    def result(self) -> Path:
        return Path(shutil.copytree(self.job(), self.out / "result"))

    def free(self) -> int:
        """A port that no program listens on."""
        with socket.create_server(("127.0.0.1", 0)) as server:
            return server.getsockname()[1]

    def weights(self) -> Path:
        return weights_of(self.configuration, self.out / "weights.pt")

    def onnx(self) -> Path | str:
        """An exported network; of an image's kind a torch one, which has no configuration in it."""
        if self.kind in ("trees", "image", "prototypes"):
            return weights_of(self.configuration, self.out / "weights.pt")
        assert call("export", f"{self.model()}", "--to", "onnx", "--out", f"{self.out}/net") == 0
        shutil.rmtree(self.out / "trained")
        return self.out / "net" / "model.onnx"

    def forest(self) -> Path:
        """Trees of scikit-learn, fitted on noise."""
        config = self.configuration
        columns = 4 if config.is_image else config.windows.steps * config.inputs
        noise = np.random.default_rng(0).normal(size=(60, columns))
        labels = np.arange(60) % config.classes
        fitted = RandomForestClassifier(3, max_depth=4, random_state=0).fit(noise, labels)
        return forest_file(fitted, self.out / "forest.onnx")

    def scale(self) -> str:
        return "--mean 0 --std 255" if self.kind == "image" else f"--data {self.data()}"

    def lanes(self) -> str:
        return "4" if self.kind == "image" else "1"

    def liberty(self) -> str:
        return " ".join(f"--liberty {path}" for path in liberty_files("tiny", self.out))

    def words(self, row: str, **given: str) -> list[str]:
        """The command line of a row."""
        command = ROWS[row][0]
        names = {name for _, name, _, _ in Formatter().parse(command) if name} - {*given}
        values = {name: self.out if name == "out" else getattr(self, name)() for name in names}
        return command.format(**given, **values).split()


@pytest.fixture
def case_of(tmp_path_factory, tmp_path, monkeypatch) -> Callable[[str], Case]:
    """``case_of(kind)``, in a working folder that the session's tests share: simulators are made once."""
    base = tmp_path_factory.getbasetemp()
    shop = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "matrix"
    shop.mkdir(exist_ok=True)
    with locked(shop / "archives.lock"):
        if not (shop / "images.npz").exists():
            archives(shop)
    monkeypatch.chdir(shop)
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setattr(os, "cpu_count", lambda: 1)  # workers would begin by importing torch
    monkeypatch.setattr("eskin.pages.stability_page.svg", lambda figure: "")  # charts are drawn, not rendered
    few_updates(monkeypatch, 20)
    return lambda kind: Case(shop, kind, tmp_path)


def cells() -> list[Any]:
    """Every row on every kind, slow ones marked. Of each verb that takes a model a row is tried on what the main
    job chose; that model takes a minute, so these are slow."""
    verbs = {
        row.partition(" ")[0]: row
        for row, (command, _) in reversed(ROWS.items())
        if {"{model}", "{result}"} & {*command.split()}
    }
    chosen = {(row, "chosen") for row in verbs.values()}
    quick = {(row, kind) for row in ROWS for kind in ROWS[row][1]}
    return [
        pytest.param(*cell, id=" ".join(cell), marks=() if cell in quick else pytest.mark.slow)
        for cell in itertools.product(ROWS, KINDS)
        if cell in quick | chosen or cell[1] != "chosen"
    ]


def sentence_of(row: str, kind: str) -> str:
    """What the refusal of a cell says; empty where it is not refused."""
    return next((words for rows, kinds, words in REFUSED if row in rows and kind in kinds), "")


@pytest.mark.parametrize("row, kind", cells())
def test_every_verb_takes_every_kind_of_model_or_says_why_not(row, kind, case_of, capsys):
    case, refusal = case_of(kind), sentence_of(row, kind)
    if row == "replay":
        model = IntegerModel.load(case.model(), images=True)
        with Device(model.config, golden_decisions(model, load_recordings(case.data()))) as device:
            shutil.rmtree(case.out / "trained")
            record = {"link": True, "baud": 2e6, "lanes": model.config.hardware.lanes, "lane_type": None}
            (case.out / "board").mkdir()
            (case.out / "board/build.json").write_text(json.dumps(record))
            status = call(*case.words(row, port=device.port))
    else:
        words = case.words(row)
        capsys.readouterr()
        with interrupted(words[-1]) if row.startswith("watch") else nullcontext():
            status = call(*words)
    shown = capsys.readouterr()
    if refusal:
        assert status == 2 and refusal in shown.err and shown.err.count("eskin: ") == 1, shown
    else:
        # a check that a tiny model misses is said: a bound
        missed = MISSED.get(row)
        assert status == 0 or (missed and status == 1 and missed in shown.out + shown.err), shown


def test_every_verb_has_a_row():
    assert {*VERBS} == {row.partition(" ")[0] for row in ROWS}
    assert {name for rows, kinds, _ in REFUSED for name in (*rows, *kinds)} <= {*ROWS, *KINDS}


def test_the_documents_show_what_is_refused():
    lines = [
        f"| {', '.join(f'`{row}`' for row in rows)} | {', '.join(kinds)} | {words} |"
        for rows, kinds, words in REFUSED
    ]
    table = "\n".join(["| verb | kind of model | ends with 2, and says |", "| --- | --- | --- |", *lines])
    page = (ROOT / "docs/figures.md").read_text()
    assert table in page, table


@each_row("cycles", [1, 4, 9, 300])
def test_the_slower_run_of_energy_is_slower(cycles):
    """Its frames take more cycles than at full pace, however many those take: the difference is divided
    by."""
    full = SimpleNamespace(frames=80, simulated_cycles=80 * cycles * TOUCHES.sensor.taxels)
    assert 80 * energy.slower_cycles(TOUCHES, full) >= 1.5 * full.simulated_cycles
