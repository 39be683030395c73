"""One command line in a forked child whose file accesses are watched, and what became of it.

It passes when it ends with a status of the command line's own, or reaches work that is known to be long
(training, a tool in a separate process): that far everything given was read and checked.
"""

import contextlib
import hashlib
import itertools
import multiprocessing
import os
import re
import resource
import signal
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import torch
from joblib import Parallel
from matplotlib.figure import Figure

from eskin.choose.front_ends import FrontEndSearch
from eskin.cli import main as command_line
from eskin.study.stability import core as stability

LIMIT_S, PROCESSOR_S = 900.0, 40
"""Time without an answer, which is long because an input gets little of a busy processor, and processor time of one
input; the longest takes a quarter of it."""
JUDGED = 6
"""Front ends that are judged; the rest of a choice is long work."""
MEMORY_BYTES = 3 << 29
"""Address space that an input may take on top of the warm process."""
ENDS = {0: "done", 1: "check not held", 2: "refused", "long work": "long work"}
"""How an input may end; anything else is a defect."""
WRITTEN = (".json", ".npz", ".png", ".html", "")
"""Endings of what a verb writes to a path that a command line names; an input of such a name may be replaced."""
KEPT = ("keep", "foreign/keep")
"""Files in ``out`` that no refused command may touch."""
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
CHANGING = {
    "os.remove": 1,
    "os.rename": 2,
    "os.mkdir": 1,
    "os.rmdir": 1,
    "os.link": 2,
    "os.symlink": 2,
    "os.truncate": 1,
    "os.chmod": 1,
}
"""Audit events that change the file system, and how many of their arguments are paths."""
PROCESSES = (
    "subprocess.Popen",
    "os.system",
    "os.posix_spawn",
    "os.fork",
    "os.exec",
    "socket.connect",
    "socket.bind",
)


class Verdict(NamedTuple):
    """One of `ENDS` or a defect, and what there is to say of it."""

    outcome: str
    detail: str = ""


# ---------------------------------------------------------------------- in the child
def _named(case: Path, words: list[str]) -> list[Path]:
    """Places that a command line names for what it writes."""
    pairs = itertools.pairwise(words)
    named = [case / "out" / place for option, place in pairs if option in ("--out", "--json")]
    return [place.resolve() for place in named if place.suffix in WRITTEN]


def _watch(case: Path, words: list[str], draws: bool, notes: list[str], stop: Callable[..., Any]) -> None:
    """Note files written outside ``out``, ``tmp`` and what ``words`` name, and objects unpickled; ``stop`` at long work.

    Long work: a gradient, a choice among many front ends, another process, a server, a mode of the stability suite, and unless ``draws`` a
    drawing.
    """
    allowed = (*(f"{os.path.realpath(case / name)}/" for name in ("out", "tmp")), "/dev/")
    named = _named(case, words)
    allowed += tuple(f"{each}/" for each in named) + tuple(f"{each.parent}/.{each.name}." for each in named)
    above = {str(folder) for each in named for folder in each.parents}

    def written(path: Any) -> None:
        if isinstance(path, (str, bytes, os.PathLike)):
            # a rename or removal acts on a link itself, so only its folder is followed
            name = os.fsdecode(path)
            real = os.path.join(os.path.realpath(os.path.dirname(name) or "."), os.path.basename(name))
            if not f"{real}/".startswith(allowed) and real not in above:
                notes.append(f"wrote outside: {real}")

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open" and isinstance(arguments[2], int) and arguments[2] & WRITING:
            written(arguments[0])
        elif event in CHANGING:
            for path in arguments[: CHANGING[event]]:
                written(path)
        elif event in PROCESSES or (event == "import" and arguments[0] == "distributed"):
            stop()
        elif event == "pickle.find_class":
            notes.append(f"unpickled: {arguments[0]}.{arguments[1]}")

    def judged(
        judge: FrontEndSearch, config: Any, judge_it: Callable[..., Any] = FrontEndSearch.judge
    ) -> Any:
        return stop() if len(judge.tried) > JUDGED else judge_it(judge, config)

    FrontEndSearch.judge = judged  # type: ignore[method-assign]
    torch.Tensor.backward = torch.autograd.grad = Parallel.__call__ = stability.judge = stop  # type: ignore
    if not draws:
        Figure.__init__ = stop  # type: ignore
    sys.addaudithook(hook)


