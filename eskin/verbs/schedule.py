"""Draw the work of each unit in each cycle, from the program of the hardware.

Example: eskin schedule model --lanes 4 --out picture
"""

import contextlib
from pathlib import Path
from typing import Any

from eskin.cli.common import LaneOptions, argument, console, option, parse_lanes, say
from eskin.golden.core import PRESETS, InputError, check_target, replacing
from eskin.golden.model import load_config
from eskin.pages.views import terminal_table
from eskin.rtl.image.image_engine import refuse_hardware
from eskin.rtl.program.image_passes import plan_of
from eskin.rtl.program.schedule import schedule
from eskin.rtl.views import image_view, schedule_view


class ScheduleRequest(LaneOptions):
    model: Path = argument("A model folder, or a preset: thesis, synthetic, pvdf, fabric.")
    out: Path = option("Folder for the files.", Path("build/schedule"))


def command(request: ScheduleRequest) -> None:
    config = PRESETS.get(str(request.model)) or load_config(request.model)
    config = config.with_lanes(*parse_lanes(request.lanes))
    check_target(request.out / "schedule")
    if config.is_forest:
        raise InputError(
            f"configuration '{config.name}', field cell: is 'trees', which walk in a fixed order without a schedule"
        )
    view: Any = image_view if config.is_image else schedule_view
    if config.is_image:
        refuse_hardware(config)
    plan: Any = plan_of(config) if config.is_image else schedule(config)
    files = view.drawing_files(plan)
    for name in files:
        check_target(request.out / name)
    with contextlib.ExitStack() as stack:  # all files or none
        for name, write in files.items():
            write(stack.enter_context(replacing(request.out / name)))
    console.print(terminal_table(view.title(plan).partition("\n")[0], view.COLUMNS, view.cells(plan)))
    say(f"files: {', '.join(str(request.out / name) for name in files)}")
