"""What goes onto a board: accelerator, serial link, decision pins. The same on every target."""

from __future__ import annotations

from collections.abc import Mapping

from amaranth.hdl import Const, Module, Signal, Value
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from eskin.golden.core.config import AcceleratorConfig
from eskin.rtl.host.uart import uart_divisor
from eskin.rtl.host.uart_link import UartLink
from eskin.rtl.top.accelerator import Accelerator

BAUD = 2e6
"""16 taxels at 3 kHz need 1.14 Mbaud."""


def reaches_pins(config: AcceleratorConfig, decision: data.View, global_shown: Signal) -> Value:
    """High where the pins take a decision that is offered (of ``decision_layout``): always, but for the local ones after an early global
    one, until the next touch."""
    if config.network.decision != "early":
        return Const(1)
    return decision.is_global | ~global_shown | (decision.step == 0)


class BoardTop(wiring.Component):
    """The accelerator behind `UartLink`, in the ``sync`` domain.

    Parameters
    ----------
    images:
        As for `Accelerator`.
    clock_hz:
        Of the ``sync`` domain; default: the configuration's.
    baud:
        Of both lines.

    Members
    -------
    rx : In(1), tx : Out(1)
        Serial lines, idle high.
    decision : Out(classes)
        One-hot: the class of the latest decision, local or global; 0 before the first.
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
        self, config: AcceleratorConfig, images: Mapping[int, list[int]] | None = None, *, clock_hz: float | None = None, baud: float = BAUD
    ) -> None:
        self._config, self._images = config, images
        self._divisor = uart_divisor(clock_hz or config.hardware.clock_hz, baud)
        super().__init__(
            {"rx": In(1), "tx": Out(1, init=1), "decision": Out(config.classes), "decision_valid": Out(1), "led": Out(1)}
            | ({"unsure": Out(1)} if config.network.margin_threshold else {})
        )

    def elaborate(self, platform):
        m = Module()
        m.submodules.accelerator = accelerator = Accelerator(self._config, self._images)
        m.submodules.link = link = UartLink(self._config, self._divisor)
        wiring.connect(m, link.frame, accelerator.i)
        wiring.connect(m, accelerator.o, link.decision)
        wiring.connect(m, link.bus, accelerator.bus)
        pins = Signal.like(self.decision)
        m.d.comb += [link.rx.eq(self.rx), self.tx.eq(link.tx), self.led.eq(link.expected[6]), self.decision.eq(pins)]
        with m.If(accelerator.o.valid & reaches_pins(self._config, accelerator.o.p, self.decision_valid)):
            m.d.sync += [pins.eq(1 << accelerator.o.p["class"]), self.decision_valid.eq(accelerator.o.p.is_global)]
            if self._config.network.margin_threshold:
                m.d.sync += self.unsure.eq(accelerator.o.p.unsure)
        return m
