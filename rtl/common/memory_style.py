"""What memories are made of: an ECP5's block memories need half of a cycle to give a word; a chip's memories begin with any word."""

from __future__ import annotations

from eskin.rtl.common.collisions import NO_COLLISION

LATE_BLOCKS = "ecp5"
"""The family whose block memories are that slow, as ``platform`` names it."""

CONFIGURED = ("ice40", "ecp5")
"""Families whose bitstream gives every word of every memory its first value, constants and working values alike."""


def begins_as_told(platform: str | None) -> bool:
    """True where constants may share a memory with working values, as it begins with them; elsewhere they are ROMs of their own."""
    return platform in CONFIGURED


def before_an_adder(platform: str | None) -> dict[str, int | str]:
    """Attributes of a small memory whose output an adder takes in the same cycle: a block memory; of LUTs where blocks are late."""
    return NO_COLLISION | {"ram_style": "distributed" if platform == LATE_BLOCKS else "block"}


def program_memory(platform: str | None) -> dict[str, int | str]:
    """Attributes of a program's memory, whose words steer everything: gates where blocks are late, else what Yosys likes."""
    return {"ram_style": "logic"} if platform == LATE_BLOCKS else {}
