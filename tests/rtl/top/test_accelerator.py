"""The whole chain in Amaranth's simulator on small recordings: every stage against the golden trace, and the
host's view."""

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from amaranth.hdl import Value

from eskin.golden.core import FEATURE_KINDS, PRESETS, AcceleratorConfig
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel, run
from eskin.golden.model.pipeline import DECISION_FIELDS
from eskin.rtl.program.memory_map import (
    ID_VALUE,
    Control,
    Fault,
    Measure,
    Register,
    Status,
    load_writes,
    memory_images,
)
from eskin.rtl.program.schedule import lowest_clock_hz
from eskin.rtl.top.accelerator import Accelerator
from tests.support.random_models import random_integer_model
from tests.support.stream_bench import Bench, bus_accesses, give_frame, unpack, values, write_all

STAGES = ("sum", "fault", "feature", "state", "logit")
COMMON = {"taxels": 5, "hidden": 5, "steps": 4, "sample_bits": 12}


def small(**changes) -> AcceleratorConfig:
    """5 taxels, thesis rules, short touches."""
    sizes = COMMON | {
        "hop": 9,
        "window": 19,
        "touch_frames": 40,
        "pretrigger_frames": 4,
        "band_low": 900,
        "band_high": 1100,
        "rearm_frames": 20,
        "lanes": 2,
        "decision": "vote",
        "clock_hz": 12e6,
    }
    return PRESETS["thesis"].replace(**sizes | changes)


def tracked(**changes) -> AcceleratorConfig:
    """5 taxels, tracked baseline, free-running hops."""
    sizes = COMMON | {
        "hop": 10,
        "window": 20,
        "rest_frames": 8,
        "clip": 60,
        "onset_mean_frames": 16,
        "onset_check_frames": 4,
        "onset_threshold": 12,
        "rearm_frames": 12,
        "lanes": 3,
        "class_names": ("a", "b", "c"),
    }
    return PRESETS["pvdf"].replace(**sizes).replace(**changes)


