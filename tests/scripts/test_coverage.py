"""scripts/coverage.py, scripts/crosses.py, tests/plan.toml and the plugin tests/support/covered.py."""

import json
import random
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from eskin.golden.core import PRESETS, QFormat
from formal.run import proofs
from scripts import ROOT, coverage
from scripts.crosses import CROSSES, Seen, build, text
from tests.support import covered
from tests.support.strategies import together
from tests.support.table import each_row


def test_every_section_has_a_row_and_every_row_has_what_it_names():
    pages = "".join(page.read_text() for page in ROOT.glob("docs/specification*.md"))
    rows = coverage.plan()
    assert {row["section"] for row in rows} == {
        int(number) for number in re.findall(r"^## (\d+)\. ", pages, re.M)
    }
    known = {"crosses": {cross.name for cross in CROSSES}, "proofs": {proof.title for proof in proofs()}}
    known["tests"] = {str(path.relative_to(ROOT)) for path in ROOT.glob("tests/**/test_*.py")}
    for row in rows:
        assert {*row} <= {"section", "property", *known} and row["property"].endswith(".")
        for kind, names in known.items():
            assert {*row.get(kind, [])} <= names, row
        assert row["tests"], row
    assert {name for row in rows for name in row.get("crosses", [])} == known["crosses"]


def test_a_wish_is_a_configuration_that_hits_its_bin():
    """Also joined with others; of stimulus, pace and arithmetic only what a configuration says of them. A refusal is of a
    field of the bin itself."""
    seen, wanted = set(), set()
    decisions = np.outer(np.arange(256), (0, 1, 0, 0, 0, 0))  # which agree
    for config in map(build, together(coverage.wishes())):
        played = SimpleNamespace(stalls=False, pace="full")
        for cross in (cross for cross in CROSSES if cross.name in OF_CONFIGURATIONS):
            seen |= {
                (cross.name, case) for case in cross.cases(Seen(config, {"decision": decisions}, played))
            }
    for cross in (cross for cross in CROSSES if cross.name in OF_CONFIGURATIONS):
        for case in cross.bins().values():
            never = cross.never(case)
            wanted |= set() if never else {(cross.name, case)}
            assert never.split(":")[0] in (
                "",
                "reset is a field of the GRU",
                "readout_rule",
                *cross.wish(case),
            )
    assert not wanted - seen
    widths = next(cross for cross in CROSSES if cross.name == "widths")
    assert not any(map(widths.never, widths.bins().values())), "every width has designs at its ends"


OF_CONFIGURATIONS = ("network", "front end", "kinds together", "lanes", "scan", "widths")


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    (tmp_path / "parts").mkdir()
    monkeypatch.setattr(coverage, "PARTS", tmp_path / "parts")
    monkeypatch.setattr(coverage, "MERGED", tmp_path / "coverage.json")
    monkeypatch.setattr(coverage, "FOLDER", tmp_path)
    return tmp_path


def merged(folder: Path, **parts) -> dict:
    for worker, hits in parts.items():
        (folder / "parts" / f"{worker}.json").write_text(json.dumps(hits))
    coverage.merge()
    return coverage.read()


def test_without_its_tests_a_bin_is_a_hole(folder):
    """Five bins drawn by a seed; two workers, and then all tests again without one bin."""
    bins = [row for row in coverage.rows({}) if not row["never"]]
    names = [f"{row['cross']}: {row['bin']}" for row in bins]
    hits = {f"{side} {name}": {name: 1} for name in names for side in "ab"}
    half = {test: found for test, found in hits.items() if test[0] == "a"}
    result = merged(folder, gw0=half, gw1={test: hits[test] for test in hits if test not in half})
    assert coverage.share(result["bins"]) == 1 == result["curve"][-1][1] and not coverage.wishes(names)
    assert "0 are missing" in coverage.page(result)
    coverage.MERGED.write_text(json.dumps(result | {"hits": hits | {"old": {"scan: 3, touch": 1}}}))
    assert merged(folder, gw0={"new": {}})["hits"]["old"] == {}  # of a cross that has changed
    for hole in random.Random(57).sample(names, 5):
        again = {test: {} if hole in found else found for test, found in hits.items()}
        result = merged(folder, gw0=again)
        missing = [row for row in result["bins"] if not row["tests"] and not row["never"]]
        assert [f"{row['cross']}: {row['bin']}" for row in missing] == [hole]
        assert f"<td>{missing[0]['bin']}</td>" in coverage.page(result).split("<h2>Plan")[0]
        cross = next(cross for cross in CROSSES if cross.name == missing[0]["cross"])
        wish = cross.wish(cross.bins()[missing[0]["bin"]])
        assert coverage.wishes({*names} - {hole}) == [wish] * bool(wish)


def test_a_bin_that_cannot_be_or_is_unknown_is_an_error_and_no_hit_is_lost(folder):
    impossible = next(row for row in coverage.rows({}) if row["never"])
    for name in (f"{impossible['cross']}: {impossible['bin']}", "scan: 3, touch"):
        with pytest.raises(ValueError, match="cannot be|no cross has"):
            merged(folder, gw0={"test": {name: 1}})
        assert [*folder.glob("parts/*")]


@each_row(
    "value, ways",
    [
        (8, {"tie"}),
        (7, {"down"}),
        (-7, {"up"}),
        (16, set()),
        (127, {"up", "high"}),
        (-200, {"tie", "low"}),
        (-129, {"up"}),
    ],
)
def test_how_a_value_is_narrowed(value, ways, monkeypatch):
    """By 4 bits into 4 bits: -8 to 7; -129 / 16 is -8.06, which is -8."""
    monkeypatch.setattr(covered, "_arithmetic", (set(), set()))
    covered.narrowed("logit", np.array([value]), 4, QFormat(4, 0))
    assert covered._arithmetic[0] == {("logit", way) for way in ways}


def test_only_what_is_bit_exact_counts(monkeypatch):
    monkeypatch.setattr(covered, "HITS", covered.defaultdict(covered.Counter))
    config = PRESETS["thesis"]
    arrays = {
        name: np.zeros((0, 6), np.int64)
        for name in ("decision", "samples", "open", "touches", "offsets", "decision_offsets")
    }
    for exact in (False, True):
        played = SimpleNamespace(bit_exact=exact, stalls=False, pace="full", probe=False, registers={})
        covered.observe(SimpleNamespace(config=config, expected=arrays), played)
        bins = {name for found in covered.HITS.values() for name in found}
        assert (f"scan: {text((1, 'touch'))}" in bins) == exact
