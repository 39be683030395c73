"""A cell that rtl/ does not know, a minimal gated unit, runs on the engine: its program, its golden function,
nothing else."""

import numpy as np

from eskin.golden.core import narrow, sigmoid_table, tanh_table
from eskin.rtl.engine.engine import Engine
from eskin.rtl.program.cells import DENSE, NORMALISE, CellProgram, ElementOp, RowBlock
from eskin.rtl.program.memory_map import memory_images
from eskin.rtl.program.schedule import schedule
from tests.rtl.engine.test_engine import beats, small, windows
from tests.support.stream_bench import Bench
from tests.support.table import each_row

# f = s(W x + U h + b); n = tanh(W x + U (f h) + b); h' = n + f (h - n)
BEFORE = RowBlock("f_before", (("U_f", "h"),), "partial", "f", "b_f", "sigmoid")
F, N = (
    RowBlock("f", (("W_f", "x"),), "sigmoid", "f"),
    RowBlock("n", (("W_n", "x"), ("U_n", "fh")), "tanh", "n", "b_n", "tanh"),
)
FORGET, BLEND = (
    ElementOp("forget", (("S.h", "f"),), state="fh"),
    ElementOp("blend", (("S.h-T.n", "f"),), state="h", add="n"),
)
MGU = CellProgram((BEFORE,), (F, N, DENSE), (NORMALISE, FORGET, BLEND), ("x", "h", "fh"), ("f",), ("n",))


def golden(c, a, centred):
    """Hidden states and logits, flat, from docs/specification.md sections 3 to 5."""
    states, logits = [], []
    for touch in centred:
        h = np.zeros(c.network.hidden, np.int64)
        for step, sums in enumerate(touch):
            x = (
                narrow(sums * a["scale"][c.length_index[step]], c.formats.gate_frac, c.formats.feature_format)
                << c.feature_align
            )
            f_row, n_row = (a[f"W_{gate}"] @ x + (a[f"b_{gate}"] << c.bias_shift) for gate in "fn")
            f = sigmoid_table(c)[
                narrow(f_row + a["U_f"] @ h, c.sigmoid_shift, c.index_format) + c.formats.table_entries // 2
            ]
            fh = narrow(f * h, c.formats.gate_frac, c.formats.state_format)
            n = tanh_table(c)[
                narrow(n_row + a["U_n"] @ fh, c.tanh_shift, c.index_format) + c.formats.table_entries // 2
            ]
            h = narrow(f * h + (c.gate_one - f) * n, c.formats.gate_frac, c.formats.state_format)
            states += h.tolist()
            logits += narrow(
                a["V"] @ h + (a["b_y"] << c.dense_bias_shift), c.logit_shift, c.formats.logit_format
            ).tolist()
    return states, logits


@each_row("lanes, lane_type", [(3, "plain"), (1, "dsp"), (16, "plain")])
def test_a_new_cell_is_a_program_and_a_golden_function(lanes, lane_type):
    config, rng = small("gru", "before", lanes, lane_type=lane_type), np.random.default_rng(lanes)
    h, d, k = config.network.hidden, config.sensor.taxels, config.classes
    shapes = {
        "W_f": (h, d),
        "W_n": (h, d),
        "U_f": (h, h),
        "U_n": (h, h),
        "V": (k, h),
        "b_f": h,
        "b_n": h,
        "b_y": k,
    }
    arrays = {
        name: rng.integers(-60, 60, shape) * (25 if name[0] == "b" else 1) for name, shape in shapes.items()
    }
    arrays |= {
        "scale": rng.integers(2000, 9000, len(config.window_lengths)),
        "mean": np.zeros(len(config.window_lengths), np.int64),
    }
    centred, states, logits, slots = windows(config, touches=3, seed=lanes), [], [], set()
    engine = Engine(config, memory_images(config, arrays, MGU), MGU)
    bench = Bench(engine, quiet=500 + 4 * schedule(config, MGU).step_cycles, max_cycles=60_000)
    bench.drive(engine.i, beats(config, centred))

    async def monitor(ctx):
        ctx.set(engine.decider_idle, 1)
        taps = [part for tap in (engine.state, engine.logit) for part in (tap.valid, tap.value)]
        async for _, _, stored, state, given, logit, done, count in ctx.tick().sample(
            *taps, engine.step.valid, engine.step.value
        ):
            states.extend([state] * stored), logits.extend([logit] * given), slots.update([count] * done)

    bench._sim.add_testbench(monitor, background=True)
    bench.run()
    assert (states, logits) == golden(config, arrays, centred)
    assert slots == {schedule(config, MGU).step_cycles}
