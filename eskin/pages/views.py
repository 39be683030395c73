"""Results in words: a template for each, in `templates`, rendered for a page or for a terminal.

A page's template is HTML. A terminal's is Markdown, ``NAME.txt.j2``: a heading and lines between bars
are a table, which is left out where it has no row; any other line is a sentence, on standard error where it
begins with ``! ``. Bars and line ends inside a value are not read as table syntax. None becomes a dash.
"""

import functools
import math
import os
import re
import shlex
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import jinja2
from rich.markup import escape
from rich.table import Column, Table

from eskin.golden.core import replacing

if TYPE_CHECKING:
    from eskin.cosim.results import Placed, Played
    from eskin.training.stage_error import LogitError

TEMPLATES = Path(__file__).with_name("templates")
USUAL_NAMES = ("recordings", "train", "training", "test", "data", "dataset")
"""Names of files that do not describe their content."""
GAP = "\u00a0"
"""Between a number and its unit: no line ends there."""


# ---------------------------------------------------------------------- figures in words
def percent(share: float, digits: int = 1) -> str:
    """``share`` as a percentage; rounding never makes 100 of anything less, nor 0 of anything more."""
    shown = f"{100 * share:.{digits}f}"
    if share > 0 and float(shown) == 0:
        return f"below {10.0**-digits:.{digits}f}{GAP}%"
    if share < 1 and float(shown) >= 100:
        shown = f"{math.floor(100 * share * 10**digits) / 10**digits:.{digits}f}"
    return f"{shown}{GAP}%"


def share(value: float | None) -> str:
    """A share in percent for a terminal, two digits."""
    return "-" if value is None else f"{100 * value:.2f} %"


def seconds(value: float) -> str:
    """A duration with a fitting unit, three digits."""
    return unit(value, "s")


def hertz(value: float) -> str:
    """A frequency with a fitting unit, no digit lost down to 1 Hz of kHz figures."""
    for prefix, scale in (("M", 1e6), ("k", 1e3)):
        if value >= scale:
            return f"{value / scale:.6g}{GAP}{prefix}Hz"
    return f"{value:.6g}{GAP}Hz"


def unit(value: float, symbol: str) -> str:
    """A quantity with the fitting multiple of its unit, three digits: ``unit(1.5e-6, "J")`` is 1.50 µJ."""
    for prefix, scale in (("", 1.0), ("m", 1e-3), ("µ", 1e-6), ("n", 1e-9)):
        if abs(value) >= scale:
            return f"{_three(value / scale)}{GAP}{prefix}{symbol}"
    return f"{_three(value / 1e-12)}{GAP}p{symbol}" if value else f"0{GAP}{symbol}"


def _three(value: float) -> str:
    """Three significant digits, never an exponent."""
    return f"{value:.{max(0, 2 - math.floor(math.log10(abs(value)))) if value else 0}f}"


def count(value: float) -> str:
    """A whole number in groups of three."""
    return f"{round(value):,}".replace(",", "\u202f")


def number(value: float | Sequence[float] | None, spec: str, factor: float = 1) -> str:
    """``value`` times ``factor`` as a format says."""
    if isinstance(value, Sequence):  # of each taxel: the least and the most
        return f"{number(min(value), spec, factor)} to {number(max(value), spec, factor)}"
    return "-" if value is None else format(value * factor, spec)


def mean_and_largest(error: "LogitError") -> str:
    """An error in words."""
    return "no step to judge" if error.max is None else f"{error.mean:.3f}, at most {error.max:.2f}"


def verdict(played: "Played | Placed") -> str:
    """Result of a co-simulation in a word or two; of a netlist as placed by ``bit_exact`` alone."""
    word = getattr(played, "verdict", "bit-exact" if played.bit_exact else "differs")
    return word.upper() if word in ("differs", "gave up") else word


def compared(played: "Played", things: str = "recordings") -> str:
    """The sentence that explains `verdict`."""
    things = things.removesuffix("s") if played.recordings == 1 else things
    values = f"{count(played.compared_values)} values of {count(played.recordings)} {things} compared"
    match verdict(played):
        case "GAVE UP" if where := played.gave_up:
            return (
                f"the hardware stopped responding at recording {where.recording}, frame {where.frame}, so the bench "
                f"ended the run; {values} until then"
            )
        case "no decision":
            return (
                f"no touch was long enough for a decision, so the network was not compared ({values}); "
                "use other recordings"
            )
        case "DIFFERS":
            return f"{count(played.mismatches)} of {values} differ"
    return f"{values}, none differs"


# ---------------------------------------------------------------------- templates
@functools.cache
def _environment(written: Callable[[Any], str] | None) -> jinja2.Environment:
    """With the filters that all templates share, and the style of pages; ``written``: how a value is put into
    a text (None: HTML)."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=written is None,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=written,
    )
    words = (
        percent,
        share,
        seconds,
        hertz,
        unit,
        count,
        number,
        mean_and_largest,
        verdict,
        compared,
        shlex.quote,
    )
    environment.filters |= {function.__name__: function for function in words}
    environment.globals |= {"zip": zip, "style": (TEMPLATES / "style.css").read_text(encoding="utf-8")}
    return environment


def _cell(value: Any) -> str:
    return "-" if value is None else " ".join(re.sub(r"(?<!\\)\|", r"\|", str(value)).splitlines())


def page(name: str, /, **values: Any) -> str:
    """The HTML of a result."""
    return _environment(None).get_template(name).render(values)


def words(name: str, /, **values: Any) -> str:
    """The Markdown of a result."""
    return _environment(_cell).get_template(f"{name}.txt.j2").render(values)


def write_text(path: Path, text: str) -> None:
    """Write a page whole or not at all."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


class Rows(NamedTuple):
    """A table: title, headings, cells of each row."""

    title: str
    columns: tuple[str, ...]
    cells: list[tuple[str, ...]]


def parts(text: str) -> Iterator[Rows | str]:
    """Tables and sentences of a Markdown text, in order."""
    title, columns = "", None
    cells: list[tuple[str, ...]] = []
    for line in [*text.splitlines(), ""]:
        line = line.strip()
        if line.startswith("|"):
            row = tuple(cell.strip().replace("\\|", "|") for cell in re.split(r"(?<!\\)\|", line)[1:-1])
            if columns is None:
                columns = row
            elif not all(re.fullmatch(r":?-{3,}:?", cell) for cell in row):
                cells.append(row)
            continue
        if columns and cells:
            yield Rows(title, columns, cells)
        if columns or line.startswith("#"):
            title, columns, cells = "", None, []
        if line.startswith("#"):
            title = line.lstrip("# ").replace("\\|", "|")
        elif line:
            yield line.replace("\\|", "|")


def tables(text: str) -> Iterator[Rows]:
    """Tables of a Markdown text."""
    return (part for part in parts(text) if isinstance(part, Rows))


def terminal_table(title: str, columns: Iterable[str], cells: Iterable[Sequence[Any]]) -> Table:
    """A table for the terminal; cells are plain text, never markup."""
    first, *further = columns
    table = Table(Column(first, no_wrap=True), *further, title=escape(title), title_justify="left")
    for row in cells:
        table.add_row(*(escape(str(cell)) for cell in row))
    return table


def short_name(data: str) -> str:
    """A name for recordings: the file's without its ending, or the folder's where the file has the usual
    name."""
    path = Path(os.path.abspath(data))
    return path.parent.name if path.stem in USUAL_NAMES else path.stem or "recordings"
