"""A newcomer's search: names of blocks, stages and verbs, and what one call tells of each."""

import subprocess
import sys

from scripts import ROOT, where
from tests.support.table import each_row

BLOCKS = {
    "frontend/onset_detector": "golden/model/preprocess.py",
    "frontend/pretrigger_ring": "golden/model/preprocess.py",
    "engine/engine": "golden/model/cells.py",
    "decision/classifier": "golden/model/pipeline.py",
    "host/uart_link": "eskin/live/link.py",
}
"""Blocks with a proof, and the file that says the same."""


def paths_of(name: str) -> set[str]:
    """Paths on the card of ``name``."""
    found = {
        line.split()[-1] if line.startswith(" ") else line.partition(":")[0]
        for line in where.card(where.index()[name])
    }
    assert all((ROOT / path).exists() for path in found)
    return found


@each_row("block", BLOCKS)
def test_a_block_leads_to_its_test_proof_and_model(block):
    folder, name = block.split("/")
    paths = {f"rtl/{block}.py", f"tests/rtl/{folder}/test_{name}.py", f"formal/{block}.py", BLOCKS[block]}
    assert paths <= paths_of(name)


def test_an_unknown_name_gives_the_nearest_and_status_two():
    ran = subprocess.run(
        [sys.executable, "-m", "scripts.where", "clasifier"], capture_output=True, text=True, timeout=600
    )
    assert ran.returncode == 2 and "near it: classifier" in ran.stderr
    assert where.main([]) == 2
