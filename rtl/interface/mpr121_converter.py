"""Frames from one or two MPR121: start-up, filtered data, cells between electrodes (docs/specification_interfaces.md
section 12)."""

from dataclasses import astuple, dataclass

from amaranth.hdl import Array, Module, Mux, Signal

from eskin.golden.core import ConverterFault
from eskin.golden.core.converters import mpr121
from eskin.golden.core.converters.mpr121 import FULL, MprPlan
from eskin.rtl.common import Block, drive, forward, outputs
from eskin.rtl.interface.converter_ports import converter_ports
from eskin.rtl.interface.i2c_master import I2C_PINS, I2cMaster, I2cOp


@dataclass(frozen=True)
class Step:
    """One operation on the bus. compare: the byte read must be ``byte``; keep: it is the lower (1) or upper
    (2) byte of an electrode; pause: cycles behind it."""

    op: I2cOp
    byte: int = 0
    compare: bool = False
    keep: int = 0
    pause: int = 0


def _message(address: int, *words: int, pause: int = 0) -> list[Step]:
    body = [Step(I2cOp.WRITE, word) for word in (address << 1, *words)]
    return [Step(I2cOp.START), *body, Step(I2cOp.STOP, pause=pause)]


def _reading(address: int, register: int, reads: list[Step]) -> list[Step]:
    head = [
        Step(I2cOp.START),
        Step(I2cOp.WRITE, address << 1),
        Step(I2cOp.WRITE, register),
        Step(I2cOp.START),
    ]
    return [*head, Step(I2cOp.WRITE, address << 1 | 1), *reads, Step(I2cOp.STOP)]


def start_up(plan: MprPlan) -> list[Step]:
    """Frees the bus (nine clocks and a stop), then sets up each chip."""
    steps = [Step(I2cOp.LAST), Step(I2cOp.START), Step(I2cOp.STOP)]
    for chip in range(plan.chips):
        address = mpr121.ADDRESS + chip
        steps += _message(address, mpr121.SOFT_RESET, mpr121.RESET_WORD, pause=plan.reset)
        steps += _message(address, mpr121.ECR, 0)
        steps += _reading(address, mpr121.CONFIG2, [Step(I2cOp.LAST, mpr121.CONFIG2_AT_RESET, compare=True)])
        steps += _message(address, mpr121.THRESHOLDS, *(mpr121.TOUCH, mpr121.RELEASE) * 12)
        charge, sampling = mpr121.SETTINGS
        steps += _message(address, mpr121.CONFIG1, charge, sampling | plan.interval)
        steps += _message(
            address, mpr121.ECR, mpr121.RUNNING, pause=plan.first if chip == plan.chips - 1 else 0
        )
    return steps


def frame(plan: MprPlan) -> list[Step]:
    """Reads the filtered data of each chip in one burst, and then whether it still runs."""
    steps: list[Step] = []
    for chip, count in enumerate(plan.electrodes):
        reads = [Step(I2cOp.READ, keep=1 + k % 2) for k in range(2 * count - 1)] + [Step(I2cOp.LAST, keep=2)]
        steps += _reading(mpr121.ADDRESS + chip, mpr121.FILTERED, reads)
        # Behind the data: a chip that lost its supply, or stopped, before or during them is in stop mode, and
        # only a set-up ends that.
        steps += _reading(mpr121.ADDRESS + chip, mpr121.ECR, [Step(I2cOp.LAST, mpr121.RUNNING, compare=True)])
    return steps


