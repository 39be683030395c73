"""The page of `eskin stability`: every failure mode with its figure and its bound, from stability.json alone."""

from pathlib import Path

from eskin.golden.core import Record
from eskin.pages.views import page, percent, tables, words, write_text
from eskin.study.stability.core import GROUPS
from eskin.study.stability.suite import weakest

PAGE = "stability.html"
GROUP_TITLES = {
    "numeric": "Numbers: rounding, saturation, widths, tables, bits",
    "stream": "The stream: touches in time, disturbances, clocks",
    "sensor": "The sensor: taxels that fail",
    "memory": "The memories: single bit flips",
}


def figure_in_words(value: float, unit: str) -> str:
    """A mode's figure: shares in percent, counts whole, the rest with four digits."""
    if unit.startswith(("accuracy", "share of")):
        return percent(value, 2)
    return f"{value:.0f}" if float(value).is_integer() and abs(value) < 1e9 else f"{value:.4g}"


FIRST = 12
"""Modes in the table before the details: those beyond their bounds and then those with the least room."""


def write_page(folder: str | Path, result: Record) -> Path:
    """Make ``stability.html`` in ``folder`` of the content of stability.json; one file, nothing outside it is
    needed to show it."""
    groups = [
        {"title": GROUP_TITLES[group], "modes": [row for row in result["modes"] if row["group"] == group]}
        for group in GROUPS
    ]
    text = page(
        "stability.html.j2",
        result=result,
        groups=groups,
        weakest=weakest(result["modes"]),
        first=weakest(result["modes"], FIRST),
        words=figure_in_words,
        failed=[record for record in result["modes"] if not record["passed"]],
        wrong=[record for record in result["modes"] if record["rtl"] and not record["rtl"]["bit_exact"]],
        confirmed=[record for record in result["modes"] if record["rtl"]],
        defences=next(tables(words("defences", **result)), None),
    )
    write_text(path := Path(folder) / PAGE, text)
    return path
