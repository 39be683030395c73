"""scripts/baselines_page.py: the figures of docs/baselines.md come from results, and nothing else of the page
changes."""

import json
import sys

import pytest

from eskin.golden.core import InputError
from eskin.study.baselines.registry import METHODS
from eskin.study.baselines.rows import row_of
from scripts import baselines_page as page

COMMON = {
    "recordings": 20,
    "classes": 3,
    "config": {"name": "x"},
    "shape": [2, 2],
    "folds": 2,
    "left_out": [],
}
TEXT = f"# Words\n\nbefore\n{page.BEGIN}\nold figures\n{page.END}\nafter\n"


def row(method: str, *shares: float, multiplies: int = 40):
    runs = [
        {"fold": k, "seed": 0, "recordings": 10, "accuracy": share, "float_accuracy": share, "parameters": 8, "multiplies": multiplies,
         "bytes": 32, "comparisons": 7, "train_s": 2.0, "decision_us": [1.0, 3.0]}
        for k, share in enumerate(shares)
    ]  # fmt: skip
    return row_of(METHODS[method], ["person"], runs)


def folder(path, *rows, **changed):
    path.mkdir()
    (path / "baselines.json").write_text(json.dumps(COMMON | {"rows": list(rows)} | changed))
    return path


def write(monkeypatch, tmp_path, *scenes: str) -> str:
    target = tmp_path / "page.txt"
    target.write_text(TEXT)
    monkeypatch.setattr(sys, "argv", ["baselines_page", "--page", str(target), *scenes])
    page.main()
    return target.read_text()


def test_folders_of_a_scene_are_joined_into_one_table(tmp_path, monkeypatch):
    first = folder(
        tmp_path / "a",
        row("svm", 0.9, 0.7),
        row("gru12-n20", 0.5, 0.4),
        row("forest", 0.6, 0.6, multiplies=0),
    )
    again = folder(tmp_path / "b", row("gru12-n20", 0.9, 0.8), row("gru12-n256", 0.3, 0.5))
    text = write(monkeypatch, tmp_path, f"mine:my sensor={first},{again}")
    assert text.startswith("# Words\n\nbefore\n") and text.endswith("\nafter\n") and "old figures" not in text
    lines = text.splitlines()
    table = [
        line.split(" | ")
        for line in lines
        if (line.startswith("| ") and "neurons" in line) or line.startswith("| R")
    ]
    assert [cells[2] for cells in table if len(cells) > 6] == ["85.0 ± 5.0", "80.0 ± 10.0", "40.0 ± 10.0"], (
        "the later folder's row"
    )
    assert "| random forest, window means | 1 | 60.0 ± 0.0 | 0, 7 comparisons |" in text
    assert (
        "| my sensor | person | GRU20, 12 neurons, thesis's protocol, 85.0 % | GRU20, 12 neurons, thesis's "
        "protocol, 85.0 %," in text
    )
    assert (
        "| my sensor, person | GRU20 above GRU256 | gru12-n20 85.0 ± 5.0 % | gru12-n256 40.0 ± 10.0 % | "
        "+45.0 ± 15.0 | holds |" in lines
    )
    assert (tmp_path / "baselines_mine.svg").read_text().startswith("<?xml")


@pytest.mark.parametrize("argument", ["no folder", "mine:my sensor=", "=x", "mine:my sensor=nowhere"])
def test_a_scene_that_cannot_be_read_is_refused(argument):
    with pytest.raises(InputError):
        page.Scene.read(argument)


def test_folders_of_different_front_ends_are_not_joined(tmp_path, monkeypatch, capsys):
    first, other = (
        folder(tmp_path / "a", row("svm", 0.9)),
        folder(tmp_path / "b", row("svm", 0.9), config={"name": "y"}),
    )
    with pytest.raises(SystemExit) as end:
        write(monkeypatch, tmp_path, f"mine:my sensor={first},{other}")
    assert (
        end.value.code == 2
        and "different" in capsys.readouterr().err
        and (tmp_path / "page.txt").read_text() == TEXT
    )
