"""The notebooks of docs/notebooks: their cells run from top to bottom, and a cell that fails is seen."""

import json
from typing import Any

import pytest

from scripts import ROOT

NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))


def run(notebook: dict[str, Any], name: str) -> dict[str, Any]:
    """The names that all code cells leave, run one after the other as Jupyter runs them."""
    assert notebook["nbformat"] == 4 and len({cell["id"] for cell in notebook["cells"]}) == len(
        notebook["cells"]
    )
    names: dict[str, Any] = {"__name__": "__main__"}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            assert not cell["outputs"], "save the notebook without its outputs"
            exec(compile("".join(cell["source"]), f"{name}, {cell['id']}", "exec"), names)
    return names


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = run(json.loads(path.read_text()), path.stem)
    if path.stem == "recordings_to_board":
        assert names["model"].score(names["held"]) > 0.9 and len(names["bitstreams"]) == 1
        assert names["result"]["bit_exact"] and names["result"]["compared_values"] > 100
        assert names["wrong"]["mismatches"] == 1
    else:
        assert names["states"] == names["expected"] and len(names["states"]) > 20
