"""Memories in which no word is read in the cycle that writes it.

Amaranth defines the result of a read that collides with a write. Block memories do not, so synthesis adds
comparators and bypasses. A memory with `NO_COLLISION` has none of them: its owner never reads and writes a
word in one cycle, or never uses the result.
"""

import re
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


def without_contents(rtlil: str) -> str:
    """``rtlil`` without initial contents of memories with ``ram_style`` huge and of those with `UNFILLED`.

    The former cannot be filled at power-on; the latter are written before anything reads them.
    """
    return "".join(
        _module_without_contents(module) for module in re.split(r"(?=^module )", rtlil, flags=re.MULTILINE)
    )


def _module_without_contents(module: str) -> str:
    marks = (
        r'attribute \\(?:ram_style "huge"|begins_as_anything .*)\n(?:\s*attribute .*\n)*\s*memory .* (\S+)\n'
    )
    huge = set(re.findall(marks, module))
    cells = re.split(r"(^  cell \$meminit_v2 .*?^  end\n)", module, flags=re.MULTILINE | re.DOTALL)
    return "".join(
        part for part in cells if not (part.startswith("  cell $meminit_v2 ") and _memory_of(part) in huge)
    )


def _memory_of(cell: str) -> str | None:
    memory = re.search(r'parameter \\MEMID "(.+)"', cell)
    return memory[1].replace("\\\\", "\\") if memory else None
