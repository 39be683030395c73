"""rtl/host/frame_sender.py: whole frames behind their numbers; what the line has no time for is left out, and the numbers
show it."""

import random

from eskin.golden.core import PRESETS
from eskin.rtl.host.frame_sender import FrameSender
from tests.support.stream_bench import Bench, put, values
from tests.support.table import each_row

CONFIG = PRESETS["fabric"].replace(taxels=5)
"""Signed samples."""


@each_row("stall, pause, least, most", [(0.0, 12, 1.0, 1.0), (0.5, 4, 0.3, 0.9), (0.9, 0, 0.05, 0.4)])
def test_frames_are_sent_whole_or_counted(stall, pause, least, most):
    """least, most: share of the wanted frames that the line has time for. ``on`` counts with a frame's first sample
    alone; a frame may be broken in any cycle."""
    dut, rng, cycles = FrameSender(CONFIG), random.Random(3), []
    for taxel in [*range(5)] * 150:
        cycles += [(taxel, side, side == 3) for side in rng.choices(range(3), k=rng.randrange(3))]
        cycles += [(taxel, 3, True), *[(0, 0, False)] * (pause * (taxel == 4))]
    cycles = [
        (*cycle, rng.randrange(-32768, 32768), rng.random() < 0.8, rng.random() < 0.1) for cycle in cycles
    ]
    bench = Bench(dut, seed=4)
    out = bench.collect(dut.o, stall=stall)

    async def play(ctx):
        for taxel, side, _, sample, on, broken in cycles:
            beat = {"sample": sample, "first": taxel == 0, "last": taxel == 4}
            put(
                ctx, dut, frame={"valid": side & 1, "ready": side >> 1, "payload": beat}, on=on, broken=broken
            )
            await ctx.tick()

    bench.process(play)
    bench.run()
    sent, number, wanted, words = [], 0, 0, None
    for cycle, (taxel, _, passes, sample, on, broken) in enumerate(cycles):
        if passes and taxel == 0:
            free = not sent or out[6 * len(sent) - 1].cycle < cycle
            wanted, words = wanted + on, [number] if on and free else None
        if passes and words:
            words.append(sample & 0xFFFF)
            sent += [words] * (taxel == 4)
        number += broken + (passes and taxel == 4)
    assert values(out) == [
        {"word": word, "last": place == 5} for words in sent for place, word in enumerate(words)
    ]
    assert least * wanted <= len(sent) <= most * wanted
