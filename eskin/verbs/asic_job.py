"""`eskin asic`: a model's accelerator in the cells of a chip's process: area, memories, clock, leakage, what its clock costs."""

from __future__ import annotations

import dataclasses
import json
import random
import re
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from eskin.cosim.gates import Chip
from eskin.cosim.netlist import Hardware, shorten_names
from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.golden.core.files import replacing, replacing_folder, write_json
from eskin.golden.core.memo import Memo, code_version, content_key
from eskin.golden.data.recordings import Recordings
from eskin.golden.model.model import IntegerModel
from eskin.rtl.asic import timing
from eskin.rtl.asic.blocks import blocks_of
from eskin.rtl.asic.energy import BAND, costs
from eskin.rtl.asic.liberty import Cell, Library, WireLoad, corners, read
from eskin.rtl.asic.models import expression, flip_cell, models
from eskin.rtl.asic.synthesis import Netlist, Process, process_of, synthesise
from eskin.rtl.fpga.synthesis import Chain
from eskin.rtl.program.memory_map import memory_images
from eskin.rtl.top.accelerator import Accelerator
from eskin.verbs import chip_energy

CACHE = Path("build/chips")
"""Finished netlists by content; safe to delete."""

MARK, PAGE, TOP = "asic.json", "asic.md", "accelerator"
UTILISATION, TILE_UM, TILE_GAP_UM = 0.7, (202.08, 154.98), (15.36, 3.78)
"""Share of a tile that cells may fill, a Tiny Tapeout tile on SG13G2, and what lies between two of them."""
WIRE_LOAD = "10k"
CANNOT = (
    "Before layout: no placement, no clock tree, no design rules. Area within 15 % before the utilisation, clock within 30 %, "
    "energy within a factor of 2."
)


def chip_config(config: AcceleratorConfig, lanes: int | None, rom: bool) -> AcceleratorConfig:
    """The configuration as a chip has it: plain lanes, a ring that macros of one port can hold, a clock that stops, constants in ROMs where
    asked."""
    lanes = lanes or config.hardware.lanes
    return config.replace(lane_type="plain", lanes=lanes, one_port=True, clock_gate=True, loadable=not rom)


def netlist_of(
    config: AcceleratorConfig, arrays: Mapping[str, np.ndarray], process: Process, *, probes: bool = False, latches: bool = True
) -> Netlist:
    """The netlist of one design; an unchanged one is taken from the build folder."""
    images = None if config.hardware.loadable else memory_images(config, arrays)
    macros = [macro.name for macro in process.macros]
    key = content_key(config.to_dict(), repr(images), probes, latches, process.library.path, macros, code_version("rtl", "golden"))
    design = Accelerator if probes else Chain
    return Netlist.of(
        Memo(CACHE).folder(key, lambda folder: synthesise(design(config, images), process, folder, top=TOP, latches=latches)), TOP
    )


def hardware_of(netlist: Netlist, process: Process, *, probes: bool, flipped: int | None = None) -> Hardware:
    """The netlist with models of its cells, whose states begin at random; ``flipped``: with one cell wrong, chosen by this seed."""
    text = shorten_names((netlist.folder / "simulated.v").read_text())
    known = {cell.name: cell for cell in (*process.library.cells.values(), *process.macros)}
    used = models(known[name.lstrip("\\")] for name in netlist.cells)
    if flipped is not None:
        text, wrong = flip_cell(text, known, flipped)
        used += wrong
    name = "played" if flipped is None else f"flipped{flipped}"
    sources = (netlist.folder / f"{name}.v", netlist.folder / f"{name}_cells.v")
    for path, content in zip(sources, (text, used), strict=True):
        with replacing(path) as temporary:
            temporary.write_text(content)
    return Hardware(sources, (), "netlist", "asic", probes)


