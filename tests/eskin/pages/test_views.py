"""eskin/pages/views.py: figures in words; what a value holds never becomes a bar, a row, a heading or markup."""

import io

import jinja2
import pytest
from rich.console import Console

from eskin.pages import views
from eskin.pages.views import Rows, parts, terminal_table, words
from tests.support.table import each_row

HOSTILE = ("a|b", "[b]a", "\\|", "two\nlines", "{{ 1 }}", "")


@each_row(
    ("text", "shown"),
    [
        (views.share(0.12345), "12.35 %"),
        (views.share(None), "-"),
        (views.number(2.5e-5, ".4g", 1e6), "25"),
        (views.number(None, ".3f"), "-"),
        (views.mean_and_largest({"mean": 0, "max": None}), "no step to judge"),
        (views.article("image"), "an image"),
    ],
)
def test_figures_in_words(text, shown):
    assert text == shown


def test_a_value_stays_in_its_cell():
    formats = {name: name for name in HOSTILE}
    (table,) = parts(words("quantise", tried=[], formats=formats))
    shown = [(name.replace("\n", " "),) * 2 for name in HOSTILE]
    assert isinstance(table, Rows) and table.title == "formats" and table.columns == ("signal", "format")
    assert table.cells == [("|", "|") if row[0] == "\\|" else row for row in shown]


def test_a_table_without_rows_is_left_out_and_sentences_keep_their_place():
    text = "first\n# title\n| a | b |\n\n# kept\n| a | b |\n| --- | --- |\n| 1 | - |\nlast\n| c |\n| 2 |"
    kept, untitled = Rows("kept", ("a", "b"), [("1", "-")]), Rows("", ("c",), [("2",)])
    assert list(parts(text)) == ["first", kept, "last", untitled]


def test_a_figure_that_is_missing_is_no_empty_cell():
    with pytest.raises(jinja2.UndefinedError, match="recordings_looked_at"):
        words("front_ends", rows=[], split=[])


def test_a_name_in_the_first_column_stays_on_one_line():
    table = terminal_table(
        "networks", ["network", "windows"], [["linear (not augmented)", "20 windows of 96"]]
    )
    text = io.StringIO()
    Console(file=text, width=36).print(table)
    assert "linear (not augmented)" in text.getvalue()
