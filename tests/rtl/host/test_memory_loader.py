"""Words of random memories: where they go, and which are refused."""

import random

from eskin.golden.core import PRESETS
from eskin.rtl.common.load_port import load_lines
from eskin.rtl.host.memory_loader import MemoryLoader
from eskin.rtl.program.memory_map import load_words, memory_words, words_per_entry
from tests.support.stream_bench import put, simulate
from tests.support.table import each_row


@each_row("hardware", [{"lanes": 6}, {"lanes": 4, "checksum": True}, {"loadable": False}])
def test_every_word_of_a_random_memory_goes_to_its_place(hardware):
    config = PRESETS["thesis"].replace(**hardware)
    dut, rng, lines = MemoryLoader(config), random.Random(1), load_lines(config)
    load, counts = dut.load, {"taken": 0, "refused": 0}

    async def bench(ctx):
        assert ctx.get(load.select) == 1  # after reset the first memory is chosen
        for _ in range(12):
            number, address = rng.choice(list(lines)), 0
            end = memory_words(config).get(number, 0) * words_per_entry(config, number)
            put(ctx, dut, data=number, chosen=1)
            await ctx.tick()
            ctx.set(dut.chosen, 0)
            for _ in range(min(load_words(config), 30)):
                word, locked = rng.randrange(1 << 16), rng.random() < 0.2
                put(ctx, dut, data=word, locked=locked, written=1)
                refused = locked or (config.hardware.checksum and address == end)
                taken = not refused and config.hardware.loadable
                assert (ctx.get(load.enable), ctx.get(dut.refused)) == (taken, refused)
                assert [ctx.get(signal) for signal in (load.select, load.address, load.data)] == [
                    1 << lines[number],
                    address,
                    word,
                ]
                counts["taken" if taken else "refused"] += 1
                address += taken
                await ctx.tick()
                ctx.set(dut.written, 0)

    simulate(dut, bench)
    assert counts["refused"] > 10 and (counts["taken"] > 100 or not config.hardware.loadable)
