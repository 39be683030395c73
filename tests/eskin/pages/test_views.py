"""eskin/pages/views.py: figures in words; what a value holds never becomes a bar, a row, a heading or markup."""

import jinja2
import pytest

from eskin.pages.views import parts, short_name, words

HOSTILE = ("a|b", "[b]a", "\\|", "two\nlines", "{{ 1 }}", "")


def test_a_value_stays_in_its_cell():
    formats = {name: name for name in HOSTILE}
    (table,) = parts(words("quantise", tried=[], formats=formats))
    shown = [(name.replace("\n", " "),) * 2 for name in HOSTILE]
    assert table.title == "formats" and table.columns == ("signal", "format")
    assert table.cells == [("|", "|") if row[0] == "\\|" else row for row in shown]


def test_a_figure_that_is_missing_is_no_empty_cell():
    with pytest.raises(jinja2.UndefinedError, match="recordings_looked_at"):
        words("front_ends", rows=[], front_ends={"split": []})


def test_a_file_with_a_name_that_says_nothing_is_called_by_its_folder():
    assert [short_name(path) for path in ("a/glove/train.npz", "a/glove/recordings.npz", "a/hand.npz")] == [
        "glove",
        "glove",
        "hand",
    ]
