"""The fastest proofs of formal/ and their seeded bugs; all of them with `make formal`."""

from __future__ import annotations

import pytest

from formal.job import ROOT, elaborate
from formal.run import Runner, good, proofs

JOBS = [(one.title, number) for one in proofs(quick=True) for number in (None, *range(len(one.bugs)))]


def test_every_proof_has_a_seeded_bug_that_is_in_the_design():
    for one in proofs():
        assert one.bugs, one.title
        for bug in one.bugs:
            assert bug.old in (ROOT / bug.file).read_text(), f"{one.title}: {bug.file} no longer has '{bug.old}': write the bug anew"


@pytest.mark.parametrize("title", [one.title for one in proofs() if not one.quick])
def test_a_proof_finds_what_it_names_in_its_block(title):
    """Signals of a block that were renamed are seen here, not only by ``make formal``."""
    assert "$check" in elaborate(title, None)


@pytest.mark.parametrize(("title", "number"), JOBS)
def test_the_proof_passes_and_the_seeded_bug_is_found(title, number):
    result = Runner(1).run((title, number))
    assert good((title, number), result), result
