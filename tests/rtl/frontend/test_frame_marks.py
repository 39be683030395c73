"""Marks of every frame against its number."""

from __future__ import annotations

import random

from amaranth.sim import Simulator

from eskin.golden.core.config import PRESETS
from eskin.rtl.frontend.frame_marks import FrameMarks, marks_of
from tests.support.table import each_row


@each_row(("preset", "names"), [("thesis", 0), ("synthetic", 4), ("pvdf", 7)])
def test_marks_are_those_of_the_frames_number(preset, names):
    config = PRESETS[preset].replace(**{} if preset == "thesis" else {"rest_frames": 6})
    dut, rng = FrameMarks(config), random.Random(1)
    assert len(marks_of(config)) == names
    hop, check = config.windows.hop, config.onset_rule.onset_check_frames

    async def bench(ctx):
        number = 0
        while number < 4 * hop + 9:
            expected = {
                "settling": number < 6,
                "settle_first": number == 0,
                "settle_last": number == 5,
                "block_end": number % check == check - 1,
                "hop_last": number % hop == hop - 1,
                "boundary": number % hop == hop - 1 and number >= hop,
                "recording_first": number == 0,
            }
            for name in marks_of(config):
                assert ctx.get(getattr(dut, name)) == expected[name], (name, number)
            taken = rng.random() < 0.6
            ctx.set(dut.taken, taken)
            await ctx.tick()
            number += taken

    sim = Simulator(dut)
    if marks_of(config):
        sim.add_clock(1e-6)
        sim.add_testbench(bench)
        sim.run()
