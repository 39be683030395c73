"""A product in digits of 4 is the product: every operand of small widths, and the lanes' widths at random and
at their ends."""

import random

from amaranth.hdl import Module, Signal, signed

from eskin.rtl.engine.recoded_product import sum_with_product
from tests.support.stream_bench import simulate
from tests.support.table import each_row


@each_row("a_bits, b_bits, bits", [(16, 8, 28), (12, 7, 30), (4, 6, 12)])
def test_products_of_the_lanes_widths(a_bits, b_bits, bits):
    rng, m = random.Random(2), Module()
    operands = a, b, base = [Signal(signed(width)) for width in (a_bits, b_bits, bits)]
    total = Signal(signed(40))
    m.d.comb += total.eq(sum_with_product(base, a, b))

    async def play(ctx):
        for _ in range(600):
            for signal in operands:
                least = -(1 << len(signal) - 1)
                some = rng.randrange(least, -least)
                ctx.set(signal, rng.choice([least, ~least, 0, -1, 1, some, some]))
            assert ctx.get(total) == ctx.get(base) + ctx.get(a) * ctx.get(b)

    simulate(m, play)
