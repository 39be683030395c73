"""The fastest proofs of formal/ and their seeded bugs; all of them with `make formal`."""

from __future__ import annotations

import pytest

from formal.job import ROOT
from formal.run import Runner, good, proofs

JOBS = [(one.title, number) for one in proofs(quick=True) for number in (None, *range(len(one.bugs)))]


def test_every_proof_has_a_seeded_bug_that_is_in_the_design():
    for one in proofs():
        assert one.bugs, one.title
        for bug in one.bugs:
            assert bug.old in (ROOT / bug.file).read_text(), f"{one.title}: {bug.file} no longer has '{bug.old}': write the bug anew"


@pytest.mark.parametrize(("title", "number"), JOBS)
def test_the_proof_passes_and_the_seeded_bug_is_found(title, number):
    result = Runner(1).run((title, number))
    assert good((title, number), result), result
