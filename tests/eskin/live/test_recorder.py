"""Touches of a board's own sensor into an archive (eskin/live/recorder.py): exactly the frames that were sent, whole touches
alone, and a file that is whole at any time."""

import dataclasses
from collections import deque

import numpy as np
import pytest

from eskin.data import load_recordings
from eskin.data.archive import save_archive
from eskin.data.fit import for_model
from eskin.golden.data import Recordings
from eskin.golden.model import Stream, run
from eskin.live.feed import Differs, Result
from eskin.live.link import SensorFrame
from eskin.live.recorder import GrowingArchive, Recorder
from eskin.live.serial_port import SerialPort
from eskin.live.sources import SensorSource
from eskin.training.times import decision_times
from eskin.verbs.watch import at_scan_rate, board_source
from tests.eskin.live.test_link import CONFIG
from tests.support.link_device import Device, SensorDevice
from tests.support.live_case import Stage
from tests.support.random_models import random_integer_model
from tests.support.table import refused

MODEL = random_integer_model(CONFIG.replace(fault_frames=0), 5)
RATE, TAXELS = CONFIG.sensor.sample_rate_hz, CONFIG.sensor.taxels
REST = round((CONFIG.onset_rule.band_low + CONFIG.onset_rule.band_high) / 2)
LEAD = Recorder(None, MODEL).lead


def rest(frames: int, seed: int = 0) -> np.ndarray:
    return REST + np.random.default_rng(seed).integers(-2, 3, (frames, TAXELS))


def touch(seed: int, frames: int = 30) -> np.ndarray:
    height = CONFIG.onset_rule.band_high + np.random.default_rng(seed).integers(5, 200, (frames, TAXELS))
    return np.minimum(height, CONFIG.sample_format.max_code)


class Line:
    """In place of the link: frames in pieces of random length, numbered; ``missing`` of them are not there."""

    def __init__(self, samples: np.ndarray, missing: set[int] = frozenset(), seed: int = 1) -> None:
        words = enumerate(samples.astype(np.uint16))
        self.waiting = [SensorFrame(k + 65500 & 0xFFFF, word) for k, word in words if k not in missing]
        self.frames, self.rng = deque[SensorFrame](), np.random.default_rng(seed)

    def listen(self, timeout_s: float) -> None:
        count = self.rng.integers(1, 40)
        self.frames.extend(self.waiting[:count])
        del self.waiting[:count]

    def write(self, writes) -> None:
        self.waiting.clear()


def recorded(path, samples, name="wool", model=MODEL, **options):
    """(the source, its events) behind ``samples``, recorded as class ``name`` into ``path``."""
    line = Line(samples, **options)
    source = SensorSource(model, line, "port", Recorder(GrowingArchive(path, model.config), model))
    events = source.change(name, undo=False)
    while line.waiting:
        events += source.listen(0)
    return source, events


