"""Source -> accelerator -> sink: the part of a board, or the module that a user's system takes; wiring only."""

from typing import Any, Literal

from amaranth.hdl import Const, Module, Signal, Value
from amaranth.lib import data, wiring
from amaranth.lib.wiring import Out
from amaranth.utils import ceil_log2

from eskin.golden.core import AcceleratorConfig, InputError, Record
from eskin.rtl.common import drive, forward, inputs, members_but, outputs
from eskin.rtl.host.axi4lite_front import Axi4LiteFront
from eskin.rtl.host.bus_shell import BusShell
from eskin.rtl.host.control import FedBy, bus_signature
from eskin.rtl.host.decision_queue import decision_word
from eskin.rtl.host.frame_sender import FrameSender
from eskin.rtl.host.uart import uart_divisor
from eskin.rtl.host.uart_link import UartLink
from eskin.rtl.host.wishbone_front import WishboneFront
from eskin.rtl.interface.interface_registers import InterfaceRegisters
from eskin.rtl.interface.stimulation import Stimulation, reset_settings
from eskin.rtl.interface.touch_position import TouchPosition
from eskin.rtl.program.memory_map import Images
from eskin.rtl.top.accelerator import Accelerator
from eskin.rtl.top.sensing import Sensing

BAUD = 2e6
"""16 taxels at 3 kHz need 1.14 Mbaud."""

ClassPins = Literal["each", "binary"]
"""Display of the latest class on pins: one pin per class, or its index as a number."""
Bus = Literal["wishbone", "axi4lite"]
"""Buses that there is a front for."""
FRONTS: Record = {"wishbone": WishboneFront, "axi4lite": Axi4LiteFront}
Source = Literal["host", "stream", "converter"]
"""Source of the frames: the host that sends the model, an AXI-Stream, or the configuration's converter."""
Host = Literal["link", "wishbone", "axi4lite"]
"""Sender of the model: a host over a `UartLink`, a CPU behind a `BusShell`."""

FRAMES = inputs("s_axis_tvalid", "s_axis_tlast", "s_axis_tuser", s_axis_tdata=16) | outputs("s_axis_tready")
DECISIONS = outputs("m_axis_tvalid", "m_axis_tlast", m_axis_tdata=32) | inputs("m_axis_tready")
INSIDE = ("bus", "frame", "words", "decision", "any_fault", "request", "expected")
"""Members of a host's parts that are no pins."""


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
            "`standalone`: there is no source of frames; add `converter` NAME, or name one in the model's "
            "config.json"
        )
    if config.opens_at_once:
        raise InputError(
            f"configuration '{config.name}', field onset: is 'immediate', which needs a host to arm it; without a host, "
            "use 'band' or 'baseline'"
        )


def refuse_slow_line(config: AcceleratorConfig, baud: float) -> None:
    """Refuse (InputError) a line on which a frame, a decision and an answer take longer than a frame lasts, nothing
    escaped."""
    needed = 10 * (2 * config.sensor.taxels + 24) * config.sensor.scan_rate_hz
    if needed > baud:
        raise InputError(
            f"configuration '{config.name}', field send_frames: {config.sensor.taxels} taxels "
            f"{config.sensor.scan_rate_hz:g} times a second need {needed:g} bit/s, and the link makes {baud:g}; set a "
            "larger scan_every, leave send_frames out, or take a faster clock for the link"
        )


