"""``make mutants`` on a project of one file and one test: what a test sees is killed, what it does not see
survives and is explained."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from scripts.mutants import KINDS, Scope, choose, is_fault, mutants

ROOT = Path(__file__).resolve().parents[2]
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
STUMBLES = """status = []

def pytest_sessionfinish(exitstatus):
    status.append(exitstatus)

def pytest_unconfigure():
    assert not any(status), "as pytest may after a failed test, over a simulation that it left open"
"""
SCOPE = """
[[named]]
name = "twice is once"
file = "golden/unit.py"
old = "value + value"
new = "value"
test = "tests/test_unit.py"

[files]
"golden/unit.py" = ["tests/test_unit.py"]
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
        "tests/conftest.py": STUMBLES,
        "tests/mutants.toml": SCOPE,
        "pyproject.toml": "[tool.pytest.ini_options]\npythonpath = ['.']\nmarkers = ['slow: x']\naddopts = \"-m 'not slow'\"\n",
    }.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    (tmp_path / "eskin" / "golden").symlink_to("../golden")
    return tmp_path


def run(project: Path, *words: str) -> tuple[int, str, dict]:
    """``make mutants`` on ``project`` in a process of its own, as it forks; torch is not needed here."""
    code = (
        "import sys; from pathlib import Path; from scripts import mutants; mutants.HEAVY = ['pytest']; "
        "sys.exit(mutants.main(sys.argv[2:], Path(sys.argv[1])))"
    )
    out = project / "build" / "mutants"
    done = subprocess.run(
        [sys.executable, "-c", code, str(project), "--out", str(out), "--limit", "4", *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=600,
    )
    result = out / "mutants.json"
    return (
        done.returncode,
        done.stdout + done.stderr,
        json.loads(result.read_text()) if result.exists() else {},
    )


@pytest.mark.slow
def test_killed_survived_timeout_and_equivalent(project):
    status, shown, result = run(project)
    outcomes = {(row["was"], row["now"]): row["outcome"] for row in result["mutants"]}
    assert outcomes["return value + value", "return value - value"] == "killed"
    assert outcomes["while value != 3:", "while value != 4:"] == "killed"
    assert outcomes["value += 1", "value += 0"] == "timeout"
    assert outcomes["return not flag", "return (flag)"] == "survived"
    # a slow test that is named goes on judging, those of a file that is named whole do not
    assert outcomes["return 3 * value", "return 4 * value"] == "killed"
    assert outcomes["return -value", "return (value)"] == "survived"
    assert all("10**6" not in was and "1 + 1" not in was and "int = 1" not in was for was, _ in outcomes), (
        "texts, refusals, defaults"
    )
    assert all(row["compared"] == (row["outcome"] == "killed") for row in result["mutants"])
    assert [row["outcome"] for row in result["mutants"] if row["kind"] == "named"] == ["killed"]
    assert (
        status == 1
        and result["counts"]["survived"] == 2
        and "+ return (flag)" in shown
        and "no reason given" in shown
    )
    verdicts = {path.name: path.stat().st_mtime_ns for path in (project / "build/mutants/verdicts").iterdir()}
    survivors = "".join(
        f'[[survivor]]\nfile = "{file}"\nwas = "{was}"\nnow = "{now}"\nequivalent = true\nreason = "never run"\n'
        for file, was, now in (
            ("golden/unit.py", "return not flag", "return (flag)"),
            ("golden/unseen.py", "return -value", "return (value)"),
        )
    )
    (project / "tests/mutants.toml").write_text(SCOPE + survivors)
    status, shown, again = run(project)
    assert (
        status == 0 and again["score"] == 1.0 and again["counts"]["equivalent"] == 2 and "never run" in shown
    )
    assert {
        path.name: path.stat().st_mtime_ns for path in (project / "build/mutants/verdicts").iterdir()
    } == verdicts, "judged twice"
    assert (project / "golden/unit.py").read_text() == CODE


def test_every_test_that_judges_is_there():
    """By file and function; a parameter set that is gone ends the run with a sentence."""
    scope = Scope.load(ROOT)
    for test in {test for tests in (*scope.tests.values(), *scope.named.values()) for test in tests}:
        file, _, name = test.partition("::")
        assert (ROOT / file).is_file(), test
        assert not name or f"def {name.partition('[')[0]}(" in (ROOT / file).read_text(), test


def test_every_mutant_of_the_project_is_one_fault_and_kinds_and_files_are_even():
    scope = Scope.load(ROOT)
    texts = {file: (ROOT / file).read_text() for file in scope.tests}
    chosen = choose(texts, 120, 1, scope.skip)
    assert len({(mutant.file, mutant.begin, mutant.old, mutant.new) for mutant in chosen}) == 120
    assert {mutant.file for mutant in chosen} == set(texts)
    assert min(sum(mutant.kind == kind for mutant in chosen) for kind in KINDS) >= 7


def test_every_named_fault_is_one_of_the_code_there_is():
    for mutant in Scope.load(ROOT).named:
        assert is_fault(mutant, (ROOT / mutant.file).read_text()), mutant.name


def test_every_reason_is_that_of_a_mutant_there_is():
    scope = Scope.load(ROOT)
    for (file, was, now), entry in scope.reasons.items():
        text = (ROOT / file).read_text()
        assert any(mutant.lines(text) == (was, now) for mutant in mutants(file, text, scope.skip)), (
            file,
            was,
        )
        assert entry["reason"]
