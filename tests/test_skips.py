"""tests/conftest.py: where CI is set, a test that is skipped for a reason of its own fails the run; a named
one is counted."""

import subprocess
import sys

import pytest

from tests.conftest import NAMED_SKIPS


@pytest.mark.parametrize(
    ("reason", "ci", "status", "said"),
    [
        (NAMED_SKIPS[0], "1", 0, "skipped, as named: 2 for"),
        ("no browser", "1", 1, "skipped, NOT NAMED in tests/conftest.py: 2 for 'no browser'"),
        ("no browser", "", 0, "2 skipped"),
    ],
)
def test_a_skip_for_a_reason_of_its_own_fails_the_run(tmp_path, monkeypatch, reason, ci, status, said):
    test = f"import pytest\n@pytest.mark.parametrize('k', [1, 2])\ndef test_it(k):\n    pytest.skip({reason!r})\ndef test_other():\n    pass\n"
    (tmp_path / "test_it.py").write_text(test)
    monkeypatch.setenv("CI", ci)
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-c",
        "/dev/null",
        "--rootdir",
        str(tmp_path),
        "-p",
        "tests.conftest",
        str(tmp_path),
    ]
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == status and said in result.stdout, result.stdout
