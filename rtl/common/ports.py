"""Ports and structs of components: declared, driven, forwarded to an owner."""

from collections.abc import Sequence
from typing import Any

from amaranth.hdl import Module, Value
from amaranth.hdl._ir import PortDirection
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out


def inputs(*bits: str, **shapes: Any) -> dict[str, wiring.Member]:
    """Inputs by name: of one bit; of a shape or signature."""
    return {name: In(shape) for name, shape in (dict.fromkeys(bits, 1) | shapes).items()}


def outputs(*bits: str, **shapes: Any) -> dict[str, wiring.Member]:
    """Outputs by name: of one bit; of a shape or signature."""
    return {name: Out(shape) for name, shape in (dict.fromkeys(bits, 1) | shapes).items()}


def struct(*bits: str, **shapes: Any) -> data.StructLayout:
    """Fields in this order, the first in the lowest bits: of one bit; of a shape."""
    return data.StructLayout(dict.fromkeys(bits, 1) | shapes)


class Block(wiring.Component):
    """A component made of one thing, its ``spec``: a configuration, a plan, a number; ``ports`` gives its members."""

    def __init__(self, spec: Any):
        self.spec = spec
        super().__init__(self.ports(spec))

    def ports(self, spec: Any) -> dict[str, wiring.Member]:
        """The members by name."""
        raise NotImplementedError


def drive(m: Module, part: Any, **values: Any) -> None:
    """Drive ports of a part, or fields of a struct, each by the value of its name: ``part.name.eq(value)``."""
    m.d.comb += [getattr(part, name).eq(value) for name, value in values.items()]


def members_but(part: wiring.Component, *names: str) -> dict[str, wiring.Member]:
    """Members of ``part`` without these ``names``."""
    return {name: member for name, member in part.signature.members.items() if name not in names}


def bare(
    design: wiring.Component, hidden: Sequence[str]
) -> tuple[Module, dict[str, tuple[Value, PortDirection]]]:
    """A module around ``design``, and the ports that it has as a top, by name: the ports of ``design`` whose names begin with
    none of ``hidden``. A hidden input keeps its reset value."""
    m = Module()
    m.submodules.accelerator = design
    directions = {In: PortDirection.Input, Out: PortDirection.Output}
    ports = {
        "__".join(map(str, path)): (Value.cast(value), directions[member.flow])
        for path, member, value in design.signature.flatten(design)
    }
    return m, {name: port for name, port in ports.items() if not name.startswith(tuple(hidden))}


def forward(m: Module, owner: wiring.Component, part: wiring.Component, *names: str) -> None:
    """Wire members of ``part`` to the members of ``owner`` with the same names: ``names``, by default all that both have."""
    for name, member in part.signature.members.items():
        if name not in (names or owner.signature.members):
            continue
        mine, its = getattr(owner, name), getattr(part, name)
        if member.is_signature:
            wiring.connect(m, its, wiring.flipped(mine))
        else:
            m.d.comb += mine.eq(its) if member.flow is Out else its.eq(mine)
