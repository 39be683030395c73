"""Cycle counts and latency budgets.

decision latency: from the rising edge that takes the last taxel of the frame that completes a window to the
first rising edge at which that window's decision can be taken, in cycles.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

from eskin.golden.core import AcceleratorConfig, Record

REFERENCES = {"reference: LSTM on a GPU": 5e-3, "reference: SVM on an FPGA": 0.350}
"""Published figures for one classification, seconds; they are shown for comparison and never decide."""


def standstill_cycles(config: AcceleratorConfig) -> int:
    """Cycles without progress after which a run has come to a standstill."""
    return 20 * (config.step_ideal + 1000)


class Measured:
    """Counts cycles as values come. counts: steps, decisions, step_min, step_max, latency_max; None: there was none."""

    def __init__(self) -> None:
        self.counts: dict[str, Any] = {"steps": 0, "decisions": 0}
        self.counts |= dict.fromkeys(("step_min", "step_max", "latency_max"))
        self._offered: list[int] = []

    def steps(self, cycles: Iterable[int]) -> None:
        """Cycles of each step, from the probe ``step``."""
        for count in map(int, cycles):
            self.counts["steps"] += 1
            self._extreme("step_min", min, count)
            self._extreme("step_max", max, count)

    def decisions(self, offered: Iterable[int]) -> None:
        """The cycles in which the next decisions of a recording could first be taken."""
        self._offered += map(int, offered)

    def end(self, frames: Iterable[int], taken: Sequence[int]) -> None:
        """A recording is over. frames: that complete the decisions' windows, from 1 on, 0: none does. taken: cycle of the
        last taxel of each frame."""
        self.counts["decisions"] += len(self._offered)
        for frame, cycle in zip(frames, self._offered, strict=False):
            if 0 < frame <= len(taken):
                self._extreme("latency_max", max, cycle - taken[frame - 1])
        self._offered = []

    def _extreme(self, name: str, which: Callable[[int, int], int], value: int) -> None:
        now = self.counts[name]
        self.counts[name] = value if now is None else which(now, value)


def step_limit_frames(config: AcceleratorConfig) -> int:
    """Frames a step may take: the least distance between two window ends. Windows that end together end the
    touch; nothing follows them."""
    ends = sorted({last for _, last in config.window_spans})
    return min((after - before for before, after in pairwise(ends)), default=config.windows.hop)


def limits(config: AcceleratorConfig) -> dict[str, float]:
    """Limit in seconds of each budget that a cycle count of the run decides."""
    period, budget = 1.0 / config.sensor.scan_rate_hz, config.hardware.decide_within_s
    if config.is_image:  # the next image takes as long to come
        image = config.image.height * period
        return {"frame": period, "step": image, "decision": budget or image}
    return {"frame": period, "step": step_limit_frames(config) * period, "decision": budget or period}


COUNT_OF = {"frame": "frame_max", "step": "step_max", "decision": "decision_latency_max"}
"""Budget -> the cycle count it limits."""


def budgets(
    config: AcceleratorConfig,
    cycles: Mapping[str, int | None],
    clock_hz: float,
    *,
    declared: bool,
    overruns: int,
) -> list[Record]:
    """Rows {name, limit_s, measured_s, met, margin_s, reference}.

    frame and decision depend on the pace, so they are judged at the declared one only; an overrun there (a
    frame that was due while the chain was not ready for it) misses ``frame``. A reference row's time is that
    of all steps of a touch; it never decides.
    """
    rows = []
    for name, limit in limits(config).items():
        count = cycles[COUNT_OF[name]]
        if count is None or (name != "step" and not declared):
            continue
        measured = count / clock_hz
        # equality survives the division
        met = measured <= limit * (1 + 1e-12) and not (name == "frame" and overruns)
        rows.append(
            {
                "name": name,
                "limit_s": limit,
                "measured_s": measured,
                "met": met,
                "margin_s": limit - measured,
                "reference": False,
            }
        )
    if cycles["step_max"] is not None:
        touch = config.windows.steps * cycles["step_max"] / clock_hz
        rows += [
            {
                "name": name,
                "limit_s": limit,
                "measured_s": touch,
                "met": touch <= limit,
                "margin_s": limit - touch,
                "reference": True,
            }
            for name, limit in REFERENCES.items()
        ]
    return rows


def needed_clock(config: AcceleratorConfig, cycles: Mapping[str, int | None]) -> float:
    """The lowest clock, Hz (rounded up to 1 kHz), at which these cycle counts meet every budget.

    The counts of a declared-pace run hardly depend on its clock, but a slow clock can make steps queue: run
    again at the result to verify.
    """
    needed = [config.sensor.taxels * config.sensor.scan_rate_hz]
    needed += [
        count / limit
        for name, limit in limits(config).items()
        if (count := cycles[COUNT_OF[name]]) is not None
    ]
    return math.ceil(max(needed) / 1e3 - 1e-9) * 1e3
