"""The budget: what is counted, and that a cap below today's figure fails."""

import subprocess
import sys
from pathlib import Path

import pytest

from scripts import house

ROOT = Path(__file__).resolve().parent.parent.parent
BUDGET = """# kept as it is
[tokens]  # a line a folder
part = {tokens}

[bytes]
templates = 9
sv = 0
cpp = 900
toml = 900
long_strings = 300

[counts]
options = 900
fields = 900
"""


def budget(folder: Path, *options: str) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "scripts.house", str(folder), *options]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600)


@pytest.fixture
def checkout(tmp_path):
    """Seven tokens, a string of 250 characters, a template of 9 bytes."""
    (tmp_path / "part/templates").mkdir(parents=True)
    (tmp_path / "part/a.py").write_text(f'"""{"d" * 300}"""\nx = 1  # one\ntext = "{"s" * 250}"\n')
    (tmp_path / "part/templates/a.j2").write_text("nine byte")
    (tmp_path / "part/link.py").symlink_to("a.py")
    subprocess.run(["git", "init", "-q"], cwd=tmp_path, check=True)
    subprocess.run(["git", "add", "part"], cwd=tmp_path, check=True)
    return tmp_path


def test_a_cap_below_todays_figure_fails(checkout):
    (checkout / "budget.toml").write_text(BUDGET.format(tokens=7))
    held = budget(checkout, "--budget")
    assert (held.returncode, held.stderr) == (0, "")
    assert "tokens part                 7 of        7\n" in held.stdout
    assert "bytes  long_strings       250 of      300\n" in held.stdout
    (checkout / "budget.toml").write_text(BUDGET.format(tokens=6))
    above = budget(checkout, "--budget")
    assert (above.returncode, above.stderr) == (1, "tokens.part is 7, above its cap of 6\n")


def test_what_has_no_cap_may_not_be_there():
    assert house.over_budget({"tokens": {"a": 1, "b": 0}}, {}) == ["tokens.a is 1, above its cap of 0"]


def test_caps_are_lowered_and_never_raised(checkout):
    text = BUDGET.format(tokens=1234)
    today = {"tokens": {"part": 1101}, "bytes": {"templates": 1000}, "counts": {"options": 17}}
    wanted = text.replace("part = 1234", "part = 1200").replace("options = 900", "options = 17")
    assert house.lowered(text, today) == wanted
