"""The plain lane: exact products at the ends of the formats, first and load, two accumulators, latency."""

from __future__ import annotations

import random

from amaranth.sim import Simulator
from hypothesis import given, settings
from hypothesis import strategies as st

from rtl.lanes import PlainLane, SerialLane


def test_two_accumulators_take_turns_and_hold_exact_sums():
    rng = random.Random(5)
    dut = PlainLane(16, 16, (36, 40))
    ends = [-(1 << 15), (1 << 15) - 1, 0, -1]
    operations = [
        (
            rng.choice([*ends, rng.randint(*ends[:2])]), rng.choice([*ends, rng.randint(*ends[:2])]), rng.random() < 0.2,
            rng.randint(-(2**30), 2**30), rng.choice([0, 1, 2]),
        )
        for _ in range(500)
    ]  # fmt: skip
    operations[:2] = [(3, 4, True, 100, 1), (5, 6, True, -7, 2)]
    acc, expected = [0, 0], []
    for a, b, first, load, valid in operations:
        for k in range(2):
            if valid >> k & 1:
                acc[k] = (load if first else acc[k]) + a * b
        expected.append(tuple(acc))
    seen = []

    async def bench(ctx):
        for cycle in range(len(operations) + 2):
            if cycle >= 2:  # latency 2: the operation of two cycles ago is in
                seen.append((ctx.get(dut.acc.acc0), ctx.get(dut.acc.acc1)))
            a, b, first, load, valid = operations[cycle] if cycle < len(operations) else (0, 0, 0, 0, 0)
            for signal, value in ((dut.tick, 1), (dut.a, a), (dut.b, b), (dut.first, first), (dut.load, load), (dut.valid, valid)):
                ctx.set(signal, value)
            await ctx.tick()

    sim = Simulator(dut)
    sim.add_clock(1e-6)
    sim.add_testbench(bench)
    sim.run()
    assert seen == expected


@settings(max_examples=30, derandomize=True, deadline=None)
@given(
    products=st.lists(
        st.tuples(st.integers(-32768, 32767), st.integers(-128, 127), st.booleans(), st.booleans()), min_size=1, max_size=12
    ),
    load=st.integers(-1000, 1000),
)
def test_serial_lane_adds_the_same_products(products, load):
    """Slot by slot against plain arithmetic, stable over the whole slot; a slot without a product changes nothing."""
    dut, slot = SerialLane(16, 8, (30,)), 8
    acc, expected = 0, []
    for a, b, first, valid in products:
        acc = (load if first else acc) + a * b if valid else acc
        expected.append({acc})
    seen = []

    async def bench(ctx):
        for number in range(len(products) + 2):
            held = set()
            a, b, first, valid = products[number] if number < len(products) else (0, 0, 0, 0)
            for signal, value in ((dut.a, a), (dut.b, b), (dut.first, first), (dut.load, load), (dut.valid, valid)):
                ctx.set(signal, value)
            for cycle in range(slot):
                ctx.set(dut.tick, cycle == slot - 1)
                held.add(ctx.get(dut.acc.acc0))
                await ctx.tick()
            seen.append(held)

    sim = Simulator(dut)
    sim.add_clock(1e-6)
    sim.add_testbench(bench)
    sim.run()
    assert seen[2:] == expected  # taken at the end of slot n, worked on in n + 1, held during n + 2
