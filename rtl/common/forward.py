"""Ports of a part that are its owner's, too."""

from amaranth.hdl import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import Out


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
