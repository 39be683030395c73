"""nextpnr on a netlist: placed and routed for a board, with figures of area and timing, and the bitstream."""

import json
import re
from collections import Counter, defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from eskin.golden.core import Record, Result
from eskin.rtl.fpga.blocks import block_of, cell_blocks, signal_blocks
from eskin.rtl.fpga.synthesis import Netlist
from eskin.rtl.fpga.targets import Target
from eskin.rtl.fpga.tools import ToolError, run_tool


class Files(NamedTuple):
    """Files of a family's tools. packer: the tool that makes the bitstream of ``placed``, with its ending; pins: the file
    of constraints, a line for each port, with ``pull`` where a pin is pulled up; options: nextpnr's for both."""

    packer: str
    placed: str
    ending: str
    pins: str
    line: str
    pull: str
    options: tuple[str, ...]


FAMILIES = {
    "ice40": Files(
        "icepack",
        "placed.asc",
        "bin",
        "pins.pcf",
        "set_io {pull}{port} {site}\n",
        "-pullup yes ",
        ("--pcf", "pins.pcf", "--asc", "placed.asc"),
    ),
    "ecp5": Files(
        "ecppack",
        "placed.config",
        "bit",
        "pins.lpf",
        'LOCATE COMP "{port}" SITE "{site}";\nIOBUF PORT "{port}" IO_TYPE=LVCMOS33{pull};\n',
        " PULLMODE=UP",
        ("--lpf", "pins.lpf", "--textcfg", "placed.config"),
    ),
    "gowin": Files(
        "gowin_pack",
        "placed.json",
        "fs",
        "pins.cst",
        'IO_LOC "{port}" {site};\nIO_PORT "{port}" IO_TYPE=LVCMOS33{pull};\n',
        " PULL_MODE=UP",
        ("--vopt", "cst=pins.cst"),
    ),
}


def _each(names: dict[str, str]) -> dict[str, str]:
    return {name: what for what, several in names.items() for name in several.split()}


KINDS = _each(
    {
        "dsp": "ICESTORM_DSP MULT18X18D ALU54B MULT9X9 MULT18X18 MULT36X36",
        "bram": "ICESTORM_RAM DP16KD SP SDP DP",
        "spram": "ICESTORM_SPRAM",
        "ff": "TRELLIS_FF DFF DFFE DFFS DFFSE DFFR DFFRE DFFP DFFPE DFFC DFFCE",
    }
)
"""Type of a placed cell that is one thing: the column it is counted in."""

COLUMNS = ("cells", "lut", "ff", "carry", "dsp", "bram", "spram")
"""Counts of a block. cells: logic cells (on iCE40 a LUT, a flip-flop, a carry or some of them together)."""

RESOURCES = _each(
    {
        "logic cells": "ICESTORM_LC TRELLIS_COMB LUT4 ALU",
        "block memories": "ICESTORM_RAM DP16KD BSRAM",
        "large memories": "ICESTORM_SPRAM",
        "multipliers": "ICESTORM_DSP MULT18X18D MULT18X18",
        "pins": "SB_IO TRELLIS_IO IOB",
        "flip-flops": "TRELLIS_FF DFF",
    }
)
"""Resources that a part can run out of, in words."""


HOLD = "Hold/min time violation for clock"
"""Line of nextpnr's log for each path that is too short."""

UNUSED_LUT, FEED_THROUGH = f"{0:016b}", f"{0xFF00:016b}"
"""Contents of a LUT that is none, and of one by which nextpnr leads a carry out of its chain (in a netlist
there are no such buffers)."""

PULLED_UP = ("pins__miso", "flash__miso", "scl", "sda")
"""Ports that nothing may drive: the pin's pull-up then shows that a converter is missing."""

CLOCK_MHZ = "100"
"""Clock that nextpnr is given. Its placement does not depend on it: it is as fast as the seed makes it, which
the caller compares."""


