"""The command line: what each verb prints and writes, and that every bad input ends in one sentence, status 2
and no changed file."""

import json
import re
import resource
import shutil
import signal
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from eskin.cli.common import VERBS
from eskin.golden.core import replacing, replacing_folder
from eskin.golden.core.groups import GROUP_OF
from scripts import ROOT
from tests.support.folder import contents
from tests.support.small_designs import TRACKED
from tests.support.table import each_row

CONFIG = TRACKED.replace(
    name="small",
    sample_rate_hz=200.0,
    hop=6,
    window=12,
    steps=4,
    clock_hz=1e5,
    class_names=("rough", "smooth"),
)


def arrays(**changes) -> dict[str, np.ndarray]:
    """Eight recordings of 100 frames that CONFIG's onset rule opens, with ``changes``; None leaves an array
    out."""
    rng = np.random.default_rng(11)
    samples = rng.normal(1000, 2, (8, 100, 4))
    for i in range(8):
        samples[i, 40:, i % 2] += 80 * np.sin(np.arange(60) * (0.05 if i % 2 else 0.3)) + 60
    good = {
        "samples": np.rint(samples).astype(np.uint16).reshape(-1, 4),
        "offsets": np.arange(0, 801, 100),
        "labels": np.arange(8) % 2,
        "class_names": np.array(["rough", "smooth"]),
        "sample_rate_hz": np.array(200.0),
        "trial": np.arange(8) // 2,
    } | changes
    return {name: value for name, value in good.items() if value is not None}


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """An empty working folder with the archive ``data.npz`` and the configuration ``config.json``."""
    monkeypatch.chdir(tmp_path)
    np.savez("data.npz", **arrays())
    Path("config.json").write_text(CONFIG.to_json())
    return tmp_path


@pytest.fixture
def model(folder) -> Path:
    """``model``: an untrained network, quantised on data.npz."""
    import torch

    from eskin.data import load_recordings
    from eskin.golden.model import FloatModel
    from eskin.training.integers import quantise
    from eskin.training.network import RecurrentClassifier

    network = RecurrentClassifier(CONFIG, generator=torch.Generator().manual_seed(2)).arrays()
    FloatModel(CONFIG, network | {"mu": np.array(20.0), "sigma": np.array(30.0)}).save(folder / "model", {})
    quantise(folder / "model", load_recordings(folder / "data.npz"))
    return folder / "model"


# ---------------------------------------------------------------------- help and usage


@each_row("verb", VERBS)
def test_every_verb_explains_itself_with_an_example(call, verb):
    status, out, _ = call(verb, "--help")
    assert status == 0 and f"Example: eskin {verb}" in out


# ---------------------------------------------------------------------- the verbs


def test_inspect_points_at_dead_and_saturated_taxels(call, folder):
    samples = arrays()["samples"]
    samples[:, 2] = 7
    samples[40:100] = np.resize(samples[:40], (60, 4))  # no touch
    touched = (np.arange(800) % 100 >= 60) & (np.arange(800) >= 100)
    samples[:, 3] = np.where(touched, 65535, samples[:, 3])  # clipped while the others move
    day = np.arange(8) // 2 % 2
    users = {"person": np.arange(8) > 6, "person,day": day, "user id": day}
    np.savez("my data.npz", **arrays(samples=samples, **users))
    status, out, _ = call("inspect", "my data.npz", *"--json figures.json".split())
    states = [taxel["state"] for taxel in json.loads(Path("figures.json").read_text())["taxel"]]
    assert status == 0 and states == ["ok", "ok", "constant", "saturated"] and "unusual taxels" in out
    assert re.search(r"│ 2 +│ constant +│ 7 +│ 7 +│", out) and re.search(r"│ 3 +│ saturated ", out)
    # what was masked need not be masked, who reads this has run it, and people come before repetitions
    assert (
        "taxel 2 never changes and is masked" in out
        and "exclude" not in out
        and "many recordings have no" in out
    )
    # a command for a shell; one person made a single recording, and a comma separates two groups
    assert "eskin inspect" not in out
    assert "next: eskin run --data 'my data.npz' --group 'user id' --out 'build/my data'" in out


