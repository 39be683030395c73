"""A part that does nothing: its ports, for a bench that tests the wiring around it and plays its outputs by
hand."""

from amaranth.hdl import Module
from amaranth.lib import wiring


def forget(part: wiring.Component) -> None:
    """Say to Amaranth that ``part`` and its parts are made on purpose and never built."""
    part._MustUse__silence = True
    for inner in vars(part).values():
        if isinstance(inner, wiring.Component):
            forget(inner)


class Silent(wiring.Component):
    """The ports of ``part``, and ``attributes`` beside them; its outputs stay where the bench sets them."""

    def __init__(self, part: wiring.Component, **attributes) -> None:
        super().__init__(part.signature)
        forget(part)
        for name, value in attributes.items():
            setattr(self, name, value)

    def elaborate(self, platform):
        return Module()
