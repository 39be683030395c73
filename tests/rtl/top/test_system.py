"""The board top: its ports with loadable and fixed memories, and its pins after reset."""

import re

import pytest
from amaranth.back import rtlil
from amaranth.hdl import Module, Mux, Signal

from eskin.golden.core import PRESETS
from eskin.rtl.common import decision_layout
from eskin.rtl.program.memory_map import memory_images
from eskin.rtl.top import system
from eskin.rtl.top.accelerator import Accelerator
from eskin.rtl.top.system import System, class_pin_count, reaches_pins
from tests.support.random_models import random_integer_model
from tests.support.silent import Silent
from tests.support.stream_bench import put, simulate
from tests.support.table import each_row


@each_row(
    "changes, options, expected",
    [
        ({"taxels": 40, "lanes": 1}, {}, "rx tx decision led"),
        ({"loadable": False, "margin_threshold": 3}, {}, "rx tx decision led unsure"),
        ({"margin_threshold": 3}, {"host": None}, "bus busy s m"),
        ({}, {"host": "wishbone", "source": "stream"}, "wb irq busy s"),
    ],
)
def test_elaborates_with_the_ports_of_a_board(monkeypatch, changes, options, expected):
    """Around an accelerator without its parts. Their first words: ``s`` of frames that come as a stream, ``m`` of
    decisions that leave as one."""
    monkeypatch.setattr(system, "Accelerator", lambda *given: Silent(Accelerator(*given)))
    model = random_integer_model(PRESETS["thesis"].replace(**changes), 1)
    images = None if model.config.hardware.loadable else memory_images(model.config, model.arrays)
    dut = System(model.config, images, clock_hz=48e6, **options)
    text = rtlil.convert(dut, name="board_top", emit_src=False)
    top = text[text.index("module \\board_top") :].partition("\nend\n")[0]
    ports = re.findall(r"put \d+ +\\([a-z]+)", top)
    assert {*ports} - {"clk", "rst"} == {*expected.split()}


@each_row("class_pins, bits", [("each", 20), ("binary", 5)])
def test_the_pins_show_the_class_as_asked(class_pins, bits):
    """The accelerator's decisions by hand: what follows on the pins is the class of the latest."""
    config = random_integer_model(
        PRESETS["fabric"].replace(class_names=tuple(f"c{k}" for k in range(20)), decision="last"), 1
    ).config
    accelerator = Silent(Accelerator(config, None))
    offered = accelerator.o
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(system, "Accelerator", lambda *_: accelerator)
        dut = System(config, clock_hz=12e6, class_pins=class_pins)
    assert class_pin_count(config, class_pins) == bits == len(dut.decision)

    async def bench(ctx):
        ctx.set(dut.rx, 1)
        await ctx.tick()
        for number, is_global in ((3, 0), (19, 1), (0, 0), (16, 1)):
            put(ctx, offered, payload={"class": number, "is_global": is_global}, valid=1)
            await ctx.tick()
            ctx.set(offered.valid, 0)
            await ctx.tick()
            assert ctx.get(dut.decision_valid) == is_global
            assert ctx.get(dut.decision) == (1 << number if class_pins == "each" else number)

    simulate(dut, bench)


@each_row("decision", ["early", "vote"])
def test_an_early_global_decision_stays_on_the_pins_until_the_next_touch(decision):
    offered, shown = Signal(decision_layout(PRESETS["fabric"])), Signal()
    takes = Signal()
    m = Module()
    m.d.comb += takes.eq(reaches_pins(PRESETS["fabric"].replace(decision=decision), offered, shown))
    m.d.sync += shown.eq(Mux(takes, offered.is_global, shown))
    # (step, global)
    events = [(0, 0), (1, 0), (1, 1), (2, 0), (3, 0), (0, 0), (0, 1), (1, 0), (0, 0), (1, 0)]

    async def bench(ctx):
        accepted = []
        for step, is_global in events:
            ctx.set(offered, {"step": step, "is_global": is_global})
            accepted.append(ctx.get(takes))
            await ctx.tick()
        assert accepted == ([1, 1, 1, 0, 0, 1, 1, 0, 1, 1] if decision == "early" else [1] * 10)

    simulate(m, bench)
