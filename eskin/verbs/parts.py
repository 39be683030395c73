"""What a model needs on each part that it can go to, from figures that exist: estimates of the choice for FPGAs,
the C export for processors. None: not known."""

import shutil
import subprocess
import tempfile
from pathlib import Path

from eskin.exchange import plain_c
from eskin.golden.core import InputError
from eskin.golden.model import IntegerModel
from eskin.pages.result import PartNeed
from eskin.rtl.fpga.targets import Target
from eskin.rtl.fpga.targets import target as find_target
from eskin.rtl.program.schedule import decision_cycles
from eskin.study.energy import PARTS
from eskin.verbs.build import suited
from eskin.verbs.cost import LINK_BLOCKS, blocks_of, cost_of, fits

BOARDS = ("icebreaker", "ulx3s", "tangnano9k")
"""A board of each FPGA."""
COMPILERS = {
    "Cortex-M0+": ("arm-none-eabi-gcc", "-mcpu=cortex-m0plus", "-mthumb"),
    "AVR": ("avr-gcc", "-mmcu=atmega1284p"),
}
"""Compiler and its options for each processor."""


def parts_of(model: IntegerModel) -> list[PartNeed]:
    """A row for each FPGA, and for each processor if C takes the model."""
    rows = [_on_fpga(model, find_target(board)) for board in BOARDS] + _on_processors(model)
    return [PartNeed(**row.model_dump()) for row in rows]  # what is not known is written, too


def _on_fpga(model: IntegerModel, target: Target) -> PartNeed:
    config, known = model.config, target.room is not None and target.device in PARTS
    row = PartNeed(part=target.device, board=target.name)
    try:
        if not known:
            row.latency_s = decision_cycles(suited(config, target)) / target.clock_hz
            return row
        cost = cost_of(config, target.name)
        row.cells, row.latency_s, row.average_w = cost.cells, cost.latency_s, cost.average_w
        if config.is_image:  # whose block memories no estimate counts
            return row
        row.fits, blocks = fits(config, target.name), blocks_of(config, target.name)
        if (
            row.fits and target.room and blocks + LINK_BLOCKS > target.room.blocks
        ):  # weights in large memories
            blocks = blocks_of(config.replace(spare_blocks=True), target.name)
        row.block_memories = blocks
    except InputError:  # what lanes there do not take
        row.fits = False
    return row


def _on_processors(model: IntegerModel) -> list[PartNeed]:
    config = model.config
    try:
        sources = plain_c.sources(model)
    except InputError:  # C does not take the model
        return []
    samples = 0 if config.is_image else config.last_frame * config.sensor.taxels
    operations = config.multiplies * (1 if config.is_image else config.windows.steps) + samples
    tables = plain_c.constant_bytes(model)
    return [
        PartNeed(part=part, bytes=_compiled(sources, compiler), constant_bytes=tables, operations=operations)
        for part, compiler in COMPILERS.items()
    ]


def _compiled(sources: dict[str, str], compiler: tuple[str, ...]) -> int | None:
    """Bytes of program and constants; None without the compiler, or where it fails."""
    name, *options = compiler
    size = name.replace("gcc", "size")
    if not (shutil.which(name) and shutil.which(size)):
        return None
    with tempfile.TemporaryDirectory() as folder:
        for path in (plain_c.HEADER, plain_c.SOURCE):
            (Path(folder) / path).write_text(sources[path])
        built = [name, *options, "-std=c99", "-Os", "-c", plain_c.SOURCE, "-o", "model.o"]
        try:
            subprocess.run(built, cwd=folder, check=True, capture_output=True, timeout=120)
            listing = subprocess.run(
                [size, "model.o"], cwd=folder, check=True, capture_output=True, text=True, timeout=60
            )
            text, data, *_ = listing.stdout.splitlines()[1].split()
        except (subprocess.SubprocessError, OSError, IndexError, ValueError):
            return None
    return int(text) + int(data)
