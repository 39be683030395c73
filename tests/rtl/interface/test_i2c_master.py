"""rtl/interface/i2c_master.py: both lines in every cycle, and the bits heard from a chip whose data stand only in the
cycle in which they are looked at."""

import random

from eskin.rtl.interface.i2c_master import I2cMaster, I2cOp
from tests.support.stream_bench import put, simulate
from tests.support.table import each_row


@each_row("quarter", [3, 4, 8])
def test_every_cycle_of_both_lines_and_every_bit_heard(quarter):
    rng, dut = random.Random(quarter), I2cMaster(quarter)
    pins, seen, expected = dut.pins, [], []

    async def cycle(ctx, *values):  # of clock, data, idle, done
        expected.append(values)
        shown = (~pins.scl_low, ~pins.sda_low, dut.idle, dut.done)
        seen.append(tuple(ctx.get(signal) & 1 for signal in shown))
        await ctx.tick()

    async def play(ctx):
        clock = data = 1
        for op in [*I2cOp, *rng.choices(list(I2cOp), k=20)]:
            byte, sent = rng.getrandbits(8), rng.getrandbits(9)
            for pause in range(rng.randrange(3), -1, -1):
                put(ctx, dut, op=op, byte=byte ^ pause, start=pause == 0)
                await cycle(ctx, clock, data, 1, 0)
            put(ctx, dut, start=0, op=rng.choice(list(I2cOp)), byte=rng.getrandbits(8))
            words = {I2cOp.WRITE: byte << 1 | 1, I2cOp.READ: 0x1FE, I2cOp.LAST: 0x1FF}
            bits = [words[op] >> 8 - k & 1 for k in range(9)] if op in words else [int(op == I2cOp.START)]
            for left, level in zip(range(len(bits))[::-1], bits, strict=True):
                end = {I2cOp.START: 0, I2cOp.STOP: 1}.get(op, level)
                waves = [(clock, data), (clock, level), (1, level), (1, end)]
                for k in range(4 * quarter):
                    # the chip's bit stands two flip-flops before the end of the third quarter, its inverse else
                    ctx.set(pins.sda, (sent >> left & 1) ^ (k != 3 * quarter - 3))
                    await cycle(ctx, *waves[k // quarter], 0, left == 0 and k == 4 * quarter - 1)
                clock, data = int(op == I2cOp.STOP), end
            if len(bits) == 9:
                expected.append((sent >> 1, 1 - sent & 1))
                seen.append((ctx.get(dut.heard), ctx.get(dut.acknowledged)))

    simulate(dut, play)
    assert seen == expected
