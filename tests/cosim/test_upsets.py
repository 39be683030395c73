"""Single upsets of the generated Verilog: the checksum flags a changed constant, and the watchdog ends every
hang. Larger campaigns have given the figures of docs/robustness.md."""

import random
from pathlib import Path
from typing import NamedTuple

import pytest

from eskin.cosim.device import HUNG, Design, Device
from eskin.golden.core import SimulationError
from eskin.rtl.fpga.generate import boot_writes
from eskin.rtl.program.memory_map import Control, Fault, Register
from eskin.rtl.top.watchdog import bound, longest_wait
from tests.rtl.top.test_accelerator import CONFIGS, recordings
from tests.support.random_models import random_integer_model
from tests.support.upset_design import PORTS, with_upsets

BUILDS = Path("build/simulators")
SMALL = CONFIGS["tracked, free"].replace(table_entries=64)


class Outcome(NamedTuple):
    """flagged: CHECKSUM was set when the first global decision was offered, or at the end. cleared: the watchdog acted.
    first: cycles to the first decision; cycles: of the whole recording."""

    flagged: bool
    cleared: bool
    hangs: bool
    first: int
    cycles: int


class Upsets:
    """A small design with a way in for upsets; its recording has two touches."""

    def __init__(self, *, checksum: bool = True, watchdog: bool = True) -> None:
        model = random_integer_model(SMALL.replace(checksum=checksum, watchdog=watchdog), seed=5)
        text, self.sites = with_upsets(model.config, model.arrays)
        self._design = Design(text, BUILDS)
        self._boot = boot_writes(model.config, model.arrays)
        self._codes = recordings(model.config, 3, [200]).recording(0)
        self._bits = model.config.sensor.sample_bits
        defended = model.config.replace(watchdog=True, checksum=True)
        self._limit = longest_wait(defended) + bound(defended) + 256
        self.clean = self.play()

    def play(self, upset: tuple[int, ...] = (0, 0, 0, 0), at: int = 0) -> Outcome:
        """One recording with ``upset`` (register, memory, word, bit) so many cycles after its `arm`."""
        device, hangs = Device(self._design, self._bits), False
        device.state.watch = Register.FAULTS
        device.reset(self._boot)
        device.forget()
        device.write(Register.CONTROL, Control.ARM)
        device.cycle()  # it clears the chain at the end of the cycle behind it
        begun = device.state.cycle
        device.poke(begun + at, **dict(zip(PORTS, upset, strict=True)))
        try:
            device.frames(self._codes, limit=self._limit)
            device.write(Register.CONTROL, Control.FINISH)
            device.settle(self._limit)
        except SimulationError:
            hangs = True
        events = device.seen()
        decided = events[events["stage"] == 0]
        flags = [row["also"] for row in decided if row["value"] >> 29 & 1 and row["cycle"] > begun + at]
        faults = int([*flags, device.read(Register.FAULTS)][0])
        first = int([*decided["cycle"], begun][0]) - begun
        cleared = bool((events["stage"] == HUNG).any())
        return Outcome(bool(faults & Fault.CHECKSUM), cleared, hangs, first, device.state.cycle - begun)


@pytest.mark.slow
@pytest.mark.parametrize("checksum", [True, False])
def test_the_checksum_flags_a_changed_constant_before_the_decision_of_its_touch(checksum):
    """Weights, tables and means, each walked through once more before the first step."""
    design, rng = Upsets(checksum=checksum), random.Random(1)
    clean = design.clean
    assert clean.first and not clean.hangs and not clean.flagged
    constants = ("means", "table")
    memories = [s for s in design.sites if s.words and (s.name.endswith(constants) or "weights_" in s.name)]
    assert len(memories) >= 3
    for number in range(240):
        site = memories[number % len(memories)]
        upset = (0, site.number, rng.randrange(site.words), rng.randrange(site.width))
        assert design.play(upset, rng.randrange(clean.first // 2)).flagged == checksum, upset


@pytest.mark.slow
@pytest.mark.parametrize("watchdog", [True, False])
def test_the_watchdog_ends_every_hang(watchdog):
    design, rng = Upsets(watchdog=watchdog), random.Random(7)
    registers = [site for site in design.sites if not site.words and site.block != "watchdog"]
    bits = [(site.number, 0, 0, bit) for site in registers for bit in range(site.width)]
    chosen = rng.sample(bits, min(800, len(bits)))
    outcomes = [design.play(upset, rng.randrange(design.clean.cycles // 2)) for upset in chosen]
    assert any(outcome.hangs for outcome in outcomes) != watchdog
    assert any(outcome.cleared for outcome in outcomes) == watchdog
