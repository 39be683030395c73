"""Top module of a board with its own sensors: converter, chain, decision pins, stimulator, and optionally a
link or a flash."""

from collections.abc import Mapping

from amaranth.hdl import Const, Module, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from eskin.golden.core import AcceleratorConfig, InputError
from eskin.rtl.host.control import bus_signature
from eskin.rtl.host.flash_loader import WAKE_S, FlashLoader, flash_pins
from eskin.rtl.host.uart import uart_divisor
from eskin.rtl.host.uart_link import UartLink
from eskin.rtl.interface.interface_registers import InterfaceRegisters
from eskin.rtl.interface.stimulation import Stimulation, reset_settings
from eskin.rtl.interface.touch_position import TouchPosition
from eskin.rtl.program.flash_image import design_number, write_count
from eskin.rtl.top.board_top import reaches_pins
from eskin.rtl.top.sensing import Sensing


def refuse_standalone(config: AcceleratorConfig) -> None:
    """Refuse (InputError) features that a board without a host cannot have."""
    if config.interface.converter.name == "none":
        raise InputError(
            "--standalone: there is no source of frames; add --converter NAME, or name one in the model's "
            "config.json"
        )
    if config.opens_at_once:
        raise InputError(
            f"configuration '{config.name}', field onset: is 'immediate', which needs a host to arm it; without a host, use 'band' or 'baseline'"
        )


class SkinTop(wiring.Component):
    """`Sensing`, with `TouchPosition` and `Stimulation` as configured, and one of four ways to get its model.

    - In the bitstream (``loadable`` false): frames are read from reset on.
    - Out of the board's flash (`FlashLoader`): frames are read from its ``done`` on; if it fails, never.
    - By a CPU behind a bus shell, as by the host of the next line.
    - By a host over `UartLink`: frames are read from its first ARM on. Decisions go onto the link, registers
      of position, faults and stimulator are accessed over it (`InterfaceRegisters`), and frames from the host
      are dropped.

    Parameters
    ----------
    images:
        Memory contents where the model is in the bitstream.
    clock_hz:
        Frequency of the ``sync`` domain.
    baud:
        Baud rate of the link; None: no link.
    flash:
        The model comes out of the board's flash. Not together with a link.
    shell:
        A bus shell stands in place of link and flash.

    Members
    -------
    pins : Out
        The converter's.
    decision : Out(classes), decision_valid : Out(1), unsure : Out(1)
        As of `eskin.rtl.top.board_top.BoardTop`.
    rx : In(1), tx : Out(1), only with a link
    flash : Out(flash_pins), only with a flash
    stim_tx : Out(1), only with a stimulator
        Its line, 115200 baud.
    bus : In, o : Out(stream of decision_layout), any_fault : Out(1), only with a shell
    led : Out(1)
        A frame was broken, the chain's watchdog acted, or the flash held no model, since reset.

    """

    def __init__(
        self,
        config: AcceleratorConfig,
        images: Mapping[int, list[int]] | None,
        *,
        clock_hz: float,
        baud: float | None = None,
        flash: bool = False,
        shell: bool = False,
    ) -> None:
        self._config, self._clock_hz, self._flash, self._shell = config, clock_hz, flash, shell
        self._divisor = uart_divisor(clock_hz, baud) if baud else None
        self.sensing = Sensing(config, images, clock_hz=clock_hz, fed_by="sensor" if shell else None)
        super().__init__(
            {
                "pins": Out(self.sensing.pins.signature),
                "decision": Out(config.classes),
                "decision_valid": Out(1),
                "led": Out(1),
            }
            | ({"unsure": Out(1)} if config.network.margin_threshold else {})
            | ({"stim_tx": Out(1, init=1)} if config.interface.stimulator != "none" else {})
            | ({"rx": In(1, init=1), "tx": Out(1, init=1)} if baud else {})
            | ({"flash": Out(flash_pins)} if flash else {})
            | (
                {"bus": In(bus_signature()), "o": Out(self.sensing.o.signature), "any_fault": Out(1)}
                if shell
                else {}
            )
        )

    def elaborate(self, platform):
        m = Module()
        config, interface = self._config, self._config.interface
        m.submodules.sensing = sensing = self.sensing
        wiring.connect(m, sensing.pins, wiring.flipped(self.pins))
        watching = sensing.accelerator.watching
        hung: Value = Const(0, 1) if watching is None else watching.hung
        unloaded: Value = Const(0, 1)
        wrong = Signal()
        taken = sensing.o.valid & sensing.o.ready
        registers = None
        if self._divisor or self._shell:
            m.submodules.registers = registers = InterfaceRegisters(config)
            wiring.connect(m, registers.inner, sensing.bus)
            m.d.comb += [registers.fault.eq(sensing.fault), sensing.run.eq(registers.armed)]
            if self._divisor:
                m.submodules.link = link = UartLink(config, self._divisor)
                wiring.connect(m, link.bus, registers.bus)
                wiring.connect(m, sensing.o, link.decision)
                m.d.comb += [link.rx.eq(self.rx), self.tx.eq(link.tx), link.frame.ready.eq(1)]
            else:
                wiring.connect(m, wiring.flipped(self.bus), registers.bus)
                wiring.connect(m, sensing.o, wiring.flipped(self.o))
                m.d.comb += self.any_fault.eq(sensing.accelerator.any_fault)
        elif self._flash:
            cycles = max(1, round(WAKE_S * self._clock_hz))
            m.submodules.loader = loader = FlashLoader(
                design_number(config), write_count(config), wake_cycles=cycles
            )
            wiring.connect(m, loader.bus, sensing.bus)
            wiring.connect(m, loader.pins, wiring.flipped(self.flash))
            unloaded = loader.failed
            m.d.comb += [sensing.run.eq(loader.done), sensing.o.ready.eq(1)]
        else:
            m.d.comb += [sensing.run.eq(1), sensing.o.ready.eq(1)]
        m.d.comb += wrong.eq(sensing.broken | sensing.fault.any() | hung | unloaded)
        m.d.sync += self.led.eq(self.led | wrong)
        with m.If(sensing.o.valid & reaches_pins(config, sensing.o.p, self.decision_valid)):
            m.d.sync += [
                self.decision.eq(1 << sensing.o.p["class"]),
                self.decision_valid.eq(sensing.o.p.is_global),
            ]
            if config.network.margin_threshold:
                m.d.sync += self.unsure.eq(sensing.o.p.unsure)
        if interface.position:
            m.submodules.position = position = TouchPosition(config)
            m.d.comb += [
                position.i.valid.eq(sensing.frame.valid & sensing.frame.ready),
                position.i.payload.eq(sensing.frame.payload),
                position.clear.eq(sensing.broken if registers is None else sensing.broken | registers.arm),
            ]
            if registers is not None:
                m.d.comb += registers.position.eq(position.o)
        if interface.stimulator != "none":
            m.submodules.stimulation = stimulation = Stimulation(config, self._clock_hz)
            m.d.comb += [stimulation.fault.eq(wrong), self.stim_tx.eq(stimulation.tx)]
            if registers is not None:
                m.d.comb += stimulation.settings.eq(registers.settings)
            else:
                m.d.comb += [
                    stimulation.settings[name].eq(value) for name, value in reset_settings(config).items()
                ]
            if interface.stimulator == "decisions":
                m.d.comb += [
                    stimulation.decision.valid.eq(taken),
                    stimulation.decision.payload.eq(sensing.o.payload),
                ]
            else:
                m.d.comb += stimulation.position.eq(position.o)
        return m
