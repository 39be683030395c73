"""Top module of a board: chain, link, decision pins; or, with its own sensors, converter and stimulator too. It is the
same on every target."""

from typing import Any, Literal

from amaranth.hdl import Const, Module, Signal, Value
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out
from amaranth.utils import ceil_log2

from eskin.golden.core import AcceleratorConfig, InputError
from eskin.rtl.common import drive, forward, outputs
from eskin.rtl.host.control import bus_signature
from eskin.rtl.host.flash_loader import WAKE_S, FlashLoader, flash_pins
from eskin.rtl.host.uart import uart_divisor
from eskin.rtl.host.uart_link import UartLink
from eskin.rtl.interface.interface_registers import InterfaceRegisters
from eskin.rtl.interface.stimulation import Stimulation, reset_settings
from eskin.rtl.interface.touch_position import TouchPosition
from eskin.rtl.program.flash_image import design_number, write_count
from eskin.rtl.program.memory_map import Images
from eskin.rtl.top.accelerator import Accelerator
from eskin.rtl.top.sensing import Sensing

BAUD = 2e6
"""16 taxels at 3 kHz need 1.14 Mbaud."""

ClassPins = Literal["each", "binary"]
"""Display of the latest class on pins: one pin per class, or its index as a number."""


def class_pin_count(config: AcceleratorConfig, class_pins: ClassPins) -> int:
    """Pins that show the class."""
    return config.classes if class_pins == "each" else ceil_log2(config.classes)


def reaches_pins(config: AcceleratorConfig, decision: data.View, global_shown: Signal) -> Value:
    """High where the pins show the offered decision (of ``decision_layout``).

    They show every decision except local ones that follow an early global one in the same touch.
    """
    if config.network.decision != "early":
        return Const(1)
    return decision.is_global | ~global_shown | (decision.step == 0)


def refuse_standalone(config: AcceleratorConfig) -> None:
    """Refuse (InputError) features that a board without a host cannot have."""
    if config.interface.converter.name == "none":
        raise InputError(
            "--standalone: there is no source of frames; add --converter NAME, or name one in the model's "
            "config.json"
        )
    if config.opens_at_once:
        raise InputError(
            f"configuration '{config.name}', field onset: is 'immediate', which needs a host to arm it; without a host, "
            "use 'band' or 'baseline'"
        )


