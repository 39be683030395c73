"""Cycle counts and latency budgets.

decision latency: from the rising edge that takes the last taxel of the frame that completes a window, or FINISH where
that brings the decision, to the first rising edge at which that window's decision can be taken, in cycles. The windows
of a whole touch are complete with its last frame.
"""

import math
from itertools import pairwise
from typing import TYPE_CHECKING

from eskin.golden.core import AcceleratorConfig, Result

if TYPE_CHECKING:
    from eskin.cosim.results import Cycles, Part

REFERENCES = {"reference: LSTM on a GPU": 5e-3, "reference: SVM on an FPGA": 0.350}
"""Published figures for one classification, seconds; they are shown for comparison and never decide."""


def standstill_cycles(config: AcceleratorConfig) -> int:
    """Cycles without progress after which a run has come to a standstill."""
    return 20 * (config.step_ideal + 1000)


def step_limit_frames(config: AcceleratorConfig) -> float:
    """Frames a step may take: the least distance between two window ends. Windows that end together end the
    touch; nothing follows them. Windows that follow the touch must be decided before the next one's first hop is
    over."""
    if config.follows_touch:
        return config.windows.hop / config.windows.steps
    ends = sorted({last for _, last in config.window_spans})
    return min((after - before for before, after in pairwise(ends)), default=config.windows.hop)


def limits(config: AcceleratorConfig) -> dict[str, float]:
    """Limit in seconds of each budget that a cycle count of the run decides."""
    period, budget = 1.0 / config.sensor.scan_rate_hz, config.hardware.decide_within_s
    if config.is_image:  # the next image takes as long to come
        image = config.image.height * period
        return {"frame": period, "step": image, "decision": budget or image}
    together = config.windows.hop if config.follows_touch else 1
    return {
        "frame": period,
        "step": step_limit_frames(config) * period,
        "decision": budget or together * period,
    }


COUNT_OF = {"frame": "frame_max", "step": "step_max", "decision": "decision_latency_max"}
"""Budget -> the cycle count it limits."""


class Budget(Result):
    """A limit in seconds beside what was measured."""

    name: str
    limit_s: float
    measured_s: float
    met: bool
    margin_s: float
    reference: bool


def budgets(config: AcceleratorConfig, played: "Part") -> list[Budget]:
    """The budgets of a co-simulation: of its cycles, clock_hz, pace, overruns.

    frame and decision depend on the pace, so they are judged at the declared one only; an overrun there (a
    frame that was due while the chain was not ready for it) misses ``frame``. A reference row's time is the time
    of all steps of a touch; it never decides.
    """
    clock_hz = played.clock_hz
    declared, step = played.pace == "declared", played.cycles.step_max
    counted = [
        (name, limit, getattr(played.cycles, COUNT_OF[name]))
        for name, limit in limits(config).items()
        if declared or name == "step"
    ]
    counted += [(name, limit, step and config.windows.steps * step) for name, limit in REFERENCES.items()]
    return [
        Budget(
            name=name,
            limit_s=limit,
            measured_s=count / clock_hz,
            # equality survives the division
            met=count / clock_hz <= limit * (1 + 1e-12) and not (name == "frame" and played.overruns),
            margin_s=limit - count / clock_hz,
            reference=name in REFERENCES,
        )
        for name, limit, count in counted
        if count is not None
    ]


def needed_clock(config: AcceleratorConfig, cycles: "Cycles") -> float:
    """The lowest clock, Hz (rounded up to 1 kHz), at which these cycle counts meet every budget.

    The counts of a declared-pace run hardly depend on its clock, but a slow clock can make steps queue: run
    again at the result to verify.
    """
    needed = [config.sensor.taxels * config.sensor.scan_rate_hz]
    needed += [
        count / limit
        for name, limit in limits(config).items()
        if (count := getattr(cycles, COUNT_OF[name])) is not None
    ]
    return math.ceil(max(needed) / 1e3 - 1e-9) * 1e3
