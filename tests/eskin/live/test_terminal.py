"""eskin/live/terminal.py: the same figures as the page, on a screen of characters."""

import io
import json
import math
import threading

import pytest
from rich.console import Console

from eskin.golden.model import random_integer_model, run
from eskin.live.player import Controls, hello
from eskin.live.sources import ModelSource, SimulationSource
from eskin.live.terminal import Screen, press, watch
from tests.eskin.live.test_sources import Twin
from tests.support.live_case import Stage
from tests.support.touch_scenes import SMALL, scene


@pytest.fixture(scope="module")
def model():
    return random_integer_model(SMALL, 3)


def drawn(screen: Screen) -> str:
    console = Console(
        file=io.StringIO(), width=140, force_terminal=True, color_system="truecolor", record=True
    )
    console.print(screen.draw())
    return console.export_text()


def test_the_screen_shows_what_the_page_shows(model):
    recordings = scene(5, seed=2)
    told = hello(model.config, recordings, range(5), source="recordings", shape=[2, 2], guessed=True)
    screen = Screen()
    assert "waiting" in drawn_raw(screen)
    screen.feed({"k": "hello", **told})
    stage = Stage(ModelSource(model), recordings).go()
    trace = run(model, recordings)
    names = model.config.network.class_names
    for message in stage.messages:
        screen.feed(message)
        if message["k"] == "decided":
            text = drawn(screen)
            assert f"{names[message['label']]} decided" in text
            assert f"{message['since']:.3f} s after the onset" in text
            assert text.count("■") == len(screen.steps) == message["step"] + 1
            assert "logits" in text
            assert "hidden state" in text
        if message["k"] == "step":
            assert names[message["label"]] in drawn(screen)
    assert screen.lines[0].startswith("recording 0: no touch") and len(screen.lines) == 5
    for index, decision in enumerate(trace.decision):
        assert decision < 0 or f"recording {index}: {names[decision]}" in screen.lines[index]
    assert f"{int((trace.decision == recordings.labels).sum())} of 5 as labelled" in drawn(screen)


def drawn_raw(screen: Screen) -> str:
    console = Console(file=io.StringIO(), width=140, record=True)
    console.print(screen.draw())
    return console.export_text()


def test_hardware_that_differs_is_said(model):
    def spoil(frame, stage, values):
        return [values[0] + 1, *values[1:]] if stage == "logit" and values else values

    recordings, screen, texts = scene(5, seed=2), Screen(), []
    screen.feed({"k": "hello", **hello(model.config, recordings, [2], source="simulation", shape=[2, 2])})
    for message in Stage(SimulationSource(model, Twin(model, spoil)), recordings, [2]).go().messages:
        screen.feed(message)
        texts.append(drawn(screen))
    assert any("DIFFERS" in text and "✗" in text and "1 values differ (logit)" in text for text in texts)
    assert screen.lines[-1].startswith("recording 2: ") and "HARDWARE DIFFERS in 6 values" in screen.lines[-1]


def test_it_ends_with_the_player(model):
    recordings = scene(4, seed=2)
    stage, out = Stage(ModelSource(model), recordings), io.StringIO()
    told = hello(model.config, recordings, range(4), source="recordings", shape=[2, 2])
    stage.hub._hello = json.dumps({"k": "hello", **told})
    thread = threading.Thread(target=stage.player.run, daemon=True)
    thread.start()
    watch(stage.hub, stage.controls, thread, Console(file=out, force_terminal=True, width=120))
    assert not thread.is_alive() and stage.hub.viewers == 1 and "eskin watch" in out.getvalue()


def test_keys():
    controls = Controls()
    for key, what in (
        (" ", ("paused", True)),
        ("+", ("speed", 2.0)),
        ("-", ("speed", 1.0)),
        ("-", ("speed", 0.5)),
        ("c", ("label", 0)),
    ):
        press(controls, key, 2)
        assert getattr(controls, what[0]) == what[1]
    for _ in range(9):
        press(controls, "+", 2)
    assert math.isinf(controls.speed)
    press(controls, "-", 2)
    press(controls, "c", 2)
    press(controls, "c", 2)
    assert controls.speed == 10.0 and controls.label == -1 and not controls.skip
    press(controls, "n", 2)
    press(controls, "x", 2)
    assert controls.skip and not controls.stopped
    press(controls, "q", 2)
    assert controls.stopped
