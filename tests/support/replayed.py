"""What was done to a device, done again to the same design in Icarus: as RTL or as a netlist."""

import subprocess
from pathlib import Path

import numpy as np

from eskin.cosim.device import Device
from eskin.cosim.netlist import Hardware

BENCH = Path(__file__).with_name("replay.sv")


class Recorded(Device):
    """A device that takes down what is done to it, and what it answers."""

    def __init__(self, model, sample_bits: int) -> None:
        super().__init__(model, sample_bits)
        self.ops: list[tuple[str, int, int]] = []
        self.words: list[str] = []

    def _did(self, op: str, first: int = 0, second: int = 0) -> None:
        if hasattr(self, "ops"):
            self.ops.append((op, first, second))

    def write(self, address: int, word: int) -> None:
        super().write(address, word)
        self._did("W", address, word)

    def read(self, address: int) -> int:
        word = super().read(address)
        self._did("R", address, word)
        return word

    def cycle(self, count: int = 1) -> None:
        super().cycle(count)
        self._did("I", count)

    def settle(self, *limits: int) -> None:
        super().settle(*limits)
        self._did("T")

    def frames(self, frames: np.ndarray, *pace: float) -> None:
        super().frames(frames, *pace)
        bits = self._bits
        for frame in frames.tolist():
            for taxel, sample in enumerate(frame):
                ends = (taxel == 0) << bits | (taxel == len(frame) - 1) << bits + 1
                self._did("S", (sample & (1 << bits) - 1) | ends)

    def forget(self) -> None:
        self.words += [f"{word & 0xFFFFFFFF:08x}" for word in self.streams()["decision"][0].tolist()]
        super().forget()

    def replay(self, hardware: Hardware, decision_bits: int, work: Path) -> tuple[int, int]:
        """(decisions, reads) that were as before.

        AssertionError: others than before.
        """
        work.mkdir(parents=True, exist_ok=True)
        self.forget()
        (work / "ops.txt").write_text("".join(f"{op} {a:x} {b:x}\n" for op, a, b in self.ops))
        (work / "decisions.txt").write_text("".join(f"{word}\n" for word in self.words))
        sources = [str(path.resolve()) for path in (BENCH, *hardware.sources)]
        macros = [f"-DPAYLOAD={self._bits + 2}", f"-DDECISION={decision_bits}", *hardware.options]
        subprocess.run(
            ["iverilog", "-g2012", "-s", "replay", "-o", "replay.vvp", *macros, *sources],
            cwd=work,
            check=True,
        )
        said = subprocess.run(
            ["vvp", "replay.vvp"], cwd=work, check=True, capture_output=True, text=True
        ).stdout
        end = said.splitlines()[-1].split()
        assert end[0] == "decisions" and end[-1] == "0", said[-2000:]
        assert int(end[1]) == len(self.words)
        return int(end[1]), int(end[3])
