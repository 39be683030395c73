"""rtl/interface/stimulator_frames.py: every byte against the protocol's table, limits, and OFF as the last
word whatever happens.

That OFF follows another electrode, a fault and the time limit is proved in formal/interface/stimulator_frames.py.
"""

from eskin.golden.core.groups import Interface
from eskin.rtl.interface.stimulator_frames import SETTINGS, StimulatorFrames
from tests.support.stimulator import PLACES, StimulatorModel, table_frames
from tests.support.stream_bench import put, simulate

LIMITS = (30, 5000, 50, 256)
ON_CYCLES = 512  # takes one bit more than any number below it


def play(body) -> None:
    """Run ``body(ctx, dut, run)``; ``run(cycles)`` lets time pass and returns the bytes that were
    taken."""
    dut = StimulatorFrames(Interface(), ON_CYCLES)

    async def bench(ctx):
        async def run(cycles: int) -> bytes:
            taken = bytearray()
            for _ in range(cycles):
                if ctx.get(dut.byte.valid):
                    taken.append(ctx.get(dut.byte.payload))
                await ctx.tick()
            return bytes(taken)

        ctx.set(dut.byte.ready, 1)
        await body(ctx, dut, run)

    simulate(dut, bench)


def test_every_byte_for_every_electrode_is_that_of_the_table():
    async def body(ctx, dut, run):
        ctx.set(dut.settings, {"amplitude": 17, "delay": 0x1234, "frequency": 9, "width": 255})
        assert await run(120) == b">OFF<" * 16
        model = StimulatorModel(LIMITS)
        for electrode in range(24):
            put(ctx, dut, electrode=electrode, request=1)
            taken = await run(160)
            assert taken == b"".join(table_frames(PLACES[electrode // 4][electrode % 4], 17, 0x1234, 9, 255))
            model.feed(taken)
            assert model.is_on and not model.wrong
            ctx.set(dut.request, 0)
            taken = await run(30)
            assert taken == b">OFF<" * 2 and ctx.get(dut.resting)
            model.feed(taken)
        assert not model.is_on and model.frames.count("ON") == 24

    play(body)


def test_a_burst_has_the_settings_of_its_begin_within_their_limits():
    async def body(ctx, dut, run):
        await run(120)
        over = {name: limit + 1 for name, limit in zip(SETTINGS, LIMITS, strict=True)}
        for settings in (dict(zip(SETTINGS, LIMITS, strict=True)), over, {name: 0x81 for name in SETTINGS}):
            put(ctx, dut, settings=settings, request=1, electrode=23)
            taken = await run(1)
            ctx.set(dut.settings, dict.fromkeys(SETTINGS, 1))
            ctx.set(dut.byte.ready, 0)  # a byte stays until it is taken
            await ctx.tick().repeat(3)
            ctx.set(dut.byte.ready, 1)
            taken += await run(160)
            kept = [min(settings[name], limit) for name, limit in zip(SETTINGS, LIMITS, strict=True)]
            assert taken == b"".join(table_frames(PLACES[5][3], *kept))
            ctx.set(dut.request, 0)
            assert await run(30) == b">OFF<" * 2

    play(body)
