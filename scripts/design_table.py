"""What twelve designs cost: cells, memories, clock, cycles, energy; one table, to be held against an earlier
one.

``python -m scripts.design_table [SCENE ...]`` prints it: for each SCENE (as of `scripts.cell_table`) a GRU of
12 with 1 and 4 DSP lanes and a linear cell with 4 on an iCE40 UP5K, and with ``--liberty`` a GRU with 4 lanes
and ROMs on a chip; and the first of them as plain C on a microcontroller. The network's numbers are random: nothing depends on them.

Cells are placed ones, onset to decision without the link; memories block and large ones; MHz those of the
placements with seeds 1 to 3. Cycles are those of the schedule. Energy and power are the estimate of ``eskin
build`` (docs/energy.md): a touch with all its frames; waiting with a clock that stops between samples, of a
chip its leakage.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.model.model import random_integer_model
from eskin.golden.model.vectors import random_recordings
from eskin.golden.training.choose_network import network
from eskin.rtl.fpga.targets import target
from eskin.rtl.program.schedule import mean_frame_cycles, step_cycles
from eskin.verbs import asic_job, build_job, energy_job
from scripts.cell_table import BOARD, scene

SCENES = ("thesis", "synthetic", "pvdf")
SEEDS, LANES = 3, 4
COLUMNS = (
    "design",
    "cells",
    "memories",
    "MHz",
    "cycles a frame, touch",
    "quiet",
    "cycles a step",
    "a touch",
    "waiting",
)


def placed(config: AcceleratorConfig) -> tuple[str, ...]:
    """Columns behind the first, of a design on the board."""
    model = random_integer_model(config, 1)
    request = build_job.BuildRequest(
        lanes_asked=True,
        config=model.config,
        arrays=model.arrays,
        target=target(BOARD),
        link=False,
        seeds=SEEDS,
    )
    try:
        built = build_job.build(request)[0]
    except build_job.BuildError as misfit:
        return (str(misfit),)
    energy = built["energy"]
    activity = energy["activity"]
    touch_j, stopped = energy["per_touch_j"] + energy["preprocessing_per_touch_j"], energy["choices"][1]
    return (
        str(built["logic_cells"]),
        f"{built['bram']} + {built['spram']}",
        ", ".join(f"{1e-6 * hertz:.1f}" for hertz in built["seeds"].values()),
        f"{activity['frame_cycles']:.1f}",
        f"{activity['quiet_frame_cycles']:.1f}",
        f"{activity['step_cycles']}",
        f"{1e6 * touch_j:.2f} uJ",
        f"{1e6 * stopped['idle_w']:.1f} uW",
    )


def on_a_chip(config: AcceleratorConfig, pdk: str, liberty: Sequence[Path]) -> tuple[str, ...]:
    """The same of a chip: kGE, latches, MHz of the slow and the typical corner; no energy without
    recordings."""
    model = random_integer_model(asic_job.chip_config(config, LANES, True), 1)
    made = asic_job.asic(model, pdk, liberty)[0]
    touch, quiet = mean_frame_cycles(model.config)
    clocks = ", ".join(f"{1e-6 * hertz:.1f}" for hertz in made["fmax_hz"].values())
    return (
        f"{made['kge']:.1f} kGE",
        f"{made['latches']} latches",
        clocks,
        f"{touch:.1f}",
        f"{quiet:.1f}",
        f"{step_cycles(model.config)}",
        "-",
        f"{1e6 * made['energy']['leakage_w']:.2f} uW",
    )


def in_software(config: AcceleratorConfig) -> tuple[str, ...]:
    """The same as plain C on a microcontroller, in cycles of its core; a recording made up, which costs what others
    do."""
    model = random_integer_model(config, 1)
    settling, again = config.rest_level.rest_frames, config.onset_rule.rearm_frames
    played = random_recordings(config, [settling + 2 * config.last_frame + 2 * again], 1)
    with tempfile.TemporaryDirectory() as work:
        (row,) = energy_job.in_software(model, played, Path(work) / "c")
    cycles = row["cycles"]
    return (
        row["core"],
        "-",
        "-",
        f"{cycles['frame']:.0f}",
        f"{cycles['quiet']:.0f}",
        f"{cycles['step']:.0f}",
        f"{1e6 * row['per_touch_j']:.0f} uJ",
        f"{1e6 * row['idle_w']:.1f} uW",
    )


def rows(scenes: Sequence[str], pdk: str, liberty: Sequence[Path]) -> Iterator[tuple[str, ...]]:
    """Rows of `COLUMNS`, each as soon as it is known."""
    for name, front, _ in map(scene, scenes):
        front = front.replace(feature_shift=())
        for cell, hidden, lanes in (("gru", 12, 1), ("gru", 12, LANES), ("linear", None, LANES)):
            config = network(front, cell, hidden).with_lanes(lanes, "dsp")
            yield f"{name}, {cell}, P = {lanes}", *placed(config)
        yield f"{name}, gru, software", *in_software(network(front, "gru", 12))
        if liberty:
            yield f"{name}, gru, chip", *on_a_chip(network(front, "gru", 12), pdk, liberty)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, a row as soon as it is known."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", default=SCENES, metavar="SCENE", help="default: three presets")
    parser.add_argument("--pdk", default="ihp-sg13g2")
    parser.add_argument("--liberty", nargs="*", type=Path, default=(), help="of the chip's process")
    asked = parser.parse_args(arguments)
    print("| " + " | ".join(COLUMNS) + " |\n|---|" + "--:|" * (len(COLUMNS) - 1))
    for row in rows(asked.scenes, asked.pdk, asked.liberty):
        print("| " + " | ".join(row) + " |", flush=True)


if __name__ == "__main__":
    main()
