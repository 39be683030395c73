"""Words and table rows for the choice: front ends and networks of a training record, for terminal and
report."""

from collections.abc import Sequence

from eskin.golden.core import PRESETS, Record

ROWS = 12
"""Most rows of a table of front ends."""


def front_end_words(row: Record) -> str:
    """A front end's fields (`eskin.choose.candidate.front_end_fields`) in words."""
    levels = {"none": "no rest level", "initial": "initial rest level", "tracked": "tracked rest level"}[
        row["rest"]
    ]
    gate = {"immediate": "open at once", "band": "onset by band"}.get(
        row["onset"], f"onset at {row.get('onset_threshold')} codes"
    )
    preset = f"preset {row['name']}: " if row["name"] in PRESETS else ""
    defences = f", {row['onset_hits']} of {row['onset_span']} checks" if row.get("onset_span", 1) > 1 else ""
    defences += f", clip at {row['clip']} codes" if row.get("clip") else ""
    scale = "one scale" if row["feature_scale"] == "array" else "a scale a taxel"
    activity = (
        f" (|{row['activity_rule']}| of {row['activity_block']} frame{'s' * (row['activity_block'] > 1)})"
        if "activity_rule" in row
        else ""
    )
    every, steps = row.get("scan_every", 1), row["steps"]
    scans = "" if every == 1 else f", one frame in {every} scanned"
    windows = f"{steps} window{'s' * (steps != 1)} of {row['window']} every {row['hop']}{scans}"
    if row.get("window_mode") == "whole":
        windows = (
            f"{steps} windows that divide the touch{scans}" if steps > 1 else f"a window of the touch{scans}"
        )
    return (
        f"{preset}{levels}, {gate}, {windows}, {'+'.join(row['feature_kinds'])}{activity}, {scale}{defences}"
    )


def windows_brief(row: Record, rows: Sequence[Record] = ()) -> str:
    """Windows and kinds of feature of a row of ``candidates``, for a narrow column: ``10 x 192/96 m+a`` is 10 windows
    of 192 frames every 96, mean and activity; ``1/4`` before them: one frame in four is scanned. Behind them the
    words by which the front end differs from those of ``rows`` that would look alike."""
    fields = row["front_end"]
    kinds = "+".join(kind[0] for kind in fields["feature_kinds"])
    every = fields.get("scan_every", 1)
    follows = fields.get("window_mode") == "whole"
    length = "whole" if follows else f"{fields['window']}/{fields['hop']}"
    brief = f"{fields['steps']} x {length}{'' if every == 1 else f' 1/{every}'} {kinds}"
    alike = [set(other["front_end_words"].split(", ")) for other in rows if windows_brief(other) == brief]
    own = row["front_end_words"].split(", ") if alike else []
    return ", ".join([brief, *(words for words in own if words not in set.intersection(*alike))])


def front_end_table(record: Record) -> list[Record]:
    """The rows to show, ROWS at most: the chosen one, the best, and the best of every gate, kind of feature,
    scale and set of windows."""
    chosen, rivals = record["chosen"], record["rivals"]
    shown = [chosen]
    for keys in (
        ("rest", "onset"),
        ("feature_kinds",),
        ("feature_scale",),
        ("scan_every",),
        ("hop", "steps"),
    ):
        seen = {str([chosen[key] for key in keys])}
        for row in rivals:
            value = str([row[key] for key in keys])
            if value not in seen and len(shown) < ROWS:
                seen.add(value)
                if row not in shown:
                    shown.append(row)
    if rivals and rivals[0] not in shown:
        shown.insert(1, rivals[0])
    return sorted(shown[:ROWS], key=lambda row: (row is not chosen, -row["accuracy"]))


def network_name(row: Record) -> str:
    """``GRU 8``, ``GRU 8 (robust)``, ``linear``, ``linear (least squares)`` or ``16 trees of depth 8``: a row of
    ``candidates`` of training.json."""
    if "trees" in row:
        return f"{row['trees']} trees of depth {row['depth']}{' (robust)' * row.get('robust', False)}"
    if not row["hidden"] and row["cell"] != "linear":
        return row["cell"]
    if row["cell"] != "linear":
        return f"{row['cell'].upper()} {row['hidden']}{' (robust)' * row.get('robust', False)}"
    return "linear" if row["recipe"] == "linear" else f"linear ({row['recipe']})"


