"""rtl/engine/lanes.py: a plain lane's sum is its loads and products, at the ends of every format."""

import random

from eskin.rtl.engine.lanes import PlainLane, lane_signature
from tests.support.stream_bench import Bench, put, unpack
from tests.support.table import each_row


@each_row("with_operands", [False, True])
@each_row("accumulates", [False, True])
def test_a_sum_is_its_loads_and_products(with_operands, accumulates):
    rng, bits = random.Random(5), {"a": 5, "b": 4, "load": 12}
    dut = PlainLane(lane_signature(*bits.values(), load_with_operands=with_operands, accumulates=accumulates))
    bench, seen, expected = Bench(dut), [], []

    async def play(ctx):
        product = load = total = 0
        counts = False
        await ctx.tick()
        for slot in range(400):
            values = {
                name: rng.choice([-1 << n - 1, (1 << n - 1) - 1, rng.randrange(-1 << n - 1, 1 << n - 1)])
                for name, n in bits.items()
            }
            tick, valid, swap = rng.random() < 0.8, rng.random() < 0.7, slot == 0 or rng.random() < 0.3
            put(ctx, dut, tick=tick, valid=valid, swap=swap, **values)
            if tick:
                start = load if with_operands else values["load"]
                if counts or swap:
                    total = (start if swap or not accumulates else total) + product
                counts, load = valid, values["load"]
                product = values["a"] * values["b"] if valid else 0
            await ctx.tick()
            seen.append(ctx.get(dut.acc))
            expected.append(unpack(dut.acc.shape(), total))

    bench.process(play)
    bench.run()
    assert seen == expected
