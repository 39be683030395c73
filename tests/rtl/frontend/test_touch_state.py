"""ARMED, TOUCH and REARM frame by frame, against the states written out."""

from __future__ import annotations

import random

from eskin.golden.core.config import PRESETS
from eskin.rtl.frontend.touch_state import TouchState
from tests.support.stream_bench import put, simulate
from tests.support.table import each_row

TOUCHES = PRESETS["thesis"].replace(
    pretrigger_frames=3, hop=2, window=4, steps=2, touch_frames=12, rearm_frames=14
)


@each_row("share", [0.05, 0.3])
def test_frames_of_a_touch_with_its_history_then_as_many_quiet_ones(share):
    dut, rng, touches = TouchState(TOUCHES), random.Random(3), 0
    last_frame = TOUCHES.last_frame

    async def bench(ctx):
        nonlocal touches
        # frames since the last touch, as many as count; still to come; quiet so far
        state, before, left, quiet = ("armed", 0, 0, 0)
        for _ in range(1500):
            met, judged, leaves = rng.random() < share, rng.random() < 0.9, rng.random() < 0.7
            put(ctx, dut, met=met, judged=judged, last=1, frame_left=leaves)
            onset = state == "armed" and met and judged
            assert (ctx.get(dut.armed), ctx.get(dut.touch)) == (state == "armed", state == "touch")
            assert ctx.get(dut.onset) == onset and ctx.get(dut.started) == (onset and leaves)
            assert ctx.get(dut.end) == (state == "touch" and left == 1)
            if leaves:
                if onset:
                    state, left, touches = "touch", last_frame - 1 - before, touches + 1
                elif state == "touch":
                    left -= 1
                    if not left:
                        state, quiet, before = "rearm", 0, 0
                elif state == "rearm" and judged:
                    quiet = 0 if met else quiet + 1
                    if quiet == TOUCHES.onset_rule.rearm_frames:
                        state, before = "armed", TOUCHES.windows.pretrigger_frames
                elif state == "armed":
                    before = min(before + 1, TOUCHES.windows.pretrigger_frames)
            await ctx.tick()

    simulate(dut, bench)
    assert touches > 4
