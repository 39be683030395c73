"""The failure modes of the table, run and judged against their bounds."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from eskin.golden.core.errors import InputError
from eskin.golden.stability.core import Bench, Case, Curve, Mode
from eskin.golden.stability.images import IMAGE_MODES, ImageBench
from eskin.golden.stability.table import HARDWARE, MODES, HardwareMode


def modes_of(bench: Bench | ImageBench) -> Mapping[str, Mode]:
    """The table of a bench's failure modes, by name."""
    return IMAGE_MODES if isinstance(bench, ImageBench) else MODES


def judge(one: Mode, bench: Any) -> tuple[dict[str, Any], Case | None]:
    """The record of a mode, as in stability.json, and its case for the hardware."""
    begin = time.perf_counter()
    bound = one.bound(bench) if callable(one.bound) else float(one.bound)
    if one.unit == "accuracy" and one.at_least and not callable(one.bound):
        bound = round(bound * (bench.origin or bench).clean_accuracy, 6)
    outcome = one.run(bench)
    curve = outcome.curve
    record = _record(
        one,
        float(outcome.value),
        bound,
        one.at_least,
        worst_case=outcome.worst_case,
        measures=one.description,
        fails_at=fails_at(curve, bound, one.at_least),
        curve={
            "xlabel": curve.xlabel,
            "ylabel": curve.ylabel,
            "x": [float(x) for x in curve.x],
            "lines": {name: [float(y) for y in line] for name, line in curve.lines.items()},
            "log": curve.log,
        },
        has_case=outcome.case is not None,
        wall_s=round(time.perf_counter() - begin, 3),
    )
    return record, outcome.case


def _record(one: Mode | HardwareMode, value: float, bound: float, at_least: bool, **own: Any) -> dict[str, Any]:
    """What stability.json says of a mode; ``own``: what experiment or co-simulation found beside its figure."""
    return {
        "name": one.name,
        "group": one.group,
        "value": value,
        "bound": bound,
        "unit": one.unit,
        "passed": bool(value >= bound if at_least else value <= bound),
        "sense": "at least" if at_least else "at most",
        "reason": one.reason,
        "broken_variant": one.breaks,
        "room": room(value, bound, at_least),
        "fails_at": None,
        "curve": None,
        "has_case": False,
        "rtl": None,
        **own,
    }


def fails_at(curve: Curve, bound: float, at_least: bool) -> float | None:
    """The first x at which the curve's first line breaks the bound; None: nowhere on it."""
    line = next(iter(curve.lines.values()))
    return next((float(x) for x, y in zip(curve.x, line, strict=True) if (y < bound if at_least else y > bound)), None)


def room(value: float, bound: float, at_least: bool) -> float:
    """Share of the room left: 1 = perfect, 0 = at the bound, below 0 = beyond it."""
    if at_least:
        return (value - bound) / max(1.0 - bound, 1e-9)
    return (bound - value) / bound if bound > 0 else (1.0 if value <= bound else -value)


def weakest(records: Sequence[Mapping[str, Any]], count: int = 3) -> list[Mapping[str, Any]]:
    """The ``count`` modes with the least room to their bounds, failed ones first."""
    return sorted(records, key=lambda record: (record["passed"], record["room"]))[:count]


def run_modes(
    bench: Bench | ImageBench,
    *,
    names: Sequence[str] | None = None,
    judged: Callable[[Sequence[str]], Sequence[dict[str, Any]]] | None = None,
    hardware: Callable[[str], dict[str, Any] | None] | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> dict[str, Any]:
    """Run every mode that applies.

    Parameters
    ----------
    names:
        Only these modes.
    judged:
        Names of modes -> their records; None: ``judge``, one after the other.
    hardware:
        Runs a mode of ``HARDWARE`` by its key -> {value, worst_case}; None where it cannot.
    progress:
        Called with ("failure modes", done, in all).

    Returns
    -------
    {modes: [{name, group, value, bound, unit, passed, worst_case, ...}], not_run: [{name, group, why}]}.

    Raises
    ------
    InputError
        An unknown name.
    """
    modes, images = modes_of(bench), " for images" if bench.config.is_image else ""
    for name in names or ():
        if name not in modes:
            raise InputError(f"stability, mode '{name}': is unknown{images}; the modes are {', '.join(modes)}")
    wanted = [modes[name] for name in names] if names is not None else list(modes.values())
    measured = HARDWARE if names is None and not images else ()
    records: list[dict[str, Any]] = []
    not_run: list[dict[str, Any]] = []

    def in_turn(names: Sequence[str]) -> list[dict[str, Any]]:
        return [judge(modes[name], bench)[0] for name in names]

    def absent(one: Mode) -> str:
        """Why a mode does not apply; empty where it does."""
        if one.onset and bench.config.opens_at_once:
            return "the gate opens at once: no onset is looked for"
        if one.detector and not bench.config.faults.fault_frames:
            return "the fault detector is off; fault_frames of the configuration switches it on"
        return "a linear cell has no state, no gates and no tables" if one.recurrent and not bench.config.recurrent else ""

    records += (judged or in_turn)([one.name for one in wanted if not absent(one)])
    not_run += [{"name": one.name, "group": one.group, "why": why} for one in wanted if (why := absent(one))]
    total = len(wanted) + len(measured)
    if progress:
        progress("failure modes", len(wanted), total)
    for number, one in enumerate(measured):
        found = hardware(one.key) if hardware else None
        if found is None:
            why = "needs hardware that is not there yet" if hardware else "needs a co-simulation"
            not_run.append({"name": one.name, "group": one.group, "why": why})
        else:
            figure = {"worst_case": found["worst_case"], "wall_s": found["wall_s"], "measures": "Measured in co-simulation."}
            played = {"rtl": found.get("rtl"), "detail": found.get("detail")}
            records.append(_record(one, float(found["value"]), one.bound, False, **figure, **played))
        if progress:
            progress("failure modes", len(wanted) + number + 1, total)
    return {"modes": records, "not_run": not_run, "weakest": [record["name"] for record in weakest(records)]}
