"""Frames from a matrix: an address, time to settle, one sample, cell after cell (docs/specification_interfaces.md
section 12)."""

from amaranth.hdl import Module, Mux, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from eskin.golden.core import ConverterFault
from eskin.golden.core.converters.matrix import MatrixPlan
from eskin.rtl.common import Block, drive, outputs
from eskin.rtl.interface.converter_ports import converter_ports
from eskin.rtl.interface.spi_master import SpiMaster


def matrix_pins(plan: MatrixPlan) -> wiring.Signature:
    """Addresses of the two multiplexers, and the converter's select, clock and data; with a plan that sleeps, what
    disables the multiplexers."""
    addresses = {"row": Out(range(max(2, plan.rows))), "column": Out(range(max(2, plan.columns)))}
    sleep = {"off": Out(1, init=1)} if plan.port.short else {}
    return wiring.Signature(
        addresses | {"cs_n": Out(1, init=1), "sclk": Out(1), "miso": In(1, init=1)} | sleep
    )


class MatrixConverter(Block):
    """All cells, row by row, one frame a ``start``. The address changes when the converter's transfer ends.
    At least ``plan.settle`` cycles later, select falls and the converter samples. With a plan that sleeps, a transfer
    whose code counts for nothing wakes the converter while the first cell settles, and behind the last a short
    transfer puts it to sleep.

    Checked are the bits that are 0 by the data sheet (ORDER), and whether all cells are at the same end of
    the range (STUCK): the amplifier's rest level must lie inside it.

    Members
    -------
    pins : Out
        `matrix_pins`; all from registers.

    The others: `converter_ports`. A frame takes ``plan.scan_cycles`` at most.
    """

    def ports(self, plan: MatrixPlan):
        return outputs(pins=matrix_pins(plan)) | converter_ports(
            plan.rows * plan.columns, plan.port.code_bits
        )

    def elaborate(self, platform):
        m = Module()
        plan, pins, chip = self.spec, self.pins, self.spec.port.chip
        m.submodules.master = master = SpiMaster(plan.port)
        drive(m, pins, cs_n=master.pins.cs_n, sclk=master.pins.sclk)
        m.d.comb += master.pins.miso.eq(pins.miso)
        settle = Signal(range(plan.settle + 1))
        settled = settle == 0
        converting = Signal()  # the transfer of this cell is under way
        cell = Signal.like(self.put.place)
        wrong = Signal()
        low = Signal(init=1)
        high = Signal(init=1)

        word = master.words[0]
        code = word[chip.code_bit : chip.code_bit + chip.code_bits]
        wrong_now, low_now, high_now = wrong | (word & chip.zeros != 0), low & ~code.any(), high & code.all()
        last_column, last_row = pins.column == plan.columns - 1, pins.row == plan.rows - 1
        taken = Signal()  # the word is there
        m.d.sync += [taken.eq(master.done & converting), settle.eq(settle - ~settled)]
        # transfers without a code, before and behind the cells
        waking, dozing = Signal(init=plan.port.waking), Signal()
        sleeps, ready, cell_over = plan.port.short > 0, settled, taken
        if sleeps:
            ready, cell_over = settled | waking | dozing, taken & ~waking & ~dozing
            m.d.comb += master.short.eq(dozing)
        m.d.comb += master.start.eq(self.busy & ready & ~converting)
        drive(m, self.put, valid=cell_over, place=cell, code=code)
        drive(
            m,
            self,
            finished=cell_over & last_column & last_row,
            fault=Mux(wrong_now, int(ConverterFault.ORDER), 0)
            | Mux(low_now | high_now, int(ConverterFault.STUCK), 0),
        )
        with m.If(master.start & master.idle):
            m.d.sync += converting.eq(1)
        with m.Elif(taken | master.idle):  # idle: only after an upset, with no transfer to wait for
            m.d.sync += converting.eq(0)
        with m.If(cell_over):
            m.d.sync += [
                cell.eq(cell + 1),
                settle.eq(plan.settle),
                wrong.eq(wrong_now),
                low.eq(low_now),
                high.eq(high_now),
                pins.column.eq(Mux(last_column, 0, pins.column + 1)),
            ]
            with m.If(last_column):
                m.d.sync += pins.row.eq(Mux(last_row, 0, pins.row + 1))
            with m.If(last_column & last_row):
                m.d.sync += dozing.eq(1) if sleeps else self.busy.eq(0)
        if sleeps:
            with m.Elif(taken):
                m.d.sync += waking.eq(0)
                with m.If(dozing):
                    m.d.sync += [self.busy.eq(0), pins.off.eq(1)]
            with m.If(self.start & ~self.busy):
                m.d.sync += [waking.eq(waking.init), dozing.eq(0), pins.off.eq(0)]
        with m.If(self.start & ~self.busy):
            m.d.sync += [
                self.busy.eq(1),
                *(signal.eq(signal.init) for signal in (converting, cell)),
                settle.eq(plan.settle),
                *(signal.eq(signal.init) for signal in (wrong, low, high, pins.row, pins.column)),
            ]
        return m