def recordings(config: AcceleratorConfig, seed: int, lengths: list[int]) -> Recordings:
    """Rest around 1000 codes with bursts, so that there are none, one or several touches; with a fault
    detector a taxel fails in most."""
    rng = np.random.default_rng(seed)
    parts = []
    for length in lengths:
        level = 1000 + rng.integers(-20, 20, config.sensor.taxels)
        samples = level + rng.integers(-3, 4, (length, config.sensor.taxels))
        for start in rng.integers(10, max(11, length), rng.integers(0, 3)):
            samples[start : start + 60] += rng.normal(0, 250, config.sensor.taxels).astype(int)
        if config.faults.fault_frames and length > 50:
            samples[int(rng.integers(length // 2)) :, rng.integers(config.sensor.taxels)] = rng.choice(
                [0, 1004, 4095]
            )
        parts.append(np.clip(samples, 0, 4095))
    rate, names = config.sensor.sample_rate_hz, config.network.class_names
    return Recordings.of(parts, sample_rate_hz=rate, class_names=names, source="made up")


class Host:
    """The bus, from a bench process."""

    def __init__(self, dut, ctx) -> None:
        self.dut, self.ctx = dut, ctx
        self.write, self.read = bus_accesses(ctx, dut.bus)

    async def until_idle(self, limit: int = 20_000) -> None:
        ticks = aiter(self.ctx.tick())
        for _ in range(limit):
            if not self.ctx.get(self.dut.busy):
                return
            await anext(ticks)
        raise AssertionError(f"still busy after {limit} cycles")


def play(
    model: IntegerModel,
    data: Recordings,
    *,
    stall: float = 0.0,
    reader: float = 0.0,
    during=None,
    frame_cycles: float = 0,
    left_off: int = 0,
    begun: Sequence[np.ndarray] = (),
    then: IntegerModel | None = None,
    writes: list[tuple[int, int]] | None = None,
    prepare: Callable[[Bench], None] = lambda bench: None,
):
    """Simulate all recordings; returns streams by stage, under ``beats`` the decisions with their cycles, and
    per-recording status words.

    ``reader``: stalls of decisions alone. ``during(host)`` runs after the first frames. ``frame_cycles``: a frame
    is offered no sooner than so many cycles after the frame before. ``left_off``: so many taxels are missing at the
    end of every recording.

    ``begun``: frames of a recording that ARM ends in its first touch, before all others.
    ``then``: a model of the same design that the host loads after all recordings, which are played again.
    ``writes``: in place of the model's. ``prepare`` adds to the bench before it runs.
    """
    config = model.config
    dut = Accelerator(config, None if config.hardware.loadable else memory_images(config, model.arrays))
    probes = [getattr(dut.probe, stage) for stage in STAGES]
    valid, codes = zip(*((probe.valid, Value.cast(probe.value)) for probe in probes), strict=True)
    bench = Bench(dut, seed=1, quiet=100, max_cycles=400_000)
    rng = np.random.default_rng(2)
    streams = {stage: [] for stage in STAGES}
    statuses = []
    decisions = bench.collect(dut.o, stall=stall or reader)
    bench.stalls[0] |= bool(stall or frame_cycles)

    async def monitor(ctx):
        async for _, _, *sampled in ctx.tick().sample(*valid, *codes):
            for stage, high, bits, probe in zip(
                STAGES, sampled, sampled[len(STAGES) :], probes, strict=False
            ):
                if high:
                    streams[stage].append(unpack(probe.value.shape(), bits))

    async def feed(ctx):
        host = Host(dut, ctx)
        assert await host.read(Register.ID) == ID_VALUE
        await load(ctx, load_writes(config, model.arrays) if writes is None else writes)
        if len(begun):
            await host.write(Register.CONTROL, Control.ARM)
            await ctx.tick()
            for samples in begun:
                await give_frame(ctx, dut.i, samples)
                if await host.read(Register.STATUS) & Status.TOUCH:
                    break
            else:
                raise AssertionError("no touch is open")
            await host.write(Register.CONTROL, Control.ARM)
            await ctx.tick().repeat(9)
            for stream in (*streams.values(), decisions):
                stream.clear()
        await play_all(ctx, host)
        if then is not None:
            await load(ctx, load_writes(config, then.arrays))
            await play_all(ctx, host)

    async def load(ctx, pairs):
        if config.hardware.loadable:
            await write_all(ctx, dut.bus, pairs)

    async def play_all(ctx, host):
        for number in range(len(data)):
            await host.write(Register.CONTROL, Control.ARM | Control.EVERY)
            await ctx.tick()
            begin = bench.cycle
            for frame, samples in enumerate(data.recording(number)):
                early = math.ceil(begin + frame * frame_cycles) - bench.cycle
                if early > 0:
                    await ctx.tick().repeat(early)
                if during is not None and frame == 30:
                    await during(host)
                left = left_off if frame == len(data.recording(number)) - 1 else 0
                pauses = lambda: stall and rng.random() < stall
                await give_frame(ctx, dut.i, samples, pauses, len(samples) - left)
            await host.write(Register.CONTROL, Control.FINISH)
            assert ctx.get(dut.busy)
            await host.write(Register.MEASURE, Measure.STEP)  # which changes nothing of it
            await host.until_idle()
            statuses.append(
                (
                    await host.read(Register.STATUS),
                    await host.read(Register.FAULTS),
                    await host.read(Register.TOUCHES),
                )
            )
            if config.faults.fault_frames:
                words = [
                    await host.read(Register.TAXEL_FAULTS + k) for k in range(-(-config.sensor.taxels // 16))
                ]
                statuses[-1] += (sum(word << 16 * k for k, word in enumerate(words)),)

    bench._sim.add_testbench(monitor, background=True)
    bench.process(feed)
    prepare(bench)
    bench.run()
    streams["decision"] = [[beat[name] for name in DECISION_FIELDS] for beat in values(decisions)]
    streams["beats"] = decisions
    return streams, statuses


def check(model: IntegerModel, data: Recordings, streams) -> None:
    """Equal at every stage, first difference named."""
    trace = run(model, data)
    for stage in (*STAGES, "decision"):
        assert streams[stage] == trace.streams[stage][0].tolist(), stage


FAULTS = {"fault_frames": 16, "fault_activity": 10}
ENDS = {"steps": 5, "hop": 8, "window": 17}
KNEES = {"integral_knee": 4, "integral_frac": 6}
CONFIGS = {
    "thesis": small(),
    "two windows end together": small(**ENDS),
    "tracked, free": tracked(
        masked_taxels=(3,), feature_kinds=FEATURE_KINDS, activity_rule="change", activity_block=5, **KNEES
    ),
    "tracked, touch windows, LSTM": tracked(
        window_mode="touch",
        touch_frames=60,
        pretrigger_frames=5,
        window=21,
        steps=5,
        cell="lstm",
        rearm_frames=24,
        decision="last",
    ),
    "opens at once, hard sigmoid": tracked(
        onset="immediate", rest="initial", rest_frames=5, clip=0, gate_activation="hard_sigmoid", scan_every=2
    ),
    "thesis, defended": small(
        **FAULTS, onset_hits=2, onset_span=3, margin_threshold=2, feature_kinds=("mean", "activity")
    ),
    "two windows end together, defended": small(**FAULTS, **ENDS, onset_hits=3, onset_span=3),
}


SEED = 44
"""Of recordings with no, one and two touches, with decisions both unsure and not where there is a threshold."""

SLOW = pytest.mark.slow
QUICK = (("two windows end together", 0.4), ("thesis, defended", 0.4))
"""Larger than the designs of tests/test_covering.py, which have every rule, cell and mode; the others are slow tests and judge
mutants."""
STAGE_CASES = [
    *QUICK,
    *(
        pytest.param(name, stall, marks=SLOW)
        for name, stall in {
            "thesis": 0.0,
            "tracked, touch windows, LSTM": 0.0,
            "opens at once, hard sigmoid": 0.0,
            "tracked, free": 0.4,
            "two windows end together, defended": 0.0,
        }.items()
    ),
]


@pytest.mark.parametrize("name, stall", STAGE_CASES)
def test_bit_exact_at_every_stage(name, stall):
    config = CONFIGS[name]
    model = random_integer_model(config, seed=5)
    data = recordings(config, SEED, [150, 60, 33, 7])
    trace = run(model, data)
    assert len(trace.streams["decision"][0]) > 4, (
        "the recordings make no decisions: nothing would be compared"
    )
    streams, statuses = play(model, data, stall=stall)
    check(model, data, streams)
    touches = np.bincount(trace.touches.recording, minlength=len(data))
    assert [status[2] for status in statuses] == touches.tolist()
    assert [bool(status[0] & Status.NO_TOUCH) for status in statuses] == (touches == 0).tolist()
    # at full pace the short hops of these configurations outrun the engine: held up and flagged, nothing lost
    allowed = Fault.INPUT_STALLED | Fault.OVERRUN
    if config.faults.fault_frames:
        flagged = trace.touches.flagged > 0
        assert (
            trace.touches.faults.any()
            and not trace.touches.faults.all()
            and 0 < flagged.sum() < flagged.size / 2
        )
        assert len(set(trace.streams["decision"][0][:, 5])) == 2 or not config.network.margin_threshold
        assert [status[3] for status in statuses] == [
            sum(1 << int(taxel) for taxel in np.flatnonzero(row)) for row in flagged
        ]
        assert [bool(status[1] & Fault.TAXEL) for status in statuses] == np.logical_or.accumulate(
            flagged.any(axis=1)
        ).tolist()
        allowed |= Fault.TAXEL
    assert not any(status[1] & ~allowed for status in statuses)


def test_a_recording_that_stops_in_the_middle_of_a_frame_is_finished():
    """Also where the frame would have ended a window: half of its sums wait in the engine for ever, and count
    as nothing under way."""
    model = random_integer_model(CONFIGS["two windows end together"], seed=4)
    whole = recordings(model.config, 45, list(range(60, 60 + model.config.windows.hop)))
    parts = [whole.recording(number) for number in range(len(whole))]
    cut = dataclasses.replace(
        whole,
        samples=np.concatenate([np.vstack([part, part[-1:]]) for part in parts]),
        offsets=whole.offsets + np.arange(len(whole) + 1),
    )
    streams, _ = play(model, cut, left_off=2)
    decisions = run(model, whole).streams["decision"][0].tolist()
    assert len(decisions) > len(whole) and streams["decision"] == decisions


@SLOW
@pytest.mark.parametrize("name, lanes", [("tracked, free", 12), ("two windows end together", 1)])
def test_the_lowest_clock_loses_nothing(name, lanes):
    """At schedule.lowest_clock_hz every frame is taken when it is due: with 1 lane the steps decide it, with
    12 the frames, whose means differ from taxel to taxel. At full pace the short hops outrun the engine of one
    lane: held up, flagged, and still nothing is lost.
    """
    config = CONFIGS[name].replace(lanes=lanes, feature_kinds=("mean",), feature_scale="taxel")
    model = random_integer_model(config, seed=5)
    data = recordings(config, SEED, [150, 60])
    streams, statuses = play(model, data, frame_cycles=lowest_clock_hz(config) / config.sensor.sample_rate_hz)
    check(model, data, streams)
    assert streams["decision"] and [status[1] for status in statuses] == [0, 0]
    if lanes == 1:
        streams, statuses = play(model, data)
        check(model, data, streams)
        assert any(status[1] & Fault.OVERRUN for status in statuses)
