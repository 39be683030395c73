"""Yosys on a design for a chip: its cells and memory macros by Liberty files, clock gates, a flat netlist
without initial values."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from amaranth.back import rtlil

from eskin.golden.core import InputError, Record, template
from eskin.rtl.asic.buffers import insert
from eskin.rtl.asic.liberty import Cell, Library, text_of
from eskin.rtl.common import CHIP, bare, open_collisions, without_contents, written_memories
from eskin.rtl.fpga.tools import run_tool
from eskin.rtl.top.clock_gate import CELL

MEMORIES = Path(__file__).with_name("memory_map.v")
RESETS = Path(__file__).with_name("reset_map.v")
WORDS_OF_A_LATCH_MEMORY = 4
"""Number of words from which latches take less area than flip-flops: their input word is shared."""

ONE_PORT, BITS_OF_MACROS = ("pretrigger_ring", "readout.places"), 2048
"""Memories that are never read and written in one cycle, so that macros of one port hold them where they have more bits
than these."""

BITS_OF_A_GATE = 3
"""Flip-flops from which on a separate clock gate saves energy: the gate's pin costs about as much as a flip-flop's
pin."""


@dataclass(frozen=True, kw_only=True)
class Process:
    """Cells of a process from which the netlist is made. flip_flop, latch, gate, high, low, buffer: cells by
    their role; nand: two inputs, the unit of kGE; macro: of the ring, or None."""

    pdk: str
    library: Library
    flip_flop: Cell
    latch: Cell | None
    gate: Cell
    nand: Cell
    high: Cell
    low: Cell
    macros: tuple[Cell, ...]

    @cached_property
    def cells(self) -> dict[str, Cell]:
        """Everything that a netlist may contain, by name."""
        return {cell.name: cell for cell in (*self.library.cells.values(), *self.macros)}


HINTS: dict[str, Record] = {
    "ihp-sg13g2": {"name": "sg13g2", "high": ("sg13g2_tiehi", "L_HI"), "low": ("sg13g2_tielo", "L_LO")},
    "sky130hd": {
        "name": "sky130",
        "high": ("sky130_fd_sc_hd__conb_1", "HI"),
        "low": ("sky130_fd_sc_hd__conb_1", "LO"),
    },
}
"""Facts about a process that its Liberty file lacks: the prefixes of its names, and the cells of a constant
with their pins."""


def process_of(pdk: str, libraries: Iterable[Library]) -> Process:
    """The cells that a netlist needs, from the typical corner's files.

    Raises
    ------
    InputError
        An unknown process, another one's file, or a cell that is needed and missing.
    """
    if pdk not in HINTS:
        raise InputError(f"`pdk` {pdk}: is unknown; use {' or '.join(HINTS)}")
    library = next(file for file in libraries if file.holds_logic)
    if not any(name.startswith(HINTS[pdk]["name"]) for name in library.cells):
        raise InputError(
            f"`liberty` {library.path}: holds no cells of {pdk}; give that process's file, or its own `pdk`"
        )
    cells = library.cells.values()

    def need(role: str, candidates: Iterable[Cell]) -> Cell:
        chosen = min(candidates, key=lambda cell: cell.area, default=None)
        if chosen is None:
            raise InputError(
                f"`liberty` {library.path}: has no {role}, which the design needs; give a file with all "
                f"cells of {pdk}"
            )
        return chosen

    of_kind = lambda kind: (cell for cell in cells if cell.kind == kind)
    named = lambda ending: (cell for cell in cells if cell.name.endswith(ending))
    plain = (
        c for c in of_kind("latch") if not {"clear", "preset"} & set(c.state) and c.state["enable"] in c.pins
    )
    ways = lambda cell: [pin.direction for pin in cell.pins.values()]
    return Process(
        pdk=pdk,
        library=library,
        flip_flop=need("flip-flop", (c for c in of_kind("flip-flop") if c.state["next_state"] in c.pins)),
        latch=min(plain, key=lambda cell: cell.area, default=None),
        # two inputs: no pin for a test
        gate=need("clock gate", (c for c in of_kind("gate") if ways(c).count("input") == 2)),
        nand=need("NAND of two inputs", named("nand2_1")),
        high=need("cell for a constant 1", named(HINTS[pdk]["high"][0])),
        low=need("cell for a constant 0", named(HINTS[pdk]["low"][0])),
        macros=tuple(
            macro for file in libraries for macro in file.macros if {"read", "write"} <= set(macro.access_j)
        ),
    )


@dataclass(frozen=True, kw_only=True)
class Netlist:
    """verilog: one flat module of the process's cells; cells: their number by name; memories: rows {name,
    words, width, bits, kind}."""

    folder: Path
    verilog: Path
    cells: Mapping[str, int]
    memories: tuple[Mapping, ...]

    @classmethod
    def of(cls, folder: Path, top: str) -> Netlist:
        """The netlist that lies in ``folder``."""
        cells = json.loads((folder / "cells.json").read_text())["modules"][f"\\{top}"]["num_cells_by_type"]
        memories = tuple(json.loads((folder / "memories.json").read_text()))
        return cls(folder=folder, verilog=folder / f"{top}.v", cells=cells, memories=memories)

    @cached_property
    def module(self) -> Record:
        """The netlist as Yosys' JSON."""
        return json.loads((self.folder / "flat.json").read_text())["modules"][self.verilog.stem]

    def counted(self, process: Process) -> list[tuple[Cell, int]]:
        """Cells, and how many of each."""
        return [(process.cells[name.lstrip("\\")], number) for name, number in self.cells.items()]