def test_a_comparison_on_random_touches_tells_nothing_of_their_labels(call, folder, model):
    written = {}
    for name, data in {"random": "", "real": "--data data.npz"}.items():
        assert call(*f"compare model {data} --json {name}.json".split())[0] == 0
        written[name] = set(json.loads(Path(f"{name}.json").read_text()))
    of_labels = {*"float_accuracy integer_accuracy per_step per_class confusion chance passed".split()}
    assert written["real"] - written["random"] == of_labels and "agreement" in written["random"]


# ---------------------------------------------------------------------- what is refused
def bad_files(model: Path) -> None:
    """Archives, configurations, models and folders that the table of refusals names."""
    for name, changes in {
        "bare": dict(offsets=None),
        "taxels": dict(samples=np.ones((800, 6), np.uint16)),
    }.items():
        np.savez(f"{name}.npz", **arrays(**changes))
    for name, changes in {
        "wide": dict(lane_type="dsp", weight_format="SQ(8,8)", recurrent_format="SQ(8,8)"),
        "slow": dict(clock_hz=1000.0),
    }.items():
        values = json.loads(CONFIG.to_json())
        for field, value in changes.items():
            values[GROUP_OF.get(field, "windows")][field] = value
        Path(f"{name}.json").write_text(json.dumps(values))
    shutil.copytree(model, "cut")
    weights = Path("cut/weights.npz")
    weights.write_bytes(weights.read_bytes()[:200])
    Path("csv/smooth").mkdir(parents=True)
    Path("csv/smooth/trial2.csv").write_bytes(b"time,a,b,c,d\n0.000,1,2,3,4\n0.005,1,2,3\n0.010,1,2,3,4\n")
    Path("mine").mkdir()
    Path("mine/thesis.tex").write_text("years of work")


DATA = "inspect {0}|train --data {0} --out new|run --data {0} --out result"
BESIDE = (
    "quantise model --data {0}|evaluate model --data {0} --json e.json|cosim model --data {0} --json c.json"
    "|generate model --out design --data {0}"
)
FITTED = f"{BESIDE}|train --data {{0}} --config config.json --out new"
BEFORE = "train --data data.npz --config {0} --out new|run --data data.npz --config {0} --out result"
FOLDER = "generate {0} --out design|evaluate {0} --data data.npz --json e.json|cosim {0} --data data.npz --json c.json"
REFUSED = [
    (f"{DATA}|{BESIDE}", "bare.npz", "array offsets: is missing"),
    (FITTED, "taxels.npz", "array samples: has 6 taxels and configuration 'small'"),
    (FOLDER, "cut", "weights.npz: is damaged"),
    (BEFORE, "wide.json", "field lane_type: is 'dsp', whose accumulator has 32 bits, and these formats need"),
    (BEFORE, "slow.json", "field clock_hz: is 1000: 5 cycles a frame cannot take 4 taxels"),
    ("convert {0} --out made.npz|train --data {0} --out new", "csv", "line 3"),
    ("convert data.npz --out {0}", "made.csv", ".npz"),
    ("convert data.npz --out made.npz --rate {0}", "nan", "--rate nan"),
    ("inspect {0}", "nothing.npz", "is not there"),
    ("train --data data.npz --config {0} --out new", "fabrik", "configuration 'fabrik'"),
    ("train --data data.npz --out {0}", "mine", "thesis.tex"),
    ("generate model --out {0}|run --data data.npz --out {0}", "mine", "other files"),
    ("inspect data.npz --json {0}", "/dev/null", "/dev/null: is not a regular file"),
    ("stability model --data data.npz --out t --no-cosim --mode {0}", "tie", "mode 'tie': is unknown"),
    ("train --data data.npz --out new --group {0}", "person", "has no group array 'person'; it has trial"),
    (
        "quantise model --formats {0}",
        "weight_bits=4",
        "--formats weight_bits=4: is not a format; give feature_bits, gate_bits, table_entries",
    ),
    (
        "quantise model --quantisation-aware --state-bits {0}",
        "12",
        "--quantisation-aware: needs the recordings of the",
    ),
    ("cosim model --data data.npz --recordings {0}", "0", "--recordings 0: is not a number of recordings"),
    ("cosim model --data data.npz --clock {0}", "0.5", "is not a clock; give 1 Hz"),
    (
        "cosim model --data data.npz --clock {0}|build model --target icebreaker --clock {0}|energy model --data data.npz --touches {0}",
        "inf",
        "inf: is not a number",
    ),
    ("evaluate model|evaluate model --data data.npz --against {0}", "design", "give one of the two"),
]


