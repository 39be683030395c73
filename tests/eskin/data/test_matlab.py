"""Recordings from .mat files, written by scipy as MATLAB writes them."""

import zlib

import numpy as np
import pytest
from scipy.io import savemat

from eskin.data import Reading, load_recordings
from tests.support.table import each_row, refused

PARTS = [np.random.default_rng(n).integers(0, 500, (20 + n, 4)).astype(float) for n in range(4)]


def cells(items):
    made = np.empty((1, len(items)), dtype=object)
    made[0, :] = items
    return made


GOOD = {
    "samples": cells(PARTS),
    "labels": np.array([[1, 2, 1, 2]]),
    "class_names": cells(["silk", "felt"]),
    "fs": 250.0,
    "person": np.array([[0], [0], [1], [1]]),
}


def write(path, **changes):
    savemat(
        path,
        {name: value for name, value in (GOOD | changes).items() if value is not None},
        do_compression=True,
    )
    return path


@each_row(
    "changes",
    [
        {},
        {"samples": None, "data": cells(PARTS)},
        {"samples": np.concatenate(PARTS), "offsets": np.cumsum([0, *map(len, PARTS)])},
        {"labels": cells(["silk", "felt", "silk", "felt"])},
        {"fs": None, "sample_rate_hz": 250},
        {"class_names": None, "label_names": cells(["silk", "felt"])},
    ],
)
def test_recordings_in_several_forms(tmp_path, changes):
    recordings = load_recordings(write(tmp_path / "r.mat", **changes))
    assert recordings.class_names == ("silk", "felt") and recordings.labels.tolist() == [0, 1, 0, 1]
    assert recordings.sample_rate_hz == 250 and recordings.groups["person"].tolist() == [0, 0, 1, 1]
    assert changes or any("numbered from 1" in note for note in recordings.notes)
    assert all(np.array_equal(recordings.recording(n), PARTS[n]) for n in range(4))


def test_stacks_and_real_samples(tmp_path):
    stack = np.stack([part[:20] for part in PARTS]) / 7
    recordings = load_recordings(write(tmp_path / "r.mat", samples=stack, class_names=None))
    assert recordings.class_names == ("1", "2") and recordings.volt_per_code == 5e-3
    assert np.abs(recordings.recording(2) * recordings.volt_per_code - stack[2]).max() <= 0.0025 + 1e-9
    named = load_recordings(
        write(tmp_path / "r.mat", samples=None, touch=cells(PARTS)),
        reading=Reading(samples="touch", rate_hz=10),
    )
    assert named.sample_rate_hz == 10 and len(named) == 4


BROKEN = [
    ({"samples": None}, "has no array of samples"),
    ({"labels": None}, "has no array of classes"),
    (
        {"samples": cells([PARTS[0], np.full((3, 4), np.nan), *PARTS[2:]])},
        "recording 1, row 1: column 1 holds 'nan', which is not a finite number",
    ),
    ({"labels": np.array([1, 2, 1])}, "give one name or whole number for each of the 4 recordings"),
    ({"labels": np.array([1, 2, 1, 7])}, "runs from 1 to 7 and there are 2 class names, numbered 1 to 2"),
    ({"labels": [0, 1, 0, -1]}, "runs from -1 to 1 .* numbered 0 to 1; leave other recordings out"),
    ({"labels": [1, 0.5, 2, 1]}, "array labels: holds 0.5; give one name or whole number for each"),
    ({"samples": cells(["a", "b", "c", "d"])}, "recording 0 is"),
    ({"samples": PARTS[0]}, "or one table and an array offsets"),
    ({"samples": np.concatenate(PARTS), "offsets": [0, 5, 3, 86]}, "does not rise after entry 1"),
    ({"fs": -3.0}, "must be one number above 0"),
]


@each_row("changes, sentence", BROKEN)
def test_a_broken_file_is_refused(tmp_path, changes, sentence):
    with refused(sentence, "r.mat"):
        load_recordings(write(tmp_path / "r.mat", **changes))


def test_files_that_are_none(tmp_path):
    path = write(tmp_path / "r.mat")
    data = path.read_bytes()
    for damaged in (b"", data[:200], data[:-40], b"\0" * 500, b"text"):
        path.write_bytes(damaged)
        with refused("r.mat"):
            load_recordings(path)
    path.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64" + b" " * 90)
    with refused("version 7.3"):
        load_recordings(path)


@each_row("kind", ["bytes", "lie"])
def test_a_file_that_unpacks_to_far_more_is_refused_before_it_is_read(tmp_path, monkeypatch, kind):
    monkeypatch.setattr("eskin.data.table.UNPACKED_BYTES", 1 << 20)
    path = write(tmp_path / "r.mat", samples=np.zeros((4, 1000, 1000 if kind == "bytes" else 10), np.uint8))
    if kind == "lie":  # declares 4 GB in place of 40 kB
        data = bytearray(path.read_bytes())
        head = zlib.compress(b"\x0e\0\0\0" + b"\xff\xff\xff\xef" + b"\0" * 64)
        path.write_bytes(data[:128] + b"\x0f\0\0\0" + len(head).to_bytes(4, "little") + head)
    monkeypatch.setattr("scipy.io.loadmat", lambda *_, **__: pytest.fail("it was read"))
    with refused(r"r.mat': has \d+ bytes and unpacks to \d+ MB"):
        load_recordings(path)


def test_a_file_that_kills_scipys_reader_is_refused(tmp_path):
    savemat(tmp_path / "r.mat", {"samples": np.zeros((2, 3, 4)), "labels": [1, 2], "fs": 1.0})
    data, tag = (tmp_path / "r.mat").read_bytes(), b"\x09\0\0\0" + (192).to_bytes(4, "little")
    assert data.count(tag) == 1
    # numbers of a kind that there is not
    (tmp_path / "r.mat").write_bytes(data.replace(tag, b"\xff" + tag[1:]))
    with refused("r.mat': is damaged"):
        load_recordings(tmp_path / "r.mat")
