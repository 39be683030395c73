"""`eskin asic`: a model's accelerator in the cells of a chip's process: area, memories, clock, leakage,
energy of its clock."""

import math
import shutil
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path

from eskin.cosim.latency import limits
from eskin.cosim.netlist import Hardware, shorten_names
from eskin.golden.core import (
    AcceleratorConfig,
    Arrays,
    Record,
    content_key,
    replacing,
    replacing_folder,
    write_json,
)
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel
from eskin.memo import Memo, code_version
from eskin.pages.views import words
from eskin.rtl.asic import timing
from eskin.rtl.asic.liberty import Library, WireLoad, corners, read
from eskin.rtl.asic.nets import BAND, Nets, costs
from eskin.rtl.asic.synthesis import Netlist, Process, models, process_of, synthesise
from eskin.rtl.fpga.synthesis import Chain
from eskin.rtl.program.memory_map import memory_images
from eskin.rtl.program.schedule import decision_cycles, step_cycles
from eskin.rtl.top.accelerator import Accelerator
from eskin.verbs import chip_energy

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
    macros = [macro.name for macro in process.macros]
    key = content_key(
        config.to_dict(), repr(images), probes, process.library.path, macros, code_version("rtl", "golden")
    )
    design = Accelerator if probes else Chain

    def make(folder: Path) -> None:
        synthesise(design(config, images), process, folder, top=TOP)

    return Netlist.of(Memo(CACHE).folder(key, make), TOP)


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
) -> tuple[Record, Netlist]:
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
    energy: Record = {"step_j": None, "interval_j": None, "touch_j": None, "leakage_w": leakage, "band": BAND}
    energy |= {"waiting_cycle_j": costs(nets, process.library.voltage, wire).root_j}
    energy |= {"method": f"{chip_energy.METHOD}; what needs recordings is null without --data"}
    if recordings is not None:
        energy |= chip_energy.measured(model, nets, process.library.voltage, wire, leakage, recordings)
    result = {
        "pdk": pdk,
        "corner": f"typ {process.library.voltage:g} V {process.library.temperature:g} C",
        "lanes": config.hardware.lanes,
        "rom": not config.hardware.loadable,
        "one_phase": config.hardware.one_phase,
        "area_um2": total,
        "area_by_kind_um2": area_of,
        "kge": total / process.nand.area / 1e3,
        "flip_flops": number_of["flip-flop"],
        "latches": number_of["latch"],
        "clock_gates": number_of["gate"],
        "memories": [{key: row[key] for key in row if key != "cell"} for row in netlist.memories],
        "fmax_hz": {corner: path and path.fmax_hz for corner, path in slowest.items()},
        "timing_by": timing.BY_STA if timing.has_sta() else timing.NOT_TOLD,
        "wire_load": (load or None) if timing.has_sta() else None,
        "paths": {
            corner: {
                "start": path.start,
                "end": path.end,
                "macros_derated": timing.MACRO_DERATING if path.derated else None,
            }
            for corner, path in slowest.items()
            if path
        },
        "energy": energy,
        "tiles": total / (UTILISATION * math.prod(TILE_UM)),
        "utilisation": UTILISATION,
        "cannot_be_claimed": CANNOT,
    }
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
        files = [*logic, *macros], foreign, load, netlist.folder
        paths[corner] = timing.slowest(netlist.verilog, TOP, *files) if logic else None
    return paths


def write(result: Record, netlist: Netlist, out: Path, clock_hz: float) -> None:
    """asic.json, the page, netlist and SDC, in one exchange."""
    with replacing_folder(out) as folder:
        shutil.copyfile(netlist.verilog, folder / "netlist.v")
        period = 1e9 / clock_hz
        sdc = timing.SDC.format(clock_hz=clock_hz, period_ns=period, outside=period / 4)
        (folder / f"{TOP}.sdc").write_text(sdc)
        (folder / PAGE).write_text(words("asic", **result))
        write_json(folder / MARK, result)
