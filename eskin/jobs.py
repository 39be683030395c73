"""Long work in many pieces: on all cores of this machine or on a dask cluster, finished results kept by their
content.

A *piece* is a value that a function of a module's top level turns into a result that JSON can hold:
``function(shared, piece)``. Data that all pieces need, such as recordings, is ``shared`` and sent to every
worker once. The key of a piece is a hash of everything that its result depends on (``content_key``). With a
folder for results, interrupted work resumes, and repeated work is not computed again.
"""

import contextlib
import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any

from eskin.golden.core import InputError, Progress, Record
from eskin.memo import Memo

Function = Callable[[Any, Any], Any]
"""(shared, piece) -> result; a worker finds it by its module and name."""

Submit = Callable[[Function, Any], Future[Any]]
"""Begins a function and a piece. What is not finished is given up when the block that has it is left by an
exception."""

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Environment of a worker: there are as many workers as cores."""


@dataclass(frozen=True, kw_only=True)
class Jobs:
    """Executor of pieces of work.

    Parameters
    ----------
    workers:
        Processes of this machine; None: one a core; 1: this process itself.
    dask:
        Address of a dask scheduler (``tcp://HOST:PORT``) whose workers are used in place of processes. They
        and the scheduler have this project installed.
    progress:
        Told how many pieces are done.
    version:
        A function of a module's top level that names the code. Workers of a cluster must run the same code as
        this machine: results of other code would be stored under the key of this code.
    """

    workers: int | None = None
    dask: str | None = None
    progress: Progress | None = None
    version: Callable[[], str] | None = None

    def results(
        self,
        function: Function,
        pieces: Record,
        shared: Any = None,
        *,
        keep: Memo | None = None,
        what: str = "done",
    ) -> Record:
        """The result of every piece, by key and in the order of ``pieces``.

        An interrupt, or the error of a piece, ends the workers at once and is raised; what was finished
        before is kept.

        Parameters
        ----------
        function, pieces, shared:
            See the head of the module; ``pieces`` is key -> piece. Workers begin with the first.
        keep:
            Where finished results are found and kept; None: nowhere.
        what:
            The name of the work in progress reports.

        Raises
        ------
        InputError
            The scheduler does not answer, its workers have other code, or a worker died.
        """
        results = {key: keep.read(key) if keep else None for key in pieces}
        waiting = {key: piece for key, piece in pieces.items() if results[key] is None}
        if not waiting:
            return results
        if self.progress:
            self.progress(what, 0, len(waiting))
        workers = min(self.workers or os.cpu_count() or 1, len(waiting))
        place: contextlib.AbstractContextManager[Submit | None] = contextlib.nullcontext()
        if self.dask is not None:
            place = _cluster(self.dask, shared, self.version)
        elif workers > 1:
            place = _processes(workers, shared)
        with place as submit:
            arriving = ((key, function(shared, piece)) for key, piece in waiting.items())
            if submit:
                with _quiet_children():
                    futures = {submit(function, piece): key for key, piece in waiting.items()}
                arriving = ((futures[future], future.result()) for future in as_completed(futures))
            for finished, (key, result) in enumerate(arriving, 1):
                if keep:
                    keep.write(key, result)
                results[key] = result
                if self.progress:
                    self.progress(what, finished, len(waiting))
        return results


# ---------------------------------------------------------------------- processes of this machine
_shared: Any = None


def _begin_worker(shared: bytes) -> None:
    """Make this process a worker: a process group of its own that ends with its parent.

    Ctrl-C at a terminal then reaches the parent alone. The parent ends its workers, each with all that it has
    started.
    """
    global _shared
    with contextlib.suppress(PermissionError):  # it leads its session already
        os.setpgid(0, 0)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_end_with_parent, daemon=True).start()
    # pickled once by the parent: the pool would pickle it again for every worker
    _shared = pickle.loads(shared)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os.killpg(0, signal.SIGKILL)


def _in_worker(function: Function, piece: Any) -> Any:
    return function(_shared, piece)


@contextlib.contextmanager
def _quiet_children() -> Iterator[None]:
    """Processes started in the block compute in one thread and do not see an interrupt until they unblock
    it."""
    # numpy reads these variables when it is imported, so they must stand before a worker starts
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    masked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    os.environ.update(ONE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
        signal.pthread_sigmask(signal.SIG_SETMASK, masked)  # an interrupt held back is raised here


@contextlib.contextmanager
def _processes(workers: int, shared: Any) -> Iterator[Submit]:
    not_ours = set(multiprocessing.active_children())
    # a fork would copy torch's locks in whatever state its threads hold them
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context, _begin_worker, (pickle.dumps(shared),)) as pool:
        try:
            yield lambda function, piece: pool.submit(_in_worker, function, piece)
        except BaseException as error:
            for process in set(multiprocessing.active_children()) - not_ours:
                with contextlib.suppress(ProcessLookupError):  # not a group yet, or gone already
                    os.killpg(process.pid or 0, signal.SIGTERM)
                process.terminate()
            # Wait for the pool's thread: it closes a pipe that Python writes to on its way out.
            pool.shutdown(cancel_futures=True)
            if isinstance(error, BrokenProcessPool):
                raise InputError(
                    "a worker process ended, perhaps out of memory; finished work is kept, so run the same command again"
                ) from None
            raise


# ---------------------------------------------------------------------- a cluster
@contextlib.contextmanager
def _cluster(address: str, shared: Any, version: Callable[[], str] | None) -> Iterator[Submit]:
    from distributed import Client

    try:
        client = Client(address, timeout="10s")
    except (OSError, ValueError) as error:
        raise InputError(
            f"--dask {address}: no scheduler answers ({error}); start 'dask scheduler', give its "
            "tcp://HOST:PORT"
        ) from None
    with client:
        if not client.scheduler_info()["workers"]:
            raise InputError(
                f"--dask {address}: the scheduler has no worker; start some with 'dask worker {address}'"
            )
        versions: Record = {}
        try:
            if version is not None:
                versions = {"the scheduler": client.run_on_scheduler(version), **client.run(version)}
        except ImportError as error:
            raise InputError(
                f"--dask {address}: scheduler or workers lack this project ({error}); install it there"
            ) from None
        foreign = sorted(where for where, code in versions.items() if version and code != version())
        if foreign:
            raise InputError(
                f"--dask {address}: {foreign[-1]} has code or libraries that differ from this machine; install the same there"
            )
        everywhere = client.scatter(shared, broadcast=True, hash=False)
        # changed code must not be answered from the cluster's memory
        with client.get_executor(pure=False) as executor:
            try:
                yield lambda function, piece: executor.submit(function, everywhere, piece)
            except BaseException:
                executor.shutdown(wait=False)  # cancels what is not finished
                raise
