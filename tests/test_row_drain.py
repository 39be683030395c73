"""Rows off the lanes: order, addends, narrowing to table index, value and logit, and where each result goes."""

from __future__ import annotations

import random

from amaranth.sim import Simulator

from golden.config import PRESETS
from golden.formats import QFormat, narrow
from rtl.row_drain import RowDrain
from rtl.schedule import schedule


def test_every_group_of_a_step_is_finished_row_by_row():
    config = PRESETS["thesis"].replace(reset="after", lanes=5, state_format=QFormat(4, 12))
    plan = schedule(config)
    dut, rng = RowDrain(config, plan), random.Random(1)
    top = 1 << config.accumulator_bits - 2
    addends = [rng.choice([rng.randint(-top, top), rng.randint(-9999, 9999)]) for _ in range(len(plan.bias_rows) + plan.partial_rows)]
    accumulators = [[rng.choice([rng.randint(-top, top), rng.randint(-99999, 99999)]) for _ in range(config.lanes)] for _ in plan.groups]
    seen = []

    async def bench(ctx):
        queue = [(number * 7, number) for number in range(len(plan.groups))]  # groups 7 cycles apart, 5 rows each
        address = 0
        for cycle in range(len(plan.groups) * 7 + 12):
            number = next((n for at, n in queue if at + 2 == cycle), None)
            ctx.set(dut.capture, number is not None)
            if number is not None:
                for lane, value in enumerate(accumulators[number]):
                    ctx.set(dut.acc[lane], value)
            ctx.set(dut.addend, addends[address % len(addends)])  # idle, it may point past the end
            _, _, partial, at, total, result, index, tanh, value, logit, address = await ctx.tick().sample(
                dut.partial, dut.partial_address, dut.total, dut.result, dut.index, dut.tanh, dut.value, dut.logit, dut.addend_address
            )
            if partial:
                seen.append(("partial", at, total))
            if result.gate or result.t:
                kind = "value" if result.t and not result.tabled else "tanh" if tanh else "sigmoid"
                seen.append((kind, result.region, result.index, value if kind == "value" else index))
            if result.logit:
                seen.append(("logit", result.index, logit))

    sim = Simulator(dut)
    sim.add_clock(1e-6)
    sim.add_testbench(bench)
    sim.run()

    expected = []
    shifts = {"sigmoid": config.sigmoid_shift, "tanh": config.tanh_shift}
    for group, acc in zip(plan.groups, accumulators, strict=True):
        for row in range(group.rows):
            kind, place = group.block.dest, group.dest + row
            total = acc[row] + addends[group.addend + row]
            regions = plan.program.gate_regions if kind == "sigmoid" else plan.program.t_regions
            if kind == "partial":
                expected.append(("partial", place, total))
            elif kind == "logit":  # the half is in the addend: here the narrowing is a floor
                half = 1 << config.logit_shift - 1
                expected.append(("logit", place, narrow(total - half, config.logit_shift, config.logit_format)))
            elif kind == "value":
                half = 1 << config.value_shift - 1
                code = narrow(total - half, config.value_shift, config.state_format)
                expected.append(("value", regions.index(group.block.region), place, code))
            else:
                code = narrow(total - (1 << shifts[kind] - 1), shifts[kind], config.index_format)
                expected.append((kind, regions.index(group.block.region), place, code))
    def order(rows):
        return sorted(rows, key=str)

    assert order(seen) == order(expected) and len(seen) == len(expected)
    for kind in ("partial", "sigmoid", "value", "logit"):
        assert [row for row in seen if row[0] == kind] == [row for row in expected if row[0] == kind]
