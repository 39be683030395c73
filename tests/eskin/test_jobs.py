"""eskin/jobs.py: results in order and by content, on processes and on a cluster; interrupts, errors,
dead workers."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import BrokenExecutor
from pathlib import Path

import pytest

from eskin.golden.core import InputError
from eskin.jobs import Jobs, beside
from eskin.memo import Memo
from scripts import ROOT
from tests.support.table import each_row, refused


# What workers do: top level, so that another process finds it.
def times(shared, piece):
    if piece == "bad":
        raise InputError("piece bad: cannot be done")
    if piece == "die":
        os._exit(1)
    return {"product": shared * piece}


def threads(_, __):
    import torch

    return torch.get_num_threads()


def this_code():
    return "the code of this test"


def own_code():
    return str(os.getpid())


PIECES = {f"k{n}": n for n in range(6)}
WANTED = {key: {"product": 7 * n} for key, n in PIECES.items()}


# ---------------------------------------------------------------------- results
@each_row("workers", [1, 2])
def test_results_come_in_order_and_progress_is_told(workers):
    moves = []
    jobs = Jobs(workers=workers, progress=lambda *move: moves.append(move))
    results = jobs.results(times, PIECES, 7, what="sevens")
    assert results == WANTED and list(results) == list(PIECES)
    assert moves == [("sevens", n, 6) for n in range(7)]


def test_what_is_kept_is_not_done_again(tmp_path):
    keep, done = Memo(tmp_path / "kept"), []

    def noted(shared, piece):
        done.append(piece)
        return times(shared, piece)

    jobs = Jobs(workers=1)
    with refused("piece bad"):
        jobs.results(noted, {"a": 1, "b": "bad", "c": 3}, 7, keep=keep)
    assert keep.read("a") == {"product": 7} and keep.read("c") is None
    (tmp_path / "kept" / "a.json").write_text('{"product": ')  # half of it, as after a full disk
    for pieces in ({"a": 1, "c": 3}, {"c": 3, "a": 1}):
        results = jobs.results(noted, pieces, 7, keep=keep)
        assert [*results.items()] == [(key, {"product": 7 * n}) for key, n in pieces.items()]
    assert done == [1, "bad", 1, 3]
    keep.forget(["a", "nothing"])
    assert keep.read("a") is None and keep.remembered("a", lambda: 5) == 5 == keep.remembered("a", lambda: 6)


def test_a_worker_that_dies_is_told_in_a_sentence():
    with refused("a worker process ended"):
        Jobs(workers=2).results(times, {"a": "die", "b": 1}, 7)


def test_a_call_beside_gives_its_result_or_its_error():
    with beside(times, 7, 6) as result:
        assert result() == {"product": 42}
    for piece, error in (("bad", InputError), ("die", BrokenExecutor)):
        with beside(times, 7, piece) as result, pytest.raises(error):
            result()


@pytest.mark.slow
def test_a_worker_computes_in_one_thread():
    before = os.environ.get("OMP_NUM_THREADS")
    assert set(Jobs(workers=2).results(threads, {"a": 0, "b": 1}).values()) == {1}
    assert os.environ.get("OMP_NUM_THREADS") == before


# ---------------------------------------------------------------------- interrupts
SLOW = """
import signal, subprocess, sys
from pathlib import Path
from eskin.jobs import Jobs
from eskin.memo import Memo

def work(shared, piece):
    if piece:
        child = subprocess.Popen(["sleep", "1000"])
        Path(f"begun{piece}").touch()
        child.wait()
    return piece

signal.signal(signal.SIGINT, signal.default_int_handler)  # what a shell starts in the background ignores it
try:
    Jobs(workers=2).results(work, {"first": 0, "a": 1, "b": 2, "c": 3}, keep=Memo(Path("kept")))
except KeyboardInterrupt:
    sys.exit(130)
"""


def running(mark: str) -> list[int]:
    """Processes that were started with this word in their environment, and their children."""
    found = []
    for path in Path("/proc").glob("[0-9]*/environ"):
        with contextlib.suppress(OSError):
            found += [int(path.parent.name)] if mark.encode() in path.read_bytes() else []
    return found


def wait_until(done) -> None:
    limit = time.monotonic() + 600
    while not done():
        assert time.monotonic() < limit
        time.sleep(0.05)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_an_interrupt_or_a_sudden_end_leaves_no_process_and_keeps_what_is_done(tmp_path, number):
    output, mark, first = tmp_path / "output", f"JOBS_TEST={tmp_path}", tmp_path / "kept/first.json"
    (tmp_path / "job.py").write_text(SLOW)
    with output.open("w") as out:
        env = os.environ | {"PYTHONPATH": str(ROOT), "JOBS_TEST": str(tmp_path)}
        process = subprocess.Popen(
            [sys.executable, "job.py"], cwd=tmp_path, env=env, stdout=out, stderr=out, start_new_session=True
        )
    try:
        files = [first, tmp_path / "begun1", tmp_path / "begun2"]
        wait_until(lambda: process.poll() is not None or all(file.exists() for file in files))
        # an interrupt as a terminal sends it: to the whole group
        (os.killpg if number == signal.SIGINT else os.kill)(process.pid, number)
        assert process.wait(timeout=600) == (130 if number == signal.SIGINT else -signal.SIGKILL)
        wait_until(lambda: not running(mark))
    finally:
        for pid in running(mark):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
    # after a sudden end joblib says what it cleans up
    assert number == signal.SIGKILL or output.read_text() == ""
    assert list(first.parent.iterdir()) == [first]


# ---------------------------------------------------------------------- a cluster
@pytest.fixture(scope="module")
def scheduler():
    """Address of a scheduler with a worker process, the first end of which counts."""
    distributed, dask = pytest.importorskip("distributed"), pytest.importorskip("dask")
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster,
    ):
        yield cluster.scheduler_address


@pytest.mark.filterwarnings("default")  # of dask's own
def test_a_cluster_gives_what_processes_give(scheduler, tmp_path):
    moves = []
    jobs = Jobs(dask=scheduler, progress=lambda *move: moves.append(move), version=this_code)
    assert jobs.results(times, PIECES, 7, keep=Memo(tmp_path)) == WANTED
    assert moves[-1] == ("done", 6, 6) and len(list(tmp_path.iterdir())) == 6
    with refused("piece bad"):
        jobs.results(times, {"a": "bad", "b": 1}, 7)
    with refused("has code or libraries that differ from this machine"):
        Jobs(dask=scheduler, version=own_code).results(times, PIECES, 7)
    with refused("a worker process ended"):
        jobs.results(times, {"a": "die", "b": 1}, 7)
