"""Registers of the position, the converter's faults and the stimulator's settings."""

from amaranth.hdl import Cat, Module, Mux, Signal, Value
from amaranth.lib.wiring import Out

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import Block, drive, inputs, outputs, struct
from eskin.rtl.host.control import bus_signature
from eskin.rtl.interface.converter_ports import FAULT_BITS
from eskin.rtl.interface.stimulation import reset_settings
from eskin.rtl.interface.stimulator_frames import SETTINGS, settings_layout
from eskin.rtl.interface.touch_position import position_layout
from eskin.rtl.program.memory_map import Control, InterfaceRegister, Register, interface_registers


class InterfaceRegisters(Block):
    """Between the host and the accelerator's bus: takes the accesses to `InterfaceRegister`, hands on all
    others in the same cycle.

    Parameters
    ----------
    config:
        ``position``, ``converter`` and ``stimulator`` say which registers there are.

    Members
    -------
    bus : In
        The host's. ``r_data`` one cycle after ``r_stb``, as the accelerator's.
    inner : Out
        The accelerator's.
    armed : Out(1)
        ARM has been written since reset.
    arm : Out(1)
        It is being written.
    position : In(struct: valid, payload of position_layout), only with ``position``
    fault : In(bits of ConverterFault), only with a converter
    sends : Out(1), only with ``send_frames``
        The host wants frames.
    settings : Out(settings_layout), only with a converter and a stimulator
        As they were written; what the stimulator gets is limited behind this (`StimulatorFrames`). An
        amplitude above 255 is 255.
    """

    def ports(self, config: AcceleratorConfig):
        registers = interface_registers(config)
        return (
            inputs(bus=bus_signature())
            | outputs("armed", "arm", inner=bus_signature())
            | (inputs(position=struct("valid", payload=position_layout)) if config.interface.position else {})
            | (inputs(fault=FAULT_BITS) if InterfaceRegister.CONVERTER_FAULTS in registers else {})
            | (outputs("sends") if InterfaceRegister.FRAMES in registers else {})
            | (
                {"settings": Out(settings_layout, init=reset_settings(config))}
                if InterfaceRegister.STIM_WIDTH in registers
                else {}
            )
        )

    def elaborate(self, platform):
        m = Module()
        bus, inner, number_of = self.bus, self.inner, InterfaceRegister
        registers = interface_registers(self.spec)
        mine = Signal()
        was_mine = Signal()
        r_data = Signal(16)
        with m.Switch(bus.addr), m.Case(*map(int, registers)):
            m.d.comb += mine.eq(1)
        drive(m, inner, addr=bus.addr, w_data=bus.w_data, w_stb=bus.w_stb & ~mine, r_stb=bus.r_stb & ~mine)
        m.d.comb += bus.r_data.eq(Mux(was_mine, r_data, inner.r_data))
        command = bus.w_stb & (bus.addr == Register.CONTROL)
        arm = self.arm
        m.d.comb += arm.eq(command & (bus.w_data & Control.ARM).any())
        m.d.sync += self.armed.eq(self.armed | arm)
        readable: dict[InterfaceRegister, Value] = {}
        if number_of.POSITION in registers:
            last = Signal(position_layout)
            count = Signal.like(r_data)
            with m.If(self.position.valid):
                m.d.sync += [last.eq(self.position.payload), count.eq(count + 1)]
            with m.If(arm):
                m.d.sync += count.eq(0)
            readable |= {
                number_of.POSITION: Cat(last.x, last.y),
                number_of.POSITION_PEAK: Cat(last.peak, last.direction, last.ended),
            }
            readable[number_of.POSITIONS] = count
        if number_of.CONVERTER_FAULTS in registers:
            faults = Signal(FAULT_BITS)
            m.d.sync += faults.eq(faults | self.fault)
            with m.If(command & (bus.w_data & Control.CLEAR_FAULTS).any()):
                m.d.sync += faults.eq(self.fault)
            readable[number_of.CONVERTER_FAULTS] = faults
        if number_of.FRAMES in registers:
            readable[number_of.FRAMES] = self.sends
            with m.If(bus.w_stb & (bus.addr == int(number_of.FRAMES))):
                m.d.sync += self.sends.eq(bus.w_data[0])
        if number_of.STIM_WIDTH in registers:
            for name, bits in SETTINGS.items():
                number, setting = number_of[f"STIM_{name.upper()}"], getattr(self.settings, name)
                readable[number] = setting
                with m.If(bus.w_stb & (bus.addr == int(number))):
                    m.d.sync += setting.eq(Mux(bus.w_data[bits:].any(), ~0, bus.w_data))
        with m.If(bus.r_stb):
            m.d.sync += [was_mine.eq(mine), r_data.eq(0)]
            with m.Switch(bus.addr):
                for number, value in readable.items():
                    with m.Case(int(number)):
                        m.d.sync += r_data.eq(value)
        return m