def beyond(row: Record) -> float:
    """Distance of a figure from its bound: above 0 beyond it, below 0 within it."""
    return abs(row["figure"] - row["bound"]) * (1 - 2 * row["held"])


def where_it_fails(candidates: Sequence[Record], unseen: Record) -> Record | None:
    """Where networks fail that were chosen without a fold, and there the network taken beside the one that clean
    recordings alone would choose, on the folds that chose both.

    Parameters
    ----------
    unseen:
        Has ``stress`` and ``gate_modes``, as run.json (`eskin.study.stability.panel.Panel.unseen`); without them
        there was no panel, and the answer is None.

    Returns
    -------
    {rows: [{mode, name (with what a figure counts), figure, bound, held, taken, plain (figures of both networks, None:
    not judged)}] of the modes that apply to the network taken, the weakest first; gates: those of gates alone;
    beyond: number of rows beyond their bounds; plain: name of the other network; sentence: remedy for the weakest mode}.
    """
    taken = next((row for row in candidates if row["chosen"]), None)
    if taken is None or "gate_modes" not in unseen:
        return None
    plain = next((row for row in candidates if row.get("calm")), taken)
    decisions, gates = (
        [
            row | {"name": f"{row['mode']}{counted}", "taken": own, "plain": _figure(plain, row["mode"])}
            for row in unseen[kind]
            if (own := _figure(taken, row["mode"])) is not None
        ]
        for kind, counted in (("stress", ""), ("gate_modes", ": false onsets"))
    )
    rows = sorted(decisions + gates, key=beyond, reverse=True)
    if not rows:
        return None
    return {
        "rows": rows,
        "gates": gates,
        "beyond": sum(not row["held"] for row in rows),
        "plain": f"{network_name(plain)}, {plain['front_end_words']}",
        "sentence": _mended(rows[0], taken, candidates),
    }


def _figure(candidate: Record, mode: str) -> float | None:
    rows = candidate["stress"] + candidate["gate_modes"]
    return next((row["figure"] for row in rows if row["mode"] == mode), None)


def _mended(weakest: Record, taken: Record, candidates: Sequence[Record]) -> str:
    """Sentence about the candidate that does best in the weakest mode, and its cost."""
    # an accuracy has to be high, a share of false onsets low
    sign, own = 1 if weakest["figure"] < weakest["bound"] else -1, weakest["taken"]
    name = f"The weakest is '{weakest['name']}': {weakest['figure']:.1%}, bound {weakest['bound']:.1%}."
    if weakest["held"]:
        return f"{name} Every figure is within its bound."
    figures = [(_figure(row, weakest["mode"]), row) for row in candidates]
    found = [(sign * figure, -row["energy_touch_j"], row) for figure, row in figures if figure is not None]
    highest, _, best = max(found, key=lambda one: one[:2])
    if highest - sign * own < 0.005:
        return f"{name} No candidate does better in this mode."
    joule, watt = (1e6 * (best[cost] - taken[cost]) for cost in ("energy_touch_j", "average_w"))
    points = 100 * (best["accuracy"] - taken["accuracy"])
    return (
        f"{name} On the folds of the choice it is {own:.1%}, and {sign * highest:.1%} with the best candidate: "
        f"{network_name(best)}, {front_end_words(best['front_end'])}. Compared with the chosen network it needs "
        f"{joule:+.2f} uJ a touch, {watt:+.2f} uW on average and {best['cells'] - taken['cells']:+d} logic cells; its "
        f"accuracy without disturbance differs by {points:+.1f} points."
    )


def decides_early(candidates: Sequence[Record]) -> Record | None:
    """The candidate with the best score that decides in half the time of the chosen candidate; ``--prefer latency``
    takes it. None: there is no such candidate."""
    timed = [row for row in candidates if row.get("decision_time_s") is not None]
    latest = next((row["decision_time_s"] / 2 for row in timed if row["chosen"]), 0.0)
    early = [row for row in timed if row["decision_time_s"] <= latest]
    return max(early, key=lambda row: row["score"], default=None)


def left_out(groups: Sequence[str]) -> str:
    """Groups that stay together on one side of a split, in words."""
    return " and ".join(groups) or "single recordings"


def unseen(split: Record) -> Record:
    """The figures of a split on folds that took no part in the choice: ``nested`` if front end or network
    were chosen on its own folds, otherwise the split itself."""
    return split.get("nested") or split
