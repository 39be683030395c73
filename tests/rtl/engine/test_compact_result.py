"""What a STORE of the compact engine writes: every kind at and beyond the ends of its format, and the tables'
answers."""

from __future__ import annotations

import random

from eskin.golden.core.activation import sigmoid_table, tanh_table
from eskin.golden.core.formats import narrow
from eskin.rtl.engine.compact_result import CompactResult
from eskin.rtl.program.compact_program import Kind
from eskin.rtl.program.schedule import schedule
from tests.rtl.engine.test_engine import small
from tests.support.stream_bench import put, simulate


def test_sat_of_every_kind_and_the_tables_answers():
    config = small("gru", "before", 1, lane_type="serial")
    code, rng = schedule(config).compact, random.Random(1)
    dut, formats = CompactResult(config, code), config.formats
    of_kind = {
        Kind.INDEX: config.index_format,
        Kind.LOGIT: formats.logit_format,
        Kind.STATE: formats.state_format,
    }
    of_kind |= {Kind.FEATURE: formats.feature_format}
    tables = sigmoid_table(config).tolist(), tanh_table(config).tolist()
    largest = (1 << code.accumulator_bits - 1) - 1
    seen = set()

    async def bench(ctx):
        ctx.set(dut.store, 1)
        for kind, fmt in of_kind.items():
            end = 1 << fmt.width - 1
            edges = [-largest - 1, -end - 1, -end, -end + 1, -1, 0, 1, end - 2, end - 1, end, largest]
            for acc in edges + [rng.randrange(-2 * end, 2 * end) for _ in range(40)]:
                put(ctx, dut, acc=max(min(acc, largest), -largest - 1), kind=kind, table=0)
                wanted = int(narrow(max(min(acc, largest), -largest - 1), 0, fmt))
                bits = (1 << fmt.width) - 1
                assert ctx.get(dut.result) & bits == wanted & bits, (kind, acc)
                seen.add((kind, wanted in (-end, end - 1)))
                if kind == Kind.INDEX:
                    tanh = rng.randrange(2)
                    ctx.set(dut.tanh, tanh)
                    await ctx.tick()
                    put(ctx, dut, table=1, kind=Kind.STATE, acc=rng.randrange(-end, end))
                    assert ctx.get(dut.result) == tables[tanh][wanted + formats.table_entries // 2]

    simulate(dut, bench)
    assert len(seen) == 8, "inside and at an end of each"
