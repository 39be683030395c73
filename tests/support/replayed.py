"""What was done to a device, done again to the same design in Icarus: as RTL or as a netlist."""

import random
from pathlib import Path

import numpy as np

from eskin.cosim.device import Device
from eskin.cosim.netlist import Hardware
from eskin.rtl.program.memory_map import Fault, Register
from tests.support.traffic import Script, beats, run


class Recorded(Device):
    """A device that takes down accesses to it and its answers."""

    def __init__(self, model, sample_bits: int) -> None:
        super().__init__(model, sample_bits)
        self.script, self.decisions = Script(), list[int]()
        self.addresses, self.reads = list[int](), list[int]()
        self._random = random.Random(1)
        self.script.sink(1)

    def write(self, address: int, word: int) -> None:
        super().write(address, word)
        self.script.write(address, word)

    def read(self, address: int) -> int:
        word = super().read(address)
        self.script.read(address)
        self.addresses.append(address)
        self.reads.append(word)
        return word

    def cycle(self, count: int = 1) -> None:
        super().cycle(count)
        if hasattr(self, "script"):
            self.script.wait(count)

    def settle(self, *limits: int) -> None:
        super().settle(*limits)
        self.script.until_idle()

    def frames(self, frames: np.ndarray, *pace: float) -> None:
        super().frames(frames, *pace)
        for frame in frames.tolist():
            for payload in beats(frame, self._bits):
                if self._random.random() < 0.125:  # this side stalls, too
                    self.script.wait(self._random.randint(1, 2))
                self.script.beat(payload)

    def forget(self) -> None:
        self.decisions += [word & 0xFFFFFFFF for word in self.streams()["decision"][0].tolist()]
        super().forget()

    def replay(self, hardware: Hardware, work: Path, builds: Path) -> tuple[int, int]:
        """(decisions, reads) that were as before, but for INPUT_STALLED of FAULTS.

        AssertionError: others than before.
        """
        self.forget()
        result = run(self.script, hardware, work, builds)
        reads = [line[1] for line in result if line[0] == "read"]
        for address, read, before in zip(self.addresses, reads, self.reads, strict=True):
            paced = Fault.INPUT_STALLED * (address == Register.FAULTS)  # it depends on this side's stalls
            assert read | paced == before | paced
        assert [line[1] for line in result if line[0] == "decision"] == self.decisions
        assert not [line for line in result if line[0] in ("stuck", "unknown", "unstable")]
        return len(self.decisions), len(self.reads)
