"""rtl/host/uart.py: the line, cycle by cycle, of every byte, with and without gaps."""

import random

from eskin.rtl.host.uart import UartTransmitter
from tests.support.stream_bench import put, simulate
from tests.support.table import each_row


@each_row("divisor", [2, 3, 26])
def test_the_line_is_that_of_the_bytes_and_high_between_them(divisor):
    rng = random.Random(divisor)
    words = rng.sample(range(256), 256 if divisor == 2 else 20)
    gaps = [0, 0, *(rng.choice((0, 0, 1, divisor, 11 * divisor)) for _ in words[2:])]
    dut, line, accepted = UartTransmitter(divisor), [], []

    async def send(ctx):
        for word, gap in zip(words, gaps, strict=True):
            ctx.set(dut.i.valid, 0)
            await ctx.tick().repeat(gap) if gap else None
            put(ctx, dut.i, valid=1, payload=word)
            await ctx.tick().until(dut.i.ready)
        ctx.set(dut.i.valid, 0)
        await ctx.tick().repeat(12 * divisor)

    async def watch(ctx):
        async for _, _, tx, valid, ready in ctx.tick().sample(dut.tx, dut.i.valid, dut.i.ready):
            line.append(tx)
            if valid and ready:
                accepted.append(len(line))  # the start bit is on the line from the next cycle on

    simulate(dut, send, watch)
    wanted = [1] * len(line)
    for begin, word in zip(accepted, words, strict=True):
        for place, bit in enumerate([0, *((word >> k) & 1 for k in range(8)), 1]):
            wanted[begin + place * divisor : begin + (place + 1) * divisor] = [bit] * divisor
    assert line == wanted
    assert accepted[1] - accepted[0] == 10 * divisor, "without a gap a byte takes ten bits"
