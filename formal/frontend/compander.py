"""The compander: a beat out for each beat in, and the formula exactly."""

from amaranth.hdl import Module, Mux, Signal, signed, unsigned

from eskin.golden.core import PRESETS
from eskin.rtl.frontend.compander import Compander
from formal.proof import Bug, assume, free_sink, free_source, keeps_its_beat, opened_up, proof, prove

CONFIG = PRESETS["thesis"].replace(taxels=4, feature_shift=(4, 9), compand="log")


@proof(
    "each sum leaves once, in order, companded by the formula of docs/specification.md section 3; offers "
    "stay until taken",
    depth=3,
    reduced="4 taxels",
    bugs=(
        Bug(
            "a beat overwrites a waiting one",
            "self.i.ready.eq(~self.o.valid | self.o.ready)",
            "self.i.ready.eq(1)",
        ),
        Bug(
            "the knee is not added",
            "+ is_negative) + (1 << knee)",
            "+ is_negative) + (1 << knee - 1)",
            file="rtl/common/fixed.py",
        ),
    ),
)
def exact_and_in_order(m: Module) -> None:
    dut = Compander(CONFIG)
    inside = opened_up(dut)
    free_source(dut.i)
    free_sink(dut.o)
    keeps_its_beat(dut.o, "o")
    # one register: what was taken last is what is offered, and nothing else ever is
    taken = dut.i.valid & dut.i.ready
    waiting = Signal()
    kept = Signal.like(dut.i.p)
    m.d.sync += waiting.eq(taken | (waiting & ~dut.o.ready))
    with m.If(taken):
        m.d.sync += kept.eq(dut.i.p)
    prove(dut.o.valid == waiting, "offered: what was taken and not handed on")
    prove(
        ~waiting
        | ((dut.o.p.taxel == kept.taxel) & (dut.o.p.length == kept.length) & (dut.o.p.final == kept.final)),
        "its flags",
    )

    knee, fraction, width = CONFIG.features.compand_knee, CONFIG.features.compand_frac, CONFIG.sum_bits
    value = Signal(signed(width + 1))
    m.d.comb += value.eq(~kept.complement)
    b = Signal(unsigned(width + 1))
    m.d.comb += b.eq(Mux(value < 0, -value, value) + (1 << knee))
    result = Signal(signed(width + fraction + 2))
    for e in range(knee, width + 1):
        with m.If((b >> e) == 1):  # 2**e is the largest power of two in b
            size = ((e - knee) << fraction) + ((b << fraction) >> e) - (1 << fraction)
            m.d.comb += result.eq(Mux(value < 0, -size, size))
    # sums are within their bound, which is less than the most negative code
    bound = CONFIG.windows.window * CONFIG.deviation_bound
    assume((~dut.i.p.complement <= bound) & (~dut.i.p.complement >= -bound))
    prove(~waiting | (~dut.o.p.complement == result), "the formula")
    prove(
        ~waiting | (inside.biased == b[:width]) & (inside.negative == (value < 0)) & (inside.passed == kept),
        "registers",
    )
    prove(~waiting | ((value <= bound) & (value >= -bound)), "within the bound")
