"""Damaged inputs and odd command lines: a sample of ``make fuzz``, that the fuzzer sees each kind of defect, and what it found."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from eskin.cli import data
from eskin.golden.core.config import PRESETS, AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.golden.core.files import MOST_UNPACKED_BYTES, ArchiveError, read_arrays
from eskin.golden.data import load as reader
from eskin.golden.data.load import load_recordings
from eskin.golden.model.model import IntegerModel, load_training, random_integer_model
from eskin.golden.studies.sweep import read_grid
from eskin.golden.training.import_network import read_layers
from eskin.golden.training.quantise import SIGNALS, quantise
from eskin.pages.report import write_report
from eskin.verbs.generate_job import generate_design
from scripts import fuzz_job
from scripts.fuzz_inputs import _header
from tests.support.result_case import CONFIG, edit, float_model, make_result

ROOT = Path(__file__).resolve().parents[2]


def fuzz(out: Path, *options: str) -> tuple[int, dict]:
    """Exit status and result of the job in a process of its own."""
    command = [sys.executable, "-m", "scripts.fuzz_job", "--out", str(out), *options]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600, check=False)
    assert (out / "fuzz.json").exists(), ended.stderr
    return ended.returncode, json.loads((out / "fuzz.json").read_text())


@pytest.mark.timeout(600)
def test_a_sample_of_all_groups_is_without_defect_and_resumes(tmp_path):
    status, result = fuzz(tmp_path, "--inputs", "100", "--seed", "2")
    assert status == 0 and not result["defects"], result["defects"]
    assert result["inputs"] >= 100 and all(sum(counts.values()) for counts in result["groups"].values())
    outcomes = {outcome for counts in result["groups"].values() for outcome in counts}
    assert {"refused", "long work", "done"} <= outcomes, "the inputs no longer reach every end, so the fuzzer has become blind"
    status, again = fuzz(tmp_path, "--inputs", "100", "--seed", "2")
    assert status == 0 and again["groups"] == result["groups"] and again["wall_s"] < 2


BREAKS = {
    "traceback": "def broken(*a, **k): return 1 / 0\n",
    "wrote outside": f"def broken(*a, **k): open({str(ROOT)!r} + '/README.md', 'a').close(); raise SystemExit(2)\n",
    "hang": "def broken(*a, **k):\n    while True: pass\n",
    "too much memory": "def broken(*a, **k): return bytearray(3 << 30)\n",
    "odd status": "def broken(*a, **k): raise SystemExit(7)\n",
    "no sentence": "def broken(*a, **k): raise SystemExit(2)\n",
    "left behind": "def broken(*a, **k): open('.half.tmp', 'w').close(); raise InputError('no')\n",
    "unpickled": "def broken(*a, **k): import pickle; pickle.loads(b'cos\\nsep\\n.'); raise InputError('no')\n",
    # past Python, so that no audit event tells of it
    "input changed": "def broken(path, **k):\n    import ctypes\n    ctypes.CDLL(None).truncate(path.encode(), 5)\n    raise SystemExit(0)",
}


@pytest.mark.parametrize("defect", BREAKS)
def test_the_fuzzer_sees(tmp_path, monkeypatch, defect):
    """The reader of recordings broken in one way; input 4 of the archives is one that it reads."""
    names = {"InputError": InputError}
    exec(BREAKS[defect], names)
    monkeypatch.setattr(reader, "load_recordings", names["broken"])
    monkeypatch.setattr(fuzz_job, "PROCESSOR_S", 1)
    records = fuzz_job.Job(tmp_path, 1, 1).run([("archives", 4)], lambda record: None)
    assert [record["outcome"] for record in records] == [defect], records
    assert (tmp_path / "failed" / "archives 4" / "in").is_dir()


# ---------------------------------------------------------------------- what it found
def test_archives_of_odd_members_are_refused_everywhere(tmp_path):
    """An unknown compression method and an encrypted member ended `eskin evaluate` and `eskin report` in a traceback."""
    folder = make_result(tmp_path / "result")
    for file, load in (("model/weights.npz", lambda: IntegerModel.load(folder / "model")), ("trace.npz", lambda: write_report(folder))):
        good = (folder / file).read_bytes()
        for offset, value in ((8, 1), (10, 97)):
            changed = bytearray(good)
            for mark, back in ((b"PK\x01\x02", 0), (b"PK\x03\x04", 2)):
                at = changed.find(mark)
                while at >= 0:
                    changed[at + offset - back] = value
                    at = changed.find(mark, at + 4)
            (folder / file).write_bytes(changed)
            with pytest.raises(InputError, match="damaged"):
                load()
        (folder / file).write_bytes(good)


def test_a_member_that_is_no_array_is_left_out(tmp_path):
    """A pickle called like an array came back as bytes and ended `eskin build` in a traceback."""
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("W_z.npy", b"\x80\x04N.")
    assert read_arrays(tmp_path / "a.npz") == {}


def test_a_bomb_is_refused_before_it_is_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr("eskin.golden.core.files.MOST_UNPACKED_BYTES", 1000)
    np.savez_compressed(tmp_path / "bomb.npz", samples=np.zeros(10_000, dtype=np.int32))
    with pytest.raises(InputError, match="unpacks to"):
        load_recordings(tmp_path / "bomb.npz")
    assert MOST_UNPACKED_BYTES == 4 << 30
    with zipfile.ZipFile(tmp_path / "lie.npz", "w") as archive:
        archive.writestr("samples.npy", _header((2**40, 4)))
    with pytest.raises(ArchiveError, match="damaged"):
        read_arrays(tmp_path / "lie.npz")


@pytest.mark.timeout(20)
@pytest.mark.parametrize("name", ["recordings.npz", "lvm", "run.json", "trace.npz", "model/training.json"])
def test_a_pipe_among_the_files_is_refused(tmp_path, name):
    """Opening it would wait for ever for a writer: `eskin report` and `eskin inspect` hung."""
    if name == "lvm":
        (tmp_path / "lvm" / "rough").mkdir(parents=True)
        os.mkfifo(tmp_path / "lvm" / "rough" / "p1.lvm")
    elif name == "recordings.npz":
        os.mkfifo(tmp_path / name)
    else:
        make_result(tmp_path)
        (tmp_path / name).unlink()
        os.mkfifo(tmp_path / name)
    with pytest.raises(InputError, match="no regular file"):
        if name == "model/training.json":
            load_training(tmp_path / "model")
        elif name in ("run.json", "trace.npz"):
            write_report(tmp_path)
        else:
            load_recordings(tmp_path / name)


@pytest.mark.parametrize(
    ("file", "field", "value"),
    [
        ("cosim.json", "compared_values", "x"),
        ("cosim.json", "compared_values", float("nan")),
        ("model/training.json", "ranges", 3),
        ("model/training.json", "ranges", [0.5]),
        ("cosim_declared.json", "budgets", {"a": 1}),
        ("run.json", "checks", None),
    ],
)
def test_a_field_of_another_type_in_a_result(tmp_path, file, field, value):
    """`eskin report` ended in a traceback."""
    edit(make_result(tmp_path) / file, **{field: value})
    with pytest.raises(InputError, match="make the result again"):
        write_report(tmp_path)


def test_a_grid_nested_beyond_reading(tmp_path):
    (tmp_path / "deep.json").write_text("[" * 100_000)
    for read in (read_grid, AcceleratorConfig.load):
        with pytest.raises(InputError, match="is not JSON"):
            read(tmp_path / "deep.json")


def test_the_working_folder_is_no_folder_to_generate_into(tmp_path):
    """``--out ""`` ended in a traceback."""
    with pytest.raises(InputError, match="name a new folder"):
        generate_design(random_integer_model(CONFIG, 1), Path(""))


@pytest.mark.timeout(60)
@pytest.mark.parametrize("bits", [-1, 1])
def test_a_width_below_two_bits_is_refused(tmp_path, bits):
    """`eskin quantise --weight-bits -1` looked for a format for ever."""
    with pytest.raises(InputError, match=f"{bits} bits were asked for"):
        quantise(make_result(tmp_path) / "model", weight_bits=bits)


def test_an_array_beyond_any_network_is_refused_before_it_is_converted(tmp_path):
    """`eskin import` ran out of memory over 400 MB of zeros in an archive of 400 kB."""
    np.savez_compressed(tmp_path / "k.npz", *[np.zeros((1 << 19, 4), dtype=np.int8)] * 5)
    with pytest.raises(InputError, match="beyond any network"):
        read_layers(tmp_path / "k.npz")


@pytest.mark.parametrize(
    "ranges",
    [
        ["feature"],
        [1.5],
        [{"signal": "weight", "min": 0, "max": "a"}],
        [{"signal": "feature", "min": 0, "max": 1}],
        [{"signal": signal, "min": 0.0, "max": float("nan")} for signal in SIGNALS],
    ],
)
def test_ranges_that_are_none_are_refused(tmp_path, ranges):
    """Ranges of another type, without a number or without a signal ended `eskin quantise` in a traceback."""
    float_model().save(tmp_path / "model", {"ranges": ranges})
    with pytest.raises(InputError, match="training.json, field ranges: .*give the recordings"):
        quantise(tmp_path / "model", None)


def test_a_class_name_that_is_no_text_is_refused():
    """A number among the names ended `eskin evaluate` in a traceback."""
    with pytest.raises(InputError, match="class_names"):
        PRESETS["thesis"].replace(class_names=("brush", 1.5, "slide"))


def test_a_link_to_itself_is_refused(tmp_path, monkeypatch):
    """`eskin inspect` named its picture after where the link leads."""
    monkeypatch.chdir(tmp_path)
    Path("recordings.npz").symlink_to("recordings.npz")
    with pytest.raises(InputError, match="recordings.npz"):
        data.inspect("recordings.npz")
