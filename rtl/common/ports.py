"""Ports of components: declared, driven, forwarded to an owner."""

from typing import Any

from amaranth.hdl import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out


def inputs(*names: str) -> dict[str, wiring.Member]:
    """Inputs of one bit."""
    return {name: In(1) for name in names}


def outputs(*names: str) -> dict[str, wiring.Member]:
    """Outputs of one bit."""
    return {name: Out(1) for name in names}


def drive(m: Module, part: Any, **values: Any) -> None:
    """Drive ports of a part, or fields of a struct, each by the value of its name: ``part.name.eq(value)``."""
    m.d.comb += [getattr(part, name).eq(value) for name, value in values.items()]


def members_but(part: wiring.Component, *names: str) -> dict[str, wiring.Member]:
    """Members of ``part`` without those of these ``names``."""
    return {name: member for name, member in part.signature.members.items() if name not in names}


def forward(m: Module, owner: wiring.Component, part: wiring.Component, *names: str) -> None:
    """Wire members of ``part`` to those of the same names of ``owner``: ``names``, by default all that both have."""
    for name, member in part.signature.members.items():
        if name not in (names or owner.signature.members):
            continue
        mine, its = getattr(owner, name), getattr(part, name)
        if member.is_signature:
            wiring.connect(m, its, wiring.flipped(mine))
        else:
            m.d.comb += mine.eq(its) if member.flow is Out else its.eq(mine)
