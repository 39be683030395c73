"""rtl/frontend/frame_door.py: of every few frames the first, whole and in order."""

import numpy as np
import pytest

from eskin.golden.core import PRESETS
from eskin.rtl.frontend.frame_door import FrameDoor
from tests.support.front_end_cases import sample_beats
from tests.support.stream_bench import SIDES, Bench, values


@pytest.mark.parametrize("stalls", [(0.0, 0.0), *SIDES])
def test_of_every_few_frames_the_first(stalls):
    every = 4 if any(stalls) else 2
    dut = FrameDoor(PRESETS["pvdf"].replace(taxels=3, feature_shift=(), scan_every=every))
    bench, frames = Bench(dut, seed=1), np.arange(11 * 3).reshape(11, 3)

    async def constant(ctx):
        ctx.set(dut.every, 1)

    bench.process(constant)
    accepted = bench.drive(dut.i, sample_beats(frames), stall=stalls[0])
    out = bench.collect(dut.o, stall=stalls[1])
    bench.run()
    assert values(out) == sample_beats(frames[::every])
    assert any(stalls) or accepted == [*range(len(accepted))], "a beat a cycle"
