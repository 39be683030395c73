"""One byte, a start or a stop on an I2C bus (UM10204; docs/specification_interfaces.md section 12)."""

from enum import Enum

from amaranth.hdl import Cat, Module, Mux, Signal
from amaranth.lib import wiring
from amaranth.lib.cdc import FFSynchronizer
from amaranth.lib.wiring import In

from eskin.rtl.common import Block, drive, inputs, outputs

I2C_PINS = wiring.Signature(outputs("scl_low", "sda_low") | {"sda": In(1, init=1)})
"""Open drain: ``..._low`` pulls the wire low, otherwise its pull-up holds it high. This controller is the
only one on its bus, and no chip here stretches the clock, so SCL is not listened to."""


class I2cOp(Enum):
    """Commands to the controller. A byte is 8 bits and the acknowledge: the chip's after WRITE, ours after
    READ, none after LAST."""

    START = 0
    STOP = 1
    WRITE = 2
    READ = 3
    LAST = 4


class I2cMaster(Block):
    """Bits of four quarters: clock low with the old data, low with the new, high, high.

    START and STOP are bits too, in which the data line falls, or rises, in the middle of the clock's high
    half; START after a byte is a repeated start.

    Parameters
    ----------
    quarter:
        Cycles of a quarter of a bit, at least 3: SDA is looked at at the end of the third, after two
        flip-flops.

    Members
    -------
    start : In(1)
        Begin ``op``; only while ``idle``.
    op : In(I2cOp), byte : In(8)
        Taken with ``start``.
    idle : Out(1)
        Between operations; the lines stay as they are.
    done : Out(1)
        One cycle, the last of an operation: ``heard`` and ``acknowledged`` hold.
    heard : Out(8)
        Byte that was read.
    acknowledged : Out(1)
        SDA was low in the ninth bit.
    pins : Out
        `I2C_PINS`, from registers.

    START and STOP take 4 quarter + 1 cycles from ``start`` to ``idle``, a byte 36 quarter + 1. From any state
    of its registers it is idle after one byte's time at most.
    """

    def ports(self, quarter: int):
        return inputs("start", op=I2cOp, byte=8) | outputs(
            "idle", "done", "acknowledged", heard=8, pins=I2C_PINS
        )

    def elaborate(self, platform):
        m, quarter = Module(), self.spec
        pins = self.pins
        sda = Signal()
        m.submodules.synchroniser = FFSynchronizer(pins.sda, sda)
        timer = Signal(range(quarter))
        quarters = Signal(range(37))  # to go
        op = Signal(I2cOp)
        byte = Cat(1, self.byte)
        bits = Signal(len(byte))  # what goes out, high bits first; what comes in follows it
        over = timer == 0
        phase = 3 - (quarters - 1)[:2]  # 0..3 within a bit
        drive(m, self, idle=quarters == 0, done=(quarters == 1) & over, heard=bits[1:], acknowledged=~bits[0])
        with m.If(quarters == 0), m.If(self.start):
            is_bit = (self.op == I2cOp.START) | (self.op == I2cOp.STOP)
            m.d.sync += [op.eq(self.op), quarters.eq(Mux(is_bit, 4, 36)), timer.eq(quarter - 1)]
            with m.Switch(self.op):
                with m.Case(I2cOp.WRITE):
                    m.d.sync += bits.eq(byte)
                with m.Case(I2cOp.READ):
                    m.d.sync += bits.eq(~1)
                with m.Case(I2cOp.LAST):
                    m.d.sync += bits.eq(-1)
        with m.Elif(~over):
            m.d.sync += timer.eq(timer - 1)
        with m.Else():
            m.d.sync += [timer.eq(quarter - 1), quarters.eq(quarters - 1)]
            # what the lines do when a quarter ends
            with m.Switch(phase):
                with m.Case(0):
                    m.d.sync += pins.sda_low.eq(
                        Mux(op == I2cOp.START, 0, Mux(op == I2cOp.STOP, 1, ~bits[-1]))
                    )
                with m.Case(1):
                    m.d.sync += pins.scl_low.eq(0)
                with m.Case(2):
                    with m.If(op == I2cOp.START):
                        m.d.sync += pins.sda_low.eq(1)
                    with m.Elif(op == I2cOp.STOP):
                        m.d.sync += pins.sda_low.eq(0)
                    with m.Else():
                        m.d.sync += bits.eq(Cat(sda, bits))
                with m.Case(3):
                    m.d.sync += pins.scl_low.eq(op != I2cOp.STOP)
        return m
