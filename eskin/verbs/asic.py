"""Make a chip's netlist and report area, memories, clock and leakage, before layout. Takes minutes.

Example: eskin asic model --pdk ihp-sg13g2 --liberty cells_typ.lib --liberty cells_slow.lib --liberty
sram.lib --rom

The energy is of steps, frames, waiting and whole touches, from the activity on recordings.
A recording is played at a slow pace, so that the clock stops between frames where it can, and everything is
counted frame by frame. A step costs what the frames around its decision cost beyond frames of the same touch
without one. What a cycle without an edge costs is known from the clock's first net, so that any clock can be
asked about.
"""

import dataclasses
import math
import shutil
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from itertools import zip_longest
from pathlib import Path

import numpy as np

from eskin.cli.common import ModelOptions, option, progress_bars, recordings_for, required, say, show, stop
from eskin.cosim.device import Accelerator, Design
from eskin.cosim.latency import limits
from eskin.cosim.netlist import Hardware, shorten_names
from eskin.golden.core import (
    AcceleratorConfig,
    Arrays,
    Result,
    check_folder,
    content_key,
    replacing,
    replacing_folder,
    write_json,
)
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel, run
from eskin.memo import Memo, code_version
from eskin.pages.views import words
from eskin.rtl.asic import timing
from eskin.rtl.asic.liberty import Library, WireLoad, corners, read
from eskin.rtl.asic.nets import BAND, Costs, Nets, costs
from eskin.rtl.asic.synthesis import Netlist, Process, models, process_of, synthesise
from eskin.rtl.fpga.generate import boot_writes, pack_decision, register_map
from eskin.rtl.fpga.tools import ToolError
from eskin.rtl.program.memory_map import memory_images
from eskin.rtl.program.schedule import decision_cycles, lowest_clock_hz, step_cycles
from eskin.rtl.top import accelerator
from eskin.study.energy import TOUCHES_PER_S
from eskin.study.touch_ends import with_touches


class AsicRequest(ModelOptions):
    pdk: str = required("Process: ihp-sg13g2 or sky130hd.", metavar="NAME")
    liberty: list[Path] = required(
        "Liberty file of the process (.lib, .lib.gz); may be repeated.", metavar="FILE"
    )
    lanes: int | None = option("Parallel multipliers. Default: the model's.")
    rom: bool = option("Put weights and constants in ROM; otherwise the host loads them.", False, "--rom")
    data: str | None = option(
        "Simulate one of these recordings for its energy; takes many minutes.", metavar="D"
    )
    out: Path = option("Folder for asic.json, asic.md, netlist.v and accelerator.sdc.", Path("build/asic"))


def command(request: AsicRequest) -> None:
    check_folder(request.out, MARK)
    integer = IntegerModel.load(request.model)
    played = recordings_for(request.data, integer.config)
    config = chip_config(integer.config, request.lanes, request.rom)
    integer = dataclasses.replace(integer, config=config)
    try:
        with progress_bars() as report:
            report(f"netlist in the cells of {request.pdk}, its clock and energy", 0, 0)
            result, netlist = asic(integer, request.pdk, request.liberty, recordings=played)
    except ToolError as error:
        stop(str(error), 1)
    clock_hz = config.hardware.clock_hz
    period = 1e9 / clock_hz
    with replacing_folder(request.out) as folder:
        shutil.copyfile(netlist.verilog, folder / "netlist.v")
        sdc = timing.SDC.format(clock_hz=clock_hz, period_ns=period, outside=period / 4)
        (folder / f"{TOP}.sdc").write_text(sdc)
        (folder / PAGE).write_text(words("asic", **dict(result)))
        write_json(folder / MARK, result)
    show("asic", **dict(result))
    say(f"{request.out}: {MARK}, {PAGE}, netlist.v, accelerator.sdc")


CACHE = Path("build/chips")
"""Finished netlists by content; safe to delete."""

MARK, PAGE, TOP = "asic.json", "asic.md", "accelerator"
UTILISATION, TILE_UM = 0.7, (202.08, 154.98)
"""Share of a tile that cells may fill, and a Tiny Tapeout tile on SG13G2."""
WIRE_LOAD = "10k"
CANNOT = (
    "Before layout: no placement, no clock tree, no design rules. Area within 15 % before the utilisation, "
    "clock within 30 %, "
    "energy within a factor of 2."
)


