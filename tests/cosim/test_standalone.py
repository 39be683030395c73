"""The netlist of a board on the part's oscillators against the golden pins, and faults that this must find."""

import dataclasses

import numpy as np
import pytest

from eskin.cosim.simulation import Simulation
from eskin.cosim.standalone import shown_on_pins
from eskin.golden.core import InputError
from eskin.rtl.top import standby
from eskin.training.made_up import random_recordings
from eskin.verbs.cosim import cosimulate
from tests.cosim.test_skin import CONFIG
from tests.support.random_models import random_integer_model

BOARD = CONFIG.replace(
    stimulator="none", converter="ads7953", sample_rate_hz=500.0, clock_hz=12e6, touch_frames=125, steps=4
)
HOW = Simulation(standalone=True)


MATRIX = BOARD.replace(converter="matrix", rows=2, columns=4)


def found(work, frames=200, board=BOARD):
    """The result of one recording."""
    model = random_integer_model(board, 1)
    return cosimulate(model, random_recordings(model.config, (frames,), seed=6), HOW, work=work)


@pytest.mark.slow
@pytest.mark.parametrize("board", [BOARD, MATRIX, BOARD.replace(converter="ad7476")])
def test_pins_are_exact_after_every_frame_at_three_speeds(board, tmp_path):
    played = found(tmp_path, 200, board)
    assert played.passed and played.compared_values == 3 * 200 and played.decisions >= 3 * 4
    oscillator = played.oscillator
    assert oscillator.scans == oscillator.starts == 3 * 200
    start_s, scan_s, after_s, _ = standby.turn(board, 12e6)
    wanted = (start_s + scan_s + after_s) * board.sensor.scan_rate_hz
    assert oscillator.duty == pytest.approx(wanted, rel=0.1)  # as the estimate of power counts it


def other_words(of):
    """Words of a scan, in place of those by which an ADS7953 sleeps."""

    def change(plan):
        words = of([word for _, word in plan.transfers])
        return dataclasses.replace(plan, transfers=tuple((0, word) for word in words))

    return change


def other_port(**fields):
    """Of the plan by which a matrix sleeps."""
    return lambda plan: dataclasses.replace(plan, port=dataclasses.replace(plan.port, **fields))


LATE, AWAKE = "class pins", "awake behind scan 1"
SEEDED = {
    "woken by its second word": (BOARD, other_words(lambda words: [words[0] | 0x20, *words[1:]]), LATE),
    "power-down a word too late": (BOARD, other_words(lambda words: [*words[:-2], 0, 0x1820]), AWAKE),
    "a matrix that is not woken": (MATRIX, other_port(waking=0), LATE),
    "a matrix whose last transfer is no power-down": (MATRIX, other_port(short=12), AWAKE),
}


@pytest.mark.slow
@pytest.mark.parametrize("fault", SEEDED)
def test_a_converter_that_does_not_sleep_or_wakes_late_is_found(fault, tmp_path, monkeypatch):
    board, change, words = SEEDED[fault]
    kind = type(standby.standby_plan(board, 12e6))
    asleep = kind.sleeping.fget
    monkeypatch.setattr(kind, "sleeping", property(lambda plan: change(asleep(plan))))
    played = found(tmp_path, 200, board)
    assert not played.passed and words in played.mismatch_list[0]


@pytest.mark.slow
def test_a_start_that_is_not_awaited_is_found(tmp_path, monkeypatch):
    monkeypatch.setattr(
        "eskin.rtl.fpga.own_clocks.start_cycles", lambda: 1
    )  # 91 us at the faster oscillators
    played = found(tmp_path, 12)
    assert not played.passed
    assert "before it is stable; oscillators off by +10%" in played.mismatch_list[0]


def test_pins_show_whole_decisions_and_no_local_one_behind_an_early_final_one():
    rows = np.array([[0, 0, 2, 9, 0, 0], [1, 0, 2, 9, 0, 1], [0, 1, 1, 9, 0, 0], [1, 3, 0, 9, 1, 0]])
    frames = np.array([2, 2, 3, 0])
    classes = "0" * (BOARD.classes - 3)
    last = [f"{classes}100110", f"{classes}010000"]
    assert shown_on_pins(BOARD, rows, frames, 3) == ([f"{classes}000000", *last], [0, 2, 3])
    early = BOARD.replace(decision="early")
    assert shown_on_pins(early, rows, frames, 3) == ([f"{classes}000000", last[0], last[0]], [0, 2, 2])


def test_what_it_does_not_play_is_refused(tmp_path):
    model = random_integer_model(BOARD.replace(sample_rate_hz=3000.0), 1)
    with pytest.raises(InputError, match="3000 scans a second leave"):
        cosimulate(model, random_recordings(model.config, (50,), seed=6), HOW, work=tmp_path)