def test_each_touch_is_a_recording_from_its_rest_to_its_pause(tmp_path):
    """Each holds frames of the sensor, decided as in the live view; a second session adds to the file."""
    path, parts = tmp_path / "touches.npz", []
    for seed in range(3):
        parts += [rest(LEAD + 40 * seed + 20, seed), touch(seed), rest(LEAD, seed + 9)]
    samples = np.concatenate(parts)
    source, events = recorded(path, samples)
    source.close()
    saved = load_recordings(path)
    assert saved.class_names == ("wool",) and len(saved) == 3 and saved.sample_rate_hz == RATE
    whole, begin = samples.tobytes(), 0
    for number in range(3):
        frames = saved.recording(number)
        onset = LEAD + 1
        begin = whole.index(frames.astype(samples.dtype).tobytes(), begin) + 1  # in order, frame by frame
        assert (
            Stream(MODEL).push(frames[: onset - 1]) == []
            and frames[onset - 1].max() > CONFIG.onset_rule.band_high
        )
    found = run(MODEL, dataclasses.replace(saved, class_names=CONFIG.network.class_names))
    results = [event for event in events if isinstance(event, Result)]
    assert [event.number for event in results] == [0, 1, 2]
    assert [event.since for event in results] == decision_times(found).round(6).tolist()
    assert [event.decision for event in results] == found.decision.tolist() and (found.decision >= 0).all()
    source, _ = recorded(path, samples[: len(samples) // 3], name="silk")
    source.close()
    grown = load_recordings(path)
    assert grown.class_names == ("wool", "silk") and grown.labels.tolist() == [0, 0, 0, 1]
    assert (grown.samples[: saved.frames] == saved.samples).all()


def test_what_is_no_whole_touch_is_not_added(tmp_path):
    """Too early, cut by a gap, not over; then a whole one is."""
    path, good = tmp_path / "touches.npz", [rest(LEAD + 50), touch(1), rest(60)]
    early = [rest(LEAD - 60), touch(2), rest(60)]
    source, _ = recorded(path, np.concatenate([*early, touch(3)]))
    assert source.record["trouble"].endswith("it came too early") and not path.exists()
    source, events = recorded(path, np.concatenate([*good, *good]), missing={LEAD + 60})
    assert [event.sentence[-1] for event in events if isinstance(event, Differs)] == ["1"]
    assert source.record["counts"] == {"wool": 1}
    source.close()
    second = np.concatenate(good)[50:]
    assert (load_recordings(path).samples[: LEAD + 30] == second[: LEAD + 30]).all()


def test_undo_takes_back_what_this_session_added(tmp_path):
    path = tmp_path / "touches.npz"
    source, _ = recorded(path, np.concatenate([rest(LEAD + 50), touch(1), rest(60)] * 2))
    source.change("silk", undo=True)
    source.close()
    assert len(load_recordings(path)) == 1 and source.record["counts"] == {"wool": 1}
    source, _ = recorded(path, np.concatenate([rest(LEAD + 50), touch(1), rest(60)]), name="silk")
    for _ in range(3):
        source.change("", undo=True)
    source.close()
    assert load_recordings(path).class_names == ("wool",) and len(load_recordings(path)) == 1
    path.unlink()
    source, _ = recorded(path, np.concatenate([rest(LEAD + 50), touch(1), rest(60)]))
    source.change("", undo=True)
    source.close()
    assert not path.exists()


def test_other_archives_and_models_are_refused(tmp_path):
    config, path = MODEL.config, tmp_path / "other.npz"
    with refused("give a name that ends with .npz"):
        GrowingArchive(tmp_path / "touches.h5", config)
    of = Recordings.of([rest(9)], ["wool"], sample_rate_hz=RATE, groups={"day": [1]})
    save_archive(of, path)
    with refused("has groups .day."):
        GrowingArchive(path, config)
    save_archive(dataclasses.replace(of, groups={}, sample_rate_hz=2 * RATE), path)
    with refused("use recordings and a model of one sensor"):
        GrowingArchive(path, config)
    at_once = dict(onset="immediate", window_mode="free", window=8)
    with refused("finds no touch to record"):
        Recorder(None, random_integer_model(CONFIG.replace(**at_once), 5))


def test_a_model_that_scans_some_frames_takes_what_its_board_sends(tmp_path):
    """The board sends the frames that the chain takes; held at the source's rate they are decided in the same way."""
    model = dataclasses.replace(MODEL, config=MODEL.config.replace(scan_every=4, sample_rate_hz=4 * RATE))
    samples = np.concatenate([rest(LEAD + 50), touch(4), rest(60)])
    source, _ = recorded(
        tmp_path / "touches.npz", samples, CONFIG.network.class_names[0], at_scan_rate(model)
    )
    source.close()
    saved = load_recordings(tmp_path / "touches.npz")
    fitting = for_model(saved, model.config)
    assert saved.sample_rate_hz == RATE and fitting.sample_rate_hz == 4 * RATE
    assert (fitting.scanned(4).samples == saved.samples).all() and run(model, fitting).decision[0] >= 0


def test_a_second_recorder_of_a_file_is_told_to_take_another(tmp_path):
    files = [GrowingArchive(tmp_path / "touches.npz", MODEL.config) for _ in range(2)]
    for number in range(3):
        files[0].add(touch(number), "wool")
        files[0].undo()
    files[0].add(touch(4), "wool")
    files[0].close()
    with refused("another program has written it"):
        files[1].add(touch(5), "silk")
    assert len(load_recordings(tmp_path / "touches.npz")) == 1


@pytest.mark.parametrize("sends", [False, True])
def test_over_a_serial_port(sends, tmp_path):
    """A board that sends no frames is refused; another is told to stop in the end."""
    path, config = tmp_path / "touches.npz", MODEL.config
    recorder = Recorder(GrowingArchive(path, config), MODEL)
    device = SensorDevice(config, rest(64)) if sends else Device(config, lambda samples: None)
    with device:
        transport = SerialPort(device.port, 2_000_000)
        try:
            if not sends:
                with refused("build it with --converter NAME --frames"):
                    board_source(MODEL, transport, device.port, 2_000_000, False, recorder)
                return
            stage = Stage(
                board_source(MODEL, transport, device.port, 2_000_000, False, recorder), None
            ).start()
            stage.controls.change(name="wool")
            waits = lambda: str((stage.seen("state") or [{"record": None}])[-1]["record"])
            stage.until(lambda: "press the sensor: touch 1 of class wool" in waits())
            device.touch = touch(6)
            stage.until(lambda: "touch 2 of class wool" in waits())
            stage.stop()
            assert stage.player.error is None and device.registers[0x34] == 0
        finally:
            transport.close()
    frames, sent = load_recordings(path).recording(0), np.array(device.sent)
    assert sent.tobytes().find(frames.astype(sent.dtype).tobytes()) >= 0
