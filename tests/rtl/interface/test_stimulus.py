"""rtl/interface/stimulus.py: electrodes of classes and of positions, how long a request lasts."""

from amaranth.hdl import Fragment

from eskin.golden.core import PRESETS, AcceleratorConfig
from eskin.rtl.interface.stimulation import Stimulation
from eskin.rtl.interface.stimulus import Stimulus
from tests.support.stream_bench import simulate
from tests.support.table import each_row


def run_events(config, events, hold=5):
    """(request, electrode) a cycle after each event (None: no event)."""
    dut, seen = Stimulus(config, hold), []
    port = dut.decision if config.interface.stimulator == "decisions" else dut.position

    async def bench(ctx):
        for event in events:
            if event == "clear":
                ctx.set(dut.clear, 1)
            elif event:
                ctx.set(port, {"valid": 1, "payload": event})
            await ctx.tick()
            ctx.set(dut.clear, 0)
            ctx.set(port.valid, 0)
            seen.append((ctx.get(dut.request), ctx.get(dut.electrode)))

    simulate(dut, bench)
    return seen


def test_decisions_by_table_and_the_time_they_hold():
    config = PRESETS["thesis"].replace(stimulator="decisions", electrodes=(7, 0, 24))
    assert run_events(config, [{"class": 0}, *[None] * 6, {"class": 2}, None, {"class": 1}, {"class": 0}, "clear"]) == [
        *[(1, 6)] * 5, *[(0, 6)] * 2, (1, 23), (1, 23), (0, 23), (1, 6), (0, 6),
    ]  # fmt: skip
    assert run_events(PRESETS["thesis"].replace(stimulator="decisions"), [{"class": 2}]) == [(1, 2)]


@each_row("rows, columns", [(13, 9), (16, 10), (4, 4)])
def test_positions_by_the_arrays_size(rows, columns):
    config = AcceleratorConfig.of(
        taxels=rows * columns,
        rows=rows,
        columns=columns,
        position=True,
        stimulator="positions",
        sample_rate_hz=100.0,
    )
    places = [
        (x, y)
        for y in range(16 * (rows - 1) + 1)
        for x in (0, 16 * (columns - 1), (7 * y) % (16 * columns - 15))
    ]
    seen = run_events(config, [{"x": x, "y": y} for x, y in places] + [{"x": 0, "y": 0, "ended": 1}])
    wanted = [4 * (6 * (2 * y + 16) // (32 * rows)) + 4 * (2 * x + 16) // (32 * columns) for x, y in places]
    assert seen[:-1] == [(1, electrode) for electrode in wanted] and not seen[-1][0]
    assert set(wanted) >= {0, 3, 20, 23}


@each_row("hold_s, on_limit_s, cycles", [(0.5, 2.0, [6_000_000, 24_000_000]), (1e-9, 1e-9, [1, 1])])
def test_times_are_whole_cycles_and_one_at_least(hold_s, on_limit_s, cycles):
    config = PRESETS["thesis"].replace(stimulator="decisions", hold_s=hold_s, on_limit_s=on_limit_s)
    made = Stimulation(config, 12e6)
    Fragment.get(made, None)
    assert [made._hold, made._on] == cycles