class Macro(Result):
    """How a memory of the design is made."""

    name: str
    words: int
    width: int
    bits: int
    kind: str


class SlowestPath(Result):
    """First and last cell of the slowest path; macros_derated: so many times slower than in their file."""

    start: str
    end: str
    macros_derated: float | None


class ChipEnergy(Result):
    """Energies, joule, each within the factor ``band``. step_j: that a step adds to its frames. interval_j: of a hop,
    interval_frames. waiting_cycle_j: a cycle without an edge. touch_j: of its frames and steps. idle_w, average_w: while nobody
    touches, and at a touch a second, at clock_hz. Then the decisions, compared with the golden model. Without
    recordings the first three are None, and all after method is absent."""

    step_j: float | None
    interval_j: float | None
    touch_j: float | None
    leakage_w: float
    band: float
    waiting_cycle_j: float
    method: str
    idle_w: float = 0.0
    average_w: float = 0.0
    interval_frames: int = 0
    clock_hz: float = 0.0
    bit_exact: bool = False
    mismatches: int = 0
    compared_values: int = 0


class Chip(Result):
    """asic.json. rom: constants in ROMs; one_phase: rows in one phase. kge: thousand NAND gates. fmax_hz, paths: by
    corner, None without a file of its cells. tiles: of Tiny Tapeout, filled to ``utilisation``."""

    pdk: str
    corner: str
    lanes: int
    rom: bool
    one_phase: bool
    area_um2: float
    area_by_kind_um2: Mapping[str, float]
    kge: float
    flip_flops: int
    latches: int
    clock_gates: int
    memories: Sequence[Macro]
    fmax_hz: Mapping[str, float | None]
    timing_by: str
    wire_load: str | None
    paths: Mapping[str, SlowestPath]
    energy: ChipEnergy
    tiles: float
    utilisation: float
    cannot_be_claimed: str


def chip_config(config: AcceleratorConfig, lanes: int | None, rom: bool) -> AcceleratorConfig:
    """The configuration as a chip has it: plain lanes, a ring that macros of one port can hold, a clock that
    stops, constants in ROMs where asked; rows in one phase where the clock (``clock_hz``) decides in time
    then (``decide_within_s``)."""
    lanes = lanes or config.hardware.lanes
    chip = config.replace(lane_type="plain", lanes=lanes, one_port=True, clock_gate=True, loadable=not rom)
    in_one, budget = chip.replace(one_phase=True), limits(chip)
    counts = {"step": step_cycles(in_one), "decision": decision_cycles(in_one)}
    in_time = all(count <= budget[name] * chip.hardware.clock_hz for name, count in counts.items())
    return in_one if in_time else chip


def netlist_of(
    config: AcceleratorConfig, arrays: Arrays, process: Process, *, probes: bool = False
) -> Netlist:
    """The netlist of one design; an unchanged one is taken from the build folder."""
    images = None if config.hardware.loadable else memory_images(config, arrays)

    def make(folder: Path) -> None:
        design = accelerator.Accelerator(config, images)
        synthesise(design, process, folder, top=TOP, hidden=() if probes else ("probe",))

    key = content_key(config, repr(images), probes, content_of(process))
    return Netlist.of(Memo(CACHE).folder(key, make), TOP)


def content_of(process: Process) -> str:
    """Key of what makes a netlist of a design: the code, the process and its Liberty files."""
    code = code_version("rtl", "golden", "verbs/asic.py")
    return content_key(code, process.pdk, process.library.path, repr(process.macros))


def hardware_of(netlist: Netlist, process: Process, *, probes: bool) -> Hardware:
    """The netlist with models of its cells in Verilog, whose states begin at random."""
    text = shorten_names((netlist.folder / "simulated.v").read_text())
    sources = (netlist.folder / "played.v", netlist.folder / "played_cells.v")
    for path, content in zip(
        sources, (text, models(cell for cell, _ in netlist.counted(process))), strict=True
    ):
        with replacing(path) as temporary:
            temporary.write_text(content)
    return Hardware(sources, (), "netlist", "asic", probes)


