"""eskin watch as a user meets it: the page in a real browser, the verb's options, what it refuses, how it
ends."""

from __future__ import annotations

import json
import threading
import time
from pathlib import Path

import pytest

from eskin.data import load_recordings
from eskin.data.fit import for_model
from eskin.golden.core import PRESETS
from eskin.golden.data import Recordings
from eskin.golden.model import run
from eskin.training.made_up import random_recordings
from eskin.training.times import decision_times
from eskin.verbs.watch import WatchRequest, watch
from tests.eskin.live.test_recorder import CONFIG, rest, touch
from tests.support import browser
from tests.support.link_device import SensorDevice
from tests.support.live_case import wait
from tests.support.random_models import random_integer_model


class Watched:
    """``with Watched(model, recordings, ...) as watched``: eskin watch in a thread, with ``baud`` on a board; its address,
    controls and, afterwards, its result."""

    def __init__(
        self, model, recordings: Recordings | None, *, speed: float = 1.0, baud: int | None = None, **options
    ) -> None:
        ready = threading.Event()

        def told(address, controls) -> None:
            self.address, self.controls = address, controls
            controls.change(speed=speed)
            ready.set()

        def work() -> None:
            request = WatchRequest(model=Path("model"), host_port=0, **options)
            self.result = watch(request, model, recordings, baud, told)

        self._thread = threading.Thread(target=work)
        self._thread.start()
        assert ready.wait(120)

    def __enter__(self) -> Watched:
        return self

    def __exit__(self, *_: object) -> None:
        self.controls.stop()
        self._thread.join()


def body(driver, name: str) -> str:
    return driver.execute_script(f"return document.body.dataset.{name} || ''")


def picture(driver, canvas: str) -> str:
    return driver.execute_script(f"return document.getElementById('{canvas}').toDataURL()")


def text(driver, name: str) -> str:
    return driver.execute_script(f"return document.getElementById('{name}').textContent")


@browser.needs_browser
def test_the_page_in_a_browser():
    """16 taxels at 3 kHz: heat map and decisions change while a recording plays, pause stops them, the
    decision is golden's, the console is silent, and nothing but this program is asked for anything."""
    model = random_integer_model(PRESETS["synthetic"], 3)
    recordings = random_recordings(model.config, (9000, 9000), seed=8)
    trace = run(model, recordings)
    assert (trace.decision >= 0).all()
    names = model.config.network.class_names
    with Watched(model, recordings, speed=0.1) as watched, browser.opened() as page:
        page.get(watched.address)
        wait(lambda: body(page, "ready") == "1" and int(body(page, "frame") or 0) > 0)
        heat, traces = picture(page, "heat"), picture(page, "traces")
        wait(lambda: picture(page, "heat") != heat and picture(page, "traces") != traces)
        wait(lambda: int(body(page, "steps") or 0) >= 2)
        logits, steps = picture(page, "logits"), body(page, "steps")
        wait(lambda: body(page, "steps") != steps and picture(page, "logits") != logits)
        local = trace.local[trace.first[0]]
        shown = page.execute_script(
            "return [...document.querySelectorAll('#chips .chip')].map(c => c.dataset.label || '')"
        )
        told = [label for label in shown if label]
        assert told == shown[: len(told)] == [str(label) for label in local[: len(told)]]

        page.execute_script("document.getElementById('pause').click()")
        wait(lambda: body(page, "paused") == "1")
        time.sleep(0.5)
        frame, heat = body(page, "frame"), picture(page, "heat")
        time.sleep(0.7)
        assert (body(page, "frame"), picture(page, "heat")) == (frame, heat) and text(
            page, "pause"
        ) == "Go on"
        page.execute_script("document.getElementById('pause').click()")
        wait(lambda: body(page, "frame") != frame)

        page.execute_script(
            "const s = document.getElementById('speed'); s.value = '0'; s.dispatchEvent(new Event('change'))"
        )
        wait(lambda: body(page, "ended") == "1" and body(page, "played") == "2")
        assert text(page, "decision") == names[trace.global_decision[trace.touches.recording == 1][-1]]
        rows = page.execute_script(
            "return [...document.querySelectorAll('#rowsplayed tr')].map(r => [...r.cells].map(c => "
            "c.textContent))"
        )
        assert [row[:3] for row in rows] == [
            [str(k), names[recordings.labels[k]], names[trace.decision[k]]] for k in (1, 0)
        ]
        assert float(rows[0][3]) == pytest.approx(decision_times(trace)[1], abs=0.006)

        page.execute_script(
            "const r = document.getElementById('rows'); r.value = 2; r.dispatchEvent(new Event('change'))"
        )
        wait(lambda: picture(page, "heat") != heat)
        assert page.execute_script("return document.getElementById('columns').value") == "8"
        page.execute_script("document.getElementById('next').click()")
        wait(lambda: body(page, "played") == "4")
        assert browser.console_errors(page) == []
        assert {address.split("/")[2] for address in browser.requests(page)} == {
            watched.address.split("/")[2]
        }
    assert watched.result["decisions"] == dict(enumerate(trace.decision.tolist()))
    assert watched.result["recordings"] == 4


@browser.needs_browser
def test_touches_of_a_board_are_recorded_in_a_browser(tmp_path):
    """What the page asks for is done; a class of the model and a new one, one touch taken back; the model reads the file."""
    model = random_integer_model(CONFIG.replace(sample_rate_hz=200.0, fault_frames=0), 5)
    known, path = model.config.network.class_names[0], tmp_path / "touches.npz"
    options = dict(baud=2_000_000, record=path)
    with (
        SensorDevice(model.config, rest(64)) as board,
        Watched(model, None, port=board.port, **options) as watched,
        browser.opened() as page,
    ):
        page.get(watched.address)
        wait(lambda: body(page, "ready") == "1")
        press = "document.getElementById(arguments[0]).click()"
        for name, touches in ((known, 2), ("wool", 1)):
            page.execute_script("document.getElementById('recordname').value = arguments[0]", name)
            page.execute_script(press, "record")
            for number in range(1, touches + 1):
                wait(lambda: body(page, "waits") == f"press the sensor: touch {number} of class {name}")  # noqa: B023
                board.touch = touch(number)
                wait(lambda: json.loads(body(page, "counts")).get(name) == number)  # noqa: B023
            page.execute_script(press, "record")
            wait(lambda: body(page, "name") == "")
        assert text(page, "recordcounts") == f"{known}: 2 touches" + "wool: 1 touch"
        page.execute_script(press, "undo")
        wait(lambda: json.loads(body(page, "counts")) == {known: 2})
        assert browser.console_errors(page) == []
    saved = for_model(load_recordings(path), model.config)
    assert len(saved) == 2 and (run(model, saved).decision >= 0).all() and watched.result["recordings"] == 3
