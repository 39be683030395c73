"""The fastest proofs of formal/ and the seeded bugs of one; all of them with `make formal`."""

import pytest

from formal import run
from formal.proof import Proof

QUICK = run.jobs_of(run.proofs(quick=True))


def test_only_verdicts_are_kept(monkeypatch, tmp_path):
    """What ran out of time, or failed on a full disk, is run again; what was proved or found is not."""
    made = Proof("made", "made", "", lambda m: None, "induction", 3, "")
    monkeypatch.setattr(run, "proof_of", lambda title: made)
    monkeypatch.setattr(run, "elaborate", lambda title, bug: "module")
    came = iter(["TIMEOUT", "ERROR", "UNKNOWN", "PASS", "never"])
    monkeypatch.setattr(run, "solve", lambda folder, method: (next(came), ""))
    verdicts = [run.run(tmp_path, ("made.made", None))["verdict"] for _ in range(5)]
    assert verdicts == ["TIMEOUT", "ERROR", "UNKNOWN", "PASS", "PASS"] and next(came) == "never"


def test_every_proof_has_a_seeded_bug_that_is_in_the_design():
    for proof in run.proofs():
        assert proof.bugs, proof.title
        for bug in proof.bugs:
            assert bug.old in (run.ROOT / bug.file).read_text(), (
                f"{proof.title}: {bug.file} no longer has '{bug.old}': write the bug anew"
            )


@pytest.mark.parametrize("title", [proof.title for proof in run.proofs() if not proof.quick])
def test_a_proof_finds_what_it_names_in_its_block(title):
    """Signals of a block that were renamed are seen here, not only by ``make formal``."""
    assert "$check" in run.elaborate(title)


SEEDED = "control.no_write_during_a_touch"
"""The proof whose first bug ``make test`` looks for; ``make formal`` looks for all of all."""


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow if bug is not None and (bug or title != SEEDED) else ())
        for name, (title, bug) in QUICK.items()
    ],
)
def test_proof(name):
    result = run.run(run.BUILD, QUICK[name])
    assert result["good"], result
