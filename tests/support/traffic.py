"""Bus traffic, frames and resets out of a script, on Icarus: what the bench, which plays recordings as a
good host does, never does.

Also what makes a simulation start in another state than the initial one, in X above all: `initial_values`,
`changed`.
"""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from eskin.cosim.netlist import Hardware
from eskin.cosim.runner import build
from eskin.cosim.runner import run as simulate
from eskin.cosim.scoreboard import FLAT_STAGES
from eskin.golden.core import AcceleratorConfig
from eskin.rtl.program.memory_map import Control, Register
from tests.support.link_flow import pack_decisions


@dataclass
class Script:
    """Operations of `tests.support.traffic_bench.Traffic`; ``segments`` is what follows each mark."""

    segments: list[tuple[int, list[list]]] = field(default_factory=lambda: [(-2, [])])

    def add(self, operation: str, *words: int) -> None:
        """One operation."""
        self.segments[-1][1].append([operation, *map(int, words)])

    def write(self, address: int, word: int) -> None:
        """A bus write."""
        self.add("write", address, word & 0xFFFF)

    def read(self, address: int) -> None:
        """A bus read."""
        self.add("read", address)

    def beat(self, payload: int) -> None:
        """One beat, held until it is taken."""
        self.add("beat", payload)

    def wait(self, cycles: int) -> None:
        """Nothing."""
        self.add("wait", cycles)

    def until_idle(self) -> None:
        """Wait for the accelerator."""
        self.add("until_idle")

    def mark(self, number: int) -> None:
        """What follows belongs to ``number``."""
        self.segments.append((number, []))

    def sink(self, seed: int) -> None:
        """Stalls of the decision stream; 0: none."""
        self.add("sink", seed)

    def reset(self, cycles: int) -> None:
        """A reset so many cycles from now; what then is left up to the next mark is not done."""
        self.add("reset", cycles)

    def command(self, command: Control) -> None:
        """Write CONTROL, and wait."""
        self.write(Register.CONTROL, command)
        self.until_idle()

    def recording(self, samples: np.ndarray, sample_bits: int) -> None:
        """A recording (frames, taxels) as a good host plays it."""
        self.command(Control.ARM)
        for frame in samples:
            for payload in beats(frame, sample_bits):
                self.beat(payload)
        self.until_idle()
        self.command(Control.FINISH)


def beat(sample: int, sample_bits: int, *, first: bool, last: bool) -> int:
    """The payload of a beat."""
    return sample & (1 << sample_bits) - 1 | first << sample_bits | last << sample_bits + 1


def beats(frame: Sequence[int], sample_bits: int) -> list[int]:
    """The payloads of a frame."""
    last = len(frame) - 1
    return [
        beat(int(sample), sample_bits, first=taxel == 0, last=taxel == last)
        for taxel, sample in enumerate(frame)
    ]


def run(
    script: Script, hardware: Hardware, work: Path, builds: Path, *, limit_s: float = 1200.0
) -> list[list[Any]]:
    """Run ``script`` on ``hardware`` in Icarus; what the bench wrote down: kind and words.

    Raises
    ------
    SimulationError
        The build or the run fails, or it takes longer than ``limit_s``.
    """
    design = [*hardware.sources]
    simulator = build("icarus", design, {}, builds, options=hardware.options, wrapper=None, top="accelerator")
    work.mkdir(parents=True, exist_ok=True)
    played = {"control": int(Register.CONTROL), "segments": script.segments}
    (work / "script.json").write_text(json.dumps(played))
    simulate(simulator, work, limit_s=limit_s, bench="tests.support.traffic_bench")
    return json.loads((work / "result.json").read_text())


def by_mark(events: Sequence[Sequence[Any]]) -> dict[int, list[Sequence[Any]]]:
    """The lines after each mark."""
    parts: dict[int, list[Sequence[Any]]] = {}
    current: list[Sequence[Any]] = []
    for line in events:
        if line[0] == "mark":
            current = parts.setdefault(line[1], [])
        else:
            current.append(line)
    return parts


def differences(
    config: AcceleratorConfig, lines: Sequence[Sequence[Any]], expected: Mapping[str, np.ndarray], index: int
) -> list[str]:
    """What of one recording, number ``index`` of the vectors, is not as the golden model says; an X anywhere
    is a difference."""
    found = [" ".join(map(str, line)) for line in lines if line[0] in ("stuck", "unknown", "unstable")]
    for stage in (*FLAT_STAGES, "decision"):
        words = [line[1] for line in lines if line[0] == stage]
        low, high = expected[f"{stage}_offsets"][index : index + 2]
        wanted = expected[stage][low:high]
        if stage == "decision":
            wanted = pack_decisions(config, wanted)
        wanted = [int(value) & 0xFFFFFFFF for value in wanted]
        if words != wanted:
            place = next(
                (k for k, pair in enumerate(zip(words, wanted, strict=False)) if pair[0] != pair[1]),
                min(len(words), len(wanted)),
            )
            pair = [row[place] if place < len(row) else "nothing" for row in (wanted, words)]
            found.append(
                f"{stage} {place}: expected {pair[0]}, got {pair[1]} ({len(wanted)} and {len(words)} in all)"
            )
    return found


def initial_values(verilog: str) -> list[int]:
    """Line numbers of every initial value of a register and of a word of a memory that is written; other
    memories are constants."""
    written = set(re.findall(r"^\s*(\\?[^\s\[]+)\s*\[.*\] <=", verilog, re.MULTILINE))
    found = []
    for number, line in enumerate(verilog.split("\n")):
        word = re.match(r" *(\\?[^\s\[]+)\s*\[\d+\] = \d+'[hd]\w+;$", line)
        if re.match(r" *initial [^\s;]+ += \d+'[hd]\w+;$", line) or (word and word[1] in written):
            found.append(number)
    return found


def changed(verilog: str, unknown: Iterable[int] = (), drawn: Mapping[int, int] | None = None) -> str:
    """``verilog`` with X for the initial values in the lines ``unknown``, and with other ones, by line
    number, in the numbers of ``drawn``."""
    lines = verilog.split("\n")
    for number in unknown:
        lines[number] = ""
    for number, value in (drawn or {}).items():
        width = width_of(lines[number])
        lines[number] = re.sub(r"'[hd]\w+;$", f"'h{value & (1 << width) - 1:x};", lines[number])
    return "\n".join(lines)


def width_of(line: str) -> int:
    """Bits of the initial value in a line."""
    return int(re.search(r"= (\d+)'[hd]", line)[1])
