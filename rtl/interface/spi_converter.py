"""A frame from SPI converters: every channel is read in turn and checked (docs/specification_interfaces.md section
12)."""

from amaranth.hdl import Array, Cat, Const, Module, Mux, Signal
from amaranth.lib import wiring

from eskin.golden.core import ConverterFault, SpiPlan
from eskin.rtl.common import drive, forward, outputs
from eskin.rtl.interface.converter_ports import converter_ports
from eskin.rtl.interface.spi_master import SpiMaster, spi_pins


class SpiConverter(wiring.Component):
    """All channels of ``plan.lines * plan.selects`` chips, one frame a ``start``.

    A frame takes ``len(plan.transfers)`` times (`SpiMaster`'s transfer + lines + 2) cycles. Checked are the
    channel's number and the bits that are 0 by the data sheet (ORDER), and for each chip whether all its
    codes are at the same end of their range (STUCK); chips with a single channel are judged together, because
    one saturated taxel is no fault. With a plan whose chips sleep, some transfers have no code.

    Members
    -------
    pins : Out
        `eskin.rtl.interface.spi_master.spi_pins`.

    The others: `converter_ports`.
    """

    def __init__(self, plan: SpiPlan, taxels: int):
        self._plan, self._taxels = plan, taxels
        super().__init__(
            outputs(pins=spi_pins(plan.lines, plan.selects)) | converter_ports(taxels, plan.code_bits)
        )

    def elaborate(self, platform):
        m = Module()
        plan, chip = self._plan, self._plan.chip
        m.submodules.master = master = SpiMaster(plan)
        forward(m, self, master, "pins")

        count, per_select = len(plan.transfers), plan.per_select
        transfer = Signal(range(count))
        line = Signal(range(max(2, plan.lines)))
        step = Signal(range(per_select))  # of the transfers of one select
        group = Signal(range(max(2, plan.selects)))
        handing = Signal()  # the codes of the transfer that has ended are forwarded, a line a cycle
        begin = Signal()
        commands = Array([Const(command, chip.bits) for _, command in plan.transfers[:per_select]])
        drive(m, master, start=begin, select=group, command=commands[step])
        if plan.short:
            m.d.comb += master.short.eq(step == per_select - 1)

        word = Signal(chip.bits)
        m.d.comb += word.eq(Array(list(master.words))[line])
        code = word[chip.code_bit : chip.code_bit + chip.code_bits]
        counted = step >= plan.first  # before that, data of commands of the frame before
        if plan.short:
            counted &= step != per_select - 1
        channel = Signal(range(max(2, chip.channels)))
        m.d.comb += channel.eq(step - plan.first)
        drive(
            m,
            self.put,
            valid=handing & counted,
            code=code,
            place=(group * plan.lines + line) * chip.channels + channel,
        )

        # ---------------------------------------------------------------- its faults
        judged = plan.lines if chip.channels > 1 else 1
        wrong = Signal()
        low = Signal(judged, init=-1)
        high = Signal(judged, init=-1)
        stuck_before = Signal()  # of the chips of a select that is done
        is_wrong = word & chip.zeros != 0
        if chip.tag_bits:
            is_wrong = is_wrong | (word[chip.tag_bit : chip.tag_bit + chip.tag_bits] != channel)
        mine = Cat(line == k for k in range(judged)) if judged > 1 else Const(1, 1)
        some, full = code.any(), code.all()
        if plan.short:  # the last word has no code
            some, full = some & counted, full | ~counted
        low_now, high_now = low & ~Mux(some, mine, 0), high & ~Mux(full, 0, mine)
        stuck_now = (low_now | high_now).any()
        with m.If(self.put.valid):
            m.d.sync += [wrong.eq(wrong | is_wrong), low.eq(low_now), high.eq(high_now)]

        # ---------------------------------------------------------------- the course of a frame
        end_of_lines = line == plan.lines - 1
        end_of_group = step == per_select - 1
        end = transfer == count - 1
        m.d.comb += begin.eq(self.busy & master.idle & ~handing)
        with m.If(master.done & self.busy):
            m.d.sync += [handing.eq(1), line.eq(0)]
        with m.If(handing):
            m.d.sync += line.eq(line + 1)
            with m.If(end_of_lines):
                m.d.sync += [handing.eq(0), transfer.eq(transfer + 1), step.eq(step + 1)]
                with m.If(end_of_group):
                    m.d.sync += [step.eq(0), group.eq(group + 1)]
                    if chip.channels > 1:
                        m.d.sync += [stuck_before.eq(stuck_before | stuck_now), low.eq(-1), high.eq(-1)]
                with m.If(end):
                    m.d.sync += self.busy.eq(0)
                    m.d.comb += self.finished.eq(1)
        m.d.comb += self.fault.eq(
            Mux(wrong | is_wrong & counted, int(ConverterFault.ORDER), 0)
            | Mux(stuck_before | stuck_now, int(ConverterFault.STUCK), 0)
        )
        with m.If(self.start & ~self.busy):
            m.d.sync += [
                *(
                    signal.eq(signal.init)
                    for signal in (transfer, step, group, handing, wrong, low, high, stuck_before)
                ),
                self.busy.eq(1),
            ]
        return m
