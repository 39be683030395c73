"""Files of the example: `prepare` writes firmware, system and expected decisions, `compare` checks its
output, `bitstream` builds for a board. The Makefile calls them."""

import argparse
import dataclasses
import re
import shutil
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
from soc import CORE, LICENCE, LOADED_WORDS, Soc

from eskin.cosim.flow import converter_model
from eskin.cosim.netlist import netlist_hardware
from eskin.data import load_recordings
from eskin.golden.core import AcceleratorConfig, InputError
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel, Stream, through_converter
from eskin.golden.model.decision_word import decision_word
from eskin.rtl.fpga.export import verilog as text_of
from eskin.rtl.fpga.generate import generate
from eskin.rtl.fpga.implementation import DoesNotFit, place
from eskin.rtl.fpga.synthesis import PoweredOn, synthesise
from eskin.rtl.fpga.targets import target
from eskin.rtl.host.flash_loader import OFFSET, image
from eskin.rtl.host.uart import uart_divisor

HERE = Path(__file__).parent
BAUD = 1e6
WORDS = {"icebreaker": 1 << 14}
"""Words of the memory: two large ones of an iCE40 UP5K; elsewhere 4096."""
FLASH_SITES = {"flash__cs_n": "16", "flash__sclk": "15", "flash__mosi": "14", "flash__miso": "17"}
"""The icebreaker's."""
CONVERTER = "ads7953"
COMPILER = "cc -target riscv32-freestanding -mcpu=generic_rv32 -O2 -std=c99 -ffreestanding -nostdlib -fno-sanitize=all"
COMPILER += " -flto -DESKIN_BASE=0x40000000u"
STRICT = "-Wall -Wextra -Werror -Wl,-T,link.ld -Wl,--gc-sections -ffunction-sections"
REST = 64
"""Frames of rest behind the last recording: the last line goes out in them."""
COUNTS = re.compile(r"cycles (\d+) works (\d+) most (\d+) missed (\d+) violations (\d+)")
LINE = re.compile(r"class (\d+) margin (\d+) step (\d+) global (\d) partial (\d) unsure (\d) time (\d+) us")


def configuration(model: IntegerModel, feed: str, clock_hz: float, board: str | None) -> AcceleratorConfig:
    """The model's, with what feeds it, one lane of the type that suits the board, and its clock."""
    config = model.config.with_lanes(1, "dsp" if board == "icebreaker" else "plain")
    return config.replace(
        converter=CONVERTER if feed == "converter" else "none",
        clock_hz=clock_hz,
        spare_blocks=board == "icebreaker" and config.recurrent,
    )


def firmware(folder: Path) -> list[int]:
    """Words of the program, compiled with the driver in ``folder``/eskin."""
    command = [sys.executable, "-m", "ziglang"]
    sources = [str(HERE / "firmware.c"), str(folder / "eskin" / "eskin.c")]
    options = [*COMPILER.split(), *STRICT.replace("link.ld", str(HERE / "link.ld")).split()]
    elf, image = folder / "firmware.elf", folder / "firmware.bin"
    subprocess.run([*command, *options, f"-I{folder / 'eskin'}", *sources, "-o", str(elf)], check=True)
    subprocess.run([*command, "objcopy", "-O", "binary", str(elf), str(image)], check=True)
    data = image.read_bytes()
    return np.frombuffer(data + bytes(-len(data) % 4), "<u4").tolist()


def parts(recordings: Recordings, begin: int, frames: int) -> Recordings:
    """Frames of each recording from ``begin`` on, at most this number (0: all)."""
    ranges = [
        np.arange(first + begin, min(last, first + begin + frames) if frames else last)
        for first, last in pairwise(recordings.offsets)
    ]
    offsets = np.cumsum([0, *map(len, ranges)])
    return dataclasses.replace(
        recordings, samples=recordings.samples[np.concatenate(ranges)], offsets=offsets
    )


def prepare(options: argparse.Namespace) -> None:
    model, folder, board = IntegerModel.load(options.model), options.out, options.board
    clock_hz = target(board).clock_hz if board else options.clock
    config = configuration(model, options.feed, clock_hz, board)
    folder.mkdir(parents=True, exist_ok=True)
    generate(config, model.arrays, folder / "eskin", bus="wishbone")
    program = firmware(folder)
    shutil.copy(LICENCE, folder / "LICENSE.serv")
    # ---------------------------------------------------------------- recordings, and the decisions expected of them
    recordings = load_recordings(options.data, config=config)
    if not 0 < options.recordings <= len(recordings):
        raise InputError(
            f"--recordings: is {options.recordings}; there are {len(recordings)}, give 1 or more"
        )
    chosen = np.linspace(0, len(recordings) - 1, options.recordings).round().astype(int)
    played = recordings.subset(chosen.tolist())
    if options.begin or options.frames:
        played = parts(played, options.begin, options.frames)
    played = played.scanned(config.sensor.scan_every)
    if options.feed == "converter":
        played, pins = through_converter(played, config)
    else:
        pins = played.samples
    samples, pins = (np.concatenate([part, part[-1:].repeat(REST, 0)]) for part in (played.samples, pins))
    (folder / "frames.hex").write_text("".join(f"{int(code) & 0xFFFF:04x}\n" for code in pins.reshape(-1)))
    decided = Stream(model, scanned=True).push(samples)
    words = [decision_word(config, decision.row()) for decision in decided]
    (folder / "expected.txt").write_text("".join(f"{word:08x}\n" for word in words))
    period = clock_hz / config.sensor.scan_rate_hz
    settings = {"FRAMES": len(pins), "PERIOD": round(period), "DIVISOR": uart_divisor(clock_hz, BAUD)}
    settings |= {"TAXELS": config.sensor.taxels, "CYCLE_PS": round(1e12 / clock_hz)}
    sources, wired = converter_model(config) if options.feed == "converter" else ((), ())
    flags = [f"-G{name}={value}" for name, value in settings.items()]
    flags += [*wired, *map(str, sources)] + ["-DFLASH"] * (board == "icebreaker")
    (folder / "simulation.f").write_text("\n".join(flags) + "\n")
    # ---------------------------------------------------------------- the system
    flash = board == "icebreaker"
    soc = Soc(config, None if flash else program, words=WORDS.get(board, 4096))
    if flash:
        halves = np.array(program, "<u4").view("<u2").tolist()
        (folder / "flash.bin").write_bytes(image(halves + [0] * (2 * LOADED_WORDS - len(halves))))
    if board is None:
        (folder / "soc.sv").write_text(text_of(PoweredOn(soc), "soc"))
        return
    bitstream(config, soc, board, folder)