def synthesise(
    design,
    process: Process,
    folder: Path,
    *,
    top: str = "accelerator",
    hidden: Sequence[str] = (),
    delay_ps: int = 10000,
) -> Netlist:
    """Netlist of ``design`` in ``folder`` (made if missing): TOP.v, cells.json, memories.json and Yosys' log.

    Parameters
    ----------
    hidden:
        Beginnings of names of ports that the netlist has not (`bare`).
    delay_ps:
        Goal of the mapping to cells.
    """
    folder.mkdir(parents=True, exist_ok=True)
    whole, ports = bare(design, hidden) if hidden else (design, None)
    text = rtlil.convert(whole, name=top, platform=CHIP, ports=ports, emit_src=False)
    (folder / f"{top}.il").write_text(open_collisions(without_contents(text, written_memories)))
    (folder / "cells.lib").write_text(text_of(process.library.path))
    for part in (MEMORIES, RESETS):
        (folder / part.name).write_text(part.read_text())
    (folder / "cells.constr").write_text(
        f"set_driving_cell {process.flip_flop.name}\nset_load 10 [all_outputs]\n"
    )
    begin = f"""read_rtlil {top}.il
hierarchy -top {top}
proc
flatten
setattr -unset init w:*
delete t:$scopeinfo
opt_expr
opt_clean
memory_collect
memory_dff
opt_clean
memory_share
memory_collect
opt_clean
write_json memories_in.json
write_rtlil begun.il
"""
    _run(folder, "begin", begin)
    rows = _memories(folder, process, top)
    (folder / "memories.json").write_text(json.dumps(rows))
    script = "read_rtlil begun.il\n"
    kinds = {row["kind"] for row in rows}
    maps = {"latches": MEMORIES.name}
    for macro in (macro for macro in process.macros if macro.name in kinds):
        maps[macro.name] = f"map_{macro.name}.v"
        (folder / f"{macro.name}.v").write_text(macro_verilog(macro))
        (folder / maps[macro.name]).write_text(macro_map(macro))
        script += f"read_verilog -lib {macro.name}.v\n"
    script += f"hierarchy -top {top}\n"
    for row in rows:
        if row["kind"] in maps:
            script += f"select -set one {top}/c:{row['cell']}\n"
            script += f"techmap -autoproc -map {maps[row['kind']]} @one\n"
    (folder / "cells_map.v").write_text(cells_map(process))
    pins = process.gate.gate_pins
    gate = f"{process.gate.name} {pins['enable']}:{pins['clock']}:{pins['output']}"
    high, low = HINTS[process.pdk]["high"], HINTS[process.pdk]["low"]
    script += f"""opt
synth -run coarse:fine -top {top}
techmap -map {RESETS.name}
memory_map
opt -undriven -fine
techmap
opt -fast
dfflegalize -cell $_DFF_P_ x -cell $_DFFE_PP_ x -cell $_DLATCH_P_ x
clockgate -pos {gate} -min_net_size {BITS_OF_A_GATE}
opt -fast
techmap -map cells_map.v
dfflibmap -liberty cells.lib
opt_clean
abc -liberty cells.lib -constr cells.constr -D {delay_ps}
setundef -zero
hilomap -singleton -hicell {high[0]} {high[1]} -locell {low[0]} {low[1]}
opt_clean -purge
write_json mapped.json
"""
    _run(folder, "synth", script)
    mapped = json.loads((folder / "mapped.json").read_text())
    insert(mapped["modules"][top], process.cells)
    (folder / "buffered.json").write_text(json.dumps(mapped))
    written = f"""read_json buffered.json
write_verilog -noattr -noexpr simulated.v
write_json flat.json
splitnets -ports
opt_clean -purge
tee -q -o cells.json stat -json
write_verilog -noattr -noexpr {top}.v
"""
    _run(folder, "written", written)
    return Netlist.of(folder, top)