def compiled(netlist: Netlist, process: Process, flipped: int | None = None) -> Callable[[int], Chip]:
    """What makes the netlist ready to play and begins with states of a seed; ``flipped``: with one cell wrong, chosen by this seed."""
    known = {cell.name: cell for cell in (*process.library.cells.values(), *process.macros)}
    module = json.loads((netlist.folder / "flat.json").read_text())["modules"][TOP]
    wrong = None
    if flipped is not None:
        parities = sorted(name for name, cell in module["cells"].items() if re.search(r"_xn?or2_\d$", cell["type"]))
        wrong = random.Random(flipped).choice(parities)
    return lambda seed: Chip(module, known, expression, seed, wrong)


def libraries_of(paths: Sequence[Path]) -> dict[str, list[Library]]:
    """The files by corner."""
    return corners([read(path) for path in paths])


def asic(
    model: IntegerModel,
    pdk: str,
    paths: Sequence[Path],
    *,
    latches: bool = True,
    recordings: Recordings | None = None,
    wire_load: str = WIRE_LOAD,
    delays: str = "cells",
) -> tuple[dict[str, Any], Netlist]:
    """The result (`asic.json`) and the netlist; ``model`` with a configuration of `chip_config`.

    With ``recordings`` one of them is played into the netlist and its energy counted, glitches by ``delays``
    (`eskin.verbs.chip_energy.DELAYS`). ``wire_load``: name of the nets' wire load; empty for nets without wires.

    Raises
    ------
    InputError
        A Liberty file that is none, of another process or without a cell that is needed.
    """
    config, arrays = model.config, model.arrays
    found = libraries_of(paths)
    process = process_of(pdk, found["typ"])
    netlist = netlist_of(config, arrays, process, latches=latches)
    known: dict[str, Cell] = {cell.name: cell for cell in (*process.library.cells.values(), *process.macros)}
    rows = [(known[name.lstrip("\\")], number) for name, number in netlist.cells.items()]
    area: dict[str, float] = {}
    for cell, number in rows:
        area[cell.kind] = area.get(cell.kind, 0.0) + cell.area * number
    total = sum(area.values())
    foreign = [library for library in found["typ"] if not library.holds_logic]
    used = {row["kind"] for row in netlist.memories}
    foreign = [library for library in foreign if used & set(library.cells)]
    paths_: dict[str, dict[str, Any]] = {}
    fmax: dict[str, float | None] = {"typ": None, "slow": None}
    load = timing.wire_load_of(process.library, wire_load) if wire_load else ""
    for corner in fmax:
        logic = [library for library in found[corner] if library.holds_logic]
        if not logic:
            continue
        own = [library for library in found[corner] if not library.holds_logic and used & set(library.cells)]
        other = [] if own or corner == "typ" else foreign
        if timing.has_sta():
            path = timing.slowest(netlist.verilog, TOP, [*logic, *own], other, load, netlist.folder)
        else:
            cells = known | {cell.name: cell for library in (*logic, *own) for cell in library.cells.values()}
            path = timing.estimated(netlist.folder / "flat.json", TOP, cells, [name for library in other for name in library.cells])
        paths_[corner] = {"start": path.start, "end": path.end, "macros_derated": timing.MACRO_DERATING if path.derated else None}
        fmax[corner] = path.fmax_hz
    wire = process.library.wire_loads.get(load, WireLoad(lengths={}, slope=0.0, farad=0.0))
    leakage = sum(cell.leakage * number for cell, number in rows)
    root = costs(netlist.folder / "flat.json", TOP, known, process.library.voltage, wire)
    energy: dict[str, Any] = {"step_j": None, "interval_j": None, "waiting_cycle_j": root.root_j, "leakage_w": leakage, "touch_j": None}
    energy |= {"band": BAND, "method": f"{chip_energy.METHOD}; what needs recordings is null without --data"}
    if recordings is not None:
        energy |= chip_energy.measured(model, netlist, process, known, wire, leakage, recordings, top=TOP, delays=delays)
    result = {
        "pdk": pdk,
        "corner": f"typ {process.library.voltage:g} V {process.library.temperature:g} C",
        "lanes": config.hardware.lanes,
        "rom": not config.hardware.loadable,
        "area_um2": total,
        "area_by_kind_um2": area,
        "area_by_block_um2": area_by_block(netlist, known),
        "kge": total / process.nand.area / 1e3,
        "flip_flops": sum(number for cell, number in rows if cell.kind == "flip-flop"),
        "latches": sum(number for cell, number in rows if cell.kind == "latch"),
        "clock_gates": sum(number for cell, number in rows if cell.kind == "gate"),
        "memories": [{key: row[key] for key in ("name", "words", "width", "bits", "kind")} for row in netlist.memories],
        "fmax_hz": fmax,
        "timing_by": timing.BY_STA if timing.has_sta() else timing.BY_TABLES,
        "wire_load": (load or None) if timing.has_sta() else None,
        "paths": paths_,
        "energy": energy,
        "clock_pins": {"before_gates": clock_pins(netlist, known)[0], "behind_gates": clock_pins(netlist, known)[1]},
        "tiles": total / room_um2(1, 1),
        "utilisation": UTILISATION,
        "cannot_be_claimed": CANNOT,
    }
    return result, netlist


