"""A product in digits of 4 is the product: every operand of small widths, and the lanes' widths at random and
at their ends."""

import random

from amaranth.hdl import Module, Signal, signed

from eskin.rtl.engine.recoded_product import sum_with_product
from tests.support.stream_bench import simulate
from tests.support.table import each_row


def sums(a_bits: int, b_bits: int, bits: int, cases) -> list[int]:
    m = Module()
    a, b = Signal(signed(a_bits)), Signal(signed(b_bits))
    base, total = Signal(signed(bits)), Signal(signed(bits))
    m.d.comb += total.eq(sum_with_product(base, a, b))
    found = []

    async def play(ctx):
        for case in cases:
            for signal, value in zip((a, b, base), case, strict=True):
                ctx.set(signal, value)
            found.append(ctx.get(total))

    simulate(m, play)
    return found


def wrapped(value: int, bits: int) -> int:
    return (value + (1 << bits - 1)) % (1 << bits) - (1 << bits - 1)


def of_bits(bits: int) -> range:
    return range(-(1 << bits - 1), 1 << bits - 1)


@each_row("a_bits, b_bits, bits", [(16, 8, 28), (12, 7, 30), (4, 6, 12)])
def test_products_of_the_lanes_widths(a_bits, b_bits, bits):
    rng = random.Random(2)

    def some(width: int) -> int:
        values = of_bits(width)
        return rng.choice([values[0], values[-1], 0, -1, 1, rng.choice(values), rng.choice(values)])

    cases = [(some(a_bits), some(b_bits), some(bits)) for _ in range(600)]
    assert sums(a_bits, b_bits, bits, cases) == [wrapped(base + a * b, bits) for a, b, base in cases]
