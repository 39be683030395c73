"""The chain for images on the bus: a clock that stops while a short row is filled up, a program that runs too
long."""

import pytest

from eskin.golden.core import AcceleratorConfig
from eskin.golden.model import run_images
from eskin.rtl.fpga.generate import boot_writes
from eskin.rtl.program.image_passes import Word
from eskin.rtl.program.memory_map import Control, Fault, ImageMemory, Register
from eskin.rtl.program.schedule import step_cycles
from eskin.rtl.top.accelerator import Accelerator
from eskin.rtl.top.watchdog import bound
from eskin.training.made_up import random_images
from tests.support.image_scenes import random_image_model
from tests.support.stream_bench import bus_accesses, give_frame, simulate
from tests.support.table import each_row, refused

CONFIG = AcceleratorConfig.of_image(4, 32, ["conv 3 2", "pool", "dense 2"], ("a", "b")).with_lanes(4, "plain")
MODEL = random_image_model(CONFIG.replace(checksum=True, watchdog=True, clock_gate=True), seed=3)
SHORT = 3
"""Pixels of the row that is filled up."""


def play(rows: list[list[int]], writes: list[tuple[int, int]]) -> tuple[list[int], list[int]]:
    """(margins, what FAULTS then reads, before and after it was cleared) of an image, a long time between
    its rows."""
    config = MODEL.config
    dut, margins, faults = Accelerator(config), [], []

    async def bench(ctx):
        write, read = bus_accesses(ctx, dut.bus)
        for register, word in [
            *writes,
            (Register.CONTROL, Control.CLEAR_FAULTS),
            (Register.CONTROL, Control.ARM),
        ]:
            await write(register, word)
        await ctx.tick()
        for row in rows:
            await give_frame(ctx, dut.i, row)
            await ctx.tick().repeat(100)
        for _ in range(2 * step_cycles(config) + 2 * bound(config)):
            if ctx.get(dut.o.valid):
                margins.append(ctx.get(dut.o.p.margin))
                ctx.set(dut.o.ready, 1)
            await ctx.tick()
            ctx.set(dut.o.ready, 0)
        for _ in range(2):
            faults.append(await read(Register.FAULTS))
            await write(Register.CONTROL, Control.CLEAR_FAULTS)
        ctx.set(dut.o.ready, 1)

    simulate(dut, bench)
    return margins, faults


@pytest.fixture(scope="module")
def image():
    return random_images(CONFIG, 1, seed=4)[0]


def test_a_short_last_row_is_filled_up_before_the_clock_stops(image):
    filled = image.copy()
    filled[-1, SHORT:] = filled[-1, SHORT - 1]
    rows = [list(map(int, row)) for row in image]
    rows[-1] = rows[-1][:SHORT]
    margins, faults = play(rows, boot_writes(MODEL.config, MODEL.arrays))
    assert margins == [int(run_images(MODEL, filled[None]).margin[0])] * 2
    assert faults == [Fault.FRAMING, 0]


def test_a_program_that_runs_too_long_is_told_by_the_checksum_and_ended_by_the_watchdog(image):
    writes = boot_writes(MODEL.config, MODEL.arrays)
    extent = writes.index((Register.MEMORY_SELECT, ImageMemory.PASSES)) + 1 + Word.EXTENT
    writes[extent] = (Register.MEMORY_DATA, 0xFFFF)  # a map of 256 x 256
    margins, faults = play([list(map(int, row)) for row in image], writes)
    assert not margins and faults == [Fault.CHECKSUM | Fault.WATCHDOG, 0]


@each_row("field, value", [("lanes", 6), ("loadable", False), ("one_port", True), ("one_phase", True)])
def test_hardware_that_images_do_not_have_is_refused_in_a_sentence(field, value):
    with refused(f"field {field}: .*"):
        Accelerator(MODEL.config.replace(**{field: value}))
