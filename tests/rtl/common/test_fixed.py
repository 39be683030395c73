"""rtl/common/fixed.py against golden/core/formats.py, and the bench against a stage that is known to be right
or wrong."""

import numpy as np
import pytest
from amaranth.hdl import Module, Signal, signed, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out
from hypothesis import given
from hypothesis import strategies as st

from eskin.golden.core import QFormat, formats
from eskin.rtl.common import fixed
from tests.support.strategies import examples
from tests.support.stream_bench import Bench, simulate, values
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


@each_row("shift", range(10))
def test_narrow_every_code(shift):
    target, codes = QFormat(2, 3), list(span(signed(9)))
    got, _ = evaluate(signed(9), lambda value: fixed.narrow(value, shift, target), codes)
    assert got == [formats.narrow(code, shift, target) for code in codes]


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


def test_wrapping_keeps_the_low_bits():
    codes = np.arange(-700, 700)
    assert (formats.clamp(codes, QFormat(3, 5), "WRAP") == codes.astype(np.int8)).all()
    assert (formats.clamp(codes, QFormat(3, 5, False), "WRAP") == codes.astype(np.uint8)).all()


@each_row("shift", range(1, 6))
def test_convergent_rounding_takes_ties_to_the_even_code(shift):
    codes = np.arange(-200, 200)
    assert (formats.shift_right(codes, shift, "RND_CONV") == np.rint(codes / 2**shift)).all()


def test_negative_shift_is_refused():
    with pytest.raises(ValueError, match="not by -1"):
        fixed.round_half_up(Signal(4), -1)


class Negator(wiring.Component):
    """A registered stage; ``fault`` breaks it in one known way."""

    i: In(stream.Signature(data.StructLayout({"value": signed(8), "last": 1})))
    o: Out(stream.Signature(data.StructLayout({"value": signed(9), "last": 1})))

    def __init__(self, fault=""):
        super().__init__()
        self.fault = fault

    def elaborate(self, platform):
        m = Module()
        m.d.comb += self.i.ready.eq(~self.o.valid | self.o.ready)
        with m.If(self.i.ready):
            m.d.sync += [
                self.o.valid.eq(self.i.valid),
                self.o.p.value.eq(-self.i.p.value),
                self.o.p.last.eq(self.i.p.last),
            ]
        if self.fault == "payload":
            m.d.sync += self.o.p.value.eq(self.o.p.value + 1)
        if self.fault == "valid":
            m.d.sync += self.o.valid.eq(self.i.valid)
        if self.fault == "deaf":
            m.d.comb += self.i.ready.eq(0)
        return m


BEATS = [{"value": value, "last": value % 3 == 0} for value in range(-60, 60)]
NEGATED = [{"value": -beat["value"], "last": beat["last"]} for beat in BEATS]


@each_row("stalls", [(0, 0), (0.5, 0), (0, 0.5), (0.4, 0.6)])
def test_bench_moves_every_beat(stalls):
    dut = Negator()
    bench = Bench(dut, seed=5)
    taken = bench.drive(dut.i, BEATS, stall=stalls[0])
    out = bench.collect(dut.o, stall=stalls[1])
    bench.run()
    assert values(out) == NEGATED and len(taken) == len(BEATS)
    if stalls == (0, 0):
        assert [beat.cycle for beat in out] == [cycle + 1 for cycle in taken] and taken == list(
            range(len(BEATS))
        )


@each_row("fault, message", [("payload", "payload changed"), ("valid", "valid fell"), ("deaf", "timeout")])
def test_bench_sees_a_broken_stage(fault, message):
    dut = Negator(fault)
    bench = Bench(dut, seed=5, max_cycles=2000)
    bench.drive(dut.i, BEATS, stall=0.4)
    bench.collect(dut.o, stall=0.6)
    with pytest.raises(AssertionError, match=message):
        bench.run()


def test_bench_refuses_a_value_that_would_wrap():
    dut = Negator()
    with pytest.raises(ValueError, match="payload.value: 128"):
        Bench(dut).drive(dut.i, [{"value": 128, "last": 0}])
