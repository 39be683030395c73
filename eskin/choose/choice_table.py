"""Words and table rows for the choice: front ends and networks of a training record, for terminal and
report."""

from collections.abc import Sequence
from typing import NamedTuple

from eskin.golden.core import PRESETS
from eskin.training.record import (
    CandidateRow,
    Disturbed,
    FrontEnd,
    FrontEndRow,
    FrontEndRows,
    ModeFigure,
    Network,
)

ROWS = 12
"""Most rows of a table of front ends."""


def front_end_words(row: FrontEnd) -> str:
    """A front end in words."""
    level = "no rest level" if row.rest == "none" else f"{row.rest} rest level"
    level += " of one frame" if row.rest_frames == 1 else ""
    gate = {"immediate": "open at once", "band": "onset by band"}.get(
        row.onset, f"onset at {row.onset_threshold} codes"
    )
    preset = f"preset {row.name}: " if row.name in PRESETS else ""
    defences = f", {row.onset_hits} of {row.onset_span} checks" if row.onset_span > 1 else ""
    defences += f", clip at {row.clip} codes" if row.clip else ""
    defences += f", taxels still for {row.fault_frames} scans masked" if row.fault_frames else ""
    scale = "one scale" if row.feature_scale == "array" else "a scale a taxel"
    activity = (
        f" (|{row.activity_rule}| of {row.activity_block} frame{'s' * (row.activity_block > 1)})"
        if row.activity_rule
        else ""
    )
    scans = "" if row.scan_every == 1 else f", one frame in {row.scan_every} scanned"
    windows = f"{row.steps} window{'s' * (row.steps != 1)} of {row.window} every {row.hop}{scans}"
    if row.window_mode == "whole":
        windows = f"{row.steps} windows that divide" if row.steps > 1 else "a window of"
        windows += f" the touch{scans}"
    return f"{preset}{level}, {gate}, {windows}, {'+'.join(row.feature_kinds)}{activity}, {scale}{defences}"


def windows_brief(row: CandidateRow, rows: Sequence[CandidateRow] = ()) -> str:
    """Windows and kinds of feature of a row of ``candidates``, for a narrow column: ``10 x 192/96 m+a`` is 10 windows
    of 192 frames every 96, mean and activity; ``1/4`` before them: one frame in four is scanned. Behind them the
    words by which the front end differs from those of ``rows`` that would look alike."""
    fields = row.front_end
    kinds = "+".join(kind[0] for kind in fields.feature_kinds)
    length = "whole" if fields.window_mode == "whole" else f"{fields.window}/{fields.hop}"
    every = "" if fields.scan_every == 1 else f" 1/{fields.scan_every}"
    brief = f"{fields.steps} x {length}{every} {kinds}"
    alike = [set(other.front_end_words.split(", ")) for other in rows if windows_brief(other) == brief]
    own = row.front_end_words.split(", ") if alike else []
    return ", ".join([brief, *(words for words in own if words not in set.intersection(*alike))])


def front_end_table(record: FrontEndRows) -> list[tuple[FrontEndRow, str]]:
    """The rows to show, and each in words; ROWS at most: the chosen one, the best, and the best of every gate, kind of
    feature, scale and set of windows."""
    chosen, rivals = record.chosen, record.rivals
    shown = [chosen]
    for part in (
        lambda row: (row.rest, row.onset),
        lambda row: row.feature_kinds,
        lambda row: row.feature_scale,
        lambda row: row.scan_every,
        lambda row: (row.hop, row.steps),
    ):
        seen = [part(chosen)]
        for row in rivals:
            if part(row) not in seen and len(shown) < ROWS:
                seen.append(part(row))
                if row not in shown:
                    shown.append(row)
    if rivals and rivals[0] not in shown:
        shown.insert(1, rivals[0])
    shown = sorted(shown[:ROWS], key=lambda row: (row is not chosen, -row.accuracy))
    return [(row, front_end_words(row)) for row in shown]


def network_name(row: Network) -> str:
    """``GRU 8``, ``GRU 8 (robust)``, ``linear``, ``linear (least squares)`` or ``16 trees of depth 8``."""
    robust = " (robust)" * row.robust
    if row.trees:
        return f"{row.trees} trees of depth {row.depth}{robust}"
    if row.hidden:
        return f"{row.cell.upper()} {row.hidden}{robust}"
    if row.cell != "linear":
        return row.cell
    return "linear" if row.recipe == "linear" else f"linear ({row.recipe})"


