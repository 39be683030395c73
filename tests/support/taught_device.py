"""A model taught by registers, in simulated hardware, and the golden stream beside it."""

import random
from pathlib import Path

import numpy as np

from eskin.cosim.device import Design
from eskin.golden.core import InputError
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel, Stream
from eskin.golden.model.prototypes import taught_in_use
from eskin.rtl.fpga.export import export
from eskin.rtl.fpga.generate import boot_writes, pack_decision
from eskin.rtl.program.memory_map import Control, Fault, Register, TeachRegister, taught_arrays
from tests.support.covered import note
from tests.support.replayed import Recorded

NEXT = ALL = 1 << 7
NONE = 0xFFFF


def same(received: dict[str, np.ndarray], model: IntegerModel) -> None:
    """What was read out is what the model holds, and nothing else."""
    assert (received["taught_count"] == model.arrays["taught_count"]).all()
    for label, used in enumerate(taught_in_use(model)):
        assert (received["taught"][label, :used] == model.arrays["taught"][label, :used]).all()
        assert not received["taught"][label, used:].any()


class Taught:
    """A device and the golden stream beside it; every command goes to both."""

    def __init__(self, model: IntegerModel, design: Design, seed: int) -> None:
        self.config, self.rng = model.config, random.Random(seed)
        self.stream = Stream(model)
        self.device = Recorded(design, self.config.sensor.sample_bits)
        self.device.reset(boot_writes(model.config, model.arrays))
        self.decisions = self.refused = self.taught = 0

    def play(self, samples: np.ndarray) -> None:
        """A recording from ARM on, in two pieces with a command between them; the end may be missing."""
        device, decisions = self.device, []
        if self.stream.onset_frame is not None:
            note("commands", "ARM", "touch", self.config.windows.window_mode)
        device.write(Register.CONTROL, Control.ARM)
        device.settle()
        device.forget()
        self.stream.arm()
        half = self.rng.randrange(1, len(samples))
        for piece in (samples[:half], samples[half:]):
            stalled = self.rng.randrange(len(piece))
            device.frames(piece[:stalled])
            device.cycle(self.rng.randrange(1, 400))
            device.frames(piece[stalled:])
            device.settle()
            decisions += self.stream.push(piece)
            if self.rng.random() < 0.5:
                self.command()
        if self.rng.random() < 0.7:
            device.write(Register.CONTROL, Control.FINISH)
            device.settle()
            decisions += self.stream.finish()
        seen = device.streams()["decision"][0].view(np.uint32).tolist()
        assert seen == [pack_decision(self.config, decision.row()) for decision in decisions]
        self.decisions += len(seen)

    def command(self) -> None:
        """TEACH or FORGET at random; a refused one leaves its flag."""
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
        assert word & 0xFF == taught_in_use(self.stream.model).sum() and refused in (None, word >> 8 & 1)
        if self.stream.onset_frame is None:
            self.read_back()
        else:
            assert self.words(0, 1) == [NONE]

    def words(self, first: int, count: int) -> list[int]:
        """Words of PLACES as they come, numbers beside them."""
        self.device.write(TeachRegister.PLACES, first)
        words = []
        for _ in range(count):
            assert self.device.read(TeachRegister.PLACES) == NONE  # too soon takes none
            words.append(self.device.read(TeachRegister.PLACES))
        return words

    def read_back(self) -> dict[str, np.ndarray]:
        """What was taught, out of the memory: what the stream holds in places in use."""

        def read(first: int, count: int) -> list[int]:
            words = self.words(first, count)
            assert [word >> 9 for word in words] == [(first + place) % 128 for place in range(count)]
            return [word & 0x1FF for word in words]

        received = taught_arrays(self.config, read)
        same(received, self.stream.model)
        return received

    def reload(self) -> None:
        """Loads the model as the stream has it, so that what was taught stays over a reset."""
        self.device.write(Register.CONTROL, Control.ARM)  # no touch is open then
        self.device.settle()
        arrays = self.stream.model.arrays | self.read_back()
        following = self.stream._following  # a touch that was named stays so
        self.stream = Stream(self.stream.model)
        self.stream._following = following
        for address, word in boot_writes(self.config, arrays):
            self.device.write(address, word)
        assert not self.device.read(Register.FAULTS) & Fault.WRITE_REFUSED
        self.check()
        self.command()


def taught_at_random(model: IntegerModel, recordings: Recordings, builds: Path, seed: int) -> Taught:
    """Every recording, with commands in and between them, and some reloads."""
    both = Taught(model, Design(export(model.config, model.arrays), builds), seed)
    for index in range(len(recordings)):
        both.play(recordings.recording(index))
        for _ in range(both.rng.randrange(3)):
            both.command()
        if index % 9 == 5:
            both.reload()
    return both