class System(wiring.Component):
    """Source -> accelerator -> sink: frames of ``source``, the model of ``host``, decisions to the host. With a link or
    a converter decisions go onto pins too, and there are `TouchPosition` and `Stimulation` as configured.

    With a converter frames from a host are dropped, and frames are read

    - without a host (the model is in the bitstream, ``loadable`` false) from reset on,
    - otherwise from the host's first ARM on. It has registers of position, faults and stimulator
      (`InterfaceRegisters`).

    Parameters
    ----------
    images:
        As for `eskin.rtl.top.accelerator.Accelerator`.
    host:
        As of `Host`; None: nobody.
    source:
        As of `Source`. Default: the converter if the configuration has one, otherwise the host, or a stream if there is
        none. A stream without a host: decisions are an AXI-Stream, registers the accelerator's own bus.
    clock_hz:
        Frequency of the ``sync`` domain; default: the configuration's.
    baud:
        Baud rate of the link.
    class_pins:
        As of `ClassPins`.
    plan:
        Without a host: scans are started from outside, and the converter is read by this plan (`Sensing`).

    Members
    -------
    rx : In(1), tx : Out(1), only with a link
        Serial lines, idle high.
    The front's and irq : Out(1), only behind a bus
    s_axis_... : In, only with a stream
    m_axis_... : Out and bus : In, only with a stream and without a host
    busy : Out(1), only without class pins
    decision : Out(classes), or Out(ceil(log2(classes))) with ``class_pins`` binary
        The class of the latest decision, local or global: one-hot, or its index; 0 before the first.
    decision_valid : Out(1)
        That decision is a touch's global one: high from it until the next touch's first step.
    unsure : Out(1), only with ``margin_threshold``
        And its margin is below the threshold: no confident decision.
    led : Out(1)
        Toggles every 64 frames or writes that were accepted. With a converter: a frame was broken, or the chain's
        watchdog acted, since reset.
    pins : Out, only with a converter
        The converter's.
    scan : In(1), resting : Out(1), only with a ``plan``
        One cycle: a scan begins; nothing moves.
    stim_tx : Out(1), only with a converter and a stimulator
        Its line, 115200 baud.

    Decisions reach the pins one cycle after they are offered, so before their packet is out.

    Raises
    ------
    InputError
        A baud rate that this clock cannot make.
    """

    def __init__(
        self,
        config: AcceleratorConfig,
        images: Images | None = None,
        *,
        host: Host | None = "link",
        source: Source | None = None,
        clock_hz: float | None = None,
        baud: float = BAUD,
        class_pins: ClassPins = "each",
        plan: Any = None,
    ):
        self._config, self._clock_hz = config, clock_hz or config.hardware.clock_hz
        if source is None:
            by_host: Source = "host" if host else "stream"
            source = by_host if config.interface.converter.name == "none" else "converter"
        self._source, self._class_pins, self._started = source, class_pins, plan is not None
        self._sends_frames = host == "link" and source == "converter" and config.interface.send_frames
        if self._sends_frames:
            refuse_slow_line(config, baud)
        self._parts: Record = {}  # of the host; the last one has its bus
        fed_by: FedBy | None = None
        if host == "link":
            self._parts["link"] = UartLink(config, uart_divisor(self._clock_hz, baud), self._sends_frames)
        elif host:
            self._parts["front"] = FRONTS[host]()
            self._parts["shell"] = BusShell(config, samples=source == "host")
            fed_by = "cpu" if source == "host" else "sensor"
        self.core: Any
        ports: Record = outputs("busy") if host else inputs(bus=bus_signature()) | outputs("busy")
        if source == "converter" or host == "link":
            ports = outputs(decision=class_pin_count(config, class_pins), decision_valid=1, led=1)
            ports |= outputs("unsure") if config.network.margin_threshold else {}
        if source == "converter":
            self.core = Sensing(config, images, clock_hz=clock_hz, fed_by=fed_by, plan=plan)
            ports |= inputs("scan") | outputs("resting") if self._started else {}
            ports |= outputs(pins=self.core.pins.signature)
            ports |= {"stim_tx": Out(1, init=1)} if config.interface.stimulator != "none" else {}
        else:
            self.core = Accelerator(config, images, fed_by)
        if source == "stream":
            ports |= FRAMES if host else FRAMES | DECISIONS
        for part in self._parts.values():
            ports |= members_but(part, *INSIDE)
        super().__init__(ports)

    def elaborate(self, platform):
        m = Module()
        config, core, parts = self._config, self.core, self._parts
        sensing = self._source == "converter"
        m.submodules["sensing" if sensing else "accelerator"] = core
        for name, part in parts.items():
            m.submodules[name] = part
            forward(m, self, part, *members_but(part, *INSIDE))
        host: Any = parts.get("link", parts.get("shell"))  # sends writes and reads, takes decisions

        # ---------------------------------------------------------------- source
        if self._source == "stream":
            drive(m, core.i.p, sample=self.s_axis_tdata, first=self.s_axis_tuser, last=self.s_axis_tlast)
            m.d.comb += [core.i.valid.eq(self.s_axis_tvalid), self.s_axis_tready.eq(core.i.ready)]
        elif not sensing:
            wiring.connect(m, host.frame, core.i)
        elif "link" in parts:
            m.d.comb += host.frame.ready.eq(1)

        # ---------------------------------------------------------------- registers
        registers, bus = None, core.bus
        if host is not None and (sensing or ("link" in parts and config.interface.position)):
            # a host sends the frames: no converter
            own = config if sensing else config.replace(converter="none")
            m.submodules.registers = registers = InterfaceRegisters(own)
            wiring.connect(m, registers.inner, core.bus)
            bus = registers.bus
        if host is not None:
            wiring.connect(m, host.bus, bus)
        elif not sensing:
            wiring.connect(m, wiring.flipped(self.bus), bus)
        if "shell" in parts:
            wiring.connect(m, parts["front"].request, host.request)
            m.d.comb += host.any_fault.eq((core.accelerator if sensing else core).any_fault)

        # ---------------------------------------------------------------- sink
        if host is not None:
            wiring.connect(m, core.o, host.decision)
        elif sensing:
            m.d.comb += core.o.ready.eq(1)
        else:
            drive(
                m,
                self,
                m_axis_tdata=decision_word(config, core.o.p),
                m_axis_tlast=core.o.p.is_global,
                m_axis_tvalid=core.o.valid,
            )
            m.d.comb += core.o.ready.eq(self.m_axis_tready)
        if sensing or "link" in parts:
            self._show(m, registers)
        else:
            forward(m, self, core, "busy")
        return m

    def _show(self, m: Module, registers: InterfaceRegisters | None) -> None:
        """Class pins and lamp; position and stimulator, as configured."""
        config, core, parts = self._config, self.core, self._parts
        sensing = self._source == "converter"
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
            begun: Value = Const(1, 1) if registers is None else registers.armed
            if self._started:
                begun = self.scan
                m.d.comb += self.resting.eq(core.resting)
            m.d.comb += [core.run.eq(begun), wrong.eq(broken | core.fault.any() | hung)]
            m.d.sync += self.led.eq(self.led | wrong)
            if registers is not None:
                m.d.comb += registers.fault.eq(core.fault)
                if self._sends_frames:
                    m.submodules.sender = sender = FrameSender(config)
                    drive(m, sender, on=registers.sends, frame=core.frame, broken=core.broken)
                    wiring.connect(m, sender.o, parts["link"].words)
        else:
            m.d.comb += self.led.eq(parts["link"].expected[6])
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
                drive(m, stimulation.settings, **reset_settings(config))
            if config.interface.stimulator == "decisions":
                drive(m, stimulation.decision, valid=core.o.valid & core.o.ready, payload=core.o.payload)
            else:
                m.d.comb += stimulation.position.eq(position.o)