def beyond(row: ModeFigure) -> float:
    """Distance of a figure from its bound: above 0 beyond it, below 0 within it."""
    return abs(row.figure - row.bound) * (1 - 2 * row.held)


class Failure(ModeFigure):
    """A mode. name: with what its figure counts. chosen, other: figures of both networks; None: not judged."""

    name: str
    chosen: float
    other: float | None


class Failures(NamedTuple):
    """rows: of the modes that apply to the chosen network, the weakest first; gates: rows of gates alone. beyond:
    number of rows beyond their bounds. plain: the other network. sentence: remedy for the weakest mode."""

    rows: list[Failure]
    gates: list[Failure]
    beyond: int
    plain: str
    sentence: str


def where_it_fails(candidates: Sequence[CandidateRow], unseen: Disturbed) -> Failures | None:
    """Where networks fail that were chosen without a fold, and there the network taken beside the one that clean
    recordings alone would choose, on the folds that chose both.

    Parameters
    ----------
    unseen:
        As in run.json (`eskin.study.stability.panel.Panel.unseen`); empty without a panel, and the answer is None then.
    """
    chosen = next((row for row in candidates if row.chosen), None)
    if chosen is None:
        return None
    plain = next((row for row in candidates if row.calm), chosen)

    def failures(rows: Sequence[ModeFigure], counted: str = "") -> list[Failure]:
        pairs = [(row, _figure(chosen, row.mode)) for row in rows]
        return [
            Failure(**row.plain(), name=f"{row.mode}{counted}", chosen=own, other=_figure(plain, row.mode))
            for row, own in pairs
            if own is not None
        ]

    gates = failures(unseen.gate_modes, ": false onsets")
    rows = sorted(failures(unseen.stress) + gates, key=beyond, reverse=True)
    if not rows:
        return None
    name = f"{network_name(plain)}, {plain.front_end_words}"
    many = sum(not row.held for row in rows)
    return Failures(rows, gates, many, name, _mended(rows[0], chosen, candidates))


def _figure(candidate: CandidateRow, mode: str) -> float | None:
    rows = (*candidate.stress, *candidate.gate_modes)
    return next((row.figure for row in rows if row.mode == mode), None)


def _mended(weakest: Failure, chosen: CandidateRow, candidates: Sequence[CandidateRow]) -> str:
    """Sentence about the candidate that does best in the weakest mode, and its cost."""
    # an accuracy has to be high, a share of false onsets low
    sign, own = 1 if weakest.figure < weakest.bound else -1, weakest.chosen
    name = f"The weakest is '{weakest.name}': {percent(weakest.figure)}, bound {percent(weakest.bound)}."
    if weakest.held:
        return f"{name} Every figure is within its bound."
    figures = [(_figure(row, weakest.mode), row) for row in candidates]
    found = [(sign * figure, -row.energy_touch_j, row) for figure, row in figures if figure is not None]
    highest, _, best = max(found, key=lambda row: row[:2])
    if highest - sign * own < 0.005:
        return f"{name} No candidate does better in this mode."
    joule, watt = best.energy_touch_j - chosen.energy_touch_j, best.average_w - chosen.average_w
    return (
        f"{name} On the folds of the choice it is {percent(own)}, and {percent(sign * highest)} with the best candidate: "
        f"{network_name(best)}, {front_end_words(best.front_end)}. Compared with the chosen network it needs "
        f"{1e6 * joule:+.2f} uJ a touch, {1e6 * watt:+.2f} uW on average and {best.cells - chosen.cells:+d} logic cells; "
        f"its accuracy without disturbance differs by {100 * (best.accuracy - chosen.accuracy):+.1f} points."
    )


def decides_early(candidates: Sequence[CandidateRow]) -> CandidateRow | None:
    """The candidate with the best score that decides in half the time of the chosen candidate; ``--prefer latency``
    takes it. None: there is no such candidate."""
    timed = [(row.decision_time_s, row) for row in candidates if row.decision_time_s is not None]
    latest = next((time_s / 2 for time_s, row in timed if row.chosen), 0.0)
    return max((row for time_s, row in timed if time_s <= latest), key=lambda row: row.score, default=None)


def percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def left_out(groups: Sequence[str]) -> str:
    """Groups that stay together on one side of a split, in words."""
    return " and ".join(groups) or "single recordings"
