"""A small accelerator under scripts of tests/support/traffic.py: any bus traffic, resets, and registers and
memories that start as X."""

import random
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from eskin.cosim.netlist import Hardware
from eskin.golden.core import AcceleratorConfig
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel, write_vectors
from eskin.golden.model import run as golden_run
from eskin.rtl.fpga.export import export
from eskin.rtl.fpga.generate import boot_writes
from eskin.rtl.program.memory_map import Control, Register
from eskin.training.made_up import random_recordings
from tests.support.random_models import random_integer_model
from tests.support.small_designs import SMALL
from tests.support.traffic import (
    Script,
    beat,
    beats,
    by_mark,
    changed,
    differences,
    initial_values,
    run,
    width_of,
)

CONFIG = SMALL.replace(hop=3, window=7, touch_frames=14, steps=3, pretrigger_frames=2, rearm_frames=11)
HARMFUL = {int(Register.CONTROL), int(Register.MEMORY_DATA), int(Register.MASK)}
"""Registers that change what a recording gives."""


class Case:
    """A model, two recordings (several touches; one), their golden vectors, and the Verilog."""

    def __init__(self, config: AcceleratorConfig = CONFIG) -> None:
        self.model: IntegerModel = random_integer_model(config, 5)
        self.config = self.model.config
        before = config.rest_level.rest_frames + config.windows.pretrigger_frames
        whole, steps = before + config.last_frame + 2 * config.windows.hop, config.windows.steps
        for seed in range(200):
            self.recordings: Recordings = random_recordings(self.config, (2 * whole, whole), seed)
            self.trace = golden_run(self.model, self.recordings)
            first = self.trace.first
            if (first >= 0).all() and self.trace.touches.completed[first].min() == steps:
                break
        else:
            raise AssertionError("no seed gives both recordings a whole touch")
        self.verilog = export(self.config, self.model.arrays)
        self.boot = boot_writes(self.config, self.model.arrays)

    def vectors(self, folder: Path) -> dict[str, np.ndarray]:
        """The golden arrays of both recordings."""
        with np.load(write_vectors(folder / "vectors.npz", self.trace, self.recordings)) as archive:
            return dict(archive)

    def design(self, folder: Path, verilog: str = "") -> Hardware:
        """The Verilog, or another, as a file."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "accelerator.sv").write_text(verilog or self.verilog)
        return Hardware((folder / "accelerator.sv",))

    def load(self, script: Script) -> None:
        """Weights, constants, masks."""
        for address, word in self.boot:
            script.write(address, word)

    def play(self, script: Script, index: int) -> None:
        """A recording as a good host plays it."""
        script.recording(self.recordings.recording(index), self.config.sensor.sample_bits)

    def open_frames(self, folder: Path) -> range:
        """Frames of recording 1 after which its first touch is surely open: from its first step on, up to the
        last but one."""
        vectors = self.vectors(folder)
        low, high = vectors["decision_offsets"][1:3]
        rows, frames = vectors["decision"][low:high], vectors["decision_frame"][low:high]
        steps = frames[rows[:, 0] == 0][: self.config.windows.steps]
        return range(int(steps[0]), int(steps[-1]))


@cache
def small_case() -> Case:
    """The case of CONFIG."""
    return Case()


def rubbish(case: Case, script: Script, rng: random.Random) -> None:
    """Traffic as no host makes it: commands at any time, half frames, wrong first and last, any word to any
    address."""
    words = (0, 1, 2, 3, 4, 7, 0xFFFF, 0x40, 0x41, 0x42, 0x5A5A)
    bits = case.config.sensor.sample_bits
    for _ in range(rng.randint(20, 150)):
        what = rng.random()
        if what < 0.35:
            address = rng.choice((*map(int, Register), rng.randrange(256)))
            for _ in range(rng.choice((1, 1, 2, 30))):
                script.write(address, rng.choice((*words, rng.randrange(1 << 16))))
        elif what < 0.45:
            script.read(rng.randrange(256))
        elif what < 0.55:
            script.wait(rng.choice((1, 2, 5, 50, 300)))
        elif what < 0.6:
            script.sink(rng.choice((0, rng.randrange(1, 1 << 30))))
        elif what < 0.8:
            for payload in beats([rng.randrange(1 << bits) for _ in range(case.config.sensor.taxels)], bits):
                script.beat(payload)
        else:
            for _ in range(rng.randint(1, 9)):
                script.beat(
                    beat(rng.randrange(1 << bits), bits, first=rng.random() < 0.3, last=rng.random() < 0.3)
                )


def recovery(case: Case, seed: str) -> Script:
    """Rubbish, and then a good host: loads, plays. What follows mark 1 must be recording 1."""
    rng, script = random.Random(seed), Script()
    if rng.random() < 0.7:
        case.load(script)
    script.mark(0)
    rubbish(case, script, rng)
    script.mark(2)
    script.sink(0)
    script.command(Control.ARM)  # ends an open touch, in which weights would be refused
    script.mark(1)
    case.load(script)
    case.play(script, 1)
    return script


def meddling(case: Case, seed: str, open_frames: range) -> Script:
    """Recording 1 with harmless bus traffic at every turn: reads, writes that change nothing, weights while
    the touch is open, stalls."""
    rng, script = random.Random(seed), Script()
    case.load(script)
    script.mark(1)
    script.sink(rng.choice((0, rng.randrange(1, 1 << 30))))
    script.command(Control.ARM)
    samples, bits = case.recordings.recording(1), case.config.sensor.sample_bits
    for number, frame in enumerate(samples):
        for payload in beats(frame, bits):
            for _ in range(rng.choice((0, 0, 1, 3))):
                address = rng.randrange(256)
                kind = rng.random()
                if kind < 0.3:
                    script.read(address)
                elif kind < 0.5 and number in open_frames:
                    script.write(Register.MEMORY_DATA, rng.randrange(1 << 16))
                elif kind < 0.6:
                    script.write(Register.CONTROL, Control.CLEAR_FAULTS)
                elif address not in HARMFUL:
                    script.write(address, rng.randrange(1 << 16))
            script.beat(payload)
    script.until_idle()
    script.command(Control.FINISH)
    return script


def resets(case: Case, count: int, seed: int) -> Script:
    """``count`` times: recording 0 (now and then the loading) is broken off by a reset in a random cycle;
    recording 1 is marked."""
    rng, script = random.Random(seed), Script()
    cycles = len(case.recordings.recording(0)) * case.config.sensor.taxels + 60
    case.load(script)
    for number in range(count):
        script.mark(-1)
        loading = rng.random() < 0.1
        script.sink(rng.choice((0, rng.randrange(1, 1 << 30))))
        script.reset(rng.randint(1, len(case.boot) if loading else cycles))
        if loading:
            case.load(script)
        case.play(script, 0)
        script.mark(number)
        script.sink(0)
        if loading:  # else the weights are still there
            case.load(script)
        case.play(script, 1)
    return script


def judge(script: Script, case: Case, folder: Path, builds: Path, verilog: str = "") -> dict[int, list[str]]:
    """What differs from golden recording 1 after each mark from 0 on, and any X or standstill."""
    vectors = case.vectors(folder)
    result = run(script, case.design(folder, verilog), folder, builds)
    parts = {number: lines for number, lines in by_mark(result).items() if number >= 0}
    return {number: differences(case.config, lines, vectors, 1) for number, lines in parts.items()}


def x_script(case: Case) -> Script:
    """Load and play twice, straight after the reset."""
    script = Script()
    case.load(script)
    for mark in (0, 1):
        script.mark(mark)
        case.play(script, 1)
    return script


def those_that_matter(lines: list[int], fails: Callable[[list[int]], bool]) -> list[int]:
    """The lines that make ``fails`` true each by itself, found by halving."""
    if not lines or not fails(lines):
        return []
    half = len(lines) // 2
    return (
        lines
        if len(lines) == 1
        else those_that_matter(lines[:half], fails) + those_that_matter(lines[half:], fails)
    )


@dataclass(frozen=True)
class Power:
    """What initial values mean. constants: lines whose value is used before it is written. multiplied: lines
    of words that only an X gets through, because it comes out of a product with 0 as X. text: of all lines;
    total, bits: of all initial values."""

    constants: list[int]
    multiplied: list[int]
    text: list[str]
    total: int
    bits: int


def power_up(case: Case, folder: Path, builds: Path, seeds: int) -> Power:
    """Start in another state: which initial values matter, and that with all others X, or at random,
    everything is golden.

    Raises AssertionError when it is not.
    """
    lines, text, script = initial_values(case.verilog), case.verilog.split("\n"), x_script(case)
    rng = random.Random(1)

    def exact(unknown=(), drawn=None) -> bool:
        found = judge(script, case, folder, builds, changed(case.verilog, unknown, drawn))
        return sorted(found) == [0, 1] and not any(found.values())

    def other(which: Iterable[int]) -> dict[int, int]:
        return {number: rng.getrandbits(width_of(text[number])) for number in which}

    assert exact()
    constants = those_that_matter(lines, lambda some: not exact(drawn=other(some)))
    free = [number for number in lines if number not in constants]
    multiplied = those_that_matter(free, lambda some: not exact(unknown=some))
    for _ in range(seeds):
        assert exact(drawn=other(free))
        assert exact(unknown=[number for number in free if number not in multiplied], drawn=other(multiplied))
    return Power(constants, multiplied, text, len(lines), sum(width_of(text[number]) for number in lines))