def _memories(folder: Path, process: Process, top: str) -> list[Record]:
    """The implementation of each memory of the design."""
    rows = []
    for name, cell in json.loads((folder / "memories_in.json").read_text())["modules"][top]["cells"].items():
        if cell["type"] != "$mem_v2":
            continue
        value = cell["parameters"]
        words, width, writes = (int(value[key], 2) for key in ("SIZE", "WIDTH", "WR_PORTS"))
        kind = "logic" if not writes else "flip-flops"
        single = writes == 1 and len({str(bit) for bit in cell["connections"]["WR_EN"]}) == 1
        macro = min(
            (m for m in process.macros if m.bits >= width),
            key=lambda m: macros_for(m, words, width) * m.area,
            default=None,
        )
        one_port = writes and any(part in name for part in ONE_PORT) and words * width > BITS_OF_MACROS
        if one_port and macro is not None:
            kind = macro.name
        elif writes and process.latch is not None and single and words >= WORDS_OF_A_LATCH_MEMORY:
            kind = "latches"
        memory_name = value.get("MEMID", name).lstrip("\\").removeprefix(f"{top}.")
        shape = dict(words=words, width=width, bits=words * width)
        rows.append(dict(name=memory_name, **shape, kind=kind, cell=name))
    return rows


def macros_for(macro: Cell, words: int, width: int) -> int:
    """Number of macros that hold a memory; narrow words lie beside each other in one word of a macro."""
    beside = 1 << (macro.bits // width).bit_length() - 1
    return -(-words // (macro.words * beside))


def cells_map(process: Process) -> str:
    """Techmap of latches and of the clock gates that the design names."""
    gate, latch = process.gate, process.latch
    pins = gate.gate_pins
    text = "".join(
        f"module {name} (input CLK, CE, output GCLK);\n"
        f"{gate.name} _TECHMAP_REPLACE_ (.{pins['clock']}(CLK), .{pins['enable']}(CE), "
        f".{pins['output']}(GCLK));\nendmodule\n"
        for name in ("\\$__CLOCK_GATE ", CELL)
    )
    if latch is not None:
        out = next(
            name
            for name, pin in latch.pins.items()
            if pin.direction == "output" and pin.function == latch.state["state"]
        )
        text += (
            "module \\$_DLATCH_P_ (input E, D, output Q);\n"
            f"{latch.name} _TECHMAP_REPLACE_ (.{latch.state['data_in']}(D), .{latch.state['enable']}(E), "
            f".{out}(Q));\nendmodule\n"
        )
    return text


def _run(folder: Path, name: str, script: str) -> None:
    (folder / f"{name}.ys").write_text(script)
    run_tool("yosys", ["-q", "-l", f"{name}.log", f"{name}.ys"], folder)


def _of_macro(name: str, macro: Cell, **values: str | bool) -> str:
    """The text of a one-port macro, from a template."""
    sizes = {"words": macro.words, "bits": macro.bits, "address": (macro.words - 1).bit_length()}
    test_pins = [pin for pin in macro.pins if "BIST" in pin]
    return template(__file__, name).render(name=macro.name, others=test_pins, **sizes, **values)


def macro_verilog(macro: Cell, random: bool = False) -> str:
    """Behaviour of a one-port macro: a word a cycle is read or written, the word read stays; contents are
    not known, or begin at random."""
    return _of_macro("macro.v", macro, random=random)


def macro_map(macro: Cell) -> str:
    """Techmap of a memory that is never read and written in one cycle to macros of one port."""
    parameters = re.findall(r"    parameter MEMID.*?(?=    input)", MEMORIES.read_text(), re.DOTALL)[0]
    return _of_macro("macro_map.v", macro, parameters=parameters)


def expression(function: str) -> str:
    """A Liberty function in Verilog's operators."""
    return function.replace("*", "&").replace("+", "|").replace("!", "~")


def model(cell: Cell) -> str:
    """The module of a cell."""
    if cell.kind == "memory":
        return macro_verilog(cell, random=True)
    pins = {name: pin for name, pin in cell.pins.items() if pin.direction in ("input", "output")}
    return template(__file__, "cell.v", expression=expression).render(cell=cell, pins=pins)


def models(cells: Iterable[Cell]) -> str:
    """Modules of all ``cells``."""
    return "".join(model(cell) for cell in cells)
