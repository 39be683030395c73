"""Fixtures for all tests: the real recordings (where they are), torch's threads, recordings made on the
spot, the installed command called in this process."""

import os
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, settings

from eskin.golden.data import Recordings
from eskin.rtl.fpga.tools import run_tool

# Before torch is loaded: its operations here are small, and a second thread on a busy machine costs a factor
# of ten.
os.environ.setdefault("OMP_NUM_THREADS", "1")
# Before a test imports onnxruntime, as eskin.exchange sets it.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

# Where no profile is named (--hypothesis-profile): tests/support/strategies.py says what they are.
# On a busy machine an example may take long.
PATIENT = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("quick", **PATIENT)
settings.register_profile("long", print_blob=True, **PATIENT)
# A failing example is enough: making it smaller would take longer than the test.
settings.register_profile("mutants", phases=(Phase.explicit, Phase.generate), **PATIENT)
settings.load_profile("quick")

pytest_plugins = ["tests.support.covered"]
SHARED_DATA = Path(__file__).resolve().parent.parent.parent / "shared" / "data"
NO_RECORDINGS = "no real recordings beside the checkout"
NAMED_SKIPS = (
    NO_RECORDINGS,
    "no Liberty files of SG13G2 beside the checkout",
    "ziglang (extra soc) is not installed",
)
"""Why a test may be skipped where CI is set: what a fresh checkout cannot have. For any other reason the run
fails."""


def pytest_sessionstart(session: pytest.Session) -> None:
    """Let Yosys compile itself, if it must, before any test's time runs (once, not in every process of
    xdist)."""
    if not hasattr(session.config, "workerinput"):
        run_tool("yosys", ["-V"], Path(__file__).parent)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Skip the tests that need the real recordings where the checkout has none beside it."""
    for item in items:
        if not SHARED_DATA.is_dir() and "shared_data" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.skip(reason=NO_RECORDINGS))


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Where CI is set, fail for a test that was skipped for a reason that is not named."""
    terminal = session.config.pluginmanager.get_plugin("terminalreporter")
    if not os.environ.get("CI") or terminal is None:
        return
    reasons = [report.longrepr[2].removeprefix("Skipped: ") for report in terminal.stats.get("skipped", [])]
    for reason in sorted(set(reasons)):
        allowed = reason in NAMED_SKIPS
        terminal.write_line(
            f"skipped, {'as named' if allowed else 'NOT NAMED in tests/conftest.py'}: "
            f"{reasons.count(reason)} for '{reason}'"
        )
        if not allowed:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the real recordings: ``shared_data / "pvdf_indent" / "recordings.npz"``."""
    return SHARED_DATA


@pytest.fixture
def call(monkeypatch, capsys) -> Callable[..., tuple[int, str, str]]:
    """``call("inspect", "data.npz")`` -> (status, standard output, standard error), as the installed command
    would end."""
    from eskin.cli import main as command_line

    monkeypatch.setenv("COLUMNS", "200")

    def run(*words: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["eskin", *map(str, words)])
        status = 0
        try:
            command_line.main()
        except SystemExit as end:
            status = int(end.code or 0)
        return status, *capsys.readouterr()

    return run


@pytest.fixture
def make_recordings() -> Callable[..., Recordings]:
    """A small set of noise recordings: ``make_recordings(lengths=[...], taxels=4, labels=[...], seed=1,
    ...)``."""

    def make(lengths=(40, 50, 60, 70), taxels=4, labels=None, classes=2, seed=1, **fields) -> Recordings:
        rng = np.random.default_rng(seed)
        return Recordings(
            samples=rng.integers(1000, 1010, (sum(lengths), taxels)).astype(np.int32),
            offsets=np.cumsum([0, *lengths]),
            labels=np.arange(len(lengths)) % classes if labels is None else np.array(labels),
            class_names=tuple(f"class{i}" for i in range(classes)),
            **{"sample_rate_hz": 500.0, "source": "made", **fields},
        )

    return make
