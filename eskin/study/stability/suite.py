"""The failure modes of the table, run and judged against their bounds."""

import time
from collections.abc import Callable, Sequence
from typing import Any

from eskin.golden.core import AcceleratorConfig, Record
from eskin.study.stability.core import Case, Mode, Outcome

NEEDS: dict[str, tuple[Callable[[AcceleratorConfig], Any], str]] = {
    "onset": (lambda config: not config.opens_at_once, "the gate opens at once: no onset is looked for"),
    "detector": (
        lambda config: config.faults.fault_frames,
        "the fault detector is off; fault_frames of the configuration switches it on",
    ),
    "state": (lambda config: config.recurrent, "a linear cell has no state, no gates and no tables"),
    "loadable": (lambda config: config.hardware.loadable, "weights are in ROM: there is nothing to write"),
}
"""Parts of a configuration that a mode may need, and the sentence for a mode that is not run without them."""


def why_not(mode: Mode, config: AcceleratorConfig, hardware: bool = True) -> str:
    """The reason why a mode is not run; empty if it is. hardware: modes that only the hardware can show may run."""
    if isinstance(mode.run, str) and not hardware:
        return "needs a co-simulation"
    return next((why for holds, why in map(NEEDS.__getitem__, mode.needs.split()) if not holds(config)), "")


def judge(
    mode: Mode, bench: Any, simulate: Callable[[str], Outcome] | None = None
) -> tuple[Record, Case | None]:
    """The record of a mode, as in stability.json, and its case for the hardware; ``simulate`` measures what
    has a key for it."""
    begin = time.perf_counter()
    bound = mode.bound(bench)
    if isinstance(mode.run, str):
        assert simulate is not None  # else it is not run
        outcome = simulate(mode.run)
    else:
        outcome = mode.run(bench)
    value, curve, fails_at = float(outcome.value), outcome.curve, None
    if curve:
        points = zip(curve["x"], next(iter(curve["lines"].values())), strict=True)
        fails_at = next((x for x, y in points if not mode.holds(y, bound)), None)
    record = {
        "name": mode.name,
        "group": mode.group,
        "value": value,
        "bound": bound,
        "unit": mode.unit,
        "passed": bool(mode.holds(value, bound)),
        "sense": "at most" if mode.at_least is None else "at least",
        "reason": mode.reason,
        "room": mode.room(value, bound),
        "fails_at": fails_at,
        "curve": curve,
        "has_case": outcome.case is not None,
        "rtl": outcome.rtl,
        "worst_case": outcome.worst_case,
        "measures": mode.description,
        "wall_s": round(time.perf_counter() - begin, 3),
    }
    return record, outcome.case


def weakest(records: Sequence[Record], count: int = 3) -> list[Record]:
    """The ``count`` modes with the least room to their bounds, failed ones first."""
    return sorted(records, key=lambda record: (record["passed"], record["room"]))[:count]
