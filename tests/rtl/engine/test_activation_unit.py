"""Both tables, exhaustively, in golden and hardware."""

import random

from amaranth.hdl import Fragment

from eskin.golden.core import PRESETS, QFormat, sigmoid_table, tanh_table
from eskin.rtl.engine.activation_unit import ActivationUnit
from tests.support.stream_bench import put, simulate
from tests.support.table import each_row


@each_row(
    "changes",
    [
        {},
        {"lane_type": "dsp"},
        {"gate_frac": 12},
        {"gate_frac": 8},
        {"gate_activation": "hard_sigmoid"},
        {"state_format": QFormat(2, 8)},
    ],
)
def test_every_entry_one_cycle_later(changes):
    """One table for both where their codes differ by a constant, two otherwise; held while not enabled.

    With 8 fraction bits tanh(4) rounds to 1: its complement needs every bit of the state's format.
    """
    config = PRESETS["thesis"].replace(table_entries=256, **changes)
    dut = ActivationUnit(config)
    seen = []

    async def bench(ctx):
        for tanh in (0, 1):
            for index in range(-128, 128):
                put(ctx, dut, index=index, tanh=tanh, enable=1)
                await ctx.tick()
                seen.append(~ctx.get(dut.not_state) if tanh else ctx.get(dut.gate))
                put(ctx, dut, index=-index - 1, enable=0)
                await ctx.tick()
                assert (~ctx.get(dut.not_state) if tanh else ctx.get(dut.gate)) == seen[-1]

    simulate(dut, bench)
    assert seen == [*sigmoid_table(config), *tanh_table(config)]


def test_a_wrong_entry_is_told_from_the_cycle_after_its_look_up_to_the_next():
    """Asked for or walked through."""
    config = PRESETS["thesis"].replace(table_entries=64, checksum=True)
    wrong, rng, counts = 37, random.Random(1), {"asked": 0, "walked": 0}

    class Changed(ActivationUnit):
        """A bit of one entry inverted."""

        def elaborate(self, platform):
            m = super().elaborate(platform)
            m.submodules.table.init[wrong] ^= 4
            return m

    dut = Changed(config)

    async def bench(ctx):
        following, entry = 0, None
        for _ in range(1500):
            enable, walk, index = (
                rng.random() < 0.5,
                rng.random() < 0.5,
                rng.choice([rng.randrange(-32, 32), wrong - 32]),
            )
            put(ctx, dut, enable=enable, walk=walk, index=index)
            await ctx.tick()
            entry = following if walk else index + 32 if enable else entry
            following = (following + walk) % 64
            assert ctx.get(dut.wrong) == (entry == wrong)
            if entry == wrong and (walk or enable):
                counts["walked" if walk else "asked"] += 1

    simulate(dut, bench)
    assert min(counts.values()) > 5


@each_row(
    "changes, tables",
    [
        ({}, 1),
        ({"lane_type": "dsp", "lanes": 5}, 1),
        ({"lane_type": "dsp", "lanes": 4}, 2),
        ({"lanes": 12, "gate_frac": 12}, 2),
    ],
)
def test_two_tables_where_the_codes_are_not_alike_or_a_few_dsp_lanes_spare_logic(changes, tables):
    config, depths = PRESETS["thesis"].replace(**changes), []

    class Watched(ActivationUnit):
        def elaborate(self, platform):
            m = super().elaborate(platform)
            depths.append(m.submodules.table.depth)
            return m

    Fragment.get(Watched(config), None)
    assert depths == [tables * config.formats.table_entries]
