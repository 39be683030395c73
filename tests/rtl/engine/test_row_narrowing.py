"""A finished row to index, value and logit against eskin.golden.core.formats.narrow: every total of a small
format."""

from types import SimpleNamespace

from eskin.golden.core import QFormat, narrow
from eskin.rtl.engine.row_chain import RowChain
from eskin.rtl.engine.row_narrowing import RowNarrowing
from tests.support.stream_bench import put, simulate


class Small:
    """The formats the narrowing looks at, so small that every total can be tried."""

    recurrent, accumulator_bits, index_bits = True, 14, 5
    sigmoid_shift, tanh_shift, value_shift, logit_shift = 7, 6, 5, 8
    logit_proven = False
    index_format = QFormat(5, 0)
    formats = SimpleNamespace(state_format=QFormat(2, 3), logit_format=QFormat(3, 1))


def expected(config, total: int) -> tuple[int, int, int, int]:
    """(sigmoid's index, tanh's, value, logit); the total holds the rounding half of its narrowing."""
    return tuple(
        int(narrow(total - (1 << shift - 1), shift, fmt))
        for shift, fmt in (
            (config.sigmoid_shift, config.index_format),
            (config.tanh_shift, config.index_format),
            (config.value_shift, config.formats.state_format),
            (config.logit_shift, config.formats.logit_format),
        )
    )


def test_a_proven_logit_has_no_saturator_and_needs_none():
    class Proven(Small):
        formats = SimpleNamespace(state_format=QFormat(2, 3), logit_format=QFormat(5, 1))
        logit_proven = True  # every total of 14 bits, 8 of them dropped

    dut = RowNarrowing(Proven)

    async def bench(ctx):
        for total in range(-(1 << 13), 1 << 13):
            ctx.set(dut.total, total)
            assert ctx.get(dut.logit) == expected(Proven, total)[3] == total >> 8

    simulate(dut, bench)


def test_the_chain_hands_every_bit_of_a_total_on():
    dut, top = RowChain(14, 3), 1 << 13
    sums = [-top, top - 1, -top + 1]

    async def bench(ctx):
        put(ctx, dut, tick=1, swap=1, acc=sums, addend=-top)
        for total in [*sums, -top]:
            await ctx.tick()
            put(ctx, dut, swap=0, shift=1)
            assert ctx.get(dut.total) == total
        assert list(ctx.get(dut.load)) == [-top] * 3

    simulate(dut, bench)


def test_every_total_of_a_small_format():
    """And of accumulators narrower than an index with the bits dropped below it."""
    ends = [set(), set(), set(), set()]
    for bits in (10, 14):

        class Narrow(Small):
            accumulator_bits = bits

        dut = RowNarrowing(Narrow)

        async def bench(ctx, dut=dut, bits=bits):
            for total in range(-1 << bits - 1, 1 << bits - 1):
                put(ctx, dut, total=total, tanh=0)
                sigmoid = ctx.get(dut.index)
                ctx.set(dut.tanh, 1)
                got = (sigmoid, ctx.get(dut.index), ctx.get(dut.value), ctx.get(dut.logit))
                assert got == expected(Small, total)
                for seen, code in zip(ends, got, strict=True):
                    seen.add(code)

        simulate(dut, bench)
    formats = (Small.index_format, Small.index_format, Small.formats.state_format, Small.formats.logit_format)
    for seen, fmt in zip(ends, formats, strict=True):
        assert {-(1 << fmt.width - 1), (1 << fmt.width - 1) - 1} <= seen, "an end was never reached"
