"""eskin watch as a user meets it: the page in a real browser, the verb's options, what it refuses, how it
ends."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from eskin.golden.core import PRESETS, AcceleratorConfig
from eskin.golden.data import Recordings, save_archive
from eskin.golden.model import random_images, random_integer_model, random_recordings, run
from eskin.golden.model.prototypes import forget
from eskin.live.recorder import Recorder
from eskin.verbs import watch_job
from tests.golden.model.test_prototypes import taught_model
from tests.support import browser
from tests.support.image_scenes import random_image_model
from tests.support.table import each_row
from tests.support.touch_scenes import SMALL, scene


def wait(condition: Callable[[], bool], seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not come to this"
        time.sleep(0.05)


class Watched:
    """``with Watched(model, recordings, ...) as watched``: eskin watch in a thread; its address, controls
    and, afterwards, its result."""

    def __init__(self, model, recordings: Recordings, **options) -> None:
        numbers, ready = list(range(len(recordings))), threading.Event()

        def told(address, controls) -> None:
            self.address, self.controls = address, controls
            ready.set()

        def work() -> None:
            self.result = watch_job.watch(model, recordings, numbers, host_port=0, ready=told, **options)

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
@pytest.mark.timeout(300)
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
        assert shown[: len([label for label in shown if label])] == [
            str(label) for label in local[: len([label for label in shown if label])]
        ]

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
        last = recordings.labels[1]
        assert text(page, "decision") == names[trace.global_decision[trace.touches.recording == 1][-1]]
        rows = page.execute_script(
            "return [...document.querySelectorAll('#rowsplayed tr')].map(r => [...r.cells].map(c => "
            "c.textContent))"
        )
        assert [row[:3] for row in rows] == [
            [str(k), names[recordings.labels[k]], names[trace.decision[k]]] for k in (1, 0)
        ]
        assert float(rows[0][3]) == pytest.approx(trace.decision_time_s()[1], abs=0.006) and 0 <= last < len(
            names
        )

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


def all_wrong(model, label: int):
    """The model with every prototype where a touch of ``label`` is not: what it was trained for is of no use,
    and one touch taught is nearer."""
    far = np.full_like(model.arrays["prototypes"], -8)
    return type(model)(model.config, {**forget(model).arrays, "prototypes": far}, model.source)


@pytest.mark.slow
@browser.needs_browser
@pytest.mark.timeout(600)
@each_row("simulate", [False, True])
def test_a_touch_taught_in_the_browser_is_known_the_next_time(simulate):
    """A button says what the touch was; the next one is decided so, by the model and by the simulated RTL
    beside it; a touch under way is refused; `forget` takes it back."""
    model = all_wrong(taught_model("gru"), 2)
    recordings = scene(9, seed=2).subset([2, 2, 2, 2])
    assert run(model, recordings).decision.tolist() != [2] * 4
    with Watched(model, recordings, speed=5, simulate=simulate) as watched, browser.opened() as page:
        page.get(watched.address)

        def click(name: str) -> None:
            page.execute_script(f"document.getElementById('{name}').click()")

        def to_the_end(played: int) -> None:
            wait(lambda: body(page, "ended") == "1" and body(page, "played") == str(played))

        wait(lambda: body(page, "ready") == "1")
        to_the_end(4)
        assert body(page, "taught") == "0 0 0" and text(page, "decision") != "pulse"
        click("teach2")
        wait(lambda: body(page, "taught") == "0 0 1")
        empty = "document.getElementById('forget2').parentElement.querySelector('canvas')"
        assert page.execute_script(f"return !{empty}.hidden && {empty}.width > 50")
        click("next")
        to_the_end(8)
        rows = page.execute_script(
            "return [...document.querySelectorAll('#rowsplayed tr')].map(r => r.cells[2].textContent)"
        )
        assert rows[:4] == ["pulse"] * 4 and "pulse" not in rows[4:]

        watched.controls.pace(0.05)
        click("next")
        wait(lambda: 2 <= int(body(page, "steps") or 0) < 5 and body(page, "ended") == "0")
        click("teach1")
        wait(lambda: "a touch is under way" in text(page, "teachnote"))
        assert body(page, "taught") == "0 0 1"
        watched.controls.pace(5)
        to_the_end(12)
        click("forget2")
        wait(lambda: body(page, "taught") == "0 0 0")
        assert browser.console_errors(page) == []
    assert watched.result["mismatches"] == 0


# ---------------------------------------------------------------------- the verb
@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    random_integer_model(SMALL, 3).save("model")
    save_archive(scene(9, seed=2), tmp_path / "data.npz")
    return tmp_path


PLAY = ("watch", "model", "--data", "data.npz", "--speed", "max")


def test_a_line_for_each_recording_and_what_was_recorded(call, folder):
    status, out, errors = call(*PLAY, "--terminal", "--record", "played.npz")
    assert (status, errors) == (0, "")
    lines = [line for line in out.splitlines() if line.startswith("recording ")]
    model = random_integer_model(SMALL, 3)
    trace, names = run(model, scene(9, seed=2)), SMALL.network.class_names
    order = [0, 1, 2, 3, 4, 5, 6, 7, 8]
    assert [line.split(": ")[0] for line in lines] == [f"recording {number}" for number in order]
    assert all(
        line.split(": ")[1].startswith(names[trace.decision[k]] if trace.decision[k] >= 0 else "no touch")
        for k, line in enumerate(lines)
    )
    with np.load(folder / "played.npz") as archive:
        assert archive["decision"][:, 0].tolist() == trace.decision.tolist()
        assert (archive["samples"] == scene(9, seed=2).samples).all()


def test_classes_come_in_turn():
    recordings = scene(9, seed=2)
    turned = recordings.subset([0, 3, 6, 1, 4, 2])
    assert watch_job.in_turn(turned, np.arange(6)) == [0, 3, 5, 1, 4, 2]
    assert watch_job.in_turn(turned, np.array([1, 2, 5])) == [1, 5, 2]


def test_an_interrupt_ends_in_order_with_a_whole_record(folder):
    words = (
        "-m eskin.cli.main watch model --data data.npz --host-port 0 --record played.npz --speed 0.5".split()
    )
    started = subprocess.Popen(
        [sys.executable, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"COLUMNS": "150"},
        # tests that a shell started in the background ignore interrupts, and would hand that on
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    try:
        address = started.stderr.readline().split()[1]
        assert address.startswith("http://127.0.0.1:")
        wait(lambda: any(path.stat().st_size > 1000 for path in folder.glob("played.*.frames")))
        started.send_signal(signal.SIGINT)
        out, errors = started.communicate(timeout=60)
    finally:
        started.kill()
        started.communicate()
    assert (started.returncode, errors) == (0, "") and "played" in out
    with np.load(folder / "played.npz") as archive:
        samples = archive["samples"]
    assert len(samples) > 60 and (samples == scene(9, seed=2).samples[: len(samples)]).all()
    assert not list(folder.glob("played.*.frames"))


def test_an_interrupt_while_the_archive_is_written_changes_nothing(call, folder, monkeypatch):
    close = Recorder.close
    monkeypatch.setattr(Recorder, "close", lambda self: (os.kill(os.getpid(), signal.SIGINT), close(self))[1])
    assert call(*PLAY, "--terminal", "--record", "played.npz")[0] == 0
    with np.load("played.npz") as archive:
        assert (archive["samples"] == scene(9, seed=2).samples[: len(archive["samples"])]).all()


MISTAKES = {
    "model": "--data: is missing; name recordings",
    "nowhere --data data.npz": "model 'nowhere': has no config.json, so it is no model folder",
    "model --data lost.npz": "recordings 'lost.npz': is not there",
    "model --data data.npz --simulate --port x": "--simulate: the simulated hardware or the board",
    "model --port /dev/no-such-port --baud 2000000": "cannot be opened (there is no such port)",
    "model --port x": "--build: is missing",
    "model --data data.npz --baud 9600": "--baud: is for a board; add --port",
    "model --data data.npz --lanes 2": "--lanes: is for --simulate",
    "model --data data.npz --speed quick": "--speed quick: is no pace",
    "model --data data.npz --speed nan": "--speed nan: is no pace",
    "model --data data.npz --shape 1x3": "--shape 1x3: holds 3 taxels and the array has 4",
    "model --data data.npz --recordings some": "--recordings some: is no number",
    "model --data data.npz --record played.txt": "--record played.txt: is an archive",
    "model --data data.npz --record model": "--record model: is an archive",
    "model --data data.npz --terminal --host 0.0.0.0": "--host 0.0.0.0: no page is served with --terminal",
    "model --data data.npz --host 203.0.113.7": "--host 203.0.113.7, --host-port 8765: cannot be opened",
    "images --data images.npz --shape 5x7": "--shape 5x7: is for recordings",
    "images --data images.npz --record played.npz": "--record played.npz: is for recordings",
    "images --simulate": "--data: is missing; a model of images",
    "images --data data.npz": "holds no images and",
}


def test_mistakes_are_one_sentence(call, folder):
    config = AcceleratorConfig.of_image(5, 7, ("conv 3 4", "dense 3"), ("cup", "ball", "ring"))
    random_image_model(config, seed=3).save(folder / "images")
    np.savez(folder / "images.npz", images=random_images(config, 2, seed=2), labels=["cup", "ball"])
    before = sorted(folder.rglob("*"))
    for words, sentence in MISTAKES.items():
        status, out, errors = call("watch", *words.split())
        assert (status, out, errors.count("\n")) == (2, "", 1) and sentence in errors, (words, errors)
        assert sorted(folder.rglob("*")) == before, words


def test_a_port_that_is_taken(call, folder):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        status, out, errors = call(*PLAY, "--host-port", port, "--record", "played.npz")
    assert (status, out) == (2, "")
    assert f"--host-port {port}: another program uses it" in errors
    assert not list(folder.glob("*played*"))


def test_a_difference_ends_with_1(call, folder, monkeypatch):
    from tests.eskin.live.test_sources import Twin

    def simulator(design, config, registers, boot, builds):
        return Twin(
            random_integer_model(SMALL, 3),
            lambda frame, stage, values: [values[0] + (stage == "logit"), *values[1:]],
        )

    monkeypatch.setattr("eskin.cosim.live.LiveSimulator", simulator)
    monkeypatch.setattr(watch_job, "export", lambda config, arrays: "")
    status, out, _ = call(*PLAY, "--terminal", "--simulate", "--recordings", "3")
    assert status == 1 and "DIFFER" in out and "values differ (logit)" in out and json.dumps(out)
