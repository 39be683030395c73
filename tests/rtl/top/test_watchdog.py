"""The watchdog: it acts at its bound and not before, never on a chain that works, and its bound covers the
longest wait there is."""

import pytest
from amaranth.hdl import EnableInserter, ResetInserter, Signal

from eskin.golden.core import PRESETS, AcceleratorConfig
from eskin.rtl.program.memory_map import Control, Fault, Register, load_writes
from eskin.rtl.top import accelerator
from eskin.rtl.top.accelerator import Accelerator
from eskin.rtl.top.watchdog import Watchdog, bound, longest_wait
from tests.rtl.engine.test_engine import small
from tests.rtl.engine.test_forest import forest
from tests.rtl.engine.test_memory_check import touch_data
from tests.rtl.top.test_accelerator import CONFIGS, SEED, Host, check, play, recordings
from tests.support.random_models import random_integer_model
from tests.support.stream_bench import Bench, give_frame, put
from tests.support.table import each_row


def test_it_acts_at_the_bound_and_counts_anew_after_progress():
    config = CONFIGS["thesis"].replace(watchdog=True)
    limit = bound(config)
    assert limit > longest_wait(config) and limit & (limit - 1) == 0
    dut = Watchdog(config)
    bench = Bench(dut, max_cycles=20 * limit)
    acts = bench.watch(dut.hung)

    async def drive(ctx):
        for due, done, cycles in (
            (1, 0, limit - 1),
            (1, 1, 1),
            (1, 0, limit - 1),
            (0, 0, 1),
            (1, 0, limit),
            (1, 0, limit + 2),
            (0, 0, 2),
        ):
            put(ctx, dut, due=due, done=done)
            for _ in range(cycles):
                await ctx.tick()

    bench.process(drive)
    bench.run()
    assert acts == [3 * limit, 4 * limit + 1], "the counter starts anew in the cycle in which it acts"


@pytest.mark.parametrize("name", ["thesis", pytest.param("two windows end together", marks=pytest.mark.slow)])
def test_the_longest_wait_of_a_chain_that_works_is_within_what_is_said(name):
    """Full pace, random stalls on both sides, the end of the recording in a touch: the counter stays below
    ``longest_wait``."""
    config = CONFIGS[name].replace(watchdog=True, checksum=True)
    model = random_integer_model(config, seed=3)
    data = recordings(config, SEED, [150, 60, 33])
    longest = [0]

    def prepare(bench):
        async def measure(ctx):
            waited, watching = 0, bench.dut.watching
            async for _, _, due, done in ctx.tick().sample(watching.due, watching.done):
                waited = waited + 1 if due and not done else 0
                longest[0] = max(longest[0], waited)

        bench._sim.add_testbench(measure, background=True)

    streams, statuses = play(model, data, stall=0.3, prepare=prepare)
    check(model, data, streams)
    assert 20 < longest[0] <= longest_wait(config)
    assert not any(status[1] & (Fault.WATCHDOG | Fault.CHECKSUM) for status in statuses)


def test_reset_once_after_a_touch(monkeypatch):
    """At a pace at which the engine waits between the steps, and is not yet through its prologue when the
    decision is taken."""
    resets = []
    monkeypatch.setattr(accelerator, "ResetInserter", lambda when: resets.append(when) or ResetInserter(when))
    config = CONFIGS["thesis"].replace(watchdog=True)
    model = random_integer_model(config, seed=1)
    data = touch_data(config, 66)
    arms, rests = [], []

    def prepare(bench):
        async def watch(ctx):
            async for _, _, front_end, engine, classifier in ctx.tick().sample(*resets):
                if front_end:
                    arms.append(bench.cycle)
                elif classifier:
                    assert engine
                    rests.append(bench.cycle)

        bench._sim.add_testbench(watch, background=True)

    beats = play(model, data, frame_cycles=80, prepare=prepare)[0]["beats"]
    steps, ends = ([beat.cycle for beat in beats if beat.value["is_global"] == which] for which in (0, 1))
    assert len(steps) == config.windows.steps and len(ends) == len(arms) == len(rests) == 1
    assert arms[0] < steps[0] and ends[0] + 1 < rests[0], "the engine was not busy: nothing had to wait"


def test_what_stands_still_is_found(monkeypatch):
    """Either alone, while nothing else is due: no frame is offered, and the other part has or gets nothing to
    do."""
    runs, parts = Signal(3, init=7), []

    def stopped(when):
        def insert(part):
            parts.append(part)
            return ResetInserter(when)(EnableInserter(runs[len(parts) - 1])(part))

        return insert

    monkeypatch.setattr(accelerator, "ResetInserter", stopped)
    config = CONFIGS["thesis"].replace(watchdog=True)
    model = random_integer_model(config, seed=1)
    data = touch_data(config, 66)
    bench = Bench(Accelerator(model.config), max_cycles=100_000)
    dut, flags = bench.dut, []
    bench.collect(dut.o)

    async def drive(ctx):
        host = Host(dut, ctx)
        for register, word in load_writes(model.config, model.arrays):
            await host.write(register, word)
        _, engine, classifier = parts
        for busy, going in (((True, False), 0b101), ((True, True), 0b011)):
            await host.write(Register.CONTROL, Control.ARM)
            await ctx.tick()
            frames = iter(data.recording(0))
            while ctx.get(runs) == 7:
                await give_frame(ctx, dut.i, next(frames))
                for _ in range(80):
                    await ctx.tick()
                    if (ctx.get(engine.status.working), not ctx.get(classifier.idle)) == busy:
                        ctx.set(runs, going)
                        break
            await ctx.tick().repeat(2 * bound(config))
            flags.append(await host.read(Register.FAULTS))
            ctx.set(runs, 7)
            await host.write(Register.CONTROL, Control.CLEAR_FAULTS)

    bench.process(drive)
    bench.run()
    assert flags == [Fault.WATCHDOG] * 2


@each_row(
    "config, wait",
    [
        (small("gru", "before", 2, window_mode="whole", decision="last"), 721),
        (PRESETS["pvdf"].with_readout(readout="prototypes", taught=2), 4864),
        (forest(), 672),
        (AcceleratorConfig.of_image(4, 32, ["conv 3 2", "dense 2"], ("a", "b")), 1482),
    ],
)
def test_the_longest_wait_of_every_kind_of_design(config, wait):
    """Figures by docs/specification_interfaces.md, section 11."""
    assert longest_wait(config) == wait


def test_the_bound_is_short_against_a_frame_of_the_presets():
    """Nobody waits long: less than two frames of the sensor, at the clock the presets name."""
    for name in ("thesis", "pvdf"):
        config = PRESETS[name]
        assert bound(config) < 3 * config.hardware.clock_hz / config.sensor.sample_rate_hz
