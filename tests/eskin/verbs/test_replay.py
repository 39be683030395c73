"""eskin replay against a board in Python behind a pseudo-terminal: equal and differing decisions, losses,
everything that can go wrong."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eskin.cosim import device
from eskin.data.archive import save_archive
from eskin.golden.core import AcceleratorConfig
from eskin.golden.model.prototypes import forget, taught_in_use
from eskin.live import link
from eskin.rtl.fpga.generate import boot_writes
from eskin.rtl.program.memory_map import Register
from eskin.teach.taught import load_taught
from eskin.training.made_up import image_recordings, random_images, random_recordings
from eskin.verbs import replay as verb
from eskin.verbs.replay import ReplayRequest
from tests.eskin.live.test_link import CONFIG
from tests.golden.model.test_prototypes import taught_model
from tests.support.image_scenes import random_image_model
from tests.support.link_device import Device, golden_decisions
from tests.support.link_flow import TIMEOUT_BYTES, board_of
from tests.support.pin_port import PinPort
from tests.support.random_models import random_integer_model
from tests.support.table import each_row, refused
from tests.support.touch_scenes import scene


@pytest.fixture(scope="module")
def model():
    return random_integer_model(CONFIG.replace(lanes=1), 5)


@pytest.fixture(scope="module")
def recordings(model):
    return random_recordings(model.config, (90, 40, 60, 12, 5), seed=4)


@pytest.fixture
def replay(call, model, recordings, tmp_path, monkeypatch):
    """``replay(port, *options)``: eskin replay of the model and recordings; (status, output, errors)."""
    model.save(tmp_path / "model")
    save_archive(recordings, tmp_path / "data.npz")
    built(tmp_path / "model/board")
    monkeypatch.setattr(verb, "ANSWER_S", 0.1)

    def run(port: str, *options: str) -> tuple[int, str, str]:
        return call("replay", tmp_path / "model", "--port", port, "--data", tmp_path / "data.npz", *options)

    return run


def test_equal_decisions(replay, model, recordings, tmp_path):
    with Device(model.config, golden_decisions(model, recordings)) as device:
        status, out, errors = replay(device.port, "--json", str(tmp_path / "replay.json"))
    assert (status, errors) == (0, "") and "equal" in out
    result = json.loads((tmp_path / "replay.json").read_text())
    assert result["bit_exact"] and result["passed"] and result["recordings"] == 5
    assert result["frames"] == recordings.frames == device.accepted
    assert result["decisions"] == device.decisions > 10
    assert not any(result[key] for key in "mismatches repeated replayed unanswered damaged".split())
    loads = boot_writes(model.config, model.arrays)
    assert device.writes[1 : 1 + len(loads)] == loads


NO_SUCCESS = [
    (0, {}, "no touch was long enough for a decision"),
    (1, {Register.TAXEL_FAULTS: 0xFFFF}, "(TAXEL_FAULTS): expected "),
]
"""Recordings with a touch, registers of the board, words of the result."""
COLUMNS = {"step": 1, "class": 2, "margin": 3}


@each_row("way", [*COLUMNS, "missing", "extra", "touches"])
def test_one_difference_in_one_recording_is_found(replay, model, recordings, way):
    golden = golden_decisions(model, recordings)

    def decide(samples):
        rows, touches = golden(samples)
        if len(samples) != 60:
            return rows, touches
        rows = {"missing": rows[:-1], "extra": np.concatenate([rows, rows[:1]])}.get(way, rows).copy()
        if way in COLUMNS:
            rows[1, COLUMNS[way]] ^= 1
        return rows, touches + (way == "touches")

    with Device(model.config, decide) as device:
        status, out, _ = replay(device.port)
    found = [line for line in out.splitlines() if line.startswith("mismatch: ")]
    assert status == 1 and all(line.startswith("mismatch: recording 2") for line in found) and found
    assert way not in COLUMNS or (len(found) == 1 and way in found[0])


@pytest.mark.parametrize(("count", "registers", "words"), NO_SUCCESS)
def test_a_false_register_or_no_decision_is_no_success(
    replay, model, recordings, tmp_path, count, registers, words
):
    few = recordings.subset([*range(count), 4])
    save_archive(few, tmp_path / "data.npz")
    with Device(model.config, golden_decisions(model, few), registers=registers) as device:
        status, out, _ = replay(device.port)
    assert status == 1 and words in out and "equal" not in out


def test_lost_packets_change_nothing(replay, model, recordings, tmp_path):
    """Some on the way there, or back; the first or the last decision of a recording alone."""
    golden = golden_decisions(model, recordings)
    with Device(model.config, golden) as device:
        replay(device.port)
    decided = device.decision_packets[: len(golden(recordings.recording(0))[0])]
    for key, loses in (
        ("repeated", lambda number, sent: not sent and number % 57 == 0),
        ("replayed", lambda number, sent: sent and number % 23 == 0),
        ("replayed", lambda number, sent: sent and number == decided[0]),
        ("replayed", lambda number, sent: sent and number == decided[-1]),
    ):
        with Device(model.config, golden, loses=loses) as device:
            status, _, _ = replay(device.port, "--json", str(tmp_path / "replay.json"))
        result = json.loads((tmp_path / "replay.json").read_text())
        assert status == 0 and result["bit_exact"] and result[key] > 0
        assert key == "replayed" or result["frames"] <= device.accepted
    assert result["replayed"] == 1


MISTAKES = {
    "other design": ({"registers": {Register.ID: 0x1234}}, "ID register reads 0x1234"),
    "other version": ({"registers": {Register.VERSION: 99}}, "version 99"),
    "silent": ({"deaf": True}, "does not answer"),
    "pulled out": ({"frames_limit": 70}, "went away"),
    "decisions never arrive": ({"loses": lambda number, sent: sent and number % 3 == 0}, "got lost 10 times"),
}


@each_row("mistake", MISTAKES)
def test_a_board_that_is_not_as_it_should_be_is_named(
    replay, model, recordings, tmp_path, monkeypatch, mistake
):
    options, sentence = MISTAKES[mistake]
    monkeypatch.setattr(verb, "ANSWER_S", 0.02)
    with Device(model.config, golden_decisions(model, recordings), **options) as device:
        status, out, errors = replay(device.port, "--json", str(tmp_path / "replay.json"))
        assert (status, out) == (2, "")
    assert errors.count("\n") == 1 and f"--port {device.port}: " in errors and sentence in errors
    assert not (tmp_path / "replay.json").exists()


def built(folder, **changes) -> None:
    folder.mkdir(parents=True)
    (folder / "build.json").write_text(
        json.dumps({"link": True, "baud": 25e6 / 13, "lanes": 1, "lane_type": "plain"} | changes)
    )


@pytest.mark.parametrize("place", ["model/board", "beside", "build/board/ulx3s"])
def test_the_rate_and_the_lanes_are_the_builds(replay, model, recordings, tmp_path, monkeypatch, place):
    """The build in the model's folder, else beside it, else of the working folder. An ulx3s's link runs at
    1.923 Mbaud by default; replay spoke at 2, which is 4 % off where 2 % are allowed."""
    monkeypatch.chdir(tmp_path)
    shutil.rmtree(tmp_path / "model/board")
    built(tmp_path / place)
    with Device(model.config, golden_decisions(model, recordings)) as device:
        status, _, errors = replay(device.port, "--json", "replay.json")
    assert (status, errors) == (0, "") and json.loads((tmp_path / "replay.json").read_text())[
        "baud"
    ] == 1923077


def test_a_build_that_does_not_tell_is_refused(replay, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    said = {"link": (False, "was built with --no-link"), "baud": (None, "build.json, field baud: ")}
    for name, (value, sentence) in said.items():
        shutil.rmtree(tmp_path / "model/board")
        built(tmp_path / "model/board", **{name: value})
        assert sentence in replay("port")[2]
    built(tmp_path / "model/other")
    status, out, errors = replay("port")
    assert (status, out) == (2, "") and "model/board, " in errors and errors.count("\n") == 1
    for name in ("board", "other"):
        shutil.rmtree(tmp_path / "model" / name)
    assert "holds its rate and lanes, and there is none" in replay("port")[2]


def request(port: str, **options: Any) -> ReplayRequest:
    return ReplayRequest(model=Path("model"), data="data", port=port, **options)


# ---------------------------------------------------------------------- images
def test_images_are_played_row_by_row_and_their_decisions_compared():
    config = AcceleratorConfig.of_image(5, 7, ("conv 3 4", "pool", "dense 3"), ("cup", "ball", "ring"))
    made = random_image_model(config.with_lanes(4, "plain"), seed=3)
    images = image_recordings(made.config, random_images(made.config, 6, seed=2))
    golden = golden_decisions(made, images)

    def wrong(samples):
        rows, touches = golden(samples)
        fourth = np.array_equal(samples, images.recording(4))
        return rows + fourth * np.array([0, 0, 0, 1, 0, 0]), touches

    for decide, mismatches in ((golden, 0), (wrong, 1)):
        with Device(made.config, decide) as device:
            result = verb.replay(request(device.port), made, images, 2000000, lambda *_: None)
        assert result["passed"] == (not mismatches) and result["mismatches"] == mismatches
        counts = [result[key] for key in ("recordings", "frames", "decisions")]
        assert counts == [6, 30, 12] and device.accepted == 30
    assert all(sentence.startswith("recording 4") for sentence in result["mismatch_list"])


def switched_on(board: device.Design) -> PinPort:
    """The pins of a simulated board."""
    simulated = device.Device(board)
    simulated.put("rx", 1)
    simulated.reset()
    return PinPort(simulated, clocks=4)


def test_what_a_board_was_taught_outlives_its_power(tmp_path, monkeypatch):
    """As `eskin replay --teach --save-taught` does it: taught, read out, and loaded with the model the next time."""
    model, recordings, kept = forget(taught_model("gru")), scene(5, seed=8), tmp_path / "taught.npz"
    board = board_of(model.config)
    monkeypatch.setattr(verb, "SerialPort", lambda port, baud: switched_on(board))
    monkeypatch.setattr(verb, "answer_s", lambda config, baud: TIMEOUT_BYTES)

    def replayed(**options: Any) -> dict:
        asked = request("pins", save_taught=kept, **options)
        return verb.replay(asked, model, recordings, 1, lambda *_: None)

    first = replayed(teach="pulse")  # recordings 0 and 1 show no whole touch
    assert first["passed"] and first["taught_equal"] and first["in_use"] == {"rise": 0, "fall": 0, "pulse": 3}
    taught = load_taught(model, kept)
    assert taught_in_use(taught).tolist() == [0, 0, 3]
    second = replayed()
    assert second["passed"] and second["in_use"] == first["in_use"]
    assert load_taught(model, kept).content == taught.content
    with refused("holds no touches taught to this model"):
        load_taught(taught_model("gru", seed=4), kept)
    with refused("is no .npz archive"):
        load_taught(model, Path(__file__))
    monkeypatch.setattr(
        link.Link, "places", lambda _, first, count: [0] * count
    )  # a board that holds nothing
    lost = replayed()
    assert lost["bit_exact"] and not lost["taught_equal"] and not lost["passed"]
