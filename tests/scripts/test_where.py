"""A newcomer's search: names of blocks, stages and verbs, and what one call tells of each."""

import subprocess
import sys
from pathlib import Path

import pytest

from eskin.cosim.scoreboard import FLAT_STAGES
from scripts import docs_site, where

BLOCKS = {
    "frontend/onset_detector": "preprocess",
    "frontend/pretrigger_ring": "preprocess",
    "engine/engine": "cells",
    "decision/classifier": "pipeline",
    "host/uart_link": "",
}
"""Blocks with a proof, and the file of golden/model that says the same; the link's model is its host, in
cosim/."""
STAGES = {"feature": ["frontend/normaliser"], "logit": ["engine/engine"], "decision": ["decision/classifier"]}
VERBS = {
    "cosim": "eskin/verbs/cosim_job",
    "run": "eskin/verbs/main_job",
    "sweep": "eskin/study/sweep",
    "schedule": "rtl/program/schedule",
    "quantise": "eskin/training/quantise",
}


def told(name: str) -> set[str]:
    """Paths on the card of ``name``."""
    found = {
        line.split()[-1] if line.startswith(" ") else line.partition(":")[0]
        for line in where.card(where.index()[name])
    }
    assert all((docs_site.ROOT / path).exists() for path in found)
    return found


@pytest.mark.parametrize("block", BLOCKS)
def test_a_block_leads_to_its_test_proof_and_model(block):
    folder, name = block.split("/")
    model = f"golden/model/{BLOCKS[block]}.py" if BLOCKS[block] else "cosim/link.py"
    assert {f"rtl/{block}.py", f"tests/rtl/{folder}/test_{name}.py", f"formal/{block}.py", model} <= told(
        name
    )


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_leads_to_its_blocks(stage):
    assert {f"rtl/{block}.py" for block in STAGES[stage]} <= told(stage)


@pytest.mark.parametrize("verb", VERBS)
def test_a_verb_leads_to_its_module_and_test(verb):
    folder, _, name = VERBS[verb].rpartition("/")
    assert {f"{VERBS[verb]}.py", f"tests/{folder}/test_{name}.py"} <= told(verb)
    assert "eskin/cli/common.py" not in told(verb), "the file of the command, not of its decorator"


def test_every_compared_stage_has_its_block():
    assert set(where.STAGES) == {*FLAT_STAGES, "decision"}
    top = "".join(
        path.read_text()
        for path in docs_site.packages()["eskin.rtl.top"] + docs_site.packages()["eskin.rtl.frontend"]
    )
    for block in {block for blocks in where.STAGES.values() for block in blocks}:
        assert Path(block).name in top, "the chain does not use this block"


def test_an_unknown_name_gives_the_nearest_and_status_two():
    ran = subprocess.run(
        [sys.executable, "-m", "scripts.where", "clasifier"], capture_output=True, text=True, timeout=600
    )
    assert ran.returncode == 2 and "near it: classifier" in ran.stderr
    assert where.main([]) == 2