class DoesNotFit(Exception):
    """The part has too little of something.

    shortage: {resource in words: (needed, available)}.
    """

    def __init__(self, shortage: dict[str, tuple[int, int]]):
        self.shortage = shortage
        super().__init__(
            ", ".join(
                f"needs {needed} {resource} of {available}"
                for resource, (needed, available) in shortage.items()
            )
        )


class NoRoute(Exception):
    """The seed's placement could not be routed; another seed's may."""


class Implementation(Result):
    """One placement.

    fmax_hz: highest clock. path: the critical path in words. blocks: {block: {column of `COLUMNS`: count}};
    all blocks together are the whole device's use. utilisation: {resource in words: (used, available)}.
    bitstream: file. hold_errors: paths between two registers that are too short at any clock.
    """

    seed: int
    fmax_hz: float
    path: str
    blocks: dict[str, dict[str, int]]
    utilisation: dict[str, tuple[int, int]]
    bitstream: Path
    hold_errors: int = 0


def place(
    netlist: Netlist, target: Target, pins: Mapping[str, str], folder: Path, *, seed: int, border: str = ""
) -> Implementation:
    """Place, route and pack; the same seed gives the same bitstream.

    Parameters
    ----------
    pins:
        Site of each port.
    folder:
        Output folder; made if missing.
    border:
        The submodule that the netlist was kept apart for (`eskin.rtl.fpga.synthesis.synthesise`, ``keep``).

    Raises
    ------
    DoesNotFit, NoRoute, ToolError
    """
    folder.mkdir(parents=True, exist_ok=True)
    family, files = netlist.family.name, FAMILIES[netlist.family.name]
    (folder / "netlist.json").write_bytes(netlist.json.read_bytes())
    words = (
        "--json netlist.json --report report.json --write placed.json --timing-allow-fail -q -l nextpnr.log"
    )
    arguments = [*target.place, *words.split(), "--seed", str(seed), "--freq", CLOCK_MHZ, *files.options]
    lines = (
        files.line.format(port=port, site=site, pull=files.pull * port.startswith(PULLED_UP))
        for port, site in pins.items()
    )
    (folder / files.pins).write_text("".join(lines))
    try:
        run_tool(f"nextpnr-{family}", arguments, folder)
    except ToolError as error:
        if "Routing design failed" in str(error):
            raise NoRoute from None
        use = _use(folder / "nextpnr.log")
        if use and netlist.multipliers:
            use.setdefault("multipliers", (netlist.multipliers, 0))  # a part that has none does not list them
        shortage = {name: count for name, count in use.items() if count[0] > count[1]}
        if shortage:
            raise DoesNotFit(shortage) from None
        raise
    bitstream = folder / f"{netlist.top}.{files.ending}"
    run_tool(files.packer, [files.placed, *target.pack, bitstream.name], folder)
    report = json.loads((folder / "report.json").read_text())
    placed = json.loads((folder / "placed.json").read_text())
    owner = cell_blocks(placed, signal_blocks(json.loads(netlist.names.read_text())), border)
    return Implementation(
        seed=seed,
        fmax_hz=1e6 * min(clock["achieved"] for clock in report["fmax"].values()),
        path=_path_in_words(report, owner),
        blocks=_count(placed, owner),
        bitstream=bitstream,
        utilisation=_in_words(
            [(name, row["used"], row["available"]) for name, row in report["utilization"].items()]
        ),
        hold_errors=(folder / "nextpnr.log").read_text().count(HOLD),
    )


def _use(log: Path) -> dict[str, tuple[int, int]]:
    """(needed, available) of each resource by nextpnr's log."""
    lines = re.findall(r"(\w+):\s+(\d+)/\s*(\d+)\s+\d+%", log.read_text() if log.exists() else "")
    return _in_words([(name, int(count), int(room)) for name, count, room in lines])


