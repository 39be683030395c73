"""Memories in which no word is read in the cycle that writes it.

Amaranth defines what such a read gives, and synthesis builds comparators and bypasses to keep the definition where block memories do not.
A memory that carries `NO_COLLISION` does without: its owner's schedule excludes such reads, or never uses what they give.
"""

from __future__ import annotations

import re

NO_COLLISION = {"no_rw_check": 1}
"""Attribute of such a memory; Yosys knows it in Verilog too."""


def open_collisions(rtlil: str) -> str:
    """``rtlil`` in which reads that collide with a write are undefined for the memories with `NO_COLLISION`."""
    lines, marked, attribute, cell = [], set(), False, None
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
"""Attributes of a memory that nothing reads before it was written; with `without_contents` it begins as anything."""


def without_contents(rtlil: str) -> str:
    """``rtlil`` in which memories with ``ram_style`` huge, and those with `UNFILLED`, begin as anything: what they are made of cannot be
    filled at power-on, and what reads them waits until they are written."""
    return "".join(_module_without_contents(module) for module in re.split(r"(?=^module )", rtlil, flags=re.MULTILINE))


def _module_without_contents(module: str) -> str:
    marks = r'attribute \\(?:ram_style "huge"|begins_as_anything .*)\n(?:\s*attribute .*\n)*\s*memory .* (\S+)\n'
    huge = set(re.findall(marks, module))
    cells = re.split(r"(^  cell \$meminit_v2 .*?^  end\n)", module, flags=re.MULTILINE | re.DOTALL)
    return "".join(part for part in cells if not (part.startswith("  cell $meminit_v2 ") and _memory_of(part) in huge))


def _memory_of(cell: str) -> str | None:
    memory = re.search(r'parameter \\MEMID "(.+)"', cell)
    return memory[1].replace("\\\\", "\\") if memory else None
