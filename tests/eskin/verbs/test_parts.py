"""Which part holds a model: figures of the choice, of the C export, and unknown where there is none."""

import math
import re

import pytest

from eskin.exchange import plain_c
from eskin.pages.result import PartNeed
from eskin.pages.views import tables, words
from eskin.verbs import cost
from eskin.verbs.parts import BOARDS, COMPILERS, parts_of
from tests.eskin.exchange.test_plain_c import IMAGES
from tests.support.image_scenes import random_image_model
from tests.support.random_models import random_integer_model
from tests.support.small_designs import TRACKED

KINDS = {
    "gru": {},
    "linear": {"cell": "linear", "decision": "last"},
    "trees": {"cell": "trees", "decision": "last"},
    "prototypes": {"readout": "prototypes", "decision": "last"},
    "images": None,
}


@pytest.mark.parametrize("kind", KINDS)
def test_every_part_has_a_row_of_figures_that_exist(kind):
    fields = KINDS[kind]
    model = (
        random_image_model(IMAGES, 1)
        if fields is None
        else random_integer_model(TRACKED.replace(**fields), 1)
    )
    rows = {row.part: row for row in parts_of(model)}
    assert all(row.plain().keys() == PartNeed.model_fields.keys() for row in rows.values())
    assert len(rows) == len(BOARDS) + len(COMPILERS) * (kind != "prototypes")  # which C does not have
    ice, ecp, gowin, *processors = rows.values()
    price = cost.cost_of(model.config)
    assert (ice.cells, ice.latency_s, ice.average_w) == (price.cells, price.latency_s, price.average_w)
    if not model.config.is_image:
        assert cost.power_of(model.config).average_w == pytest.approx(price.average_w, rel=1e-12)
    assert (ice.fits, ecp.fits) == ((None, None) if kind == "images" else (True, True))
    assert ecp.average_w > ice.average_w
    assert gowin.fits is gowin.cells is gowin.average_w is None and gowin.latency_s > 0
    for row in processors:
        config = model.config
        adds = 0 if config.is_image else config.last_frame * config.sensor.taxels
        steps = 1 if config.is_image else config.windows.steps
        assert row.fits is row.bytes is None and row.operations == steps * config.multiplies + adds
        assert row.constant_bytes > max(array.size for array in model.arrays.values())
    (shown,) = tables(words("parts", run={"parts": [row.model_dump() for row in rows.values()]}))
    assert len(shown.cells) == len(rows) and "unknown" in shown.cells[2]


def test_bytes_are_a_compilers(tmp_path, monkeypatch):
    """A compiler that leaves 700 bytes of program and 20 of data; without `size` there is no figure."""
    model = random_integer_model(TRACKED, 1)
    for name, text in (
        ("avr-gcc", "test -f eskin_model.h && touch model.o"),
        ("avr-size", "echo 'text data bss'; echo '700 20 9 x'"),
    ):
        assert parts_of(model)[-1].bytes is None
        (tmp_path / name).write_text(f"#!/bin/sh\n{text}\n")
        (tmp_path / name).chmod(0o755)
        monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    *_, cortex, avr = parts_of(model)
    assert avr.bytes == 720 and cortex.bytes is None


def test_tables_are_counted_in_bytes():
    """As their declarations in C have them."""
    model = random_integer_model(TRACKED, 1)
    text = plain_c.sources(model)[plain_c.SOURCE]
    tables = re.findall(r"static const u?int(\d+)_t \w+((?:\[\d+\])+)", text)
    assert {"8", "16"} < {bits for bits, _ in tables}
    sizes = [int(bits) // 8 * math.prod(map(int, re.findall(r"\d+", size))) for bits, size in tables]
    assert plain_c.constant_bytes(model) == sum(sizes)
