"""rtl/interface/teach_buttons.py: each press is heard once, whatever its contacts do."""

import random

from amaranth.sim import Simulator

from eskin.rtl.interface.teach_buttons import HELD, TeachButtons

LOOK = 8
SAID = ("chosen", "forgotten", "taught", "named")


def test_presses_are_heard_once_in_spite_of_bouncing():
    dut, rng, heard = TeachButtons(LOOK), random.Random(4), []
    presses = [
        *(("choose_n", 5, ["chosen"]), ("teach_n", HELD - 5, ["taught"]), ("teach_n", HELD + 9, ["named"])),
        *(("choose_n", 2 * HELD, ["forgotten"]), ("choose_n", 0, []), ("teach_n", 4, ["taught"])),
    ]

    async def watch(ctx):
        while True:
            await ctx.tick()
            heard.extend(name for name in SAID if ctx.get(getattr(dut, name)))

    async def play(ctx):
        async def settles(line, level: int) -> None:
            for _ in range(LOOK - 2):
                ctx.set(line, rng.randrange(2))
                await ctx.tick()
            ctx.set(line, level)

        for name, looks, _ in presses:
            line = getattr(dut, name)
            if looks:
                await settles(line, 0)
                await ctx.tick().repeat(looks * LOOK)
                await settles(line, 1)
            else:  # a disturbance, as long as one can be that at most one look sees
                ctx.set(line, 0)
                await ctx.tick().repeat(LOOK)
                ctx.set(line, 1)
            await ctx.tick().repeat(4 * LOOK)

    simulator = Simulator(dut)
    simulator.add_clock(1e-6)
    simulator.add_testbench(watch, background=True)
    simulator.add_testbench(play)
    simulator.run()
    assert heard == [word for *_, said in presses for word in said]
