"""A model taught by registers, in simulated hardware: after every touch, TEACH, FORGET and reload it decides as
the golden stream does."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest

from eskin.cosim.device import Design, Device
from eskin.golden.core.errors import InputError
from eskin.golden.data.recordings import Recordings
from eskin.golden.model.model import IntegerModel
from eskin.golden.model.prototypes import forget, taught_in_use
from eskin.golden.model.stream import Stream
from eskin.rtl.fpga.export import export
from eskin.rtl.fpga.generate import boot_writes, pack_decision
from eskin.rtl.program.memory_map import Control, Fault, Register, TeachRegister
from tests.golden.model.test_prototypes import taught_model
from tests.support.table import each_row
from tests.support.touch_scenes import scene

BUILDS = Path(__file__).resolve().parents[2] / "build" / "simulators"
PURPOSE = "a test"
NEXT = ALL = 1 << 7


class Taught:
    """A device and the golden stream beside it; every command goes to both."""

    def __init__(self, model: IntegerModel, builds: Path, seed: int) -> None:
        self.config, self.rng = model.config, random.Random(seed)
        self.stream = Stream(model)
        self.device = Device(Design(export(model.config, model.arrays), builds, PURPOSE), 16)
        self.device.reset(boot_writes(model.config, model.arrays))
        self.decisions = self.refused = self.taught = 0

    def play(self, samples: np.ndarray) -> None:
        """A recording from ARM on, in two pieces with a command between them; the end may be missing."""
        device, told = self.device, []
        device.write(Register.CONTROL, Control.ARM)
        device.settle()
        device.forget()
        self.stream.arm()
        half = self.rng.randrange(1, len(samples))
        for piece in (samples[:half], samples[half:]):
            device.frames(piece)
            device.settle()
            told += self.stream.push(piece)
            if self.rng.random() < 0.5:
                self.command()
        if self.rng.random() < 0.7:
            device.write(Register.CONTROL, Control.FINISH)
            device.settle()
            told += self.stream.finish()
        seen = [int(word, 16) for word in device.streams()["decision"].words]
        assert seen == [pack_decision(self.config, decision.row()) for decision in told]
        self.decisions += len(seen)

    def command(self) -> None:
        """TEACH or FORGET at random; what is refused leaves its flag."""
        label, option = self.rng.randrange(self.config.classes), self.rng.random() < 0.4
        self.device.write(Register.CONTROL, Control.CLEAR_FAULTS)
        refused, was = False, taught_in_use(self.stream.model).sum()
        try:
            if self.rng.random() < 0.8:
                self.device.write(TeachRegister.TEACH, label | option * NEXT)
                self.stream.teach(label, following=option)
            else:
                self.device.write(TeachRegister.FORGET, label | option * ALL)
                self.stream.forget(None if option else label)
        except InputError:
            refused = True
        self.device.settle()
        self.taught += int(taught_in_use(self.stream.model).sum() > was)
        self.refused += refused
        self.check(refused)

    def check(self, refused: bool | None = None) -> None:
        word = self.device.read(TeachRegister.TAUGHT)
        assert word & 0xFF == taught_in_use(self.stream.model).sum()
        assert refused is None or word >> 8 == refused

    def reload(self) -> None:
        """Loads the model as the stream has it, so that what was taught stays over a reset."""
        self.device.write(Register.CONTROL, Control.ARM)  # no touch is open then
        self.stream.arm()
        self.device.settle()
        for address, word in boot_writes(self.config, self.stream.model.arrays):
            self.device.write(address, word)
        assert not self.device.read(Register.FAULTS) & Fault.WRITE_REFUSED
        self.check()


def taught_at_random(model: IntegerModel, recordings: Recordings, builds: Path, seed: int) -> Taught:
    """Every recording, with commands in and between them, and some reloads."""
    both = Taught(model, builds, seed)
    for index in range(len(recordings)):
        both.play(recordings.recording(index))
        for _ in range(both.rng.randrange(3)):
            both.command()
        if index % 9 == 5:
            both.reload()
    return both


@pytest.mark.timeout(900)
@each_row("cell", ["gru", "linear"])
def test_what_is_taught_in_hardware_is_what_the_stream_is_taught(cell):
    model = forget(taught_model(cell))
    both = taught_at_random(model, scene(30, seed=8), BUILDS, seed=3)
    assert both.decisions > 150 and both.refused > 5 and both.taught > 5
