"""The element-wise unit: its operand holds every difference, its result stays within the states' bound, its
sum never overflows."""

from amaranth.hdl import Const, Module, Mux, Signal, signed

from eskin.golden.core import PRESETS, QFormat, tanh_table
from eskin.rtl.engine.elementwise import ElementwiseUnit
from eskin.rtl.program.schedule import schedule
from formal.proof import Bug, assume, free, proof, prove


def _unit(m: Module, config) -> ElementwiseUnit:
    dut = ElementwiseUnit(config, schedule(config))
    m.submodules.dut = dut
    free(dut.s, dut.not_t, dut.x, dut.use_t, dut.minus, dut.add, dut.acc, dut.feature, dut.tick)
    return dut


def _operand(m: Module, config) -> None:
    dut = _unit(m, config)
    largest = int(tanh_table(config).max())
    t = Signal(signed(17), name="t_value")
    m.d.comb += t.eq(~dut.not_t)
    within = lambda value: (value <= largest) & (value >= -largest)
    # states are tanh values or blends of them; a centred sum comes with zeros (microcode: window, state_zero,
    # t_zero)
    assume(within(t) & Mux(dut.minus | dut.use_t, within(dut.s), 1))
    assume((dut.x == 0) | ((dut.s == 0) & (~dut.use_t & (~dut.minus | (t == 0)))))
    exact = Signal(signed(20))
    m.d.comb += exact.eq(dut.x + Mux(dut.use_t, t, dut.s) - Mux(dut.minus, t, 0))
    prove(dut.a == exact, "the operand is the exact difference")


@proof(
    "the element-wise operand is S, T, S - T or the centred sum exactly, for every state that the tanh "
    "table allows",
    depth=1,
    reduced="none, preset thesis",
    quick=True,
    bugs=(
        Bug(
            "the complement's one is forgotten",
            "Mux(self.minus, self.not_t, -1) + 1)",
            "Mux(self.minus, self.not_t, -1))",
        ),
    ),
)
def operand_is_exact(m: Module) -> None:
    _operand(m, PRESETS["thesis"])


WIDEST = PRESETS["thesis"].replace(
    state_format=QFormat(2, 14),
    weight_format=QFormat(1, 7),
    recurrent_format=QFormat(3, 5),
    feature_format=QFormat(3, 8),
)


@proof(
    "the same for the finest states, SQ(2,14)",
    depth=1,
    reduced="none, preset thesis with finer states",
    bugs=(
        Bug(
            "an operand a bit too narrow",
            "difference = Signal(signed(16))",
            "difference = Signal(signed(15))",
        ),
    ),
)
def operand_is_exact_finest(m: Module) -> None:
    _operand(m, WIDEST)


NARROW = PRESETS["thesis"].replace(
    state_format=QFormat(2, 4),
    gate_frac=4,
    table_entries=64,
    feature_format=QFormat(4, 4),
    weight_format=QFormat(3, 5),
    recurrent_format=QFormat(3, 5),
    bias_format=QFormat(3, 5),
    logit_format=QFormat(4, 4),
    dense_bias_format=QFormat(3, 5),
)


@proof(
    "a blend h + z (n - h) of states within the tanh table's bound stays within it, after rounding; its sum "
    "fits the accumulator",
    depth=1,
    reduced="states SQ(2,4), gates of 4 fraction bits",
    bugs=(Bug("T is not added", "Mux(self.add, ~self.not_t, 0)", "0"),),
)
def blend_stays_in_bound(m: Module) -> None:
    config = NARROW
    dut = _unit(m, config)
    largest, z = int(tanh_table(config).max()), Signal(range(config.gate_one + 1), name="z")
    free(z)
    n = Signal(signed(10))
    m.d.comb += n.eq(~dut.not_t)
    assume(
        (n <= largest) & (n >= -largest) & (dut.s <= largest) & (dut.s >= -largest) & (z <= config.gate_one)
    )
    assume((dut.x == 0) & ~dut.use_t & dut.minus & dut.add & ~dut.feature)
    total = Signal(signed(40))
    m.d.comb += total.eq(dut.load + dut.a * z)
    assume(dut.acc == total)
    limit = 1 << config.elementwise_bits - 1
    prove((total < limit) & (total >= -limit), "the sum fits")
    prove((dut.result <= largest) & (dut.result >= -largest), "the new state is within the bound")
    half = 1 << config.formats.gate_frac - 1
    prove(
        dut.result == (dut.s * z + n * (config.gate_one - z) + half) >> config.formats.gate_frac,
        "it is the blend, rounded half up",
    )


@proof(
    "a finished sum is narrowed exactly, a feature saturated to its format and aligned, a state to its own; "
    "where a cell's states never "
    "saturate, exactly for every sum that its format holds",
    depth=1,
    reduced="states SQ(2,4), gates of 4 fraction bits; a GRU and an LSTM",
    quick=True,
    bugs=(
        Bug(
            "a state that may saturate is taken for one that may not",
            "all(op.between for op in states)",
            "any(op.between for op in states)",
        ),
        Bug(
            "WRAP instead of SAT",
            "self.code.eq(saturate(shifted, config.formats.feature_format))",
            "self.code.eq(shifted)",
        ),
    ),
)
def narrowed(m: Module) -> None:
    for cell in ("gru", "lstm"):
        config = NARROW.replace(cell=cell)
        dut = ElementwiseUnit(config, schedule(config))
        m.submodules[cell] = dut
        free(dut.acc)
        free(dut.feature)
        exact = Signal(signed(len(dut.acc)), name=f"exact_{cell}")
        m.d.comb += exact.eq(dut.acc >> config.formats.gate_frac)

        def saturated(fmt: QFormat, exact: Signal = exact):
            return Mux(exact > fmt.max_code, fmt.max_code, Mux(exact < fmt.min_code, fmt.min_code, exact))

        state, feature = saturated(config.formats.state_format), saturated(config.formats.feature_format)
        held = (exact == state) if cell == "gru" else Const(1)
        prove(~dut.feature | (dut.result == feature << config.feature_align), f"features of the {cell}")
        prove(dut.feature | ~held | (dut.result == state), f"states of the {cell}")