def tiles_of(text: str) -> tuple[int, int]:
    """(wide, high) of ``8x2``.

    Raises
    ------
    InputError
    """
    found = re.fullmatch(r"([1-9]\d?)x([1-9]\d?)", text)
    if found is None:
        raise InputError(f"--fit {text}: is not of the form WxH; give tiles of Tiny Tapeout, such as 8x2")
    return int(found[1]), int(found[2])


def room_um2(wide: int, high: int) -> float:
    """What the cells may take of so many tiles, gaps between them included: 8 x 2 are 0.541 mm2."""
    width, height = (count * tile + (count - 1) * gap for count, tile, gap in zip((wide, high), TILE_UM, TILE_GAP_UM, strict=True))
    return UTILISATION * width * height


def fitted(
    model: IntegerModel, pdk: str, paths: Sequence[Path], place: tuple[int, int], *, latches: bool = True
) -> tuple[IntegerModel, list[dict[str, float]]]:
    """The model with the most lanes of its own, half of them and so on, that fit; what was tried: lanes, area_um2, tiles_filled."""
    process = process_of(pdk, libraries_of(paths)["typ"])
    known = {cell.name: cell for cell in (*process.library.cells.values(), *process.macros)}
    tried: list[dict[str, float]] = []
    lanes = model.config.hardware.lanes
    while True:
        model = dataclasses.replace(model, config=model.config.with_lanes(lanes))
        netlist = netlist_of(model.config, model.arrays, process, latches=latches)
        area = sum(known[name.lstrip("\\")].area * number for name, number in netlist.cells.items())
        tried.append({"lanes": lanes, "area_um2": area, "tiles_filled": area / room_um2(*place)})
        if area <= room_um2(*place) or lanes == 1:
            return model, tried
        lanes //= 2


def clock_pins(netlist: Netlist, known: Mapping[str, Cell]) -> tuple[int, int]:
    """Pins on the clock's own net, and behind gates."""
    module = json.loads((netlist.folder / "flat.json").read_text())["modules"][TOP]
    clock, pins = module["ports"]["clk"]["bits"][0], [0, 0]
    for cell in module["cells"].values():
        for pin, bits in cell["connections"].items():
            if pin in known[cell["type"]].pins and known[cell["type"]].pins[pin].clock:
                pins[bits[0] != clock] += 1
    return pins[0], pins[1]


def area_by_block(netlist: Netlist, known: Mapping[str, Cell]) -> dict[str, float]:
    """um2 by block."""
    module = json.loads((netlist.folder / "flat.json").read_text())["modules"][TOP]
    areas: dict[str, float] = {}
    for cell, block in blocks_of(module, known).items():
        areas[block] = areas.get(block, 0.0) + known[module["cells"][cell]["type"]].area
    return dict(sorted(areas.items(), key=lambda row: -row[1]))


def write(result: Mapping[str, Any], netlist: Netlist, out: Path, clock_hz: float) -> None:
    """asic.json, the page, netlist and SDC, in one exchange."""
    with replacing_folder(out) as folder:
        shutil.copyfile(netlist.verilog, folder / "netlist.v")
        period = 1e9 / clock_hz
        (folder / f"{TOP}.sdc").write_text(timing.SDC.format(clock_hz=clock_hz, period_ns=period, outside=period / 4))
        (folder / PAGE).write_text(page(result))
        write_json(folder / MARK, result)


