"""Top module of a board: accelerator, serial link, decision pins. It is the same on every target."""

from collections.abc import Mapping
from typing import Literal

from amaranth.hdl import Const, Module, Signal, Value
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out
from amaranth.utils import ceil_log2

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.host.uart import uart_divisor
from eskin.rtl.host.uart_link import UartLink
from eskin.rtl.interface.interface_registers import InterfaceRegisters
from eskin.rtl.interface.touch_position import TouchPosition
from eskin.rtl.top.image_accelerator import make_accelerator

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


class BoardTop(wiring.Component):
    """The accelerator behind `UartLink`, in the ``sync`` domain; with ``position`` `TouchPosition` beside it,
    read as registers.

    Parameters
    ----------
    images:
        As for `Accelerator`.
    clock_hz:
        Frequency of the ``sync`` domain; default: the configuration's.
    baud:
        Baud rate of both lines.
    class_pins:
        As of `ClassPins`.

    Members
    -------
    rx : In(1), tx : Out(1)
        Serial lines, idle high.
    decision : Out(classes), or Out(ceil(log2(classes))) with ``class_pins`` binary
        The class of the latest decision, local or global: one-hot, or its index; 0 before the first.
    decision_valid : Out(1)
        That decision is a touch's global one: high from it until the next touch's first step.
    unsure : Out(1), only with ``margin_threshold``
        And its margin is below the threshold: no confident decision.
    led : Out(1)
        Toggles every 64 frames or writes that were accepted.

    Decisions reach the pins one cycle after they are offered, so before their packet is out.

    Raises
    ------
    InputError
        A baud rate that this clock cannot make.
    """

    def __init__(
        self,
        config: AcceleratorConfig,
        images: Mapping[int, list[int]] | None = None,
        *,
        clock_hz: float | None = None,
        baud: float = BAUD,
        class_pins: ClassPins = "each",
    ) -> None:
        self._config, self._images, self._class_pins = config, images, class_pins
        self._divisor = uart_divisor(clock_hz or config.hardware.clock_hz, baud)
        super().__init__(
            {"rx": In(1), "tx": Out(1, init=1), "decision_valid": Out(1), "led": Out(1)}
            | {"decision": Out(class_pin_count(config, class_pins))}
            | ({"unsure": Out(1)} if config.network.margin_threshold else {})
        )

    def elaborate(self, platform):
        m = Module()
        m.submodules.accelerator = accelerator = make_accelerator(self._config, self._images)
        m.submodules.link = link = UartLink(self._config, self._divisor)
        wiring.connect(m, link.frame, accelerator.i)
        wiring.connect(m, accelerator.o, link.decision)
        if self._config.interface.position:  # of the frames that the host sends
            m.submodules.position = position = TouchPosition(self._config)
            m.submodules.registers = registers = InterfaceRegisters(self._config.replace(converter="none"))
            wiring.connect(m, link.bus, registers.bus)
            wiring.connect(m, registers.inner, accelerator.bus)
            m.d.comb += [
                position.i.valid.eq(link.frame.valid & link.frame.ready),
                position.i.payload.eq(link.frame.payload),
                position.clear.eq(registers.arm),
                registers.position.eq(position.o),
            ]
        else:
            wiring.connect(m, link.bus, accelerator.bus)
        m.d.comb += [link.rx.eq(self.rx), self.tx.eq(link.tx), self.led.eq(link.expected[6])]
        with m.If(accelerator.o.valid & reaches_pins(self._config, accelerator.o.p, self.decision_valid)):
            m.d.sync += self.decision_valid.eq(accelerator.o.p.is_global)
            number = accelerator.o.p["class"]
            m.d.sync += self.decision.eq(number if self._class_pins == "binary" else 1 << number)
            if self._config.network.margin_threshold:
                m.d.sync += self.unsure.eq(accelerator.o.p.unsure)
        return m
