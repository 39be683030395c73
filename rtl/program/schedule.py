"""The schedule of a configuration's step, and the clocks that follow from it."""

import math
from functools import lru_cache

from eskin.golden.core import SUMMED, AcceleratorConfig
from eskin.rtl.program.cells import CellProgram, cell_program
from eskin.rtl.program.image_passes import plan_of
from eskin.rtl.program.scheduler import Schedule, Scheduler
from eskin.rtl.program.timing import (
    FRAME_EXTRA_CYCLES,
    VERDICT_CYCLES,
    detector_latency,
    forest_cycles,
    logit_to_decision,
)

IMAGE_START_CYCLES = 2
"""Cycles from the last pixel of an image to the start of the engine."""


@lru_cache(maxsize=64)
def schedule(config: AcceleratorConfig, program: CellProgram | None = None) -> Schedule:
    """Place one step of ``program`` (the configured cell's by default) on ``config.hardware.lanes`` lanes and
    one element-wise lane.

    A single lane does the element-wise operations too, between two dot products.
    """
    program = program or cell_program(config)
    ways = (False, True) if any(op.activated for op in program.elements) else (False,)
    plans = [Scheduler(config, program, yields).run() for yields in ways]
    # neither way is always the shorter one
    return min(plans, key=lambda plan: plan.step_cycles)


def step_cycles(config: AcceleratorConfig) -> int:
    """Cycles of a step up to its decision; of an image, for which there is no schedule of slots, from its
    start."""
    if config.is_forest:
        return forest_cycles(config) - 1 + logit_to_decision(config)
    return (
        plan_of(config).logit_cycles + logit_to_decision(config)
        if config.is_image
        else schedule(config).step_cycles
    )


def longest_step(config: AcceleratorConfig) -> int:
    """What register LONGEST reads behind a step: cycles up to its last logit."""
    return step_cycles(config) - logit_to_decision(config) + (not config.is_image)


def decision_cycles(config: AcceleratorConfig) -> int:
    """Cycles from the last feature of a window, or the last pixel of an image, to the decision. With ``window_mode``
    whole the most from the last taxel of a touch, or from FINISH, to its last decision, if no touch follows meanwhile:
    the store is halved, the first window leaves, and the others leave beside the steps.
    """
    if config.is_image:
        return step_cycles(config) + IMAGE_START_CYCLES
    if config.is_forest:
        last = forest_cycles(config) + logit_to_decision(config)
    else:
        last = schedule(config).decision_cycles
    if not config.follows_touch:
        return last
    leaving = math.ceil(leaving_cycles(config))
    beside = (config.windows.steps - 1) * max(leaving, step_cycles(config))
    return detector_latency(config) + frame_cycles(config) + leaving + beside + last


def frame_cycles(config: AcceleratorConfig, *, ends_window: bool = True, ends_block: bool = True) -> int:
    """The most cycles that a frame of a touch takes.

    A frame that ends a window takes three cycles an input, four for windows of 2 hop + 1, and one more if
    means differ from input to input. Any other takes one a taxel, two where a block of activity ends with it,
    or where a ring of one port takes a beat and gives one. The onset rule adds FRAME_EXTRA_CYCLES, features
    beyond the mean three. This also covers the cycles for which frames of fewer than 4 taxels wait for
    each other. A row of an image takes one a pixel. With ``window_mode`` whole a frame ends no window, and one that
    fills the store takes a cycle for each of its words.
    """
    if config.is_image:
        return config.sensor.taxels
    features, windows = config.features, config.windows
    if config.follows_touch:
        summed = 1 + ("activity" in features.feature_kinds)
        per_taxel = summed * (1 + config.stored_sums * ends_window)
    elif ends_window:
        per_taxel = config.kinds * (3 + windows.window - 2 * windows.hop + (config.constants > 1))
    else:
        one_port = config.hardware.one_port and windows.window_mode == "touch" and not config.opens_at_once
        per_taxel = 1 + (one_port or (ends_block and "activity" in features.feature_kinds))
    beyond = features.feature_kinds != ("mean",)
    return per_taxel * config.sensor.taxels + FRAME_EXTRA_CYCLES + 3 * beyond


def leaving_cycles(config: AcceleratorConfig, sums: int = 0) -> float:
    """Cycles that a window of ``window_mode`` whole takes to leave the store: the most, or the mean over the windows of a
    touch of ``sums`` sums. The normaliser takes a value in two cycles, a window's first in three, or each in three
    where means differ from input to input."""
    windows, kinds = config.windows, config.features.feature_kinds
    differ = config.constants > 1
    most, steps = not sums, windows.steps
    hops = windows.store_per_window if most else max(1.0, sums / steps)
    since_onset = hops * steps if most else hops * (steps + 1) / 2
    reads = sum(hops + config.doublings if kind in SUMMED else since_onset for kind in kinds)
    return config.sensor.taxels * (reads + (6 + differ + most) * config.kinds) + hops + 2 - differ


def mean_frame_cycles(config: AcceleratorConfig) -> tuple[float, float]:
    """Cycles for which a frame keeps the chain busy on average: one of a touch, its windows included and its steps
    not, and one without a touch.

    A frame takes a cycle a taxel, the detector's latency, one cycle for the sum of its hop and one for the mean
    beside other kinds; a second cycle a taxel where a block of activity ends, and the verdict where a
    check of the onset ends. A ring adds three cycles to the frames of a touch; other frames end at it. A frame that
    ends a window takes as many as `frame_cycles`.
    """
    if config.is_image:
        return frame_cycles(config), frame_cycles(config)
    kinds, rule, taxels = config.features.feature_kinds, config.onset_rule, config.sensor.taxels
    plain: float = taxels + detector_latency(config) + 1
    if rule.onset == "baseline":
        plain += VERDICT_CYCLES / rule.onset_check_frames
    ring = config.windows.window_mode == "touch" and not config.opens_at_once
    running = plain + 3 * ring + (len(kinds) > 1 and "mean" in kinds and not config.follows_touch)
    if "activity" in kinds:
        running += taxels / config.features.activity_block
    if config.follows_touch:  # the frames that fill the store, and the values at the end, while steps go on
        words = config.stored_sums * taxels * (1 + ("activity" in kinds))
        sums = config.last_frame // config.windows.hop >> config.doublings
        leaving, step = leaving_cycles(config, sums), step_cycles(config)
        beside = config.windows.steps * max(0, leaving - step) + min(leaving, step)
        return running + (config.doublings * (words + 3) + beside) / config.last_frame, running
    windows = len({end for _, end in config.window_spans}) / config.last_frame
    return running + windows * (frame_cycles(config) - running), plain if ring else running


def lowest_clock_hz(config: AcceleratorConfig) -> float:
    """The lowest clock at which every frame is taken when it is due and no window is ever lost, known before
    anything is simulated.

    A frame that ends a window takes longest (`frame_cycles`). Steps must keep up with hops; windows that end
    closer together than that, as the last two of the thesis do, wait in the two buffers; of windows that follow the
    touch all are decided before the next touch's first hop is over. Latency budgets ask for more: see cosim.
    """
    steps = decision_cycles(config) if config.follows_touch else step_cycles(config)
    return max(frame_cycles(config), steps / config.windows.hop) * config.sensor.scan_rate_hz
