"""Open-drain pins of a part around a design that pulls wires low or lets them go."""

from amaranth.hdl import Const, IOBufferInstance, IOPort, Module
from amaranth.lib import wiring

from eskin.rtl.common import Block, forward, members_but


class OpenDrain(Block):
    """``inner`` with the pins ``scl`` and ``sda`` in place of its port ``pins`` (`I2C_PINS`); its other ports
    as they are.

    Each pin is a buffer whose output is a constant 0 and whose enable is the pull: no state of the design
    drives it high.
    """

    def ports(self, inner: wiring.Component):
        return members_but(inner, "pins")

    def elaborate(self, platform):
        m = Module()
        m.submodules.inner = inner = self.spec
        forward(m, self, inner)
        low = Const(0, 1)
        m.submodules.scl = IOBufferInstance(IOPort(1, name="scl"), o=low, oe=inner.pins.scl_low)
        m.submodules.sda = IOBufferInstance(
            IOPort(1, name="sda"), i=inner.pins.sda, o=low, oe=inner.pins.sda_low
        )
        return m
