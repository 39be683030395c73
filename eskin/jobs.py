"""Long work in many pieces: on all cores of this machine or on a dask cluster, finished results kept by their
content.

A *piece* is a value that a function of a module's top level turns into a result that JSON can hold:
``function(shared, piece)``. Data that all pieces need, such as recordings, is ``shared``. The key of a piece is a hash
of everything that its result depends on (``content_key``). With a folder for results, interrupted work resumes, and
repeated work is not computed again.
"""

import contextlib
import os
import pickle
import signal
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError
from dataclasses import dataclass
from functools import partial
from typing import Any

from joblib import Parallel, delayed, parallel_config

from eskin.golden.core import InputError, Progress, Record
from eskin.memo import Memo

Function = Callable[[Any, Any], Any]
"""(shared, piece) -> result; a worker finds it by its module and name."""

Results = Generator[tuple[str, Any], None, None]
"""Key and result of each piece, as they arrive; unfinished pieces are given up when it is closed."""

DIED = "a worker process ended, perhaps out of memory; finished work is kept, so run the same command again"


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
        if self.dask is not None:
            results_as_done = _on_cluster(self.dask, self.version, function, shared, waiting)
        else:
            results_as_done = _on_cores(workers, function, shared, waiting)
        with contextlib.closing(results_as_done) as done:
            for finished, (key, result) in enumerate(done, 1):
                if keep:
                    keep.write(key, result)
                results[key] = result
                if self.progress:
                    self.progress(what, finished, len(waiting))
        return results


def _keyed(function: Function, shared: Any, key: str, piece: Any) -> tuple[str, Any]:
    return key, function(shared, piece)


# ---------------------------------------------------------------------- processes of this machine
def _begin_worker(parent: int) -> None:
    """Make this process a worker: a process group that ends with its parent, with all that it has started.

    Ctrl-C at a terminal then reaches the parent alone, which ends its workers.
    """
    os.setpgid(0, 0)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(1)
    os.killpg(0, signal.SIGKILL)


def _begun(workers: int, tasks: Iterable[Any]) -> Any:
    """Results of ``tasks``, which have begun, as they arrive."""
    # arrays travel whole: a worker that maps them as files could not write into its copy
    place: Record = dict(
        inner_max_num_threads=1, max_nbytes=None, initializer=_begin_worker, initargs=(os.getpid(),)
    )
    # No piece waits in a worker: joblib ends first what a worker has started, and the worker would begin the next piece.
    with parallel_config("loky", n_jobs=workers, **place):
        return Parallel(return_as="generator_unordered", batch_size=1, pre_dispatch="n_jobs")(tasks)


def _on_cores(workers: int, function: Function, shared: Any, pieces: Record) -> Results:
    try:
        yield from _begun(
            workers, (delayed(_keyed)(function, shared, key, piece) for key, piece in pieces.items())
        )
    except BrokenExecutor:
        raise InputError(DIED) from None


@contextlib.contextmanager
def beside(function: Callable[..., Any], *arguments: Any) -> Iterator[Callable[[], Any]]:
    """Begin a call in another process, whose linear algebra has one thread. The context gives a function that waits for the
    result. The end of the context ends a call that still runs.

    function, arguments: can be pickled; what changes in them later is not seen there.

    Raises
    ------
    BrokenExecutor
        When waiting: the process died. Errors of the call are raised there, too.
    """
    with tempfile.NamedTemporaryFile() as file:  # a pipe would hold all of it once more
        pickle.dump(partial(function, *arguments), file)
        file.flush()
        begun = _begun(2, [delayed(_call)(file.name)])  # joblib would stay in this process with one worker
        try:
            yield lambda: next(begun)
        finally:
            with warnings.catch_warnings(action="ignore"):  # of a call that is ended
                begun.close()


def _call(path: str) -> Any:
    with open(path, "rb") as file:
        return pickle.load(file)()


# ---------------------------------------------------------------------- a cluster
def _on_cluster(
    address: str, version: Callable[[], str] | None, function: Function, shared: Any, pieces: Record
) -> Results:
    from distributed import Client, KilledWorker, as_completed

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
        # joblib's own back end of dask waits for ever when a worker dies
        futures = [client.submit(_keyed, function, everywhere, *keyed) for keyed in pieces.items()]
        try:
            for future in as_completed(futures):
                yield future.result()
        except (KilledWorker, CancelledError):
            raise InputError(DIED) from None