def bitstream(config: AcceleratorConfig, soc: Soc, board: str, folder: Path) -> None:
    part = target(board)
    design = PoweredOn(soc, part.family.power_on_cycles(part.clock_hz))
    netlist = synthesise(design, part.family, folder / "netlist", top="soc", verilog=CORE)
    cells = netlist_hardware(netlist.verilog, part.family.name, board, probes=False)
    for name, source in zip(("netlist.v", "cells.v"), cells.sources, strict=False):
        shutil.copy(source, folder / name)
    (_, tx), free = part.uart, iter(part.pins)
    sites = {"clk": part.clock_pin, "tx": tx, "led": part.led}
    sites |= FLASH_SITES if board == "icebreaker" else {}
    sites |= {f"pins__{name}": next(free) for name in ("cs_n", "mosi", "miso", "sclk")}
    placed = place(netlist, part, sites, folder / "placed", seed=1)
    shutil.copy(placed.bitstream, folder / f"soc{placed.bitstream.suffix}")
    used = ", ".join(
        f"{count} of {room} {name}" for name, (count, room) in placed.utilisation.items() if count
    )
    print(f"{board}: {used}; {placed.fmax_hz / 1e6:.1f} MHz of {part.clock_hz / 1e6:g} ({placed.path})")
    if board == "icebreaker":
        print(f"{folder}/flash.bin: the program, for byte {OFFSET:#x} of the flash")


def compare(options: argparse.Namespace) -> int:
    """Exit status 1 when a decision differs from the golden model's, or one is missing or too many."""
    text = options.said.read_text()
    rows = [tuple(map(int, line)) for line in LINE.findall(text)]
    words = [
        label | step << 7 | margin << 15 | is_global << 29 | partial << 30 | unsure << 31
        for label, margin, step, is_global, partial, unsure, _ in rows
    ]
    expected = [int(line, 16) for line in (options.out / "expected.txt").read_text().split()]
    compared = max(len(words), len(expected))
    differ = compared - sum(a == b for a, b in zip(words, expected, strict=False))
    counts = re.search(COUNTS, text)
    if counts is None:
        print(f"{options.said}: the simulation did not come to its end", file=sys.stderr)
        return 1
    cycles, works, most, missed, violations = map(int, counts.groups())
    frames, period = (
        int(re.findall(rf"-G{name}=(\d+)", (options.out / "simulation.f").read_text())[0])
        for name in ("FRAMES", "PERIOD")
    )
    print(f"the CPU waits in {1 - works / cycles:.2%} of {cycles} cycles, {frames} frames")
    print(
        f"it works in {works / frames:.0f} of {period} cycles a frame, at most {most}; {missed} frames missed"
    )
    failed = missed or violations or "fault" in text
    if failed:
        print(f"{violations} limits of the converter broken; {text.count('fault')} faults told")
    print(f"{options.out.name}: {compared} decisions compared, {differ} differ")
    return int(bool(differ or failed or not compared))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    verbs = parser.add_subparsers(required=True)
    verb = verbs.add_parser("prepare")
    verb.add_argument("feed", choices=["converter", "cpu"])
    verb.add_argument("--model", type=Path, required=True)
    verb.add_argument("--data", default="synthetic")
    verb.add_argument("--recordings", type=int, default=3)
    verb.add_argument("--begin", type=int, default=0, help="first frame of each recording that is played")
    verb.add_argument("--frames", type=int, default=0, help="of each recording; 0: all")
    verb.add_argument("--clock", type=float, default=12e6)
    verb.add_argument("--board", choices=["icebreaker", "ulx3s"])
    verb.add_argument("--out", type=Path, required=True)
    verb.set_defaults(job=prepare)
    verb = verbs.add_parser("compare")
    verb.add_argument("said", type=Path)
    verb.add_argument("--out", type=Path, required=True)
    verb.set_defaults(job=compare)
    options = parser.parse_args()
    try:
        return options.job(options) or 0
    except InputError as error:
        print(f"build.py: {error}", file=sys.stderr)
        return 2
    except subprocess.CalledProcessError as error:  # the compiler has said why
        return error.returncode
    except DoesNotFit as error:
        print(f"build.py: the system {error}; take a smaller model", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