def _in_words(counts: list[tuple[str, int, int]]) -> dict[str, tuple[int, int]]:
    """{resource in words: (used, available)}; an adder of a Gowin part (ALU) takes the place of a LUT."""
    use: dict[str, tuple[int, int]] = {}
    for name, count, room in counts:
        if name in RESOURCES:
            before, most = use.get(RESOURCES[name], (0, 0))
            use[RESOURCES[name]] = (before + count, max(most, room))
    return use


def _count(placed: Record, owner: dict[str, str]) -> dict[str, dict[str, int]]:
    blocks: dict[str, Counter[str]] = defaultdict(Counter)
    (module,) = placed["modules"].values()
    constants = {
        bit for name, net in module["netnames"].items() if name.startswith("$PACKER_") for bit in net["bits"]
    }
    for name, cell in module["cells"].items():
        kind, counts, parameters = cell["type"], blocks[owner[name]], cell["parameters"]
        if kind == "ICESTORM_LC":
            counts["cells"] += 1
            counts["ff"] += parameters["DFF_ENABLE"].endswith("1")
            counts["carry"] += parameters["CARRY_ENABLE"].endswith("1")
            # The others: a flip-flop alone, a carry alone (unless a LUT has joined it), room between carry
            # chains.
            joined = name.endswith("$CARRY") and parameters["LUT_INIT"][-16:] not in (
                UNUSED_LUT,
                FEED_THROUGH,
            )
            counts["lut"] += name.endswith("_LC") or (
                joined and constants.isdisjoint(cell["connections"]["O"])
            )
        elif kind == "TRELLIS_COMB":
            counts["cells"] += 1
            counts["carry"] += parameters.get("MODE") == "CCU2"
            counts["lut"] += parameters.get("MODE", "LOGIC") == "LOGIC"
        elif kind == "ALU" or re.fullmatch("LUT[1-4]", kind):
            counts["cells"] += 1
            counts["carry"] += kind == "ALU"
            # the others hold four words of a memory's column each, or lead to a flip-flop
            counts["lut"] += kind != "ALU" and not re.search(r"_LUT[0-3]$|_passthrough_lut\$$", name)
        elif kind in KINDS:
            counts[KINDS[kind]] += 1
    return {
        name: {column: counts[column] for column in COLUMNS}
        for name, counts in sorted(blocks.items())
        if counts.total()
    }


def _path_in_words(report: Record, owner: dict[str, str]) -> str:
    """The slowest path between two registers: its blocks, and how much logic it crosses."""

    def delay(path: Record) -> float:
        return sum(part["delay"] for part in path["path"])

    inside = [
        path
        for path in report["critical_paths"]
        if path["from"] == path["to"] and path["from"].startswith("posedge")
    ]
    if not inside:
        return "no path between two registers"
    worst = max(inside, key=delay)
    parts = worst["path"]
    ends = (parts[0]["from"]["cell"], parts[-1]["to"]["cell"])
    begin, end = (f"{owner.get(cell, block_of(cell))} ({_signal(cell)})" for cell in ends)
    logic = [part for part in parts if part["type"] == "logic"]
    carries = sum(
        part["from"]["port"].startswith(("CIN", "FCI")) or part["to"]["port"].startswith(("COUT", "FCO"))
        for part in logic
    )
    wires = sum(part["delay"] for part in parts if part["type"] == "routing")
    return (
        f"from {begin} to {end}: {delay(worst):.1f} ns through {len(logic) - carries} logic cells and "
        f"{carries} carries, "
        f"{100 * wires / delay(worst):.0f} % of it wires"
    )


def _signal(cell: str) -> str:
    """The signal after which Yosys and nextpnr named a cell, without its path."""
    name = re.split(
        r"_(?:SB|TRELLIS)_|_LUT[1-4]_|_CCU2C_|_L6MUX|_PFUMX|_MUX2_|_ALU_|_MULT\d|_DFFLC|_DFF[A-Z]*_Q|_LC$|_DSP$|_RAM$",
        cell,
    )[0]
    return name.rsplit(".", 1)[-1] or cell
