"""rtl/host/driver: the C driver, as compilers see it, and as it plays recordings into the Verilated shell."""

import subprocess

import pytest

from eskin.golden.core import PRESETS, AcceleratorConfig
from eskin.golden.model import Stream, run
from eskin.golden.model.decision_word import decision_word
from eskin.golden.model.prototypes import forget, taught_in_use
from eskin.rtl.fpga.generate import generate
from eskin.rtl.program.memory_map import Event, Fault, Register, ShellRegister
from eskin.rtl.program.register_files import entries
from eskin.training.made_up import random_recordings
from tests.golden.model.test_prototypes import taught_model
from tests.support.c_driver import STRICT
from tests.support.driver_board import Board
from tests.support.random_models import random_integer_model
from tests.support.touch_scenes import scene

CONFIG = PRESETS["thesis"].replace(
    taxels=5, feature_shift=(), hidden=4, steps=12, hop=60, window=120, touch_frames=800, lanes=1
)


@pytest.fixture(scope="module")
def model():
    return random_integer_model(CONFIG, 3)


@pytest.fixture(scope="module")
def design(model, tmp_path_factory):
    return generate(model.config, model.arrays, tmp_path_factory.mktemp("driver") / "design", bus="wishbone")


SOURCES = {
    "user.c": '#include "load.h"\n#include "eskin.h"\nsize_t size(void);\nsize_t size(void) { return sizeof eskin_load; }\n',
    "fixed.c": '#define ESKIN_BASE 0x30000000u\n#include "eskin.c"\n',
}
"""Beside eskin.c."""


def test_compiles_without_a_warning(design):
    for name, text in SOURCES.items():
        (design / name).write_text(text)
    options = [option for option in STRICT if not option.startswith("-std")]
    calls = [["gcc", *STRICT, "-ffreestanding", name] for name in ("eskin.c", *SOURCES)]
    for call in [*calls, ["g++", "-x", "c++", "-std=c++17", *options, "eskin.c"]]:
        done = subprocess.run([*call, "-c", "-o", "out.o"], cwd=design, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def recordings(model):
    length = CONFIG.rest_level.rest_frames + CONFIG.last_frame + 4 * CONFIG.windows.hop
    return random_recordings(model.config, [length, length // 2, length, length], 5)


@pytest.mark.parametrize(
    "lazy, pairs",
    [
        (lazy, pairs) if lazy == pairs else pytest.param(lazy, pairs, marks=pytest.mark.slow)
        for lazy in (False, True)
        for pairs in (False, True)
    ],
)
def test_recordings_decide_as_the_model_does(model, design, recordings, lazy, pairs):
    """Every decision through driver and shell."""
    rows, offsets = run(model, recordings).streams["decision"]
    board = Board(design)
    driver = board.driver
    assert driver("present") and driver.load()
    driver("enable", Event.DECISION, 0)
    for number in range(len(recordings)):
        samples = recordings.recording(number)
        expected = [decision_word(model.config, row) for row in rows[slice(*offsets[number : number + 2])]]
        asks = (lambda: False) if lazy else lambda: board.device.get("irq")
        assert driver.play(samples, asks, pairs) == expected
        assert not driver("faults") & ~(Fault.OVERRUN if lazy else 0)
    assert bool(driver.refused) == lazy
    driver("enable", 0, 0)
    board.device.cycle(4)
    assert not board.device.get("irq")
    assert len(rows)


@pytest.mark.parametrize("pairs", [False, True], ids=["codes", "pairs"])
def test_an_interrupt_routine_takes_decisions_within_a_frame(model, design, recordings, pairs):
    """It runs between a sample that was refused and the next write of the same frame."""
    rows, offsets = run(model, recordings).streams["decision"]
    board, words, within = Board(design, seed=1), [], 0
    driver, take, write = board.driver, board.driver.decisions, board._access
    driver.decisions = lambda: words.extend(take()) or []

    def interrupted(offset, word):
        nonlocal within
        value = write(offset, word)
        if word is not None and offset in (4 * ShellRegister.SAMPLE, 4 * ShellRegister.SAMPLE_PAIR):
            events = write(4 * ShellRegister.EVENTS, None)
            if events & Event.DECISION and not events & Event.SPACE and board.random.random() < 0.5:
                within += 1
                driver.decisions()
        return value

    assert driver.load()
    board._access = interrupted
    for number in range(len(recordings)):
        samples = recordings.recording(number)
        words.clear()
        driver.play(samples, lambda: False, pairs)
        assert words == [
            decision_word(model.config, row) for row in rows[slice(*offsets[number : number + 2])]
        ]
    assert within > 3 and driver.refused > 3


def test_registers_are_as_the_files_describe_them(design):
    """Reset values, what reads as 0, what holds what was written, and that no other address is a register."""
    board = Board(design)
    described = set()
    for register in entries(AcceleratorConfig.load(design / "config.json"), shell=True):
        for offset in range(4 * register.address, 4 * (register.address + register.count), 4):
            described.add(offset)
            value = board.read(offset)
            known = sum(field.mask for field in register.fields if field.reset is not None)
            reset = 0 if register.reset is None else register.reset
            assert value & known == reset & known if register.access != "wo" else value == 0, register.name
            if register.access == "rw":
                board.write(offset, 0xFFFFFFFF)
                assert board.read(offset) == sum(field.mask for field in register.fields)
                board.write(offset, 0)
            elif register.access == "ro" and offset != 4 * Register.FAULTS:
                board.write(offset, 0xFFFFFFFF)
                assert board.read(offset) & known == value & known
    assert not board.driver("faults") & ~Fault.WRITE_REFUSED
    for offset in range(0, 512, 4):
        if offset not in described:
            board.driver("clear_faults")
            assert board.read(offset) == 0
            assert board.driver("faults") == (Fault.ADDRESS if offset < 0x100 else 0), hex(offset)


@pytest.mark.slow
def test_touches_are_taught_and_forgotten_through_the_driver(tmp_path):
    model = forget(taught_model("gru"))
    board = Board(generate(model.config, model.arrays, tmp_path / "design", bus="wishbone"))
    assert board.driver.load()
    stream, recordings = Stream(model), scene(12, seed=6)
    seen = []
    for index in range(2, 12):
        stream.arm()
        if index == 4:
            board.driver("teach", 2, 1)
            stream.teach(2, following=True)
        samples = recordings.recording(index)
        expected = [*stream.push(samples), *stream.finish()]
        words = [decision_word(model.config, decision.row()) for decision in expected]
        assert board.driver.play(samples) == words
        seen += words
        label = index % 3
        if index == 9:
            board.driver("forget", label, 0)
            stream.forget(label)
        else:
            board.driver("teach", label, 0)
            stream.teach(label)
        while board.driver("busy"):
            pass
        assert board.driver("taught") == taught_in_use(stream.model).sum() and not board.driver(
            "teaching_refused"
        )
    board.driver("teach", 3, 0)  # no such class
    assert board.driver("teaching_refused") and len(seen) > 60
    board.driver("forget", 0, 1)
    assert board.driver("taught") == 0
