"""The fastest proofs of formal/ and the seeded bugs of one; all of them with `make formal`."""

import pytest

from formal import run
from formal.proof import Proof

GATE = {
    f"{proof.title} None": (proof.title, None)
    for proof in run.proofs(
        ["clock_gate", "stimulator_frames", "frame_guard", "pretrigger_ring.one", "pretrigger_ring.two"]
    )
}
"""Proofs that take up to a minute and see mutants that no test sees."""
JOBS = run.jobs_of(run.proofs(quick=True)) | GATE


def test_only_verdicts_are_kept(monkeypatch, tmp_path):
    """What ran out of time, or failed on a full disk, is run again; what was proved or found is not."""
    made = Proof("made", "made", "", lambda m: None, "induction", 3, "")
    monkeypatch.setattr(run, "proof_of", lambda title: made)
    monkeypatch.setattr(run, "elaborate", lambda title, bug: "module")
    ends = iter(["TIMEOUT", "ERROR", "UNKNOWN", "PASS", "never"])
    monkeypatch.setattr(run, "solve", lambda folder, method: (next(ends), ""))
    verdicts = [run.run(tmp_path, ("made.made", None))["verdict"] for _ in range(5)]
    assert verdicts == ["TIMEOUT", "ERROR", "UNKNOWN", "PASS", "PASS"] and next(ends) == "never"


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


FAST = {"control.no_write_during_a_touch 0", *(f"{proof.title} None" for proof in run.proofs(quick=True))}
FAST -= {"decision_queue.once_and_in_order None"}
"""With the first bug of one proof; ``make formal`` looks for all of all. The longest is slow: tests/rtl/host/test_driver.py
reads its queue."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in FAST else pytest.mark.slow) for name in JOBS]
)
def test_proof(name):
    result = run.run(run.BUILD, JOBS[name])
    assert result["good"], result
