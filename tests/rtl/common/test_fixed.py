"""rtl/common/fixed.py against golden/core/formats.py, and the bench against a stage that is known to be right
or wrong."""

import numpy as np
from amaranth.hdl import Module, Signal, signed, unsigned
from hypothesis import given
from hypothesis import strategies as st

from eskin.golden.core import QFormat, formats
from eskin.rtl.common import fixed
from tests.support.strategies import examples
from tests.support.stream_bench import simulate
from tests.support.table import each_row


def evaluate(shape, expression, codes):
    """Results of the combinational ``expression(source)`` for each of ``codes``, and the result's shape."""
    m = Module()
    source = Signal(shape)
    result = expression(source)
    probe = Signal(result.shape())
    m.d.comb += probe.eq(result)
    out = []

    async def bench(ctx):
        for code in codes:
            ctx.set(source, code)
            await ctx.delay(1e-9)
            out.append(ctx.get(probe))

    simulate(m, bench)
    return out, result.shape()


def span(shape):
    width, is_signed = shape.width, shape.signed
    return range(-(1 << width - 1), 1 << width - 1) if is_signed else range(1 << width)


@each_row("source", [signed(8), unsigned(8), signed(3), unsigned(3), signed(1), unsigned(1)])
@each_row(
    "target",
    [
        QFormat(5, 0),
        QFormat(1, 3, False),
        QFormat(8, 0),
        QFormat(12, 0),
        QFormat(8, 0, False),
        QFormat(9, 0, False),
        QFormat(1, 0),
    ],
)
def test_saturate_every_code(source, target):
    codes = list(span(source))
    got, shape = evaluate(source, lambda value: fixed.saturate(value, target), codes)
    assert shape == fixed.shape_of(target)
    assert got == [formats.clamp(code, target) for code in codes]
    assert got == formats.clamp(np.array(codes), target).tolist()


@examples(60, 600)
@given(
    width=st.integers(2, 40),
    shift=st.integers(0, 30),
    bits=st.integers(1, 32),
    is_signed=st.booleans(),
    draw=st.data(),
)
def test_narrow_any_width(width, shift, bits, is_signed, draw):
    target, source = QFormat(bits, 0, is_signed), signed(width)
    low, high = -(1 << width - 1), (1 << width - 1) - 1
    codes = [low, high, 0, -1, *draw.draw(st.lists(st.integers(low, high), max_size=12))]
    got, _ = evaluate(source, lambda value: fixed.narrow(value, shift, target), codes)
    assert got == [formats.narrow(code, shift, target) for code in codes]


@each_row("bound", [1, 2, 7, 100, 127, 128, 500])
def test_clip_every_code(bound):
    codes = list(span(signed(8)))
    got, shape = evaluate(signed(8), lambda value: fixed.clip(value, bound), codes)
    assert shape == signed(formats.signed_bits(bound))
    assert got == [min(max(code, -bound), bound) for code in codes]


@each_row("shift", range(1, 6))
def test_convergent_rounding_takes_ties_to_the_even_code(shift):
    codes = np.arange(-200, 200)
    assert (formats.shift_right(codes, shift, "RND_CONV") == np.rint(codes / 2**shift)).all()


def test_wrapping_keeps_the_low_bits():
    codes = np.arange(-700, 700)
    assert (formats.clamp(codes, QFormat(3, 5), "WRAP") == codes.astype(np.int8)).all()
    assert (formats.clamp(codes, QFormat(3, 5, False), "WRAP") == codes.astype(np.uint8)).all()
