"""rtl/engine/lanes.py: a plain lane's sum is its loads and products, at the ends of every format."""

import random

from amaranth.hdl import signed

from eskin.rtl.engine.lanes import PlainLane, lane_signature
from tests.support.stream_bench import put, simulate, unpack
from tests.support.table import each_row


@each_row("with_operands", [False, True])
@each_row("accumulates", [False, True])
def test_a_sum_is_its_loads_and_products(with_operands, accumulates):
    rng, widths = random.Random(5), (5, 4, 12)
    dut = PlainLane(lane_signature(*widths, load_with_operands=with_operands, accumulates=accumulates))
    seen, expected = [], []

    async def play(ctx):
        before, total = (0, 0, 0), 0
        for _ in range(400):
            a, b, load = (rng.choice([-1 << n - 1, (1 << n - 1) - 1, rng.getrandbits(n - 1)]) for n in widths)
            tick, valid, swap = rng.choices([0, 1], [1, 2], k=3)
            put(ctx, dut, tick=tick, valid=valid, swap=swap, a=a, b=b, load=load)
            if tick:
                product, counts, load_before = before
                base = load_before if with_operands else load
                if counts or swap:
                    total = (base if swap or not accumulates else total) + product
                before = a * b * valid, valid, load
            await ctx.tick()
            seen.append(ctx.get(dut.acc))
            expected.append(unpack(signed(widths[2]), total))

    simulate(dut, play)
    assert seen == expected
