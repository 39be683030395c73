"""Rows become an image: addresses, filling up of short rows, and when the engine is started."""

from __future__ import annotations

import random

import pytest
from amaranth.sim import Simulator

from eskin.golden.core.config import AcceleratorConfig
from eskin.rtl.image.image_receiver import ImageReceiver

CONFIG = AcceleratorConfig.of_image(4, 5, ["dense 2"], ("a", "b"))


def run(frames: list[list[int]], images: int, seed: int) -> tuple[list[dict[int, int]], list[int], int]:
    """(address -> value of each image that was started, cycles from its last pixel to the start, framing faults); engine and classifier
    are busy at random."""
    dut, rng = ImageReceiver(CONFIG), random.Random(seed)
    beats = [(value, number == 0, number == len(frame) - 1) for frame in frames for number, value in enumerate(frame)]
    started: list[dict[int, int]] = []
    waits, faults = [], 0

    async def bench(ctx):
        nonlocal faults
        image: dict[int, int] = {}
        busy, left, waited = 0, list(beats), 0
        for _ in range(4000):
            if len(started) == images:
                return
            ctx.set(dut.busy, busy > 0)
            free = rng.random() < 0.7
            ctx.set(dut.free, free)
            offered = bool(left) and rng.random() < 0.8
            ctx.set(dut.i.valid, offered)
            if offered:
                ctx.set(dut.i.p.sample, left[0][0])
                ctx.set(dut.i.p.first, left[0][1])
                ctx.set(dut.i.p.last, left[0][2])
            faults += ctx.get(dut.framing_fault)
            if ctx.get(dut.fill.valid):
                assert not busy, "the engine reads its memory"
                assert bool(image) != bool(ctx.get(dut.begun))
                image[ctx.get(dut.fill.address)] = ctx.get(dut.fill.value)
                waited = 0
            if offered and ctx.get(dut.i.ready):
                left.pop(0)
            if ctx.get(dut.start):
                assert free and not busy and len(image) == 20
                started.append(image)
                waits.append(waited)
                image, busy = {}, rng.randint(2, 9)
            else:
                busy = max(0, busy - 1)
            waited += 1
            await ctx.tick()
        raise AssertionError(f"{len(started)} images were started")

    sim = Simulator(dut)
    sim.add_clock(1e-6)
    sim.add_testbench(bench)
    sim.run()
    return started, waits, faults


@pytest.mark.parametrize("seed", range(3))
def test_images_one_after_the_other(seed):
    rng = random.Random(seed)
    frames = [[rng.randrange(256) for _ in range(5)] for _ in range(12)]
    started, waits, faults = run(frames, 3, seed)
    flat = [value for frame in frames for value in frame]
    assert [list(image.values()) for image in started] == [flat[k : k + 20] for k in (0, 20, 40)]
    assert all(list(image) == list(range(20)) for image in started)
    assert min(waits) == 1 and faults == 0


def test_a_short_row_is_filled_up_with_its_last_pixel_and_told():
    started, _, faults = run([[1, 2, 3, 4, 5], [6, 7], [8, 9, 10, 11, 12], [13, 14, 15, 16, 17]], 1, seed=4)
    assert list(started[0].values()) == [1, 2, 3, 4, 5, 6, 7, 7, 7, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17]
    assert faults > 0