class Board(wiring.Component):
    """Source -> chain -> sinks: frames over a `UartLink` into the accelerator, or `Sensing`; decisions on pins and to
    who sends the model; `TouchPosition` and `Stimulation` beside them as configured.

    With ``sensing`` frames from a host are dropped, and there are four ways to get the model.

    - In the bitstream (``loadable`` false): frames are read from reset on.
    - Out of the board's flash (`FlashLoader`): frames are read from its ``done`` on; if it fails, never.
    - By a CPU behind a bus shell, as by the host of the next line.
    - By a host over the link: frames are read from its first ARM on. Decisions go onto the link, registers of position,
      faults and stimulator are accessed over it (`InterfaceRegisters`).

    Parameters
    ----------
    images:
        As for `eskin.rtl.top.accelerator.Accelerator`.
    clock_hz:
        Frequency of the ``sync`` domain; default: the configuration's.
    baud:
        Baud rate of the link; None: no link.
    class_pins:
        As of `ClassPins`.
    sensing:
        Frames come from the configuration's converter.
    flash, shell:
        In place of the link: the model comes out of the board's flash; a bus shell is around it.

    Members
    -------
    rx : In(1), tx : Out(1), only with a link
        Serial lines, idle high.
    decision : Out(classes), or Out(ceil(log2(classes))) with ``class_pins`` binary
        The class of the latest decision, local or global: one-hot, or its index; 0 before the first.
    decision_valid : Out(1)
        That decision is a touch's global one: high from it until the next touch's first step.
    unsure : Out(1), only with ``margin_threshold``
        And its margin is below the threshold: no confident decision.
    led : Out(1)
        Toggles every 64 frames or writes that were accepted. With ``sensing``: a frame was broken, the chain's watchdog
        acted, or the flash held no model, since reset.
    pins : Out, only with ``sensing``
        The converter's.
    stim_tx : Out(1), only with a stimulator
        Its line, 115200 baud.
    flash : Out(flash_pins), only with a flash
    bus : In, o : Out(stream of decision_layout), any_fault : Out(1), only with a shell

    Decisions reach the pins one cycle after they are offered, so before their packet is out.

    Raises
    ------
    InputError
        A baud rate that this clock cannot make; a flash together with a link or a shell: both would drive the
        bus.
    """

    def __init__(
        self,
        config: AcceleratorConfig,
        images: Images | None = None,
        *,
        clock_hz: float | None = None,
        baud: float | None = BAUD,
        class_pins: ClassPins = "each",
        sensing: bool = False,
        flash: bool = False,
        shell: bool = False,
    ):
        if flash and (baud or shell):
            raise InputError(
                "flash: the model comes from the flash or from a host; leave out flash, or link and shell"
            )
        self._config, self._clock_hz = config, clock_hz or config.hardware.clock_hz
        self._class_pins, self._sensing, self._flash, self._shell = class_pins, sensing, flash, shell
        self._divisor = uart_divisor(self._clock_hz, baud) if baud else None
        self.core: Any
        if sensing:
            self.core = Sensing(config, images, clock_hz=clock_hz, fed_by="sensor" if shell else None)
        else:
            self.core = Accelerator(config, images)
        stimulates = sensing and config.interface.stimulator != "none"
        shelled = {"bus": In(bus_signature()), "o": Out(self.core.o.signature), "any_fault": Out(1)}
        super().__init__(
            outputs(decision=class_pin_count(config, class_pins), decision_valid=1, led=1)
            | ({"rx": In(1, init=1), "tx": Out(1, init=1)} if baud else {})
            | (outputs("unsure") if config.network.margin_threshold else {})
            | (outputs(pins=self.core.pins.signature) if sensing else {})
            | ({"stim_tx": Out(1, init=1)} if stimulates else {})
            | (outputs(flash=flash_pins) if flash else {})
            | (shelled if shell else {})
        )

    def elaborate(self, platform):
        m = Module()
        config, core, sensing = self._config, self.core, self._sensing
        m.submodules["sensing" if sensing else "accelerator"] = core
        link, registers, host = None, None, core.bus
        if (self._divisor or self._shell) if sensing else config.interface.position:
            # a host sends the frames: no converter
            own = config if sensing else config.replace(converter="none")
            m.submodules.registers = registers = InterfaceRegisters(own)
            wiring.connect(m, registers.inner, core.bus)
            host = registers.bus
        unloaded: Value = Const(0, 1)
        begun: Value = Const(1, 1) if registers is None or not sensing else registers.armed
        if self._divisor:
            m.submodules.link = link = UartLink(config, self._divisor)
            wiring.connect(m, link.bus, host)
            wiring.connect(m, core.o, link.decision)
            m.d.comb += [link.rx.eq(self.rx), self.tx.eq(link.tx)]
        elif self._shell:
            wiring.connect(m, wiring.flipped(self.bus), host)
            forward(m, self, core, "o")
            m.d.comb += self.any_fault.eq(core.accelerator.any_fault)
        else:
            m.d.comb += core.o.ready.eq(1)
        if self._flash:
            cycles = max(1, round(WAKE_S * self._clock_hz))
            m.submodules.loader = loader = FlashLoader(
                design_number(config), write_count(config), wake_cycles=cycles
            )
            wiring.connect(m, loader.bus, core.bus)
            wiring.connect(m, loader.pins, wiring.flipped(self.flash))
            begun, unloaded = loader.done, loader.failed
        with m.If(core.o.valid & reaches_pins(config, core.o.p, self.decision_valid)):
            number = core.o.p["class"]
            m.d.sync += [
                self.decision.eq(number if self._class_pins == "binary" else 1 << number),
                self.decision_valid.eq(core.o.p.is_global),
            ]
            if config.network.margin_threshold:
                m.d.sync += self.unsure.eq(core.o.p.unsure)
        frame: Any = core.frame if sensing else core.i
        broken, wrong = core.broken if sensing else Const(0, 1), Signal()
        if sensing:
            forward(m, self, core, "pins")
            watching = core.accelerator.watching
            hung: Value = Const(0, 1) if watching is None else watching.hung
            m.d.comb += [core.run.eq(begun), wrong.eq(broken | core.fault.any() | hung | unloaded)]
            m.d.sync += self.led.eq(self.led | wrong)
            if link is not None:
                m.d.comb += link.frame.ready.eq(1)
            if registers is not None:
                m.d.comb += registers.fault.eq(core.fault)
        elif link is not None:
            wiring.connect(m, link.frame, core.i)
            m.d.comb += self.led.eq(link.expected[6])
        position: Any = None
        if config.interface.position:
            m.submodules.position = position = TouchPosition(config)
            drive(m, position.i, valid=frame.valid & frame.ready, payload=frame.payload)
            m.d.comb += position.clear.eq(broken if registers is None else broken | registers.arm)
            if registers is not None:
                m.d.comb += registers.position.eq(position.o)
        if sensing and config.interface.stimulator != "none":
            m.submodules.stimulation = stimulation = Stimulation(config, self._clock_hz)
            m.d.comb += [stimulation.fault.eq(wrong), self.stim_tx.eq(stimulation.tx)]
            if registers is not None:
                m.d.comb += stimulation.settings.eq(registers.settings)
            else:
                m.d.comb += [
                    stimulation.settings[name].eq(value) for name, value in reset_settings(config).items()
                ]
            if config.interface.stimulator == "decisions":
                drive(m, stimulation.decision, valid=core.o.valid & core.o.ready, payload=core.o.payload)
            else:
                m.d.comb += stimulation.position.eq(position.o)
        return m
