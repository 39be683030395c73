"""A board without a host is taught by its buttons: what it decides at its pins is what the golden stream decides
that was taught the same, also after its power was off."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eskin.cosim.netlist import Hardware, netlist_hardware
from eskin.golden.data.recordings import Recordings
from eskin.golden.model.conversion import through_converter
from eskin.golden.model.model import IntegerModel, random_integer_model
from eskin.golden.model.prototypes import forget, taught_in_use
from eskin.golden.model.stream import Stream
from eskin.golden.model.taught_log import played, sizes
from eskin.golden.model.vectors import random_recordings
from eskin.rtl.fpga.export import _verilog
from eskin.rtl.fpga.synthesis import synthesise
from eskin.rtl.fpga.targets import target
from eskin.rtl.fpga.wiring import Wiring
from eskin.rtl.program.flash_image import FLASH_OFFSET, flash_contents, log_layout
from eskin.verbs.flow import BUILD
from tests.cosim.test_skin import CONFIG
from tests.support.skin import Played, play

CHOOSE, TEACH = 1, 2
PRESS, REST, GAP = 70, 80, 180
"""Frames, at 1000 a second: of a short press, between presses, behind a touch until one is pressed."""
HOLD = 1150
CLOCK_HZ = 1.152e6


def taught_by_buttons() -> IntegerModel:
    config = CONFIG.replace(
        loadable=True, clock_hz=CLOCK_HZ, converter_hz=CLOCK_HZ / 4, decision="last", steps=4, touch_frames=130
    ).with_readout(readout="prototypes", prototypes=2, taught=3, state_code_bits=4, state_code_shift=10)
    return forget(random_integer_model(config, 1))


class Session:
    """A recording of touches with presses between them, and what a golden stream makes of it."""

    def __init__(self, model: IntegerModel) -> None:
        self.stream, self.config = Stream(model), model.config
        self.frames: list[np.ndarray] = []
        self.buttons: list[tuple[int, int]] = []
        self.decided: list[int] = []
        self.refused = 0
        self.shown = 0

    def add(self, frames: np.ndarray) -> None:
        """Goes on with these frames."""
        recordings = Recordings.of([frames]) if False else None
        del recordings
        self.frames.append(frames)
        for decision in self.stream.push(frames):
            row = decision.row()
            self.shown = int(row[2])
            if row[0]:
                self.decided.append(self.shown)