def figures(result: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The result in words."""
    fmax, energy = result["fmax_hz"], result["energy"]
    shares = ", ".join(f"{kind} {um2 / 1e6:.3f}" for kind, um2 in sorted(result["area_by_kind_um2"].items(), key=lambda row: -row[1]))
    speed = ", ".join(f"{corner} {hertz / 1e6:.1f} MHz" if hertz else f"{corner}: no file of cells" for corner, hertz in fmax.items())
    load = f"wire load {result['wire_load']}" if result["wire_load"] else "no wire load"
    derated = [
        f"macros {row['macros_derated']:g} times slower at {corner}" for corner, row in result["paths"].items() if row["macros_derated"]
    ]
    return [
        ("process", f"{result['pdk']}, {result['corner']}"),
        ("design", f"{result['lanes']} lanes, {'constants in ROMs' if result['rom'] else 'loadable'}"),
        ("area", f"{result['area_um2'] / 1e6:.3f} mm2, {result['kge']:.1f} kGE: {shares}"),
        ("cells", f"{result['flip_flops']} flip-flops, {result['latches']} latches, {result['clock_gates']} clock gates"),
        ("tiles", f"{result['tiles']:.1f} of Tiny Tapeout at {100 * result['utilisation']:.0f} % filled"),
        ("highest clock", f"{speed} ({result['timing_by']}, {', '.join([load, *derated])})"),
        ("leakage", f"{energy['leakage_w'] * 1e6:.2f} uW"),
        ("cycle without an edge", f"{energy['waiting_cycle_j'] * 1e12:.2f} pJ"),
        *energy_figures(energy),
        ("energies are", f"within a factor of {energy['band']:g}; {energy['method']}"),
        ("not claimed", result["cannot_be_claimed"]),
    ]


def energy_figures(energy: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What was counted on a recording, in words; nothing where there was none."""
    if energy["step_j"] is None:
        return []
    parts = ", ".join(f"{name} {1e9 * joule:.0f}" for name, joule in sorted(energy["interval_parts_j"].items(), key=lambda row: -row[1]))
    clock, glitches = f"{energy['clock_hz'] / 1e6:.3g} MHz", energy["glitches"]
    return [
        ("a step", f"{1e9 * energy['step_j']:.1f} nJ"),
        (f"a step interval of {energy['interval_frames']} frames", f"{1e6 * energy['interval_j']:.2f} uJ at {clock}, in nJ: {parts}"),
        ("a whole touch", f"{1e6 * energy['touch_j']:.1f} uJ"),
        (
            "glitches add",
            f"{1e9 * glitches['step_j']:.1f} nJ to a step, {1e9 * glitches['interval_j']:.0f} nJ to an interval, "
            f"{1e6 * glitches['touch_j']:.1f} uJ to a touch, {1e6 * glitches['average_w']:.2f} uW to the average: {glitches['method']}",
        ),
        ("cycles with an edge", f"{100 * energy['clocked_share']:.0f} % in a touch at {clock}"),
        (
            "average at one touch a second",
            f"{1e6 * energy['average_w']:.1f} uW; 1000 mAh at 5 V last {energy['battery_hours'] / 8766:.0f} years",
        ),
        ("played", f"{energy['compared_values']} values compared, {energy['mismatches']} mismatches"),
    ]


def page(result: Mapping[str, Any]) -> str:
    """The page."""
    rows = [("figure", "value"), ("---", "---"), *figures(result)]
    memories = [("memory", "words", "bits of a word", "made of"), ("---",) * 4]
    memories += [(row["name"], row["words"], row["width"], row["kind"]) for row in result["memories"]]
    blocks = [("block", "um2"), ("---", "---:"), *((name, f"{area:.0f}") for name, area in result["area_by_block_um2"].items())]
    table = "\n".join("| " + " | ".join(map(str, row)) + " |" for row in rows)
    others = "\n\n".join("\n".join("| " + " | ".join(map(str, row)) + " |" for row in part) for part in (memories, blocks))
    return f"# Chip\n\n{table}\n\n{others}\n"
