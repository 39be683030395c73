"""rtl/frontend/onset_filter.py: every sequence of eight frames for M of up to 5, and frames that are not
judged."""

import itertools
import random

import pytest
from amaranth.hdl import ResetInserter, Signal

from eskin.golden.core.config import PRESETS
from eskin.rtl.frontend.onset_filter import OnsetFilter
from tests.support.stream_bench import Bench


@pytest.mark.parametrize("hits, span", [(1, 2), (2, 2), (2, 3), (1, 4), (3, 4), (4, 5), (5, 5), (9, 16)])
def test_m_of_k(hits, span):
    dut, reset = OnsetFilter(PRESETS["pvdf"].replace(onset_hits=hits, onset_span=span)), Signal()
    bench, rng = Bench(ResetInserter(reset)(dut)), random.Random(span)
    every = (
        itertools.product((0, 1), repeat=8)
        if span < 6
        else [[rng.randrange(2) for _ in range(40)] for _ in range(40)]
    )

    async def play(ctx):
        for sequence in every:
            judged = []
            for hit in sequence:
                while rng.random() < 0.3:  # a frame that is not judged leaves nothing behind
                    ctx.set(dut.i, {"valid": 0, "hit": rng.randrange(2)})
                    await ctx.tick()
                judged.append(hit)
                ctx.set(dut.i, {"valid": 1, "hit": hit})
                assert ctx.get(dut.met) == (sum(judged[-span:]) >= hits), judged
                await ctx.tick()
            ctx.set(dut.i.valid, 0)
            ctx.set(reset, 1)
            await ctx.tick()
            ctx.set(reset, 0)

    bench.process(play)
    bench.run()
