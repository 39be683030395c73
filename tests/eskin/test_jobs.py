"""eskin/jobs.py: results in order and by content, on processes and on a cluster; interrupts, errors,
dead workers."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from eskin.golden.core import InputError
from eskin.jobs import Jobs
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


@pytest.mark.slow
def test_a_worker_computes_in_one_thread():
    before = os.environ.get("OMP_NUM_THREADS")
    assert set(Jobs(workers=2).results(threads, {"a": 0, "b": 1}).values()) == {1}
    assert os.environ.get("OMP_NUM_THREADS") == before


# ---------------------------------------------------------------------- interrupts
SLOW = """
import os, signal, subprocess, sys, time
from pathlib import Path
from eskin.jobs import Jobs
from eskin.memo import Memo

def work(shared, piece):
    if piece:
        child = subprocess.Popen(["sleep", "1000"])
        Path(f"{piece}.new").write_text(f"{os.getpid()} {child.pid}")
        os.rename(f"{piece}.new", f"{piece}.pids")
        child.wait()
    return piece

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # what a shell starts in the background ignores it
    try:
        Jobs(workers=2).results(work, {"first": 0, "a": 1, "b": 2, "c": 3}, keep=Memo(Path("kept")))
    except KeyboardInterrupt:
        sys.exit(130)
"""


def alive(pid: int) -> bool:
    """Whether a process runs; one that nobody has waited for does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def wait_until(what, process, output: Path, seconds: float = 600) -> None:
    limit = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < limit and process.poll() is None, output.read_text()
        time.sleep(0.05)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_an_interrupt_or_a_sudden_end_leaves_no_process_and_keeps_what_is_done(tmp_path, number):
    (tmp_path / "job.py").write_text(SLOW)
    output = tmp_path / "output"
    with output.open("w") as out:
        process = subprocess.Popen(
            [sys.executable, "job.py"],
            cwd=tmp_path,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
            stdout=out,
            stderr=out,
            start_new_session=True,
        )
    files = [tmp_path / "1.pids", tmp_path / "2.pids"]
    pids: list[int] = []
    try:
        wait_until(
            lambda: all(file.exists() for file in files) and (tmp_path / "kept" / "first.json").exists(),
            process,
            output,
        )
        pids = [int(word) for file in files for word in file.read_text().split()]
        assert len(pids) == 4 and all(map(alive, pids))
        os.killpg(process.pid, number)  # as a terminal does: to the whole group
        assert process.wait(timeout=600) == (130 if number == signal.SIGINT else -signal.SIGKILL)
        limit = time.monotonic() + 600
        while any(map(alive, pids)) and time.monotonic() < limit:
            time.sleep(0.05)
        assert not any(map(alive, pids)), "workers and what they started end too"
    finally:
        for pid in [process.pid, *pids]:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        process.wait()
    assert output.read_text() == "" and [path.name for path in (tmp_path / "kept").iterdir()] == [
        "first.json"
    ]


# ---------------------------------------------------------------------- a cluster
@pytest.fixture(scope="module")
def scheduler():
    """Address of a scheduler with two worker processes."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
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
