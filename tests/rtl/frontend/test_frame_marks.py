"""Marks of every frame against its number."""

from __future__ import annotations

import random

from amaranth.sim import Simulator

from eskin.golden.core.config import PRESETS
from eskin.rtl.frontend.frame_marks import FrameMarks, TouchMarks, marks_of
from tests.support.stream_bench import simulate
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


@each_row(
    ("hop", "odd", "steps", "frames"),
    [
        (1, 0, 1, 2),
        (1, 1, 3, 9),
        (2, 0, 3, 9),
        (2, 1, 4, 7),
        (5, 1, 4, 20),
        (5, 1, 5, 21),
        (5, 0, 5, 21),
        (9, 1, 1, 10),
    ],
)
def test_marks_of_a_touch_are_those_of_its_windows(hop, odd, steps, frames):
    config = PRESETS["thesis"].replace(
        hop=hop, window=2 * hop + odd, steps=steps, touch_frames=frames, pretrigger_frames=0
    )
    dut, rng, last = TouchMarks(config), random.Random(1), config.last_frame
    emits = {end for _, end in config.window_spans}

    async def bench(ctx):
        number = 0
        while number < 3 * last:
            frame = number % last + 1
            expected = (frame % hop == 0 or frame == last, frame in emits, frame == last)
            assert (ctx.get(dut.hop_last), ctx.get(dut.emit), ctx.get(dut.end)) == expected, number
            taken = rng.random() < 0.6
            ctx.set(dut.taken, taken)
            await ctx.tick()
            number += taken

    simulate(dut, bench)
