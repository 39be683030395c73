"""Yosys on a design: RTLIL in, a netlist of one FPGA family's cells out (JSON for nextpnr, Verilog for
simulation, counts)."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from amaranth.back import rtlil
from amaranth.hdl import Cat, ClockDomain, ClockSignal, Module, Mux, ResetSignal, Signal
from amaranth.lib import wiring

from eskin.rtl.common import bare, forward, inputs, open_collisions, outputs, without_contents
from eskin.rtl.fpga.tools import ToolError, run_tool


@dataclass(frozen=True, kw_only=True)
class Family:
    """Properties of one family of parts for Yosys.

    synth: the command. dsp: the cell with a multiplier. library: files of its cell
    models in Yosys' share folder (``+``), the first for simulation. power_on_s: seconds of reset that the
    part needs once it is configured. blocks: shapes (words, bits) of a block memory.
    """

    name: str
    synth: str
    dsp: str
    library: str
    blocks: tuple[tuple[int, int], ...] = ((256, 16), (512, 8), (1024, 4), (2048, 2))
    power_on_s: float = 0.0

    def power_on_cycles(self, clock_hz: float) -> int:
        """Cycles of reset at a clock of ``clock_hz``: the power of two that lasts ``power_on_s`` or longer; 0
        where none is needed."""
        return 1 << (math.ceil(self.power_on_s * clock_hz) - 1).bit_length() if self.power_on_s else 0


BLOCK_MEMORY_S = 15e-6
"""Block memories of an iCE40 read zeros for some 3 us after configuration, a delay of the part that no signal
reports (YosysHQ/icestorm issue 76). The reset lasts five times as long, as amaranth's platform for these
parts waits."""

ICE40 = Family(
    name="ice40",
    synth="synth_ice40 -device u -dsp",
    dsp="SB_MAC16",
    library="+/ice40/cells_sim.v",
    power_on_s=BLOCK_MEMORY_S,
)
MULTIPLIERS = ("SB_MAC16", "MULT18X18D", "MULT9X9", "MULT18X18", "MULT36X36")

ECP5 = Family(
    name="ecp5",
    synth="synth_ecp5",
    dsp="MULT18X18D",
    library="+/ecp5/cells_sim.v +/ecp5/cells_bb.v",
    blocks=((512, 36), (1024, 18), (2048, 9), (4096, 4), (8192, 2), (16384, 1)),
)

GOWIN = Family(
    name="gowin",
    synth="synth_gowin",
    dsp="MULT18X18",
    library="+/gowin/cells_sim.v +/gowin/cells_xtra_gw1n.v",
    blocks=ECP5.blocks,
)

WHOLE_WORDS = Path(__file__).with_name("whole_words.v")
"""A techmap that saves a logic cell for each block memory of an iCE40."""


class Harness(wiring.Component):
    """A design behind four pins, for parts with fewer pins than the design has ports; a figure of area and
    timing needs registers on both sides.

    Parameters
    ----------
    hidden:
        Beginnings of names of ports that are left open (`bare`).

    Members
    -------
    shift_in : In(1)
        Next bit of the design's inputs, which are one shift register.
    capture : In(1)
        Take all of its outputs; otherwise they go out bit by bit.
    shift_out : Out(1)
    """

    def __init__(self, design: wiring.Component, hidden: Sequence[str]):
        self._design, self._hidden = design, hidden
        super().__init__(inputs("shift_in", "capture") | outputs("shift_out"))

    def elaborate(self, platform):
        m = Module()
        m.submodules.chain, ports = bare(self._design, self._hidden)
        inputs, outputs = (
            Cat(value for value, way in ports.values() if way.value == wanted)
            for wanted in ("input", "output")
        )
        given = Signal(len(inputs))
        taken = Signal(len(outputs))
        m.d.comb += [inputs.eq(given), self.shift_out.eq(taken[0])]
        m.d.sync += [given.eq(Cat(self.shift_in, given)), taken.eq(Mux(self.capture, outputs, taken >> 1))]
        return m


class PoweredOn(wiring.Component):
    """``inner`` as the top of a bitstream: clocked by the pin ``clk``, its other ports as pins.

    The part gives every flip-flop its reset value when it is configured; ``hold`` > 0 keeps them there for so
    many cycles more.

    Parameters
    ----------
    hold:
        A power of two, `Family.power_on_cycles`; 0: the design has no reset.
    """

    def __init__(self, inner: wiring.Component, hold: int = 0):
        self._inner, self._hold = inner, hold
        super().__init__(inputs("clk") | dict(inner.signature.members))

    def elaborate(self, platform):
        m = Module()
        m.domains.sync = ClockDomain(reset_less=not self._hold)
        m.d.comb += ClockSignal().eq(self.clk)
        if self._hold:
            m.domains.power_on = ClockDomain(reset_less=True, local=True)
            timer = Signal(self._hold.bit_length())  # stops when its top bit is set
            m.d.comb += [ClockSignal("power_on").eq(self.clk), ResetSignal().eq(~timer[-1])]
            m.d.power_on += timer.eq(timer + ~timer[-1])
        m.submodules.inner = self._inner
        forward(m, self, self._inner)
        return m


@dataclass(frozen=True, kw_only=True)
class Netlist:
    """Output of `synthesise`.

    json (for nextpnr), verilog (cells of the family, one flat module ``top``), cells: number of cells by
    type, names: the design before any optimisation, flat, by which signals of the netlist are told apart.
    """

    top: str
    family: Family
    names: Path
    json: Path
    verilog: Path
    cells: dict[str, int]

    @classmethod
    def of(cls, folder: Path, family: Family, top: str) -> Netlist:
        """The netlist that lies in ``folder``."""
        endings = {"names": "_names.json", "json": ".json", "verilog": ".v"}
        files = {name: folder / f"{top}{ending}" for name, ending in endings.items()}
        return cls(top=top, family=family, cells=_count(folder / "cells.json"), **files)

    @property
    def multipliers(self) -> int:
        """Multiplier cells."""
        return sum(self.cells.get(name, 0) for name in MULTIPLIERS)


def synthesise(
    design,
    family: Family,
    folder: Path,
    *,
    top: str = "accelerator",
    hidden: Sequence[str] = (),
    keep: Sequence[str] = (),
    verilog: Sequence[Path] = (),
) -> Netlist:
    """Netlist of ``design`` in ``folder`` (made if missing): TOP.il, TOP.json, TOP.v and Yosys' log.

    Multiplier cells that the design instantiates by itself are out of Yosys' sight while products are mapped:
    its pass for inferred products merges and drops instantiated ones without a word.

    Parameters
    ----------
    hidden:
        Beginnings of names of ports that the netlist has not (`bare`).
    keep:
        Paths of submodules across whose borders nothing is optimised, so that their cells can be told from
        the rest.
    verilog:
        Files with modules that the design instantiates.

    Raises
    ------
    ToolError
        Yosys failed, or a multiplier cell of the design is missing in the netlist.
    """
    folder.mkdir(parents=True, exist_ok=True)
    whole, ports = bare(design, hidden) if hidden else (design, None)
    text = rtlil.convert(whole, name=top, platform=family.name, ports=ports, emit_src=False)
    (folder / f"{top}.il").write_text(without_contents(open_collisions(text)))
    hide, show, hard_cell = "", "", family.dsp
    if family.dsp == "SB_MAC16":
        hard_cell = "KEPT_MAC16"
        hide = f"copy {family.dsp} {hard_cell}\nchtype -set {hard_cell} t:{family.dsp}\n"
        show = f"chtype -set {family.dsp} t:{hard_cell}\ndelete ={hard_cell}\n"
    synth = f"{family.synth} -top {top}"
    mapping = f"{synth}\n"
    if family.name == "ice40":
        (folder / WHOLE_WORDS.name).write_text(WHOLE_WORDS.read_text())
        # a longer script of ABC: some LUTs in a thousand less
        mapping = f"""scratchpad -copy abc9.script.flow2 abc9.script
{synth} -run begin:map_ram
memory_libmap -lib +/ice40/brams.txt -lib +/ice40/spram.txt -no-auto-huge
techmap -map {WHOLE_WORDS.name}
{synth} -run map_ram:blif
"""
    hold = "".join(f"setattr -mod -set keep_hierarchy 1 {top}.{path}\n" for path in keep)
    (folder / "instances.v").write_text("".join(path.read_text() for path in verilog))
    # -defer: a module is looked at with the parameters that it is used with
    read = "read_verilog -defer instances.v\n" if verilog else ""
    script = f"""{read}read_rtlil {top}.il
hierarchy -top {top}
proc
design -push-copy
flatten
write_json {top}_names.json
design -pop
read_verilog -lib {family.library}
{hold}flatten
{hide}tee -q -o asked.json stat -json
{mapping}{show}{hold.replace("-set keep_hierarchy 1", "-unset keep_hierarchy")}flatten
delete t:$scopeinfo
tee -q -o cells.json stat -json
write_json {top}.json
write_verilog -noattr {top}.v
"""
    (folder / "synth.ys").write_text(script)
    run_tool("yosys", ["-q", "-l", "yosys.log", "synth.ys"], folder)
    requested = _count(folder / "asked.json").get(hard_cell, 0)
    result = Netlist.of(folder, family, top)
    if result.multipliers < requested:
        raise ToolError(
            f"yosys lost multipliers: the design instantiates {requested} {family.dsp}, the netlist has "
            f"{result.multipliers}"
        )
    return result


def _count(path: Path) -> dict[str, int]:
    return json.loads(path.read_text())["design"]["num_cells_by_type"]