def libraries_of(paths: Sequence[Path]) -> dict[str, list[Library]]:
    """The files by corner."""
    return corners([read(path) for path in paths])


def asic(
    model: IntegerModel, pdk: str, paths: Sequence[Path], *, recordings: Recordings | None = None
) -> tuple[Chip, Netlist]:
    """The result (`asic.json`) and the netlist; ``model`` with a configuration of `chip_config`.

    With ``recordings`` one of them is played into the netlist and its energy counted.

    Raises
    ------
    InputError
        A Liberty file that is none, of another process or without a cell that is needed.
    """
    config = model.config
    libraries = libraries_of(paths)
    process = process_of(pdk, libraries["typ"])
    netlist = netlist_of(config, model.arrays, process)
    nets, counted = Nets(netlist.module, process.cells), netlist.counted(process)
    area_of, number_of = defaultdict[str, float](float), Counter[str]()
    for cell, number in counted:
        area_of[cell.kind] += cell.area * number
        number_of[cell.kind] += number
    total = sum(area_of.values())
    load = timing.wire_load_of(process.library, WIRE_LOAD)
    wire = process.library.wire_loads.get(load, WireLoad(lengths={}, slope=0.0, farad=0.0))
    slowest = _slowest(netlist, libraries, load) if timing.has_sta() else dict.fromkeys(("typ", "slow"))
    leakage = sum(cell.leakage * number for cell, number in counted)
    if recordings is None:
        energy = ChipEnergy(
            step_j=None,
            interval_j=None,
            touch_j=None,
            leakage_w=leakage,
            band=BAND,
            waiting_cycle_j=costs(nets, process.library.voltage, wire).root_j,
            method=f"{METHOD}; what needs recordings is null without --data",
        )
    else:
        energy = measured(model, nets, process.library.voltage, wire, leakage, recordings)
    result = Chip(
        pdk=pdk,
        corner=f"typ {process.library.voltage:g} V {process.library.temperature:g} C",
        lanes=config.hardware.lanes,
        rom=not config.hardware.loadable,
        one_phase=config.hardware.one_phase,
        area_um2=total,
        area_by_kind_um2=area_of,
        kge=total / process.nand.area / 1e3,
        flip_flops=number_of["flip-flop"],
        latches=number_of["latch"],
        clock_gates=number_of["gate"],
        memories=[Macro.model_validate(row) for row in netlist.memories],
        fmax_hz={corner: path.fmax_hz if path else None for corner, path in slowest.items()},
        timing_by=timing.BY_STA if timing.has_sta() else timing.NOT_TOLD,
        wire_load=(load or None) if timing.has_sta() else None,
        paths={
            corner: SlowestPath(
                start=path.start, end=path.end, macros_derated=timing.MACRO_DERATING if path.derated else None
            )
            for corner, path in slowest.items()
            if path
        },
        energy=energy,
        tiles=total / (UTILISATION * math.prod(TILE_UM)),
        utilisation=UTILISATION,
        cannot_be_claimed=CANNOT,
    )
    return result, netlist


def _slowest(
    netlist: Netlist, libraries: Mapping[str, Sequence[Library]], load: str
) -> dict[str, timing.Slowest | None]:
    """The slowest path of each corner; None without a file of its cells."""
    kinds = {row["kind"] for row in netlist.memories}

    def macros_of(corner: str) -> list[Library]:
        return [
            library for library in libraries[corner] if not library.holds_logic and kinds & set(library.cells)
        ]

    paths: dict[str, timing.Slowest | None] = {}
    for corner in ("typ", "slow"):
        logic = [library for library in libraries[corner] if library.holds_logic]
        macros, foreign = macros_of(corner), [] if macros_of(corner) else macros_of("typ")
        files = [*logic, *macros], foreign, load
        paths[corner] = timing.slowest(netlist.verilog, TOP, *files) if logic else None
    return paths