class Mpr121Converter(Block):
    """A burst from each chip, then the cells one a cycle, one frame a ``start``.

    After reset, and after any fault, the chips are set up again. No acknowledge is SILENT; a CONFIG2 that is
    not as after a reset, or an ECR that is not as written, is READBACK; upper bits that are not 0 are ORDER;
    a chip whose electrodes are all 0, or electrodes that are all at full scale, are STUCK.

    Members
    -------
    pins : Out
        `I2C_PINS`.

    The others: `converter_ports`.
    """

    def ports(self, plan: MprPlan):
        return outputs(pins=I2C_PINS) | converter_ports(plan.rows * plan.columns, mpr121.CODE_BITS + 1)

    def elaborate(self, platform):
        m = Module()
        plan, bits = self.spec, mpr121.CODE_BITS
        m.submodules.master = master = I2cMaster(plan.quarter)
        forward(m, self, master, "pins")
        setting_up, reading = start_up(plan), frame(plan)
        program = setting_up + reading
        at = Signal(range(len(program)))
        step = Step(*(Array(column)[at] for column in zip(*map(astuple, program), strict=True)))

        total = sum(plan.electrodes)
        electrodes = Array([Signal(bits, name=f"electrode{k}") for k in range(total)])
        lower = Signal(8)
        index = Signal(range(total))
        timer = Signal(range(max(plan.reset, plan.first) + 1))
        running = Signal(init=1)
        issued = Signal()
        expanding = Signal()
        fresh = Signal(init=1)  # in the start-up
        # low: this chip's electrodes; dead: a whole chip's
        wrong = Signal()
        low = Signal()
        dead = Signal()
        high = Signal()
        row = Signal(range(max(2, plan.rows)))
        column = Signal(range(max(2, plan.columns)))
        cell = Signal.like(self.put.place)
        drive(m, self, busy=running | expanding, away=fresh | ~running & ~expanding & (timer != 0))
        m.d.sync += timer.eq(timer - (timer != 0))

        # ---------------------------------------------------------------- cells
        across, _ = plan.lines
        direct = plan.chips == 2

        def line(place, first: int, count: int):
            mine = Array([electrodes[first + k] for k in range(count)])
            return mine[place] << 1 if direct else mine[place >> 1] + mine[(place + 1) >> 1]

        by_column, by_row = line(column, 0, across), line(row, across, total - across)
        last_column, last_row = column == plan.columns - 1, row == plan.rows - 1
        drive(
            m, self.put, valid=expanding, place=cell, code=FULL - Mux(by_row > by_column, by_row, by_column)
        )
        bad = Signal(len(self.fault))
        m.d.comb += bad.eq(
            Mux(wrong, int(ConverterFault.ORDER), 0) | Mux(dead | high, int(ConverterFault.STUCK), 0)
        )

        def begin(fault):
            """The start-up after a frame or step, with its fault."""
            drive(m, self, finished=1, fault=fault)
            m.d.sync += [running.eq(1), fresh.eq(1), at.eq(0), timer.eq(plan.reset)]

        with m.If(expanding):
            m.d.sync += [cell.eq(cell + 1), column.eq(Mux(last_column, 0, column + 1))]
            with m.If(last_column):
                m.d.sync += row.eq(row + 1)
            with m.If(last_column & last_row):
                m.d.sync += expanding.eq(0)
                with m.If(bad.any()):
                    begin(bad)
                with m.Else():
                    m.d.comb += self.finished.eq(1)
        with m.Elif(running):
            drive(m, master, op=step.op, byte=step.byte, start=(timer == 0) & ~issued)
            with m.If(master.start):
                m.d.sync += issued.eq(1)
            with m.Elif(master.idle):  # only after an upset: the operation that is waited for is not there
                m.d.sync += issued.eq(0)
            with m.If(master.done & issued):
                m.d.sync += [issued.eq(0), at.eq(at + 1), timer.eq(step.pause)]
                with m.If(step.keep == 1):
                    m.d.sync += lower.eq(master.heard)
                with m.If(step.keep == 2):
                    code = (master.heard << 8 | lower)[:bits]
                    m.d.sync += [
                        electrodes[index].eq(code),
                        index.eq(index + 1),
                        wrong.eq(wrong | master.heard[bits - 8 :].any()),
                        low.eq(low & ~code.any()),
                        high.eq(high & code.all()),
                    ]
                with m.If(step.compare):  # the last of a chip's steps
                    m.d.sync += [dead.eq(dead | low), low.eq(1)]
                with m.If(at == len(setting_up) - 1):
                    m.d.sync += [running.eq(0), fresh.eq(0)]
                with m.If(at == len(program) - 1):
                    m.d.sync += [running.eq(0), expanding.eq(1), row.eq(0), column.eq(0), cell.eq(0)]
                with m.If((step.op == I2cOp.WRITE) & ~master.acknowledged):
                    begin(int(ConverterFault.SILENT))
                with m.Elif(step.compare & (master.heard != step.byte)):
                    begin(int(ConverterFault.READBACK))
        with m.Elif(self.start & (timer == 0)):
            m.d.sync += [
                running.eq(1),
                at.eq(len(setting_up)),
                index.eq(0),
                wrong.eq(0),
                dead.eq(0),
                low.eq(1),
                high.eq(1),
            ]
        return m
