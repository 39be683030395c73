"""Cells of a table: formats of a record, and what they do with None."""

from eskin.pages.tables import rows_of
from tests.support.table import each_row

RECORD = {
    "name": "[b]a",
    "share": 0.12345,
    "time_s": 2.5e-5,
    "met": False,
    "none": None,
    "splits": [{"spread": 0.5}],
}


@each_row(
    ("cell", "text"),
    [
        ("{name}", "[b]a"),
        ("{share:percent}", "12.35 %"),
        ("{share:100*.1f} ± {splits[0][spread]:.2f}", "12.3 ± 0.50"),
        ("{time_s:1e6*.4g} us", "25 us"),
        ("{met:met|missed}", "missed"),
        ("{none:.3f}", "-"),
        ("{none:percent}", "-"),
        (lambda record: record["none"], "None"),
    ],
)
def test_a_cell_is_filled_as_its_column_says(cell, text):
    assert rows_of([RECORD], {"heading": cell}) == [(text,)]
