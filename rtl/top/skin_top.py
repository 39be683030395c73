"""What goes onto a board that needs no host: converter, chain, decision pins, stimulator. The same on every target."""

from __future__ import annotations

from collections.abc import Mapping

from amaranth.hdl import Const, Module, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import Out

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.rtl.interface.stimulation import Stimulation, reset_settings
from eskin.rtl.interface.touch_position import TouchPosition
from eskin.rtl.top.board_top import reaches_pins
from eskin.rtl.top.sensing import Sensing


def refuse_standalone(config: AcceleratorConfig) -> None:
    """Refuse (InputError) what a board without a host cannot do."""
    if config.interface.converter == "none":
        raise InputError("--standalone: nothing delivers frames; add --converter NAME, or name one in the model's config.json")
    if config.opens_at_once:
        raise InputError(
            f"configuration '{config.name}', field onset: is 'immediate', whose one touch begins when a host arms it; "
            "a board without a host needs 'band' or 'baseline'"
        )


class SkinTop(wiring.Component):
    """`Sensing`, with what its configuration asks for of `TouchPosition` and `Stimulation`; frames are read from reset on.

    Parameters
    ----------
    images:
        Memory contents: the model is in the bitstream (``loadable`` false).
    clock_hz:
        Of the ``sync`` domain.

    Members
    -------
    pins : Out
        The converter's.
    decision : Out(classes), decision_valid : Out(1), unsure : Out(1)
        As of `eskin.rtl.top.board_top.BoardTop`.
    stim_tx : Out(1), only with a stimulator
        Its line, 115200 baud.
    led : Out(1)
        A frame was broken, or the chain's watchdog acted, since reset.

    """

    def __init__(self, config: AcceleratorConfig, images: Mapping[int, list[int]], *, clock_hz: float) -> None:
        self._config, self._clock_hz = config, clock_hz
        self.sensing = Sensing(config, images, clock_hz=clock_hz)
        super().__init__(
            {"pins": Out(self.sensing.pins.signature), "decision": Out(config.classes), "decision_valid": Out(1), "led": Out(1)}
            | ({"unsure": Out(1)} if config.network.margin_threshold else {})
            | ({"stim_tx": Out(1, init=1)} if config.interface.stimulator != "none" else {})
        )

    def elaborate(self, platform):
        m = Module()
        config, one = self._config, self._config.interface
        m.submodules.sensing = sensing = self.sensing
        wiring.connect(m, sensing.pins, wiring.flipped(self.pins))
        watching = sensing.accelerator.watching
        hung: Value = Const(0, 1) if watching is None else watching.hung
        wrong = Signal()
        m.d.comb += [sensing.run.eq(1), sensing.o.ready.eq(1), wrong.eq(sensing.broken | sensing.fault.any() | hung)]
        m.d.sync += self.led.eq(self.led | wrong)
        with m.If(sensing.o.valid & reaches_pins(config, sensing.o.p, self.decision_valid)):
            m.d.sync += [self.decision.eq(1 << sensing.o.p["class"]), self.decision_valid.eq(sensing.o.p.is_global)]
            if config.network.margin_threshold:
                m.d.sync += self.unsure.eq(sensing.o.p.unsure)
        if one.position:
            m.submodules.position = position = TouchPosition(config)
            m.d.comb += [
                position.i.valid.eq(sensing.frame.valid & sensing.frame.ready),
                position.i.payload.eq(sensing.frame.payload),
                position.clear.eq(sensing.broken),
            ]
        if one.stimulator != "none":
            m.submodules.stimulation = stimulation = Stimulation(config, self._clock_hz)
            m.d.comb += [stimulation.fault.eq(wrong), self.stim_tx.eq(stimulation.tx)]
            m.d.comb += [stimulation.settings[name].eq(value) for name, value in reset_settings(config).items()]
            if one.stimulator == "decisions":
                m.d.comb += [stimulation.decision.valid.eq(sensing.o.valid), stimulation.decision.payload.eq(sensing.o.payload)]
            else:
                m.d.comb += stimulation.position.eq(position.o)
        return m
