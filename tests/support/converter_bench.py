"""A converter's controller and a model of its chips at the pins: what each frame that ended brought."""

from collections.abc import Callable
from typing import NamedTuple

from eskin.golden.core import ConverterFault
from tests.support.stream_bench import Bench


class Frame(NamedTuple):
    """codes: by taxel. away: the converter was being set up, as it was asked for or ended. cycles: since it was asked
    for; end: the cycle in which it ended."""

    codes: dict[int, int]
    fault: ConverterFault
    away: bool
    cycles: int
    end: int


def play_frames(
    dut, chip, count: int, *, period: int | None = None, between: Callable[[int], None] = lambda ended: None
) -> list[Frame]:
    """``count`` frames of ``dut`` with the testbench ``chip`` at its pins.

    Parameters
    ----------
    period:
        Cycles from start to start; None: a frame is asked for whenever the controller is free.
    between:
        Called before the first frame and behind each, with the number of those that ended.
    """
    bench, ended, codes = Bench(dut, max_cycles=100_000, quiet=10), [], {}
    bench._sim.add_testbench(chip.play, background=True)

    async def drive(ctx):
        begun, due, start, busy, away, away_before, put = 0, 0, False, False, True, False, dut.put
        ticks = aiter(
            ctx.tick().sample(dut.busy, dut.away, put.valid, put.place, put.code, dut.finished, dut.fault)
        )
        between(0)
        while len(ended) < count:
            free = not (start or busy or away)
            if start != (start := free if period is None else bench.cycle % period == 0):
                ctx.set(dut.start, start)
            begun = bench.cycle if start else begun
            _, _, busy, away, valid, place, code, finished, fault = await anext(ticks)
            away_before = away if start else away_before
            due += start and not away
            if valid:
                assert place not in codes
                codes[place] = code
            if finished:
                cycles = bench.cycle - begun
                ended.append(
                    Frame(dict(codes), ConverterFault(fault), bool(away | away_before), cycles, bench.cycle)
                )
                codes.clear()
                between(len(ended))
        assert due == sum(not frame.away for frame in ended)
        ctx.set(dut.start, 0)
        await ctx.tick().repeat(150)
        assert ctx.get(dut.away) or not ctx.get(dut.busy), "no frame begins unasked"

    bench.process(drive)
    bench.run()
    return ended
