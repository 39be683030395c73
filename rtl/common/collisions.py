"""Memories in which no word is read in the cycle that writes it.

Amaranth defines the result of a read that collides with a write. Block memories do not, so synthesis adds
comparators and bypasses. A memory with `NO_COLLISION` has none of them: its owner never reads and writes a
word in one cycle, or never uses the result.
"""

import re
from collections.abc import Callable
from typing import Any

from amaranth.hdl import Module
from amaranth.lib.memory import Memory, ReadPort, WritePort

NO_COLLISION = {"no_rw_check": 1}
"""Attribute of such a memory; Yosys knows it in Verilog too."""


def working_memory(
    m: Module, name: str, shape: Any, depth: int, attrs: dict = NO_COLLISION, granularity: int | None = None
) -> tuple[ReadPort, WritePort]:
    """Ports of a new memory of working values, submodule ``name``."""
    m.submodules[name] = memory = Memory(shape=shape, depth=depth, init=[], attrs=attrs)
    read, write = memory.read_port(), memory.write_port(granularity=granularity)
    return read, write


def open_collisions(rtlil: str) -> str:
    """``rtlil``, changed so that a read that collides with a write is undefined in memories marked
    `NO_COLLISION`."""
    marked: set[str] = set()
    lines, attribute, cell = [], False, None
    for line in rtlil.splitlines():
        text = line.strip()
        if text.startswith("module "):
            marked = set()
        elif text.startswith("attribute "):
            attribute = attribute or text.startswith("attribute \\no_rw_check ")
        else:
            if text.startswith("memory ") and attribute:
                marked.add(text.split()[-1])
            attribute = False
        if text.startswith("cell "):
            cell = None
        elif text.startswith("parameter \\MEMID "):
            cell = text.split()[-1].strip('"').replace("\\\\", "\\")
        elif cell in marked and (mask := re.match(r"(\s*parameter \\COLLISION_X_MASK (\d+)')", line)):
            line = mask[1] + "1" * int(mask[2])
        lines.append(line)
    return "\n".join(lines) + "\n"


UNFILLED = NO_COLLISION | {"begins_as_anything": 1}
"""Attributes of a memory that nothing reads before it was written; with `without_contents` it begins as
anything."""


def marked_memories(module: str) -> set[str]:
    """Memories of a module that cannot be filled at power-on (``ram_style`` huge), or have `UNFILLED`."""
    marks = (
        r'attribute \\(?:ram_style "huge"|begins_as_anything .*)\n(?:\s*attribute .*\n)*\s*memory .* (\S+)\n'
    )
    return set(re.findall(marks, module))


def written_memories(module: str) -> set[str]:
    """Memories of a module that are written."""
    return set(map(_memory_of, re.findall(r"(?ms)^  cell \$memwr_v2 .*?^  end\n", module)))


def without_contents(rtlil: str, memories: Callable[[str], set[str]] = marked_memories) -> str:
    """``rtlil`` without initial contents of those memories of each module."""
    modules = re.split(r"(?m)^(?=module )", rtlil)
    return "".join(_without(module, memories(module)) for module in modules)


def _without(module: str, memories: set[str]) -> str:
    left = lambda cell: "" if _memory_of(cell[0]) in memories else cell[0]
    return re.sub(r"(?ms)^  cell \$meminit_v2 .*?^  end\n", left, module)


def _memory_of(cell: str) -> str:
    return re.findall(r'parameter \\MEMID "(.+)"', cell)[0].replace("\\\\", "\\")
