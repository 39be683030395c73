"""Stimulation: the stimulator's line from decisions or positions, wiring only (docs/specification_interfaces.md section
14)."""

import math

from amaranth.hdl import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import decision_layout, drive, forward, inputs, outputs, struct
from eskin.rtl.host.uart import UartTransmitter, uart_divisor
from eskin.rtl.interface.stimulator_frames import SETTINGS, StimulatorFrames, settings_layout
from eskin.rtl.interface.stimulus import Stimulus
from eskin.rtl.interface.touch_position import position_layout

STIMULATOR_BAUD = 115200


def reset_settings(config: AcceleratorConfig) -> dict[str, int]:
    """Settings after a reset."""
    return {name: getattr(config.interface, f"stim_{name}") for name in SETTINGS}


class Stimulation(wiring.Component):
    """Stimulus -> StimulatorFrames -> UartTransmitter.

    Parameters
    ----------
    clock_hz:
        Frequency of the ``sync`` domain; it must make 115200 baud within 2 %.

    Members
    -------
    decision or position : In
        As of `Stimulus`.
    fault : In(1)
        Anything is wrong: the request is taken back and OFF follows.
    settings : In(settings_layout)
    tx : Out(1)
        The stimulator's line.
    on : Out(1)
        As of `StimulatorFrames`.
    """

    def __init__(self, config: AcceleratorConfig, clock_hz: float):
        interface = config.interface
        self._config, self._divisor = config, uart_divisor(clock_hz, STIMULATOR_BAUD)
        self._hold, self._on = (
            max(1, math.floor(seconds * clock_hz)) for seconds in (interface.hold_s, interface.on_limit_s)
        )
        name, layout = (
            ("decision", decision_layout(config))
            if interface.stimulator == "decisions"
            else ("position", position_layout)
        )
        self._name = name
        super().__init__(
            inputs("fault", settings=settings_layout)
            | outputs("on")
            | {name: In(struct("valid", payload=layout)), "tx": Out(1)}
        )

    def elaborate(self, platform):
        m = Module()
        m.submodules.stimulus = stimulus = Stimulus(self._config, self._hold)
        m.submodules.frames = frames = StimulatorFrames(self._config.interface, self._on)
        m.submodules.transmitter = transmitter = UartTransmitter(self._divisor)
        wiring.connect(m, frames.byte, transmitter.i)
        forward(m, self, stimulus, self._name)
        forward(m, self, frames, "fault", "settings", "on")
        forward(m, self, transmitter, "tx")
        m.d.comb += stimulus.clear.eq(self.fault)
        drive(m, frames, request=stimulus.request, electrode=stimulus.electrode)
        return m
