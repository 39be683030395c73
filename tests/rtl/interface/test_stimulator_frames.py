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
            sent = bytearray()
            for _ in range(cycles):
                if ctx.get(dut.byte.valid):
                    sent.append(ctx.get(dut.byte.payload))
                assert not (ctx.get(dut.resting) and (ctx.get(dut.byte.valid) or ctx.get(dut.on)))
                await ctx.tick()
            return bytes(sent)

        ctx.set(dut.byte.ready, 1)
        await body(ctx, dut, run)

    simulate(dut, bench)


def test_every_byte_for_every_electrode_is_that_of_the_table():
    async def body(ctx, dut, run):
        assert await run(120) == b">OFF<" * 16
        model = StimulatorModel(LIMITS)
        for electrode in range(24):
            settings = [(17, 0x1234, 9, 255), LIMITS, [limit + 1 for limit in LIMITS]][electrode % 3]
            put(ctx, dut, settings=dict(zip(SETTINGS, settings, strict=True)), electrode=electrode, request=1)
            await run(1)
            put(ctx, dut, settings=dict.fromkeys(SETTINGS, 1))  # for the next burst
            sent = await run(159)
            limited = map(min, settings, LIMITS)
            assert sent == b"".join(table_frames(PLACES[electrode // 4][electrode % 4], *limited))
            model.feed(sent)
            assert model.is_on and not model.wrong
            ctx.set(dut.request, 0)
            sent = await run(30)
            assert sent == b">OFF<" * 2 and ctx.get(dut.resting)
            model.feed(sent)
        assert not model.is_on and model.frames.count("ON") == 24

    play(body)
