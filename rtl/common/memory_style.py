"""Implementation of memories where it depends on the target.

An ECP5's block memories take half a cycle to deliver a word. An iCE40 UP5K has few block memories, and four
large ones of 16384 words of 16 bits with a single port, which only the host can fill. A chip's memories power
up with arbitrary contents.
"""

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common.collisions import NO_COLLISION
from eskin.rtl.common.layouts import expands

LATE_BLOCKS = "ecp5"
"""The family whose block memories are that slow, as ``platform`` names it."""

CONFIGURED = ("ice40", "ecp5", "gowin")
"""Families whose bitstream gives every word of every memory its first value, constants and working values
alike."""


CHIP = "chip"
"""Value of ``platform`` in the netlist of a chip."""


def begins_as_told(platform: str | None) -> bool:
    """True where constants may share a memory with working values, as it begins with them; elsewhere they are
    ROMs of their own."""
    return platform in CONFIGURED


def before_an_adder(platform: str | None) -> dict[str, int | str]:
    """Attributes of a small memory whose output an adder takes in the same cycle: a block memory; of LUTs
    where blocks are late."""
    return NO_COLLISION | {"ram_style": "distributed" if platform == LATE_BLOCKS else "block"}


def program_memory(platform: str | None) -> dict[str, int | str]:
    """Attributes of a program's memory, whose words control everything: gates where blocks are late,
    otherwise Yosys' choice."""
    return {"ram_style": "logic"} if platform == LATE_BLOCKS else {}


SMALL_FAMILY, LARGE_MEMORIES, LARGE_WORDS = "ice40", 4, 1 << 14
"""The family whose part with multipliers has large memories: their number and words."""

FEW_WORDS = 6
"""Largest memory, in words, that is made of flip-flops where block memories are short."""


def short_of_blocks(config: AcceleratorConfig, platform: str | None) -> bool:
    """True if a design saves block memories at the cost of some logic cells.

    Only on an iCE40 UP5K (DSP lanes): with ``spare_blocks``, with kinds of feature beyond the mean, or with
    separate weights for every window.
    """
    spares = config.hardware.spare_blocks or expands(config) or config.sets > 1
    return platform == SMALL_FAMILY and config.hardware.lane_type == "dsp" and spares


def addends_memory(config: AcceleratorConfig, platform: str | None) -> dict[str, int | str]:
    """Attributes of the addends' memories. As constants that nothing writes they would become LUTs, some 80
    of them, where a part with multipliers has block memories left."""
    small = platform == SMALL_FAMILY and config.hardware.lane_type == "dsp"
    return NO_COLLISION | ({"ram_style": "block"} if small and not short_of_blocks(config, platform) else {})


def lanes_in_large_memories(config: AcceleratorConfig, platform: str | None, words: int) -> int:
    """Number of lanes, from the first on, whose ``words`` weights lie in a large memory."""
    spared = short_of_blocks(config, platform) and config.hardware.loadable and words <= LARGE_WORDS
    return min(config.hardware.lanes, LARGE_MEMORIES - config.has_prototypes) if spared else 0


def prototypes_memory(config: AcceleratorConfig, platform: str | None, words: int) -> dict[str, int | str]:
    """Attributes of the memory of prototypes, which has one port: a large memory where there is one."""
    large = platform == SMALL_FAMILY and config.hardware.lane_type == "dsp" and words <= LARGE_WORDS
    return NO_COLLISION | {"ram_style": "huge" if large else "block"}


def means_memory(config: AcceleratorConfig, platform: str | None, words: int) -> dict[str, int | str]:
    """Attributes of the memory of the means; an adder takes its output."""
    few = short_of_blocks(config, platform) and words <= FEW_WORDS
    return NO_COLLISION | {"ram_style": "logic"} if few else before_an_adder(platform)
