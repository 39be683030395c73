"""Plays recordings into a chip's compiled netlist (`eskin.cosim.gates`), and takes down what cosim/harness.sv takes down of a simulator."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from eskin.cosim.gates import Chip
from eskin.cosim.scoreboard import Stream
from eskin.golden.core.errors import SimulationError

QUIET = 4
"""Cycles a bus command may need before busy shows it."""
STUCK = 100_000
"""Cycles in which a chain that works has long done what it is waited for."""
Write = tuple[int, int]
"""Address and word of a bus write."""


class GateBench:
    """The ports of a chip, cycle by cycle.

    Parameters
    ----------
    sample_bits:
        Of a sample.
    stages:
        Probes that are taken down.
    count:
        Called after each edge that passed the first clock gate.

    Attributes
    ----------
    streams: of each stage and ``decision`` the words (hex) and their cycles since the last `forget`. cycles, edges: clock cycles so far,
    and those of which the edge passed. frame_ends: cycles that took a frame's last taxel. frame_cycles_max: of a frame, from its first
    taxel offered to its last one taken. stalls: cycles in which a taxel waited. overruns: frames that came late.
    """

    def __init__(self, chip: Chip, sample_bits: int, stages: Iterable[str] = (), count: Callable[[], None] | None = None) -> None:
        self.chip, self._sample_bits, self._count = chip, sample_bits, count
        self._stages = tuple(stage for stage in stages if chip.has(f"probe__{stage}__valid"))
        self.cycles = self.edges = self.decisions = 0
        self.frame_cycles_max = self.stalls = self.overruns = 0
        self.frame_ends: list[int] = []
        self.streams: dict[str, Stream] = {}
        self.forget()

    def forget(self) -> None:
        """Begin new streams."""
        self.streams = {stage: Stream([], []) for stage in (*self._stages, "decision")}

    def _take_down(self, stage: str, value: int) -> None:
        self.streams[stage].words.append(f"{value:08x}")
        self.streams[stage].cycles.append(self.cycles)

    def cycle(self) -> bool:
        """One clock cycle; whether a taxel that was offered is taken."""
        chip = self.chip
        chip.settle()
        ready = bool(chip.get("i__ready"))
        if chip.get("o__valid"):
            self._take_down("decision", chip.get("o__payload"))
            self.decisions += 1
        for stage in self._stages:
            if chip.get(f"probe__{stage}__valid"):
                self._take_down(stage, chip.get(f"probe__{stage}__value"))
        passed = chip.edge()
        if passed and self._count is not None:
            self._count()
        self.cycles += 1
        self.edges += passed
        return ready

    def reset(self, boot: Iterable[Write] = ()) -> None:
        """Reset, then bus writes."""
        for name in ("i__valid", "bus__w_stb", "bus__r_stb"):
            self.chip.put(name, 0)
        self.chip.put("o__ready", 1)
        self.chip.put("rst", 1)
        for _ in range(4):
            self.cycle()
        self.chip.put("rst", 0)
        for address, word in boot:
            self.write(address, word)

    def write(self, address: int, word: int) -> None:
        """A bus write."""
        for name, value in (("bus__addr", address), ("bus__w_data", word), ("bus__w_stb", 1)):
            self.chip.put(name, value)
        self.cycle()
        self.chip.put("bus__w_stb", 0)

    def read(self, address: int) -> int:
        """A bus read."""
        self.chip.put("bus__addr", address)
        self.chip.put("bus__r_stb", 1)
        self.cycle()
        self.chip.put("bus__r_stb", 0)
        self.cycle()
        return self.chip.get("bus__r_data")

    def settled(self) -> None:
        """Cycles until nothing is under way.

        Raises
        ------
        SimulationError
            It never is.
        """
        for waited in range(STUCK):
            self.cycle()
            if waited > QUIET and not self.chip.get("busy") and not self.chip.get("o__valid"):
                return
        raise SimulationError("the netlist stays busy")

    def frames(self, frames: np.ndarray, period: float = 0.0, mark: Callable[[], None] | None = None) -> None:
        """Play frames (frames, taxels).

        Parameters
        ----------
        period:
            Clock cycles from frame to frame; 0: a taxel whenever one is taken.
        mark:
            Called in the cycle in which a frame's first taxel is taken, before its edge.

        Raises
        ------
        SimulationError
            No taxel is taken.
        """
        chip, last = self.chip, frames.shape[1] - 1
        begun = self.cycles
        for number, frame in enumerate(frames):
            first_offered = self.cycles
            for taxel, sample in enumerate(frame):
                value = int(sample) & (1 << self._sample_bits) - 1
                chip.put("i__payload", value | (taxel == 0) << self._sample_bits | (taxel == last) << self._sample_bits + 1)
                chip.put("i__valid", 1)
                for waited in range(STUCK):
                    if taxel == 0 and mark is not None:
                        chip.settle()
                        if chip.get("i__ready"):
                            mark()
                    if self.cycle():
                        break
                    self.stalls += 1
                    self.overruns += taxel == 0 and waited == 0
                else:
                    raise SimulationError("the netlist takes no frame")
            self.frame_ends.append(self.cycles - 1)
            self.frame_cycles_max = max(self.frame_cycles_max, self.cycles - first_offered)
            if not period:
                continue
            due = begun + round((number + 1) * period)
            self.overruns += self.cycles > due
            chip.put("i__valid", 0)
            while self.cycles < due:
                if chip.program.top is not None and not chip.edge_needed() and not chip.get("o__valid"):
                    self.cycles = due  # asleep: nothing changes until the next taxel
                else:
                    self.cycle()
        chip.put("i__valid", 0)
        chip.settle()


def rows_of_frames(bench: GateBench, joule: np.ndarray, play: Callable[[Callable[[], None]], None]) -> np.ndarray:
    """A row a frame, from its first taxel to the next one's: cycles, edges that passed, decisions, reads and writes of macros, joule by
    kind.

    Parameters
    ----------
    joule:
        What the bench's ``count`` adds to.
    play:
        Plays the frames, with what it is given as ``mark``.
    """
    marks: list[np.ndarray] = []
    play(lambda: marks.append(np.concatenate([[bench.cycles, bench.edges, bench.decisions], bench.chip.accesses, joule])))
    return np.diff(np.array(marks), axis=0)