# ---------------------------------------------------------------------- energy
BUILDS = Path("build/simulators")
ZEPTO = 1e-21
"""Joule of the unit in which a netlist adds up."""
NEAR = 3
"""Frames on either side of a step whose energy may belong to its decision; fewer where windows follow
closely."""
DRAIN_CYCLES = 48
"""Cycles of a slow frame beyond two a taxel: enough for the clock to stop within it."""
METHOD = (
    "changes of nets from cycle to cycle at gate level, Liberty energy and capacitance, wire load; no glitches, "
    "no clock tree, no layout"
)


def _resting(recordings: Recordings, frames: int) -> Recordings:
    """The first of ``recordings``, with its last frame repeated ``frames`` times, because the frames after a
    decision belong to the energy of its step."""
    single = recordings.subset([0])
    samples = np.concatenate([single.samples, np.repeat(single.samples[-1:], frames, axis=0)])
    return dataclasses.replace(single, samples=samples, offsets=np.array([0, len(samples)]))


def counting(nets: Nets, cost: Costs) -> str:
    """The netlist in Verilog. Output ``joule`` is the energy so far in `ZEPTO` joule, and ``edges`` the number of
    edges behind the gate before all others (without one, of all)."""
    counted: dict[str, list[tuple[str, float]]] = {"joule": [], "edges": []}

    def joined(bits: Sequence[int | str]) -> str:
        names = [f"n{bit}" if isinstance(bit, int) else f"1'b{bit}" for bit in reversed(bits)]
        return names[0] if len(names) == 1 else "{" + ",\n".join(names) + "}"  # no edge of {n} is seen

    def count(kind: str, joule: float, clock: str, when: str = "1") -> None:
        """Edges of ``clock``."""
        toggle = f"toggle_{len(lines)}"
        lines.append(f"reg {toggle} = 0; always @(posedge {clock}) if ({when}) {toggle} <= ~{toggle};")
        counted[kind].append((toggle, joule))

    ports, lines = nets.module["ports"], [f"wire n{net};" for net in {*nets.driver, *nets.receivers}]
    for name, port in ports.items():
        ends = joined(port["bits"]), name
        lines.append("assign {} = {};".format(*ends if port["direction"] == "input" else reversed(ends)))
    for name, kind in nets.cells.items():
        pins = {pin: joined(bits) for pin, bits in nets.module["cells"][name]["connections"].items() if bits}
        lines.append(
            f"{kind.name} c{len(lines)} ({', '.join(f'.{pin}({ends})' for pin, ends in pins.items())});"
        )
        if kind.kind == "memory":
            enable, write, read = (pins[f"A_{pin}"] for pin in ("MEN", "WEN", "REN"))
            for access, when in (("write", write), ("read", f"{read} & ~{write}")):
                count("joule", kind.access_j[access], pins["A_CLK"], f"{enable} & {when}")
    for net, joule in cost.joule.items():
        if cost.kind[net] == "clock":
            count("joule", joule, f"n{net}")
        else:
            counted["joule"].append((f"n{net}", joule))
    (first, *others) = (name for name, *_ in nets.receivers[nets.clock])
    gate = nets.cells[first].gate_pins.get("output")
    trunk = nets.module["cells"][first]["connections"][gate][0] if gate and not others else nets.clock
    count("edges", ZEPTO, f"n{trunk}")
    for output, each in counted.items():
        top, amounts = (
            len(each) - 1,
            (f"cost[{k}] = 64'd{round(joule / ZEPTO)};" for k, (_, joule) in enumerate(each)),
        )
        values = ",\n".join(value for value, _ in reversed(each))
        lines += [
            f"generate if (1) begin : counter_{output}",
            f"reg [63:0] sum = 0; reg [63:0] cost [0:{top}]; reg [{top}:0] was; wire [{top}:0] now = {{{values}}}; integer k;",
            *("initial begin", *amounts, f"end assign {output}__count = sum;"),
            f"always @(posedge clk) begin for (k = 0; k <= {top}; k = k + 1) if (now[k] != was[k]) sum = sum + cost[k];",
            "was <= now; end end endgenerate",
        ]
    heads = [f"{port['direction']} [{len(port['bits']) - 1}:0] {name}" for name, port in ports.items()]
    heads += [f"output [63:0] {output}__count" for output in counted]
    cells = {cell.name: cell for cell in nets.cells.values()}
    text = [f"module accelerator ({', '.join(heads)});", *lines, "endmodule", models(cells.values())]
    return "\n".join(text)


