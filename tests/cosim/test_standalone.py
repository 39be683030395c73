"""The netlist of a board on the part's oscillators against the golden pins, and faults that this must find."""

import dataclasses

import numpy as np
import pytest

from eskin.cosim.simulation import Simulation
from eskin.cosim.standalone import shown_on_pins
from eskin.golden.core import InputError
from eskin.golden.core.converters.spi import SpiPlan
from eskin.rtl.top import standby
from eskin.training.made_up import random_recordings
from eskin.verbs.cosim import cosimulate
from tests.cosim.test_skin import CONFIG
from tests.support.random_models import random_integer_model

BOARD = CONFIG.replace(
    stimulator="none", converter="ads7953", sample_rate_hz=500.0, clock_hz=12e6, touch_frames=125, steps=4
)
HOW = Simulation(standalone=True)


def found(work, frames=200):
    """The result of one recording."""
    model = random_integer_model(BOARD, 1)
    return cosimulate(model, random_recordings(model.config, (frames,), seed=6), HOW, work=work)


@pytest.mark.slow
def test_pins_are_exact_after_every_frame_at_three_speeds(tmp_path):
    played = found(tmp_path)
    assert played.passed and played.compared_values == 3 * 200 and played.decisions >= 3 * 4
    oscillator = played.oscillator
    assert oscillator.scans == oscillator.starts == 3 * 200
    start_s, scan_s, after_s = standby.turn(BOARD, 12e6)
    wanted = (start_s + scan_s + after_s) * BOARD.sensor.scan_rate_hz
    assert oscillator.duty == pytest.approx(wanted, rel=0.1)  # as the estimate of power counts it


def late_wake(plan):
    """The second word wakes the chip, not the first."""
    plan = AWAKE.fget(plan)
    (group, word), *others = plan.transfers
    return dataclasses.replace(plan, transfers=((group, word | 0x20), *others))


AWAKE = SpiPlan.sleeping


@pytest.mark.slow
def test_a_converter_that_is_woken_late_is_found(tmp_path, monkeypatch):
    monkeypatch.setattr(SpiPlan, "sleeping", property(late_wake))
    played = found(tmp_path, 12)
    assert not played.passed and (played.conversion.violations or played.mismatches)


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
