"""rtl/frontend/frame_marks.py: the marks of a touch's frames, for every small shape of windows."""

from itertools import product

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.frontend.frame_marks import TouchMarks
from tests.support.front_end_cases import BAND, BASE, TOUCH, touch_marks
from tests.support.stream_bench import simulate


def test_marks_of_every_frame_of_two_touches():
    """Hops of one frame, odd and even windows, a last window that is cut by any number of frames."""
    for hop, odd, steps, cut in product((1, 2, 3, 5), (0, 1), (1, 2, 4), range(5)):
        frames = hop * (steps - 1) + 2 * hop + odd - cut
        if frames <= hop * (steps - 1) or frames < 2:
            continue
        windows = dict(hop=hop, window=2 * hop + odd, steps=steps, touch_frames=frames, pretrigger_frames=0)
        config = AcceleratorConfig.of(**(BASE | BAND | TOUCH | windows))
        dut, seen = TouchMarks(config), []

        async def bench(ctx, dut=dut, seen=seen, count=2 * config.last_frame):
            for number in range(count):
                ctx.set(dut.taken, 0)
                await ctx.tick().repeat(number % 3 + 1)
                seen.append({name: ctx.get(getattr(dut, name)) for name in ("hop_last", "emit", "end")})
                ctx.set(dut.taken, 1)
                await ctx.tick()

        simulate(dut, bench)
        assert seen == 2 * [touch_marks(config, frame) for frame in range(1, config.last_frame + 1)], windows
