"""Rows become an image: addresses, filling up of short rows, and when the engine is started."""

import random

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.image.image_receiver import ImageReceiver
from tests.support.stream_bench import put, simulate

CONFIG = AcceleratorConfig.of_image(4, 5, ["dense 2"], ("a", "b"))


def run(frames: list[list[int]], seed: int) -> tuple[list[tuple[int, int]], list[int], int, int]:
    """Pixels (address, value) that are written, cycles from the last of them to each start, framing faults,
    first pixels told; the classifier is free at random."""
    dut, rng = ImageReceiver(CONFIG), random.Random(seed)
    left = [
        (value, number == 0, number == len(frame) - 1)
        for frame in frames
        for number, value in enumerate(frame)
    ]
    pixels: list[tuple[int, int]] = []
    waits: list[int] = []
    told = [0, 0]

    async def bench(ctx):
        waited = 0
        for _ in range(300):
            free = rng.random() < 0.7
            ctx.set(dut.free, free)
            offered = bool(left) and rng.random() < 0.8
            ctx.set(dut.i.valid, offered)
            if offered:
                put(ctx, dut.i.p, sample=left[0][0], first=left[0][1], last=left[0][2])
            told[0] += ctx.get(dut.status.framing_fault)
            told[1] += ctx.get(dut.status.started)
            if ctx.get(dut.fill.valid):
                assert bool(pixels) != bool(ctx.get(dut.status.started))
                pixels.append((ctx.get(dut.fill.address), ctx.get(dut.fill.value)))
                waited = 0
            if offered and ctx.get(dut.i.ready):
                left.pop(0)
            if ctx.get(dut.start):
                assert free and len(pixels) == 20
                waits.append(waited)
            waited += 1
            await ctx.tick()
        assert not left, "a beat was not taken"

    simulate(dut, bench)
    return pixels, waits, *told


def test_one_image_and_what_comes_behind_it_does_nothing():
    waits = []
    for seed in range(3):
        rng = random.Random(seed)
        frames = [[rng.randrange(256) for _ in range(5)] for _ in range(9)]
        pixels, waited, faults, begun = run(frames, seed)
        assert pixels == list(enumerate([value for frame in frames for value in frame][:20]))
        assert (len(waited), faults, begun) == (1, 0, 1)
        waits += waited
    assert min(waits) == 1


def test_a_short_row_is_filled_up_with_its_last_pixel_and_told():
    rows = [[1, 2, 3, 4, 5], [6, 7], [8, 9, 10, 11, 12], [13, 14, 15, 16, 17]]
    pixels, waits, faults, _ = run(rows, seed=4)
    assert [value for _, value in pixels] == [*range(1, 8), 7, 7, 7, *range(8, 18)]
    assert faults > 0 and len(waits) == 1
