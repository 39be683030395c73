"""rtl/frontend/fault_detector.py against eskin.golden.model.preprocess: every change of two samples, streams
with gaps, recordings in turn."""

import numpy as np
from amaranth.hdl import ResetInserter, Signal

from eskin.golden.core import AcceleratorConfig
from eskin.golden.data import Recordings
from eskin.golden.model import find_touches
from eskin.golden.model.preprocess import activity
from eskin.rtl.frontend.fault_detector import FaultDetector
from tests.support.stream_bench import Bench, put
from tests.support.table import each_row


def config_of(**changes) -> AcceleratorConfig:
    base = dict(
        name="faults",
        sample_bits=12,
        hidden=4,
        sample_rate_hz=1000.0,
        window_mode="free",
        hop=2,
        window=4,
        steps=2,
        onset="immediate",
        fault_frames=8,
        fault_activity=20,
    )
    return AcceleratorConfig.of(**(base | changes))


def golden_flags(config, stream) -> np.ndarray:
    """(taxels) frame that raises each flag, 0 none."""
    recordings = Recordings.of([stream], sample_rate_hz=config.sensor.sample_rate_hz)
    return find_touches(config, recordings, steps=0).flagged[0]


def play(config, streams, *, gap=0.0, seed=0):
    """For each stream, after a reset: ``flag`` at each beat (frames, taxels), and ``flags`` at the end; and
    how often ``raised`` was high.

    gap: chance of an idle cycle after each beat, repeated.
    """
    dut, reset = FaultDetector(config), Signal()
    bench = Bench(ResetInserter(reset)(dut), max_cycles=2_000_000)
    raised, seen, rng = bench.watch(dut.raised), [], np.random.default_rng(seed)

    async def feed(ctx):
        for stream in streams:
            flags = np.zeros(stream.shape, dtype=int)
            for t, frame in enumerate(stream):
                for taxel, sample in enumerate(frame):
                    ctx.set(dut.i, {"valid": 1, "taxel": taxel})
                    await ctx.tick()
                    ctx.set(dut.i.valid, 0)
                    put(
                        ctx,
                        dut,
                        complement=~int(sample) & (1 << config.fault_bits) - 1,
                        settling=t < config.rest_level.rest_frames,
                    )
                    flags[t, taxel] = ctx.get(dut.flag)
                    while rng.random() < gap:
                        await ctx.tick()
                        assert ctx.get(dut.flag) == flags[t, taxel]  # until the next beat is taken
            await ctx.tick()
            seen.append((flags, ctx.get(dut.flags)))
            ctx.set(reset, 1)
            await ctx.tick()
            ctx.set(reset, 0)

    bench.process(feed)
    bench.run()
    return seen, len(raised)


def check(config, streams, **options) -> None:
    seen, raised = play(config, streams, **options)
    pulses = 0
    for stream, (flags, at_end) in zip(streams, seen, strict=True):
        by = golden_flags(config, stream)
        frames = np.arange(1, len(stream) + 1)[:, None]
        assert np.array_equal(flags, (by > 0) & (by <= frames))
        assert at_end == sum(1 << int(taxel) for taxel in np.flatnonzero(by))
        pulses += int(((by > 0) & (by <= frames)).sum())
    assert raised == pulses


def pairs(bits: int, taxels: int) -> list[np.ndarray]:
    """Streams of two frames in which every pair of codes occurs."""
    codes = np.arange(1 << 2 * bits)
    both = np.stack([codes >> bits, codes & (1 << bits) - 1])
    return [both[:, at : at + taxels] for at in range(0, len(codes), taxels)]


@each_row(
    "limit, signed",
    [(0, False), (1, True), (3, False), (4, True), (7, False), (7, True), (8, True), (20, False)],
)
def test_every_change_of_a_small_format(limit, signed):
    config = config_of(taxels=128, sample_bits=4, sample_signed=signed, fault_frames=2, fault_activity=limit)
    streams = pairs(4, 128)
    seen, _ = play(config, [stream - 8 * signed for stream in streams])
    for stream, (_, at_end) in zip(streams, seen, strict=True):
        failed = activity(config, stream - 8 * signed) <= limit
        assert at_end == sum(1 << int(taxel) for taxel in np.flatnonzero(failed))


CASES = {
    "rest none": dict(),
    "settling": dict(rest="initial", rest_frames=13),
    "block of 2": dict(fault_frames=2, fault_activity=0),
    "no limit": dict(fault_activity=65535),
    "limit 1": dict(fault_activity=1, sample_bits=10),
    "limit wider than a change": dict(
        fault_frames=32, fault_activity=300, sample_bits=16, sample_signed=True
    ),
}


def stream_of(config, seed: int, frames: int = 100) -> np.ndarray:
    """Walks of small and of large steps, standstills, swings between the ends of the range."""
    rng = np.random.default_rng(seed)
    low, high = config.sample_format.min_code, config.sample_format.max_code
    steps = rng.integers(-6, 7, (frames, config.sensor.taxels)) * rng.choice(
        [1, 1, 40], (frames, config.sensor.taxels)
    )
    stream = np.clip((low + high) // 2 + steps.cumsum(axis=0), low, high)
    for _ in range(4):
        begin, taxel = rng.integers(frames), rng.integers(config.sensor.taxels)
        stream[begin : begin + rng.integers(60), taxel] = rng.choice([low, high, 3])
    swings = rng.integers(frames)
    stream[swings : swings + 40 : 2, 0], stream[swings + 1 : swings + 41 : 2, 0] = low, high
    return stream


@each_row("name", CASES)
def test_equal_to_golden_recording_after_recording(name):
    """The memory keeps what the recordings before have left; one of them ends within a block."""
    config = config_of(taxels=5, **CASES[name])
    streams = [stream_of(config, seed, frames) for seed, frames in ((1, 100), (2, 45), (3, 100))]
    flagged = [golden_flags(config, stream) for stream in streams]
    assert any(by.any() for by in flagged) and (name == "no limit" or not all(by.all() for by in flagged))
    check(config, streams, gap=0.3, seed=7)
