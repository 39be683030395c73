"""The engine and the classifier behind it, bit for bit against golden cells, and their cycles against the
schedule."""

import numpy as np
import pytest
from amaranth.hdl import Fragment, Module
from amaranth.lib import wiring

from eskin.golden.core import PRESETS, AcceleratorConfig, QFormat, narrow
from eskin.golden.model import IntegerModel
from eskin.golden.model.pipeline import decide
from eskin.rtl.decision.classifier import Classifier
from eskin.rtl.engine.engine import Engine
from eskin.rtl.engine.forest import ForestEngine
from eskin.rtl.engine.window_queue import WindowQueue
from eskin.rtl.program.memory_map import memory_images
from eskin.rtl.program.schedule import decision_cycles, step_cycles
from tests.support.random_models import random_integer_model
from tests.support.stream_bench import Bench, put, simulate, values


class EngineBench(wiring.Component):
    """Engine and classifier wired as in the accelerator."""

    def __init__(self, config: AcceleratorConfig, images) -> None:
        engine = ForestEngine if config.is_forest else Engine
        self.engine, self.classifier = engine(config, images), Classifier(config)
        # there constants share a memory with partial sums
        self.platform = "ecp5" if config.hardware.lanes > 2 else None
        super().__init__(
            {
                "i": self.engine.signature.members["i"],
                "o": self.classifier.signature.members["o"],
                "finish": wiring.In(1),
            }
        )

    def elaborate(self, platform):
        m = Module()
        engine, classifier = self.engine, self.classifier
        m.submodules.engine, m.submodules.classifier = Fragment.get(engine, self.platform), classifier
        wiring.connect(m, wiring.flipped(self.i), engine.i)
        wiring.connect(m, classifier.o, wiring.flipped(self.o))
        m.d.comb += [
            classifier.logit.eq(engine.logit),
            engine.decider_idle.eq(classifier.idle),
            classifier.finish.eq(self.finish),
        ]
        return m


def small(cell: str, reset: str, lanes: int, **changes) -> AcceleratorConfig:
    """A small configuration of a cell: 5 taxels, 6 hidden, 3 classes, 3 steps."""
    sizes = {"taxels": 5, "lanes": lanes, "steps": 3, "hop": 4, "window": 8, "touch_frames": 64} | changes
    thesis = PRESETS["thesis"].replace(name="small", hidden=6, pretrigger_frames=4)
    return thesis.replace(cell=cell, reset=reset, state_format=QFormat(4, 12), loadable=False, **sizes)


def windows(config: AcceleratorConfig, touches: int, seed: int) -> np.ndarray:
    """Centred sums (touches, steps, D): mostly in the range of the scale, some at the ends."""
    rng = np.random.default_rng(seed)
    sums = rng.normal(0, 900, (touches, config.windows.steps, config.inputs)).astype(np.int64)
    extreme = rng.random(sums.shape) < 0.1
    return np.where(extreme, rng.choice([-32768, 32767, 0], sums.shape), sums).clip(-32768, 32767)


def beats(config: AcceleratorConfig, centred: np.ndarray) -> list[dict]:
    """Stream beats of windows."""
    last = config.inputs - 1
    return [
        {
            "value": int(value),
            "length": config.length_index[step],
            "first": int(k == 0),
            "last": int(k == last),
            "final": int(step == config.windows.steps - 1),
        }
        for touch in centred
        for step, window in enumerate(touch)
        for k, value in enumerate(window)
    ]


def expected(model: IntegerModel, centred: np.ndarray):
    """Feature, state and logit codes, flat, and (is_global, step, class, margin) rows."""
    config = model.config
    scale = model.arrays["scale"][list(config.length_index)]
    scale = scale[None, :, list(config.input_constants)] if config.constants > 1 else scale[None, :, None]
    features = narrow(centred * scale, config.formats.gate_frac, config.formats.feature_format)
    hidden, logits = model.forward(features)
    last, rows = config.windows.steps - 1, []
    local, margin, overall, lead = decide(config, logits, np.full(len(logits), last + 1))
    for touch, (label, ahead) in enumerate(zip(overall.tolist(), lead.tolist(), strict=True)):
        pairs = zip(local[touch].tolist(), margin[touch].tolist(), strict=True)
        rows += [*((0, step, *pair) for step, pair in enumerate(pairs)), (1, last, label, ahead)]
    return features.reshape(-1).tolist(), hidden.reshape(-1).tolist(), logits.reshape(-1).tolist(), rows


