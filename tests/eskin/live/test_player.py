"""eskin/live/player.py and sources.py: every decision is golden's at every pace, controls act, nothing waits
for a viewer."""

import math
import time
from itertools import pairwise

import numpy as np
import pytest

from eskin.golden.data import Recordings
from eskin.golden.model import run
from eskin.live import player as module
from eskin.live.sources import ModelSource
from eskin.training.formats import with_network
from eskin.training.times import decision_times
from tests.support.live_case import Stage
from tests.support.random_models import random_integer_model
from tests.support.touch_scenes import SMALL, scene


@pytest.fixture(scope="module")
def model():
    return random_integer_model(SMALL, 3)


@pytest.fixture(scope="module")
def recordings() -> Recordings:
    return scene(9, seed=2)


@pytest.mark.parametrize("cell", ["gru", "linear"])
@pytest.mark.parametrize("piece", [1, 7, 512])
def test_what_is_shown_is_what_golden_says(recordings, cell, piece, monkeypatch):
    model = random_integer_model(with_network(SMALL, cell=cell), 4)
    monkeypatch.setattr(module, "FASTEST_FRAMES", piece)
    stage = Stage(ModelSource(model), recordings).go()
    trace = run(model, recordings)
    rows, offsets = trace.streams["decision"]
    assert stage.player.decisions == dict(enumerate(trace.decision.tolist()))
    times, shown, of_touch = decision_times(trace), [], trace.touches
    for message in stage.messages:
        match message["k"]:
            case "begin":
                shown.append([])
                touches = -1
            case "onset":
                touches += 1
                row = np.flatnonzero(of_touch.recording == len(shown) - 1)[touches]
                assert (message["frame"], message["start"]) == (
                    of_touch.onset_frame[row],
                    of_touch.start_frame[row],
                )
            case "step":
                shown[-1].append([0, message["step"], message["label"], message["margin"], 0, 0])
                for name in ("features", "hidden", "logits"):
                    assert message[name] == getattr(trace, name)[row, message["step"]].tolist()
            case "decided":
                shown[-1].append(
                    [1, *(int(message[name]) for name in ("step", "label", "margin", "partial", "unsure"))]
                )
                if message["touch"] == 0 and not message["partial"]:
                    assert message["since"] == pytest.approx(times[len(shown) - 1])
    assert shown == [rows[low:high].tolist() for low, high in pairwise(offsets)] and len(rows) > 30
    assert [message["decision"] for message in stage.seen("result")] == trace.decision.tolist()
    tally = stage.player.tally
    assert (tally.frames, tally.recordings, tally.touches) == (recordings.frames, 9, len(trace.touches))
    assert tally.correct == np.sum(trace.decision == recordings.labels)
    assert tally.undecided == np.sum(trace.decision < 0) > 0


def test_pause_next_class_and_the_end(model, recordings):
    stage = Stage(ModelSource(model), recordings, speed=0.2).start()
    stage.until(lambda: len(stage.seen("frames")) > 2)
    stage.controls.change(paused=True)
    stage.until(lambda: stage.seen("state")[-1]["paused"])
    frames = stage.player.tally.frames
    time.sleep(0.2)
    assert stage.player.tally.frames == frames > 0
    stage.controls.change(skip=True)
    stage.until(lambda: len(stage.seen("begin")) == 2)
    assert stage.seen("end")[0]["whole"] is False and not stage.seen("result")
    stage.controls.change(label=2)
    stage.controls.change(paused=False)
    stage.until(lambda: stage.seen("begin")[-1]["label"] == 2)
    stage.controls.change(speed=math.inf)
    stage.until(lambda: stage.seen("state")[-1]["ended"])
    assert [begun["number"] for begun in stage.seen("begin")] == [0, 1, 2, 5, 8]
    stage.controls.change(skip=True)
    stage.until(lambda: len(stage.seen("begin")) == 8)
    assert [begun["number"] for begun in stage.seen("begin")][5:] == [2, 5, 8]
    stage.stop()
    assert stage.player.error is None