def _child(case: Path, words: list[str], draws: bool, answer: Connection) -> None:
    """Run the command line; send its status, or the traceback it ended in, and the notes."""
    handle = os.open(case / "said.txt", os.O_WRONLY | os.O_CREAT, 0o644)
    for number in (1, 2):
        os.dup2(handle, number)
    sys.stdout, sys.stderr = open(1, "w"), open(2, "w", errors="backslashreplace")  # noqa: SIM115
    warnings.simplefilter("ignore")
    os.environ |= {"HOME": str(case / "tmp"), "TMPDIR": str(case / "tmp"), "COLUMNS": "200"}
    # torch settles it when it is imported, for good
    os.environ["TORCHINDUCTOR_CACHE_DIR"] = str(case / "tmp" / "torch")
    tempfile.tempdir = None
    sys.dont_write_bytecode = True  # a verb's modules are compiled when it first runs, beside their source
    os.chdir(case / "out")
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_CPU, (PROCESSOR_S, PROCESSOR_S))
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY_BYTES, used + MEMORY_BYTES))
    notes: list[str] = []

    def finish(status: Any, failure: str = "") -> NoReturn:
        sys.stdout.flush()
        sys.stderr.flush()
        answer.send((status, list(notes), failure))
        os._exit(0)

    _watch(case, words, draws, notes, lambda *_, **__: finish("long work"))
    sys.argv = ["eskin", *words]
    try:
        command_line.main()
    except SystemExit as end:
        finish(end.code)
    except BaseException as error:
        finish("too much memory" if isinstance(error, MemoryError) else "traceback", traceback.format_exc())
    finish(0)


# ---------------------------------------------------------------------- in the parent
def watched(case: Path, words: list[str], draws: bool = False) -> Verdict:
    """The verdict on a command line in ``case`` (tests/support/fuzz_inputs.py: make_case)."""
    before = _tree(case / "in")
    answer, sender = multiprocessing.Pipe(duplex=False)
    child = multiprocessing.get_context("fork").Process(target=_child, args=(case, words, draws, sender))
    child.start()
    sender.close()
    late, reply = not answer.poll(LIMIT_S), None
    with contextlib.suppress(EOFError):
        reply = None if late else answer.recv()
    child.kill()
    child.join()
    output = (case / "said.txt").read_text(errors="replace")
    if reply is None:
        out_of_time = late or child.exitcode in (-signal.SIGXCPU, -signal.SIGKILL)
        if out_of_time and _goes_on(output):
            return _judged(case, words, before, "long work", output)
        return Verdict("hang" if out_of_time else "odd status", f"exit code {child.exitcode}\n{output}")
    status, notes, failure = reply
    if failure or notes:
        return Verdict(status, failure) if failure else Verdict(notes[0].partition(":")[0], "\n".join(notes))
    return _judged(case, words, before, status, output)


def _goes_on(output: str) -> bool:
    """Whether a job said of itself that it moves: a progress line with two counts or more."""
    counts: dict[str, set[str]] = {}
    for what, count in re.findall(r"([a-z][a-z ]*): (\d+) of \d+", output):
        counts.setdefault(what, set()).add(count)
    return any(len(values) > 1 for values in counts.values())


def _judged(case: Path, words: list[str], before: dict[str, str], status: Any, output: str) -> Verdict:
    """The verdict on an end without an exception."""
    after = _tree(case / "in")
    named = tuple(f"{place}/" for place in _named(case, words))
    own = {
        name
        for name in before.keys() | after.keys()
        if f"{(case / 'in' / name).resolve()}/".startswith(named)
    }
    strays = {entry.name for entry in case.iterdir()} - {"in", "out", "tmp", "said.txt"}
    left = [str(path.relative_to(case)) for path in (case / "tmp").rglob("*")]
    left += [str(path.relative_to(case)) for path in (case / "out").rglob(".*") if ".work" not in path.name]
    defects = {
        "input changed": sorted(
            name for name in (before.keys() | after.keys()) - own if before.get(name) != after.get(name)
        ),
        "wrote outside": sorted(strays),
        "odd status": [] if status in ENDS else [f"status {status}", output],
        "traceback": [output] if "Traceback (most recent call last)" in output else [],
        "no sentence": []
        if status != 2 or any(word in output for word in ("eskin: ", "Error", "Usage"))
        else [output],
        "written by a refused command": [
            name for name in KEPT if status == 2 and (case / "out" / name).read_bytes() != b"keep"
        ],
        "left behind": left if status == 2 else [],
    }
    bad = next((outcome for outcome, details in defects.items() if details), "")
    return Verdict(bad, "\n".join(defects[bad])) if bad else Verdict(ENDS[status], output)


def _tree(folder: Path) -> dict[str, str]:
    """Every entry below ``folder``: its kind, and of files the hash."""
    entries = {}
    for path in sorted(folder.rglob("*")):
        kind = (
            "link" if path.is_symlink() else "folder" if path.is_dir() else "" if path.is_file() else "other"
        )
        entries[str(path.relative_to(folder)).encode("utf-8", "replace").decode()] = (
            kind or hashlib.sha256(path.read_bytes()).hexdigest()
        )
    return entries