def run(model: IntegerModel, centred: np.ndarray, *, stall: float = 0.0, seed: int = 0):
    """Simulate; returns streams as `expected`, decision cycles, start cycles and step cycles."""
    config = model.config
    dut = EngineBench(config, memory_images(config, model.arrays))
    bench = Bench(dut, seed=seed, quiet=500 + step_cycles(config), max_cycles=60_000)
    engine = dut.engine
    seen = {"feature": [], "state": [], "logit": [], "started": [], "step": []}
    bench.drive(dut.i, beats(config, centred), stall=stall)
    decisions = bench.collect(dut.o, stall=stall)

    async def monitor(ctx):
        ports = {name: getattr(engine, name) for name in ("logit", "feature", "state", "step")}
        taps = [signal for port in ports.values() for signal in (port.valid, port.value)]
        status, was_busy = engine.status, 0
        ticks = ctx.tick().sample(
            engine.started, engine.check_failed, engine.busy, status.windows_open, *taps
        )
        async for _, _, started, wrong, busy, is_open, *now in ticks:
            assert not wrong, "every word is the image's"
            assert was_busy >= started and is_open >= now[0], "a window waits, a step is open"
            was_busy = busy
            for name, valid, value in zip(ports, now[::2], now[1::2], strict=True):
                if valid:
                    seen[name].append(int(value))
            if started:
                seen["started"].append(bench.cycle)

    bench._sim.add_testbench(monitor, background=True)
    bench.run()
    rows = [(d["is_global"], d["step"], d["class"], d["margin"]) for d in values(decisions)]
    return seen, rows, decisions


@pytest.mark.parametrize(
    "cell, reset, lanes, decision, lane_type",
    [
        ("gru", "before", 1, "vote", "plain"),
        ("lstm", "before", 2, "last", "plain"),
        ("gru", "after", 4, "last", "plain"),
        ("lstm", "before", 4, "vote", "plain"),
        ("gru", "after", 4, "vote", "dsp"),
        ("lstm", "before", 1, "vote", "dsp"),
        ("gru", "before", 2, "vote", "dsp"),
    ],
)
def test_bit_exact_in_the_schedule(cell, reset, lanes, decision, lane_type):
    check_exact_and_cycles(small(cell, reset, lanes, decision=decision, lane_type=lane_type), touches=3)


def check_exact(model: IntegerModel, centred: np.ndarray, **options):
    """Every stream equals the golden cell's; those that were seen, and the decisions."""
    seen, got_rows, decisions = run(model, centred, **options)
    assert (seen["feature"], seen["state"], seen["logit"], got_rows) == expected(model, centred)
    return seen, decisions


def check_exact_and_cycles(config: AcceleratorConfig, touches: int) -> None:
    """And every step and decision takes the schedule's cycles."""
    model = random_integer_model(config, seed=7 + config.hardware.lanes)
    config = model.config
    seen, decisions = check_exact(model, windows(config, touches=touches, seed=config.hardware.lanes))
    local = [d.cycle for d in decisions if not d.value["is_global"]]
    assert [d - s for d, s in zip(local, seen["started"], strict=True)] == [decision_cycles(config)] * len(
        local
    )
    assert set(seen["step"]) == {step_cycles(config)}


@pytest.mark.parametrize("lanes", [3, 12])
def test_bit_exact_with_stalls(lanes):
    config = small("gru", "before", lanes, hidden=12, taxels=16)
    model = random_integer_model(config, seed=lanes)
    check_exact(model, windows(model.config, touches=2, seed=lanes), stall=0.3, seed=lanes)


def test_the_largest_sum_of_a_row_keeps_its_sign():
    model = random_integer_model(small("gru", "before", 1, taxels=16), seed=1)
    for name in ("W_z", "W_r", "W_n"):
        model.arrays[name] = np.full_like(model.arrays[name], -128)
    check_exact(model, np.full((1, 3, 16), -32768))


def test_a_window_in_its_buffer_has_its_own_flags():
    whole = dict(window_mode="whole", decision="last")
    dut, windows = WindowQueue(small("gru", "before", 3, **whole), 3), [(0, 1), (1, 0)]

    async def bench(ctx):
        for partial, final in windows:
            put(ctx, dut.i, valid=1, payload={"last": 1, "partial": partial, "final": final})
            await ctx.tick().until(dut.i.ready)
        for window in windows:
            assert (ctx.get(dut.partial), ctx.get(dut.final)) == window
            put(ctx, dut, released=1)
            await ctx.tick()

    simulate(dut, bench)


def test_a_step_is_open_from_its_start_to_its_end():
    dut, seen = WindowQueue(small("gru", "before", 3), 3), []

    async def bench(ctx):
        for started, done in ((0, 0), (1, 0), (0, 0), (0, 1), (0, 0)):
            put(ctx, dut, started=started, step_done=done)
            seen.append((ctx.get(dut.computing), ctx.get(dut.open)))
            await ctx.tick()

    simulate(dut, bench)
    assert seen == [(0, 0), (0, 0), (1, 1), (1, 1), (0, 0)]
