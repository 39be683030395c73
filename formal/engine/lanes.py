"""The lane types do the same sums, and no sum that the configuration allows overflows."""

from amaranth.hdl import Module, Mux, Signal, signed

from eskin.golden.core import PRESETS
from eskin.rtl.engine.lanes import PlainLane, lane_signature
from eskin.rtl.engine.sb_mac16 import DspLane
from formal.proof import Bug, assume, free, opened_up, proof, prove

DSP = "rtl/engine/sb_mac16.py"
CONFIG = PRESETS["thesis"]
NARROW = dict(a_bits=5, b_bits=4, acc_bits=12)
NARROWER = "operands of 5 and 4 bits, sums of 12"


INPUTS = ("tick", "a", "b", "swap", "load", "valid")


def _inputs(m: Module, lane) -> None:
    for name in INPUTS:
        free(getattr(lane, name))


def _told_early(m: Module, plain: PlainLane, inside, dsp: DspLane, beside) -> None:
    """The same inputs, but `valid`, which the plain lane wants a slot before the other one."""
    told = Signal()
    _inputs(m, plain)
    for name in INPUTS:
        m.d.comb += getattr(dsp, name).eq(told if name == "valid" else getattr(plain, name))
    with m.If(plain.tick):
        m.d.sync += told.eq(plain.valid)
    prove(inside.counts == told, "told a slot before")
    prove(
        (inside.a == Mux(told, beside.a, 0)) & (inside.b == Mux(told, beside.b, 0)),
        "the same operands where they count",
    )


@proof(
    "the DSP lane's behaviour gives the plain lane's sums, slot by slot, load and product never being in "
    "one slot (the schedule's gap)",
    depth=2,
    reduced=NARROWER,
    quick=True,
    bugs=(
        Bug("the DSP's sum does not begin anew", "with m.If(self.swap):", "with m.If(0):", file=DSP),
        Bug(
            "the plain lane adds without being told",
            "a.eq(Mux(self.valid, self.a, 0)),\n                b.eq(Mux(self.valid, self.b, 0)),",
            "a.eq(self.a),\n                b.eq(self.b),",
        ),
    ),
)
def dsp_is_plain(m: Module) -> None:
    signature = lane_signature(**NARROW, load_with_operands=False)
    plain, dsp = PlainLane(signature), DspLane(signature)
    plain_inside, dsp_inside = opened_up(plain, "plain"), opened_up(dsp, "dsp")
    _told_early(m, plain, plain_inside, dsp, dsp_inside)
    assume(~(dsp.swap & dsp.valid))
    prove(plain.acc == dsp.acc, "the same sum")


@proof(
    "the same on the element-wise lane of a GRU with reset before: one product a sum, on top of what came "
    "with its operands",
    depth=2,
    reduced=NARROWER,
    bugs=(
        Bug(
            "the DSP's load comes a slot late",
            "m.d.sync += total.eq(load + a * b)",
            "m.d.sync += total.eq(self.load + a * b)",
            file=DSP,
        ),
    ),
)
def dsp_is_plain_single_products(m: Module) -> None:
    signature = lane_signature(**NARROW, load_with_operands=True, accumulates=False)
    plain, dsp = PlainLane(signature), DspLane(signature)
    plain_inside, dsp_inside = opened_up(plain, "plain"), opened_up(dsp, "dsp")
    _told_early(m, plain, plain_inside, dsp, dsp_inside)
    assume(~dsp.swap | dsp.valid)  # without a gap they come in the same slot
    prove(plain.acc == dsp.acc, "the same sum")
    prove(plain_inside.load == dsp_inside.load, "the same load")


def _no_overflow(m: Module, a_bits: int, b_bits: int, acc_bits: int, addend: int, terms: int) -> None:
    """A lane of real widths: rows of at most ``terms`` products of any operands and an addend of at most
    ``addend``, in one part or two."""
    lane = PlainLane(lane_signature(a_bits, b_bits, acc_bits, load_with_operands=False))
    inside = opened_up(lane)
    _inputs(m, lane)
    count = Signal(range(terms + 1))
    loaded = Signal(range(terms + 1))  # products in the sum, in the load
    exact = Signal(signed(48))
    largest = 1 << a_bits + b_bits - 2
    # what is loaded is an addend, or the sum of a row's first part, which goes on with as many products as
    # are left to the row
    free(loaded)
    most = Signal(signed(48))
    m.d.comb += most.eq(addend + loaded * largest)
    assume((lane.load <= most) & (lane.load >= -most))
    counts = inside.counts
    assume((loaded + counts <= terms) & (~(lane.tick & counts & ~lane.swap) | (count < terms)))
    adds = lane.tick & (counts | lane.swap)
    with m.If(adds):
        m.d.sync += [
            count.eq(Mux(lane.swap, loaded, count) + counts),
            exact.eq(Mux(lane.swap, lane.load, exact) + inside.a * inside.b),
        ]
    bound = Signal(signed(48))
    m.d.comb += bound.eq(addend + count * largest)
    prove((exact <= bound) & (exact >= -bound), "as large as its products allow")
    prove(count <= terms, "terms")
    prove(counts | (inside.a == 0), "operands that do not count are 0")
    prove(lane.acc == exact, "the sum in the accumulator is the exact one")


HALF = 1 << max(CONFIG.sigmoid_shift, CONFIG.tanh_shift, CONFIG.value_shift) - 1
ADDEND = (CONFIG.formats.bias_format.magnitude << CONFIG.bias_shift) + HALF
TERMS = CONFIG.sensor.taxels + CONFIG.network.hidden


@proof(
    "a row's accumulator never overflows: addend of any bias and half, products of any weights with any "
    "states and features",
    depth=1,
    reduced="none, preset thesis",
    bugs=(
        Bug(
            "an accumulator two bits too narrow",
            "return max(18, signed_bits(self.accumulator_bound))",
            "return max(18, signed_bits(self.accumulator_bound) - 2)",
            file="golden/core/config.py",
            depth=40,
        ),
    ),
)
def row_sums_fit(m: Module) -> None:
    _no_overflow(m, CONFIG.operand_bits, CONFIG.weight_bits, CONFIG.accumulator_bits, ADDEND, TERMS)
