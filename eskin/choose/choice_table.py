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
    return f"{preset}{levels}, {gate}, {_windows(row)}, {scale}{defences}"


def _windows(row: Record) -> str:
    activity = (
        f" (|{row['activity_rule']}| of {row['activity_block']} frame{'s' * (row['activity_block'] > 1)})"
        if "activity_rule" in row
        else ""
    )
    kinds, every = "+".join(row["feature_kinds"]), row.get("scan_every", 1)
    scans = "" if every == 1 else f", one frame in {every} scanned"
    return f"{row['steps']} window{'s' * (row['steps'] != 1)} of {row['window']} every {row['hop']}{scans}, {kinds}{activity}"


def front_end_brief(row: Record) -> str:
    """Windows and kinds of feature of a row of ``candidates``."""
    return _windows(row["front_end"])


def windows_brief(row: Record) -> str:
    """The same for a narrow column: ``10 x 192/96 m+a`` is 10 windows of 192 frames every 96, mean and
    activity; ``1/4`` before them: one frame in four is scanned."""
    fields = row["front_end"]
    kinds = "+".join(kind[0] for kind in fields["feature_kinds"])
    every = fields.get("scan_every", 1)
    return (
        f"{fields['steps']} x {fields['window']}/{fields['hop']}{'' if every == 1 else f' 1/{every}'} {kinds}"
    )


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
    """``GRU 8``, ``GRU 8 (robust)``, ``linear`` or ``linear (least squares)``: a row of ``candidates`` of training.json."""
    if not row["hidden"] and row["cell"] != "linear":
        return row["cell"]
    if row["cell"] != "linear":
        return f"{row['cell'].upper()} {row['hidden']}{' (robust)' * row.get('robust', False)}"
    return "linear" if row["recipe"] == "linear" else f"linear ({row['recipe']})"


def beyond(row: Record) -> float:
    """Distance of a figure from its bound: above 0 beyond it, below 0 within it."""
    return abs(row["figure"] - row["bound"]) * (1 - 2 * row["held"])


def where_it_fails(candidates: Sequence[Record]) -> Record | None:
    """The network chosen under disturbance beside the one that clean recordings alone would choose; None
    without a panel.

    Returns
    -------
    {rows: [{mode, figure, bound, held, plain (figure of the other network, None: not judged)}], the weakest
    first; held, modes: numbers of modes; plain: name of the other network; sentence: remedy for the weakest
    mode}.
    """
    taken = next((row for row in candidates if row["chosen"] and row.get("stress")), None)
    if taken is None:
        return None
    plain = next((row for row in candidates if row.get("calm")), taken)
    plain_figures = {row["mode"]: row["figure"] for row in plain["stress"]}
    rows = [row | {"plain": plain_figures.get(row["mode"])} for row in taken["stress"]]
    rows.sort(key=beyond, reverse=True)
    return {
        "rows": rows,
        "held": sum(row["held"] for row in rows),
        "modes": len(rows),
        "plain": f"{network_name(plain)}, {front_end_brief(plain)}",
        "sentence": _mended(rows[0], taken, candidates),
    }


def _mended(weakest: Record, taken: Record, candidates: Sequence[Record]) -> str:
    """Sentence about the candidate that does best in the weakest mode, and its cost."""
    # an accuracy has to be high, a share of false onsets low
    sign = 1 if weakest["figure"] < weakest["bound"] else -1
    found = [
        (sign * row["figure"], -other["energy_touch_j"], other)
        for other in candidates
        for row in other["stress"]
        if row["mode"] == weakest["mode"]
    ]
    name = f"The weakest is '{weakest['mode']}': {weakest['figure']:.1%}, bound {weakest['bound']:.1%}."
    if weakest["held"]:
        return f"{name} Every figure is within its bound."
    best = max(found, key=lambda one: one[:2])[2]
    (figure,) = (row["figure"] for row in best["stress"] if row["mode"] == weakest["mode"])
    if sign * (figure - weakest["figure"]) < 0.005:
        return f"{name} No candidate does better in this mode."
    joule = 1e6 * (best["energy_touch_j"] - taken["energy_touch_j"])
    points = 100 * (best["accuracy"] - taken["accuracy"])
    return (
        f"{name} The best candidate in this mode reaches {figure:.1%}: {network_name(best)}, "
        f"{front_end_words(best['front_end'])}. Compared with the chosen network it needs {joule:+.2f} uJ a touch and "
        f"{best['cells'] - taken['cells']:+d} logic cells; its accuracy without disturbance differs by {points:+.1f} points."
    )


def left_out(groups: Sequence[str]) -> str:
    """Groups that stay together on one side of a split, in words."""
    return " and ".join(groups) or "single recordings"


def unseen(split: Record) -> Record:
    """The figures of a split on folds that took no part in the choice: ``nested`` if front end or network
    were chosen on its own folds, otherwise the split itself."""
    return split.get("nested") or split
