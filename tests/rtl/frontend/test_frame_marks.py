"""The marks of every frame follow from its number: against the windows, for every form of hop, window and rest."""

import random

from eskin.golden.core import PRESETS
from eskin.rtl.frontend.frame_marks import FrameMarks, TouchMarks, marks_of
from tests.support.stream_bench import simulate
from tests.support.table import each_row

SMALL = PRESETS["thesis"].replace(pretrigger_frames=0, feature_shift=())


def play(dut, names, frames: int) -> list[tuple[int, ...]]:
    """The marks of so many frames, which are seen before and in the cycle in which they are taken."""
    seen, rng = [], random.Random(frames)

    async def body(ctx):
        for _ in range(frames):
            waits = rng.randrange(3)
            for cycle in range(waits + 1):
                ctx.set(dut.taken, cycle == waits)
                marks = tuple(ctx.get(getattr(dut, name)) for name in names)
                await ctx.tick()
            seen.append(marks)

    simulate(dut, body)
    return seen


@each_row(
    "hop, window, steps, touch_frames",
    [(1, 2, 1, 2), (1, 2, 2, 3), (1, 3, 3, 4), (2, 5, 4, 9), (3, 6, 1, 2), (3, 6, 3, 10), (3, 7, 3, 13)],
)
def test_of_a_touch(**windows):
    config = SMALL.replace(**windows)
    last, ends = config.last_frame, {end for _, end in config.window_spans}
    touch = [
        (number % config.windows.hop == 0 or number == last, number in ends, number == last)
        for number in range(1, last + 1)
    ]
    assert play(TouchMarks(config), ("hop_last", "emit", "end"), 3 * last) == 3 * touch


@each_row("hop, rest_frames, check", [(1, 1, 1), (3, 5, 4), (4, 8, 2)])
def test_of_a_recording(hop, rest_frames, check):
    free = dict(window_mode="free", hop=hop, window=2 * hop, steps=2)
    config = SMALL.replace(
        **free,
        rest="initial",
        rest_frames=rest_frames,
        onset="baseline",
        onset_check_frames=check,
        onset_mean_frames=8,
    )
    expected = [
        (
            number < rest_frames,
            number == 0,
            number == rest_frames - 1,
            (number + 1) % check == 0,
            (number + 1) % hop == 0,
            (number + 1) % hop == 0 and number >= hop,
            number == 0,
        )
        for number in range(4 * hop + 9)
    ]
    assert play(FrameMarks(config), marks_of(config), len(expected)) == expected
