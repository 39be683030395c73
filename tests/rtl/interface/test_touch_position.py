"""rtl/interface/touch_position.py against the golden positions, bit for bit; the golden ones against where
the touches were."""

import numpy as np

from eskin.golden.core import AcceleratorConfig
from eskin.golden.model.position import Position, PositionStream, direction
from eskin.rtl.interface.touch_position import TouchPosition
from tests.support.array_touches import REST, touches
from tests.support.stream_bench import Bench, put
from tests.support.table import each_row

SIZES = {"13x9": (13, 9), "16x10": (16, 10), "4x4": (4, 4)}


def config_of(rows: int, columns: int, **fields) -> AcceleratorConfig:
    base = dict(
        taxels=rows * columns,
        rows=rows,
        columns=columns,
        sample_bits=8,
        sample_rate_hz=100.0,
        band_high=255,
        position=True,
        position_rest=REST,
        position_threshold=10,
    )
    return AcceleratorConfig.of(**base | fields)


def hardware(
    samples: np.ndarray,
    config: AcceleratorConfig,
    clear_after: int | None = None,
    clear_at: int | None = None,
) -> list[tuple]:
    """Positions, by frame; ``clear`` behind frame ``clear_after``, or with the beat ``clear_at`` of the
    frame behind it."""
    dut, taxels = TouchPosition(config), config.sensor.taxels
    bench, positions, frame_now, ended_at = Bench(dut, max_cycles=2_000_000), [], [0], [0]
    quotient = (max(config.interface.rows, config.interface.columns) - 1).bit_length() + 5  # its bits

    async def play(ctx):
        for frame, cells in enumerate(samples):
            for place, sample in enumerate(cells):
                last = place == taxels - 1
                put(
                    ctx,
                    dut,
                    clear=clear_after is not None and frame == clear_after + 1 and place == clear_at,
                    i={"valid": 1, "payload": {"sample": int(sample), "first": place == 0, "last": last}},
                )
                await ctx.tick()
                if last:
                    frame_now[0], ended_at[0] = frame, bench.cycle
                ctx.set(dut.i, {"valid": 0, "payload": {"sample": 99, "first": 0, "last": 0}})
                if place % 7 == 3:
                    await ctx.tick()
            await ctx.tick().repeat(24)
            ctx.set(dut.clear, 0)
            if frame == clear_after and clear_at is None:
                ctx.set(dut.clear, 1)
                await ctx.tick()
                ctx.set(dut.clear, 0)

    async def watch(ctx):
        async for *_, valid, p in ctx.tick().sample(dut.o.valid, dut.o.payload):
            if valid:
                assert bench.cycle - ended_at[0] == (1 if p.ended else 2 * quotient + 1)
                positions.append((frame_now[0], p.x, p.y, p.peak, bool(p.ended), p.direction))

    bench._sim.add_testbench(watch, background=True)
    bench.process(play)
    bench.run()
    return positions


def as_told(golden: list[Position]) -> list[tuple]:
    return [(p.frame, p.x, p.y, p.peak, p.ended, p.direction) for p in golden]


@each_row(
    "fields",
    [
        dict(sample_signed=True, position_rest=-100, band_high=100),
        dict(sample_bits=16, position_rest=40_000, band_high=60_000),
        dict(columns=16, position_rest=0),
        dict(rows=16, columns=10, position_rest=0),
    ],
)
def test_bit_exact_on_random_frames_of_other_samples(fields):
    config = config_of(**dict(rows=4, columns=5) | fields)
    low, high, cells = config.sample_format.min_code, config.sample_format.max_code, config.sensor.taxels
    samples = np.random.default_rng(2).integers(low, high + 1, (15, cells))
    samples[[3, 4, 9, 12]] = low
    samples[4, :2] = 21, 11  # half a step of the place, where that is rest
    samples[5] = high
    # one cell alone, or none: slides of the whole array's length
    single = np.where(np.eye(cells + 1, cells), high, low)
    samples = np.vstack([samples, single[[-2, 0, -1, 0, -2, -1, 3, 7, -1]]])
    assert hardware(samples, config) == as_told(PositionStream(config).push(samples))


@each_row("beat, cycles", [(None, 5), *((beat, 6) for beat in range(16))])
def test_a_clear_forgets_the_touch_and_the_frame_that_it_comes_in(beat, cycles):
    config = config_of(4, 4)
    samples, _, _ = touches(4, 4, count=1, seed=3, frames=8)
    before = as_told(PositionStream(config).push(samples[:5]))
    golden = before + [
        (f + cycles, *rest) for f, *rest in as_told(PositionStream(config).push(samples[cycles:]))
    ]
    assert hardware(samples, config, clear_after=4, clear_at=beat) == golden
    assert not any(row[4] for row in before)


@each_row("size, inner_error", [("13x9", 0.2), ("16x10", 0.2), ("4x4", 0.35)])
def test_the_centre_is_near_the_truth_and_slides_give_their_direction(size, inner_error):
    rows, columns = SIZES[size]
    config = config_of(rows, columns)
    samples, truth, ways = touches(rows, columns, count=60, seed=9)
    golden = PositionStream(config).push(samples)
    errors = []
    for p in golden:
        if not p.ended and truth[p.frame]:
            x, y = truth[p.frame]
            if (1.5 <= x <= columns - 2.5 and 1.5 <= y <= rows - 2.5) or (
                size == "4x4" and 1 <= x <= 2 and 1 <= y <= 2
            ):
                errors.append(np.hypot(p.x / 16 - x, p.y / 16 - y))
    assert len(errors) > 10 and np.max(errors) < inner_error
    ends = [p for p in golden if p.ended]
    assert len(ends) == len(ways)
    clear = right = 0
    for p, (dx, dy) in zip(ends, ways, strict=True):
        if max(abs(dx), abs(dy)) < 0.01:
            assert p.direction == 0
        elif max(abs(dx), abs(dy)) > 1.6 and abs(abs(dx) - abs(dy)) > 0.8:
            clear += 1
            right += p.direction == direction(int(16 * dx), int(16 * dy), 1)
    summary = f"error {np.mean(errors):.3f}, at most {np.max(errors):.3f} cells; {right} of {clear} slides"
    print(f"{size}: {len(errors)} positions, {summary}")
    assert clear > 5 and right == clear


@each_row("size", SIZES)
def test_bit_exact_on_generated_touches(size):
    rows, columns = SIZES[size]
    config = config_of(rows, columns)
    samples, _, _ = touches(rows, columns, count=3, seed=rows, frames=6)
    golden = PositionStream(config).push(samples)
    assert len(golden) > 20 and {p.direction for p in golden} - {0}
    assert hardware(samples, config) == as_told(golden)
