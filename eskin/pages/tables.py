"""Tables of results: columns told once, rendered for a terminal and for a page.

A column is a heading and how a record fills it: a function of the record, or a format such as
``{accuracy:percent}``, ``{splits[0][spread]:.3f}``, ``{latency_s:1e6*.4g}`` (times 1e6, then ``.4g``) or
``{met:met|missed}`` (by its truth). What is None is a dash.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from string import Formatter
from typing import Any

from rich.markup import escape
from rich.table import Table

Columns = Mapping[str, str | Callable[[Any], Any]]
"""Heading -> format or function of a record."""


def percent(share: float | None) -> str:
    """A share in percent, two digits."""
    return "-" if share is None else f"{100 * share:.2f} %"


def mean_and_largest(error: Mapping[str, Any]) -> str:
    """{mean, max} of an error in words."""
    return "no step to judge" if error["max"] is None else f"{error['mean']:.3f}, at most {error['max']:.2f}"


class _Words(Formatter):
    def format_field(self, value: Any, spec: str) -> str:
        if "|" in spec:
            return spec.split("|")[not value]
        if spec == "percent" or value is None:
            return percent(value)
        factor, _, rest = spec.rpartition("*")
        return format(value * float(factor) if factor else value, rest)


def rows_of(records: Iterable[Mapping[str, Any]], columns: Columns) -> list[tuple[str, ...]]:
    """The cells of each record."""
    words = _Words()
    return [
        tuple(
            words.vformat(cell, (), record) if isinstance(cell, str) else str(cell(record))
            for cell in columns.values()
        )
        for record in records
    ]


def terminal_table(title: str, columns: Iterable[str], rows: Iterable[Sequence[Any]]) -> Table:
    """A table for the terminal; its cells are text, whatever they hold."""
    table = Table(*columns, title=escape(title), title_justify="left")
    for row in rows:
        table.add_row(*(escape(str(cell)) for cell in row))
    return table


def markdown(columns: Iterable[str], rows: Iterable[Sequence[Any]]) -> str:
    """The same in Markdown."""
    head = list(columns)
    return "".join("| " + " | ".join(map(str, row)) + " |\n" for row in (head, ["---"] * len(head), *rows))
