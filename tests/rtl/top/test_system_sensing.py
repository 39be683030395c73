"""A board with sensors (rtl/top/system.py): whatever is wrong lights the lamp and takes the stimulator's electrode off; the next
decision is heard again."""

from types import SimpleNamespace

import pytest
from amaranth.hdl import Signal

from eskin.golden.core import PRESETS
from eskin.rtl.interface.stimulation import STIMULATOR_BAUD
from eskin.rtl.top import system
from eskin.verbs.build import BoardRequest, command
from tests.support.silent import Silent
from tests.support.stream_bench import simulate
from tests.support.table import refused

CLOCK_HZ = 4 * STIMULATOR_BAUD
CONFIG = PRESETS["thesis"].replace(converter="ads7953", stimulator="decisions", hold_s=0.03)
CAUSES = {
    "nothing": lambda sensing: None,
    "a frame is missing": lambda sensing: sensing.broken,
    "a code is wrong": lambda sensing: sensing.fault,
    "the watchdog acted": lambda sensing: sensing.accelerator.watching.hung,
}


def skin(monkeypatch, host=None):
    """A board around a chain that does nothing, and a list that will hold its stimulator."""
    sensing_of, stimulation_of, made = system.Sensing, system.Stimulation, []
    watching = SimpleNamespace(watching=SimpleNamespace(hung=Signal()))
    monkeypatch.setattr(
        system, "Sensing", lambda *arguments, **options: Silent(sensing_of(*arguments), accelerator=watching)
    )
    monkeypatch.setattr(
        system, "Stimulation", lambda *arguments: made.append(stimulation_of(*arguments)) or made[-1]
    )
    return system.System(CONFIG, None, host=host, clock_hz=CLOCK_HZ), made


@pytest.mark.parametrize("name", CAUSES)
def test_any_fault_is_a_lamp_and_off_until_the_next_decision(name, monkeypatch):
    dut, made = skin(monkeypatch)
    levels = set()

    async def play(ctx):
        async def until(value: bool) -> None:
            for _ in range(12_000):
                if ctx.get(made[0].on) == value:
                    return
                await ctx.tick()
                levels.add(ctx.get(dut.stim_tx))
            raise AssertionError(f"the stimulator is {'not on' if value else 'still on'}")

        async def pulse(signal) -> None:
            ctx.set(signal, 1)
            await ctx.tick()
            ctx.set(signal, 0)

        chain, cause = dut.core, CAUSES[name](dut.core)
        ctx.set(chain.o.p["class"], 1)
        await pulse(chain.o.valid)
        await until(True)
        assert not ctx.get(dut.led) and ctx.get(dut.decision) == 2 and levels == {0, 1}
        if cause is None:
            await ctx.tick().repeat(8_000)
            assert ctx.get(made[0].on) and not ctx.get(dut.led)
            await until(False)  # held for long enough
            return
        await pulse(cause)
        assert ctx.get(dut.led)
        await until(False)
        await pulse(chain.o.valid)
        await until(True)
        assert ctx.get(dut.led)

    simulate(dut, play)


def test_frames_need_a_line_that_is_fast_enough():
    """10 (2 x 16 + 24) bits 3000 times a second."""
    config = CONFIG.replace(send_frames=True)
    system.refuse_slow_line(config, 1.68e6)
    with refused(
        "field send_frames: 16 taxels 3000 times a second need 1.68e.06 bit/s, and the link makes 1.5e.06"
    ):
        system.System(config, baud=1.5e6)
    for options in ({}, {"converter": "ads7953", "standalone": True}):
        with refused("add --converter NAME, and leave out --standalone"):
            command(BoardRequest(model="model", target="icebreaker", frames=True, **options))


def test_what_needs_a_host_is_refused():
    with refused("there is no source of frames; add `converter`"):
        system.refuse_standalone(CONFIG.replace(converter="none"))
    immediate = dict(onset="immediate", window_mode="free", window=614)
    with refused("use 'band' or 'baseline'"):
        system.refuse_standalone(CONFIG.replace(**immediate))
