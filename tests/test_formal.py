"""The fastest proofs of formal/ and their seeded bugs; all of them with `make formal`."""

from __future__ import annotations

import pytest

from formal.job import run
from formal.run import good, proofs

JOBS = [(one.title, number) for one in proofs(quick=True) for number in (None, *range(len(one.bugs)))]


@pytest.mark.parametrize(("title", "number"), JOBS)
def test_the_proof_passes_and_the_seeded_bug_is_found(title, number):
    result = run(title, number)
    assert good((title, number), result), result
