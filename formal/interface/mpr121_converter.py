"""Frames of an MPR121: start-up and frames come to an end, each frame with one word; none is good of a chip
that is not alive."""

from unittest import mock

from amaranth.hdl import Cat, Module, Mux, Signal
from amaranth.lib import wiring

from eskin.golden.core import ConverterFault
from eskin.golden.core.converters.mpr121 import RUNNING, MprPlan
from eskin.rtl.interface import mpr121_converter
from eskin.rtl.interface.i2c_master import I2cMaster, I2cOp
from eskin.rtl.interface.mpr121_converter import Mpr121Converter, Step
from formal.proof import Bug, before, free, free_inputs, less_is_to_go, opened_up, proof, prove

PLAN = MprPlan(chips=1, electrodes=(4,), rows=3, columns=3, lines=(2, 2), quarter=3, reset=5, first=6)
PAUSES = [Step(I2cOp.STOP, pause=1), Step(I2cOp.STOP, pause=2)]
READS = [Step(I2cOp.WRITE, 5), Step(I2cOp.READ, keep=1), Step(I2cOp.LAST, keep=2)]
REDUCED = "3 x 3 cells on 4 electrodes, 3 cycles a quarter of a bit, waits of 5 and 6 cycles, a program of one operation of each kind"


@proof(
    "whatever is on the bus, in every cycle the controller goes on towards being idle or to a fault, after "
    "which the set-up begins anew; a "
    "frame ends with one word, and only a frame or a fault does",
    depth=2,
    reduced=REDUCED,
    bugs=(
        Bug(
            "a pause stops at one",
            "timer.eq(timer - (timer != 0))",
            "timer.eq(timer - (timer > 1))",
            depth=40,
        ),
        Bug(
            "the next step is the same",
            "[issued.eq(0), at.eq(at + 1)]",
            "[issued.eq(0), at.eq(at)]",
            depth=40,
        ),
    ),
)
def goes_on(m: Module) -> None:
    with mock.patch.multiple(mpr121_converter, start_up=lambda plan: PAUSES, frame=lambda plan: READS):
        dut = Mpr121Converter(PLAN)
        inside = opened_up(dut)
    port = inside.parts["I2cMaster"]
    free_inputs(dut)
    running, expanding, at = inside.running, inside.expanding, inside.at
    first, steps = len(inside.setting_up), len(inside.program)
    # ---- what is to go: steps, then in a step first the pause, then the port's quarters; or cells, when all steps are done
    to_go = Signal(8, name="steps_to_go")
    m.d.comb += to_go.eq(Mux(at < first, first, steps) - at)
    port_left = Cat(port.timer, port.quarters)
    idle = port.quarters == 0
    within = Mux(inside.issued, Mux(idle, 1024, port_left), Mux(idle, 512, 2048 + port_left)) + inside.timer
    across, down = (
        (PLAN.columns - 1 - inside.column)[: len(inside.column)],
        (PLAN.rows - 1 - inside.row)[: len(inside.row)],
    )
    left = Signal(24, name="to_go")
    m.d.comb += left.eq(Mux(running, to_go << 12 | within, Cat(across, down)))
    failed = before(dut.finished & dut.fault.any(), "failed")
    good = before(dut.finished & ~dut.fault.any(), "good")
    was_busy, was_fresh = before(dut.busy, "was_busy"), before(inside.fresh, "was_fresh")
    less_is_to_go(left, ~was_busy | ~dut.busy | failed)
    prove(~failed | (inside.fresh & running & (at == 0)), "after a fault the set-up begins anew")
    prove(~good | (was_busy & ~dut.busy), "a frame's word comes at its end")
    prove(~(was_busy & ~dut.busy) | good | was_fresh, "a frame ends with a word")
    # ---- for the induction
    prove(~(running & expanding), "steps or cells")
    prove(~expanding | ~inside.fresh, "cells only of a frame")
    prove(~running | (at < steps), "a step")
    prove(running | ~inside.fresh, "the set-up goes on to its end")
    prove(~running | (inside.fresh == (at < first)), "the set-up comes first")


class AnyPort(wiring.Component):
    """An I2C port whose operations take a cycle and hear anything."""

    def __init__(self, quarter: int) -> None:
        master = I2cMaster(quarter)
        master._MustUse__used = True  # it lends its signature alone
        super().__init__(master.signature)

    def elaborate(self, platform):
        m = Module()
        free(self.heard, self.acknowledged, m=m)
        m.d.sync += self.done.eq(self.start)
        m.d.comb += self.idle.eq(~self.done)
        return m


@proof(
    "a chip that does not read back what was written is told, and one that reads nothing but 0 gives no "
    "good frame",
    depth=2,
    reduced="one electrode, a program of its reading and the readback; operations of one cycle",
    bugs=(
        Bug(
            "what is read back is not compared",
            "step.compare & (master.heard != step.byte)",
            "Const(0)",
            depth=40,
        ),
        Bug("a dead chip goes by", "dead.eq(dead | low)", "dead.eq(dead)", depth=40),
        Bug("zeros are not seen", "low.eq(low & ~code.any())", "low.eq(0)", depth=40),
    ),
)
def alive(m: Module) -> None:
    program = [
        Step(I2cOp.READ, keep=1),
        Step(I2cOp.LAST, keep=2),
        Step(I2cOp.LAST, RUNNING, compare=True),
        Step(I2cOp.STOP),
    ]
    parts = {"start_up": lambda plan: PAUSES, "frame": lambda plan: program, "I2cMaster": AnyPort}
    with mock.patch.multiple(mpr121_converter, **parts):
        dut = Mpr121Converter(PLAN)
        inside = opened_up(dut)
    free(dut.start)
    running, at, port = inside.running, inside.at, inside.master
    compared, end = len(PAUSES) + 2, len(PAUSES) + len(program)
    unlike = before(
        running & inside.issued & port.done & (at == compared) & (port.heard != RUNNING), "unlike_set_up"
    )
    told = before(Mux(dut.finished, dut.fault, 0), "told")
    good, code = before(dut.finished & ~dut.fault.any(), "good"), inside.electrodes[0].any()
    prove(~unlike | (told == ConverterFault.READBACK), "what does not read back is told")
    prove(~good | code, "a good frame has a code above 0")
    # ---- for the induction
    prove(~running | (at < end), "a step")
    prove(
        ~running | (at < len(PAUSES)) | (at >= compared) | ((inside.index == 0) & inside.low),
        "one electrode is read",
    )
    prove(~running | (at != compared) | inside.low | code, "low is the electrode's")
    prove(~running | (at <= compared) | inside.dead | code, "dead is the chip's")
    prove(~inside.expanding | inside.dead | code, "dead stays")
