"""eskin/live/recorder.py: what is recorded is what was played, whole or not at all."""

import numpy as np
import pytest

from eskin.data import load_recordings
from eskin.golden.core import InputError
from eskin.golden.data import load_archive, save_archive
from eskin.live.recorder import Recorder
from tests.support.table import each_row
from tests.support.touch_scenes import SMALL


def test_an_archive_that_loads(tmp_path):
    rng = np.random.default_rng(5)
    samples = rng.integers(0, 65536, (30, 4))
    recorder = Recorder(tmp_path / "new" / "mine.npz", SMALL)
    assert not recorder.path.exists()
    recorder.begin(2)
    recorder.frames(samples[:10])
    recorder.frames(samples[10:20])
    recorder.end(1)
    recorder.begin(0)  # without a frame: left out
    recorder.begin(1)
    recorder.frames(samples[20:])
    recorder.end(1)
    assert recorder.frames_written == 30 and recorder.close()
    loaded = load_archive(tmp_path / "new" / "mine.npz")
    assert (loaded.samples == samples).all()
    assert loaded.offsets.tolist() == [0, 20, 30]
    assert loaded.labels.tolist() == [2, 1]
    assert loaded.class_names == SMALL.network.class_names
    assert loaded.sample_rate_hz == SMALL.sensor.sample_rate_hz
    assert loaded.groups == {}, "what the model decided is no group that training may split by"
    with np.load(tmp_path / "new" / "mine.npz") as archive:
        assert archive["decision"].tolist() == [[1], [1]] and archive["samples"].dtype == np.uint16
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["mine.npz"]


def test_an_old_archive_stays_when_nothing_was_played(tmp_path):
    (tmp_path / "mine.npz").write_bytes(b"old")
    recorder = Recorder(tmp_path / "mine.npz", SMALL)
    recorder.begin(0)
    assert not recorder.close()
    assert [path.name for path in tmp_path.iterdir()] == ["mine.npz"] and (
        tmp_path / "mine.npz"
    ).read_bytes() == b"old"


def test_frames_stay_when_the_archive_cannot_be_written_and_become_one_later(tmp_path, monkeypatch):
    """The disk is full at the end; what the last piece could not bring there whole is left out."""
    samples = np.random.default_rng(5).integers(0, 65536, (30, 4))
    recorder = Recorder(tmp_path / "mine.npz", SMALL)
    for label, part in ((2, samples[:10]), (0, samples[10:])):
        recorder.begin(label)
        recorder.frames(part)
        recorder.end(1)
    monkeypatch.setattr(
        np, "savez", lambda *_, **__: (_ for _ in ()).throw(OSError(28, "No space left on device"))
    )
    with pytest.raises(InputError, match=r"mine.npz: cannot be written \(No space left.* make room") as error:
        recorder.close()
    monkeypatch.undo()
    (raw,) = tmp_path.iterdir()
    assert f"eskin convert {raw} --out {tmp_path / 'mine.npz'}" in str(error.value)
    save_archive(load_recordings(raw), recorder.path)
    loaded = load_archive(recorder.path)
    assert (loaded.samples == samples).all()
    assert loaded.offsets.tolist() == [0, 10, 30]
    assert loaded.labels.tolist() == [2, 0]
    raw.write_bytes(raw.read_bytes()[:-1])
    assert (load_recordings(raw).samples == samples[:29]).all()
    for text in (b"", b"[" * 9, b"{}\n", raw.read_bytes().splitlines()[0] + b"\n", b'{"code": "O"}'):
        raw.write_bytes(text)
        with pytest.raises(InputError, match="holds no frame"):
            load_recordings(raw)


def test_signed_and_short_codes_keep_their_type(tmp_path):
    config = SMALL.replace(sample_bits=8, sample_signed=True)
    recorder = Recorder(tmp_path / "mine.npz", config)
    recorder.begin(0)
    recorder.frames(np.array([[-128, 127, 0, -1]]))
    assert recorder.close()
    loaded = load_archive(tmp_path / "mine.npz")
    assert loaded.samples.tolist() == [[-128, 127, 0, -1]]
    assert loaded.sample_bits == 8
    assert loaded.sample_signed


@each_row(
    ("name", "sentence"),
    [("mine.txt", "ends with .npz"), ("folder.npz", "no regular file"), ("file/mine.npz", "is a file")],
)
def test_names_that_cannot_be_written(tmp_path, name, sentence):
    (tmp_path / "folder.npz").mkdir()
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=sentence):
        Recorder(tmp_path / name, SMALL)
