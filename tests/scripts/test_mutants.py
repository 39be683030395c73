"""``make mutants`` on a project of one file and one test: what a test sees is killed, what it does not see
survives and is explained."""

import itertools
import subprocess
from collections import Counter

import pytest

from scripts import ROOT
from scripts.mutants import OUT, Scope, choose, judge, mutants, report

CODE = '''"""One unit: 1 + 1."""


def twice(value: int = 1) -> int:
    """1 + 1 is 2."""
    if value > 10**6:
        raise ValueError("more than 1 + 1")
    return value + value


def late(value):
    while value != 3:
        value += 1
    return value


def unseen(flag):
    return not flag
'''
TEST = """import pytest
from eskin.golden.slow import thrice
from eskin.golden.unit import late, twice
from eskin.golden.unseen import negative

def test_twice():
    assert twice(3) == 6 and late(2) == 3

@pytest.mark.slow
def test_slow():
    assert thrice(5) == 15 and negative(5) == -5
"""
SCOPE = """
[[named]]
name = "twice is once"
file = "golden/unit.py"
old = "value + value"
new = "value"
test = "tests/test_unit.py"

[files]
"golden/unit.py" = ["tests/test_unit.py", "tests/test_unit.py::test_slow"]
"golden/slow.py" = ["tests/test_unit.py::test_slow"]
"golden/unseen.py" = ["tests/test_unit.py"]
"""


@pytest.fixture
def project(tmp_path):
    """The tiny project."""
    for name, text in {
        "eskin/__init__.py": "",
        "golden/__init__.py": "",
        "golden/unit.py": CODE,
        "golden/slow.py": "def thrice(value):\n    return 3 * value\n",
        "golden/unseen.py": "def negative(value):\n    return -value\n",
        "tests/test_unit.py": TEST,
        "tests/conftest.py": "import hypothesis\n\nhypothesis.settings.register_profile('mutants')\n",
        "tests/mutants.toml": SCOPE,
        "pyproject.toml": "[tool.pytest.ini_options]\npythonpath = ['.']\nmarkers = ['slow: x']\naddopts = \"-m 'not slow'\"\n",
    }.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    (tmp_path / "eskin" / "golden").symlink_to("../golden")
    subprocess.run("git init -q && git add .", shell=True, cwd=tmp_path, check=True)
    return tmp_path


@pytest.mark.slow
def test_killed_survived_timeout_and_equivalent(project, capsys, monkeypatch):
    monkeypatch.setattr("scripts.mutants.LIMIT", 4)
    out = project / OUT

    def verdicts():
        return {path.name: path.stat().st_mtime_ns for path in (out / "verdicts").iterdir()}

    rows = judge(project, 100, 1)
    outcomes = {(row.was, row.now): row.outcome for row in rows.itertuples()}
    assert outcomes["return value + value", "return ((value)-(value))"] == "killed"
    assert outcomes["while value != 3:", "while value != (4):"] == "killed"
    assert outcomes["value += 1", "value += (0)"] == "timeout"
    assert outcomes["return not flag", "return (flag)"] == "survived"
    # a slow test that is named goes on judging, the slow tests of a file that is named whole do not
    assert outcomes["return 3 * value", "return (4) * value"] == "killed"
    assert outcomes["return -value", "return (value)"] == "survived"
    assert all("10**6" not in was and "1 + 1" not in was and "int = 1" not in was for was, _ in outcomes), (
        "texts, refusals, defaults"
    )
    assert (rows["compared"] == (rows["outcome"] == "killed")).all()
    assert list(rows["outcome"][rows["kind"] == "named"]) == ["killed"]
    first = verdicts()
    assert not report(project, 100, 1)
    shown = capsys.readouterr().out
    assert "+ return (flag)" in shown and "no reason given" in shown and "1 by a" not in shown
    survivors = "".join(
        f'[equivalent."golden/{file}.py"]\n"return ({name})" = "never run"\n'
        for file, name in (("unit", "flag"), ("unseen", "value"))
    )
    (project / "tests/mutants.toml").write_text(SCOPE + survivors)
    assert report(project, 100, 1)
    shown = (out / "mutants.md").read_text()
    assert (
        "100.0% killed (seed 1)" in shown
        and "equivalent: golden/unseen.py:2" in shown
        and "never run" in shown
    )
    assert verdicts() == first, "judged twice"
    assert (project / "golden/unit.py").read_text() == CODE


def test_every_test_that_judges_is_there():
    scope = Scope.load(ROOT)
    for test in itertools.chain(*scope.tests.values(), *scope.named.values()):
        file, _, name = test.partition("::")
        assert f"def {name.partition('[')[0]}" in (ROOT / file).read_text(), test


def test_every_mutant_of_the_project_is_one_fault_and_kinds_and_files_are_even():
    scope = Scope.load(ROOT)
    chosen = choose(scope.texts, 120, 1, scope.skip)
    assert len(set(chosen)) == 120
    assert {mutant.file for mutant in chosen} == set(scope.texts)
    kinds = Counter(mutant.kind for mutant in chosen)
    assert len(kinds) == 9 and min(kinds.values()) >= 7


def test_every_named_fault_is_one_of_the_code_there_is():
    for mutant in Scope.load(ROOT).named:
        assert mutant.is_fault(), mutant.name


def test_every_reason_is_that_of_a_mutant_there_is():
    scope = Scope.load(ROOT)
    for file, now in scope.reasons:
        found = (mutant.lines()[1] for mutant in mutants(file, scope.texts[file], scope.skip))
        assert now in found, (file, now)
