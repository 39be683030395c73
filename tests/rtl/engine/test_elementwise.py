"""Around the multiplier of element-wise operations alone: operands, the start of a sum, narrowed
results, table index."""

import random
from itertools import product

from eskin.golden.core import PRESETS, QFormat, clamp, narrow, tanh_table
from eskin.rtl.engine.elementwise import ElementwiseUnit
from eskin.rtl.program.schedule import schedule
from tests.support.stream_bench import simulate
from tests.support.table import each_row

CASES = {
    "aligned": {},
    "the finest states": {
        "state_format": QFormat(2, 14),
        "weight_format": QFormat(1, 7),
        "recurrent_format": QFormat(3, 5),
        "feature_format": QFormat(3, 8),
    },
    "features wider than states": {"state_format": QFormat(2, 8)},
    "features narrower than states": {"state_format": QFormat(6, 8)},
    "on the one lane": {"lanes": 1, "lane_type": "dsp"},
    "cell state": {"cell": "lstm", "state_format": QFormat(4, 12)},
    "a cell state that saturates before features": {
        "cell": "lstm",
        "table_entries": 1024,
        "state_format": QFormat(4, 8),
        "feature_format": QFormat(6, 8),
    },
    "an index with one fraction bit less than a state": {
        "cell": "lstm",
        "table_entries": 1024,
        "state_format": QFormat(4, 8),
    },
}


@each_row("changes", CASES.values())
def test_equal_to_the_formulas(changes):
    config = PRESETS["thesis"].replace(**changes)
    plan, rng = schedule(config), random.Random(1)
    dut = ElementwiseUnit(config, plan)
    state = config.formats.state_format
    # states need no saturation
    keeps = all(op.between for op in plan.program.elements if op.state and op.state != "x")
    half = 0 if plan.shared else 1 << config.formats.gate_frac - 1
    bound = int(tanh_table(config).max()) if keeps else state.max_code >> 1  # of a difference's states

    def drawn(bits: int) -> int:
        low, high = -(1 << bits - 1), (1 << bits - 1) - 1
        return rng.choice(
            [low, high, 0, -1, rng.randint(low, high), rng.randint(low >> bits // 2, high >> bits // 2)]
        )

    async def bench(ctx):
        for _, centred, feature, use_t, minus, add, tick in product(range(8), *6 * [(False, True)]):
            s, t, x = drawn(state.width), drawn(state.width), drawn(config.centred_format.width)
            if centred:
                s = use_t = minus = 0
            else:
                s, t = (rng.choice([-bound, bound, rng.randint(-bound, bound)]) for _ in range(2))
                x = 0
            acc = drawn(config.elementwise_bits)
            if keeps and not feature:
                acc = drawn(state.width) << config.formats.gate_frac | rng.randrange(
                    1 << config.formats.gate_frac
                )
            given = {
                "s": s,
                "not_t": ~t,
                "x": x,
                "use_t": use_t,
                "minus": minus,
                "add": add,
                "acc": acc,
                "feature": feature,
                "tick": tick,
            }
            for name, value in given.items():
                ctx.set(getattr(dut, name), value)
            floor = acc >> config.formats.gate_frac
            code, clamped = clamp(floor, config.formats.feature_format), clamp(floor, state)
            assert ctx.get(dut.a) == (x if centred else (t if use_t else s) - (t if minus else 0))
            assert ctx.get(dut.load) == half + ((t if add else 0) << config.formats.gate_frac)
            assert ctx.get(dut.code) == code
            assert ctx.get(dut.result) == (code << config.feature_align if feature else clamped)
            before = ctx.get(dut.index)
            await ctx.tick()
            if config.state_index_shift > 0:
                assert ctx.get(dut.index) == (
                    narrow(clamped, config.state_index_shift, config.index_format) if tick else before
                )

    simulate(dut, bench)


def test_a_blend_of_states_stays_within_the_largest_of_tanh():
    """Every two states of narrow formats with every gate, by section 8's rounding: no state needs saturation."""
    config = PRESETS["thesis"].replace(
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
    largest, unit = int(tanh_table(config).max()), config.gate_one
    states = range(-largest, largest + 1)
    for s, n, z in product(states, states, range(unit + 1)):
        assert abs(narrow((n << 4) + (s - n) * z, 4, config.formats.state_format)) <= largest