def measured(
    model: IntegerModel, nets: Nets, voltage: float, wire: WireLoad, leakage_w: float, recordings: Recordings
) -> ChipEnergy:
    """The energies of one recording with a whole touch.

    Parameters
    ----------
    model:
        With the chip's configuration.
    leakage_w:
        Of the whole chip.

    Raises
    ------
    InputError
        No recording has a whole touch.
    """
    config = model.config
    chosen = _resting(with_touches(model, recordings, 1)[1], config.windows.hop)
    trace, cost = run(model, chosen), costs(nets, voltage, wire)
    design, boot = Design(counting(nets, cost), BUILDS), boot_writes(config, model.arrays)
    device = Accelerator(design, config, register_map(config), boot, probes=False)
    device.command("ARM")
    device.forget()  # what a chain not yet reset may have offered
    marks = []
    for frame in chosen.recording(0):
        marks.append([device.state.decisions, device.get("edges__count"), device.get("joule__count")])
        device.frames(frame[None], 2 * config.sensor.taxels + DRAIN_CYCLES)
    # from each frame to the next one's first taxel
    decided, edges, joule = np.diff(marks, axis=0).T
    device.command("FINISH")
    decisions = device.streams()["decision"][0].view(np.uint32).tolist()
    expected = [pack_decision(config, row) for row in trace.streams["decision"][0]]
    differing = sum(decision != other for decision, other in zip_longest(decisions, expected))
    onset = int(trace.touches.onset_frame[trace.first[0]]) - 1
    clock = max(lowest_clock_hz(config), decision_cycles(config) / limits(config)["decision"])
    spent = joule * ZEPTO + cost.root_j * edges
    energy = summary(config, decided, edges, spent, onset, cost.root_j, leakage_w, clock)
    energy.bit_exact, energy.mismatches = not differing and bool(decisions), differing
    energy.compared_values = len(expected)
    return energy


def summary(
    config: AcceleratorConfig,
    decisions: np.ndarray,
    edges: np.ndarray,
    frame: np.ndarray,
    onset: int,
    root_j: float,
    leakage_w: float,
    clock_hz: float,
) -> ChipEnergy:
    """Energies from what each frame costs.

    Parameters
    ----------
    decisions, edges:
        Of each frame; edges of the clock behind its first gate.
    frame:
        Joule of each frame, edges of the clock included.
    onset:
        Number of the frame at which the touch begins.
    """
    decided = np.flatnonzero(decisions)
    of_steps = np.zeros(len(frame), bool)
    around = NEAR + step_cycles(config) // (2 * config.sensor.taxels + DRAIN_CYCLES)
    around = min(around, max(1, (config.windows.hop - 1) // 2 - 1))
    for row in decided:
        of_steps[max(0, row - around) : row + around + 1] = True
    plain = ~of_steps
    plain[: decided[0]] = plain[decided[-1] + 1 :] = False
    quiet = slice(NEAR, max(NEAR + 1, onset - around))
    hop, rate = config.windows.hop, config.sensor.scan_rate_hz
    period, steps, frames = clock_hz / rate, config.windows.steps, config.last_frame

    def whole(which: np.ndarray | slice) -> float:
        """Energy of a frame at that clock: its edges, and the clock's first net in the cycles without one."""
        return float(frame[which].mean() + root_j * (period - edges[which].mean()))

    step = float((frame[of_steps].sum() - of_steps.sum() * frame[plain].mean()) / steps)
    idle_w = leakage_w + rate * whole(quiet)
    return ChipEnergy(
        step_j=step,
        interval_j=hop * whole(plain) + step + leakage_w * hop / rate,
        touch_j=frames * whole(plain) + steps * step + leakage_w * frames / rate,
        leakage_w=leakage_w,
        band=BAND,
        waiting_cycle_j=root_j,
        method=METHOD,
        idle_w=idle_w,
        average_w=idle_w + TOUCHES_PER_S * steps * step,
        interval_frames=hop,
        clock_hz=clock_hz,
    )
