"""What a bus shell costs: cells of the whole design less those of the bare one, its clock and the cycles of a
frame, one table.

``python -m scripts.bus_cells [ROW ...]`` prints it, or its rows of these names: Yosys' counts on an iCE40 UP5K before
placement, preset ``thesis`` on one lane, and the highest clock of one placement (seed 1) with registers around all
ports. A frame of 16 taxels goes in through the C driver, pair by pair, as fast as the Verilated design takes it. The
network's numbers are random: nothing depends on them.
"""

from __future__ import annotations

import sys
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from eskin.golden.core.config import PRESETS
from eskin.golden.model.model import IntegerModel, random_integer_model
from eskin.rtl.fpga.generate import generate
from eskin.rtl.fpga.implementation import place
from eskin.rtl.fpga.synthesis import ICE40_DSP, Chain, Harness, PoweredOn, synthesise
from eskin.rtl.fpga.targets import target
from eskin.rtl.top.bus_top import Bus, BusTop

ROWS: dict[str, dict[str, Any]] = {
    "Wishbone": {"bus": "wishbone"},
    "APB": {"bus": "apb"},
    "AXI4-Lite": {"bus": "axi4lite"},
    "Wishbone, no queue": {"bus": "wishbone", "depth": 0},
    "Wishbone, a queue of 4": {"bus": "wishbone", "depth": 4},
    "Wishbone, frames from a stream": {"bus": "wishbone", "axis": True},
}

FRAMES = 300


def random_model() -> IntegerModel:
    """The design behind the buses."""
    return random_integer_model(PRESETS["thesis"].replace(lanes=1), 1)


def cells(design: Any) -> tuple[int, int]:
    """LUTs and flip-flops."""
    with tempfile.TemporaryDirectory() as folder:
        counts = synthesise(design, ICE40_DSP, Path(folder)).cells
    return counts["SB_LUT4"], sum(count for name, count in counts.items() if name.startswith("SB_DFF"))


def clock_mhz(design: Any) -> float:
    """Of one placement."""
    board = target("icebreaker")
    pins = dict(
        zip(("clk", "shift_in", "capture", "shift_out"), (board.clock_pin, *board.pins), strict=False)
    )
    with tempfile.TemporaryDirectory() as folder:
        netlist = synthesise(PoweredOn(Harness(design)), ICE40_DSP, Path(folder))
        return place(netlist, board, pins, Path(folder) / "placed", seed=1).fmax_hz / 1e6


@cache
def frame_cycles(bus: Bus) -> float:
    """Mean of the cycles from one frame to the next, at rest."""
    from tests.support.driver_board import Board  # as the tests drive the same pins

    model = random_model()
    with tempfile.TemporaryDirectory() as folder:
        board = Board(generate(model.config, model.arrays, Path(folder) / "design", bus=bus), bus)
        assert board.driver("present") and board.driver.load()
        samples = np.full((FRAMES, model.config.sensor.taxels), 2000)
        begin = board.device.state.cycle
        board.driver.play(samples, lambda: board.device.get("irq"), pairs=True)
        return (board.device.state.cycle - begin) / FRAMES


def main() -> None:
    """Print the table, a row as soon as it is known."""
    config = random_model().config
    bare = cells(Chain(config))
    print("| shell | LUT | flip-flops | MHz | cycles a frame |\n| --- | --: | --: | --: | --: |")
    print(
        f"| none (the whole design) | {bare[0]} | {bare[1]} | {clock_mhz(Chain(config)):.1f} | |", flush=True
    )
    for name in sys.argv[1:] or ROWS:
        lut, ff = cells(BusTop(config, **ROWS[name]))
        mhz = clock_mhz(BusTop(config, **ROWS[name]))
        cycles = "" if ROWS[name].get("axis") else f"{frame_cycles(ROWS[name]['bus']):.0f}"
        print(f"| {name} | {lut - bare[0]} | {ff - bare[1]} | {mhz:.1f} | {cycles} |", flush=True)


if __name__ == "__main__":
    main()
