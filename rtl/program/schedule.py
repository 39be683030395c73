"""The schedule of a configuration's step, and the clocks that follow from it."""

from functools import lru_cache

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.program.cells import CellProgram, cell_program
from eskin.rtl.program.image_passes import plan_of
from eskin.rtl.program.scheduler import Schedule, Scheduler
from eskin.rtl.program.timing import FRAME_EXTRA_CYCLES, FRAME_WAY_CYCLES, logit_to_decision

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
    return (
        plan_of(config).logit_cycles + logit_to_decision(config)
        if config.is_image
        else schedule(config).step_cycles
    )


def decision_cycles(config: AcceleratorConfig) -> int:
    """Cycles from the last feature of a window, or the last pixel of an image, to the decision."""
    return step_cycles(config) + IMAGE_START_CYCLES if config.is_image else schedule(config).decision_cycles


def frame_cycles(config: AcceleratorConfig, *, ends_window: bool = True, ends_block: bool = True) -> int:
    """The most cycles that a frame of a touch takes.

    A frame that ends a window takes three cycles an input, four for windows of 2 hop + 1, and one more if
    means differ from input to input. Any other takes one a taxel, two where a block of activity ends with it,
    or where a ring of one port takes a beat and gives one. The onset rule adds FRAME_EXTRA_CYCLES, features
    beyond the mean three. This also covers the cycles for which frames of fewer than 4 taxels wait for
    each other. A row of an image takes one a pixel.
    """
    if config.is_image:
        return config.sensor.taxels
    features, windows = config.features, config.windows
    if ends_window:
        per_taxel = config.kinds * (3 + windows.window - 2 * windows.hop + (config.constants > 1))
    else:
        one_port = config.hardware.one_port and windows.window_mode == "touch" and not config.opens_at_once
        per_taxel = 1 + (one_port or (ends_block and "activity" in features.feature_kinds))
    beyond = features.feature_kinds != ("mean",)
    return per_taxel * config.sensor.taxels + FRAME_EXTRA_CYCLES + 3 * beyond


def mean_frame_cycles(config: AcceleratorConfig) -> tuple[float, float]:
    """Cycles that a frame takes on average: one of a touch, and one without a touch.

    If hops run on, frames without a touch end blocks, but no window. Otherwise they end at the ring: a
    cycle a taxel and the way to the ring. A touch that has caught up goes past a ring of one port.
    """
    if config.is_image:
        return frame_cycles(config), frame_cycles(config)
    config = config.replace(one_port=False)
    plain, of_block = (frame_cycles(config, ends_window=False, ends_block=ends) for ends in (False, True))
    blocks = (of_block - plain) / config.features.activity_block
    windows = len({end for _, end in config.window_spans}) / config.last_frame
    touch = plain + blocks + windows * (frame_cycles(config) - of_block)
    waits = config.windows.window_mode == "touch" and not config.opens_at_once
    return touch, config.sensor.taxels + FRAME_WAY_CYCLES if waits else plain + blocks


def lowest_clock_hz(config: AcceleratorConfig) -> float:
    """The lowest clock at which every frame is taken when it is due and no window is ever lost, known before
    anything is simulated.

    A frame that ends a window takes longest (`frame_cycles`). Steps must keep up with hops; windows that end
    closer together than that, as the last two of the thesis do, wait in the two buffers. Latency budgets ask
    for more: see cosim.
    """
    keep_up = step_cycles(config) * config.sensor.scan_rate_hz / config.windows.hop
    return max(frame_cycles(config) * config.sensor.scan_rate_hz, keep_up)
