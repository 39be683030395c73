"""The fastest proofs of formal/ and their seeded bugs; all of them with `make formal`."""

from __future__ import annotations

import types

import pytest

from formal import job
from formal.job import ROOT, elaborate
from formal.run import Runner, good, proofs


def test_only_verdicts_are_kept(monkeypatch, tmp_path):
    """What ran out of time, or failed on a full disk, is run again; what was proved or found is not."""
    monkeypatch.setattr(job, "BUILD", tmp_path)
    monkeypatch.setattr(
        job, "load", lambda title: types.SimpleNamespace(method="induction", depth=3, bugs=())
    )
    monkeypatch.setattr(job, "elaborate", lambda title, bug: "module")
    came = iter(["TIMEOUT", "ERROR", "UNKNOWN", "PASS", "never"])
    monkeypatch.setattr(job, "_sby", lambda folder: (next(came), ""))
    told = [job.run("made", None) for _ in range(5)]
    assert [(result["verdict"], result["kept"]) for result in told] == [
        ("TIMEOUT", False),
        ("ERROR", False),
        ("UNKNOWN", False),
        ("PASS", False),
        ("PASS", True),
    ]


JOBS = [(one.title, number) for one in proofs(quick=True) for number in (None, *range(len(one.bugs)))]


def test_every_proof_has_a_seeded_bug_that_is_in_the_design():
    for one in proofs():
        assert one.bugs, one.title
        for bug in one.bugs:
            assert bug.old in (ROOT / bug.file).read_text(), (
                f"{one.title}: {bug.file} no longer has '{bug.old}': write the bug anew"
            )


@pytest.mark.parametrize("title", [one.title for one in proofs() if not one.quick])
def test_a_proof_finds_what_it_names_in_its_block(title):
    """Signals of a block that were renamed are seen here, not only by ``make formal``."""
    assert "$check" in elaborate(title, None)


@pytest.mark.parametrize(("title", "number"), JOBS)
def test_the_proof_passes_and_the_seeded_bug_is_found(title, number):
    result = Runner(1).run((title, number))
    assert good((title, number), result), result