def test_what_is_refused_is_one_sentence_and_changes_no_file(call, folder, model, monkeypatch):
    """The command ends with 2, one line on standard error, nothing on standard output; of a configuration before a
    recording is read."""
    import eskin.data.load

    def too_late(*_, **__):
        raise AssertionError("recordings were read before the configuration was refused")

    bad_files(model)
    Path("build/cosim").mkdir(parents=True, exist_ok=True)  # where runs of cosim have their own folders
    before = contents(folder)
    for commands, name, sentence in REFUSED:
        with monkeypatch.context() as patch:
            if commands == BEFORE:
                patch.setattr(eskin.data.load, "load_archive", too_late)
            for command in commands.split("|"):
                status, out, err = call(*command.format(name).split())
                assert (status, out, err.count("\n")) == (2, "", 1), (command, name, out, err)
                assert err.startswith("eskin: ") and sentence in err, err
                assert name in err or not Path(name).suffix, err
                assert contents(folder) == before, (command, name)


# ---------------------------------------------------------------------- interrupts and full disks
def test_an_interrupt_ends_with_130_and_one_sentence(call, folder, monkeypatch):
    """It comes while recordings are read."""
    monkeypatch.setattr("eskin.data.load.load_archive", lambda *_, **__: signal.raise_signal(signal.SIGINT))
    before = contents(folder)
    # a process of xdist ignores an interrupt; a user at a terminal does not
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        status, out, err = call(*"train --data data.npz --out new".split())
    finally:
        signal.signal(signal.SIGINT, handler)
    assert (status, out, err.count("\n")) == (130, "", 1) and err.startswith("eskin: stopped by the user")
    assert contents(folder) == before


INTERRUPTED_AT = """import importlib.abc, os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
class Finder(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == {module!r}:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Finder())
sys.argv = ["eskin", "--help"]
from {place} import main
main()
"""


@each_row("module", ["typer", "eskin.cli.common"])
def test_an_interrupt_while_modules_are_loaded_ends_with_130(module):
    entry = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]["eskin"]
    program = INTERRUPTED_AT.format(module=module, place=entry.partition(":")[0])
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 130 and not done.stdout, done
    assert done.stderr.startswith("eskin: stopped by the user") and done.stderr.count("\n") == 1


def test_a_full_disk_leaves_no_folder(call, model):
    """No file may hold more than 4 kB."""
    before, limits = contents(model.parent), resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, limits[1]))
    try:
        status, _, err = call("generate", "model", "--out", "new/er")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert status == 2 and "File too large" in err, err
    assert not Path("new").exists() and contents(model.parent) == before


@each_row("function", [replacing, replacing_folder])
def test_folders_that_were_made_for_a_file_go_with_it(function, tmp_path):
    for other, left in ((None, []), ("er/other", ["er", "er/other"])):
        with pytest.raises(OSError), function(tmp_path / "new" / "er" / "name"):
            if other:
                (tmp_path / "new" / other).write_text("another process's")
            raise OSError
        assert [str(path.relative_to(tmp_path / "new")) for path in (tmp_path / "new").rglob("*")] == left
