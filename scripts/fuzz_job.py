"""``make fuzz``: thousands of damaged inputs and command lines, each in a process and a folder of its own, and what became of them.

Each input runs the command line as installed (`eskin.cli.main.main`) in a forked child whose file accesses are watched. It passes
when it
ends with a status of the command line's own, or reaches work that is known to be long (training, a tool in a process of its own): that far
everything given was read and checked. It fails as one of `DEFECTS`, and its folder is kept in ``failed/``.

An input is known by its group and number alone, so a failing one can be made again: ``python -m scripts.fuzz_job --only
"archives 17"``.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import functools
import gc
import hashlib
import io
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NoReturn

ROOT = Path(__file__).resolve().parents[1]
LIMIT_S, PROCESSOR_S = 150.0, 40
"""Wall and processor time of one input; the longest takes a quarter of it."""
MEMORY_BYTES = 1 << 30
"""Address space that an input may take on top of the warm process."""
DEFECTS = (
    "traceback",
    "hang",
    "no sentence",
    "odd status",
    "wrote outside",
    "left behind",
    "input changed",
    "unpickled",
    "too much memory",
    "not golden",
)
ENDS = {0: "done", 1: "check not held", 2: "refused"}
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
CHANGING = {"os.remove": 1, "os.rename": 2, "os.mkdir": 1, "os.rmdir": 1, "os.link": 2, "os.symlink": 2, "os.truncate": 1, "os.chmod": 1}
"""Audit events that change the file system, and how many of their arguments are paths."""


PROCESSES = ("subprocess.Popen", "os.system", "os.posix_spawn", "os.fork", "os.exec", "socket.connect")


class LongWork(BaseException):
    """Raised in place of work that takes long."""


# ---------------------------------------------------------------------- in the child
def _watch(case: Path, rng: random.Random) -> list[str]:
    """Note in the returned list what is written outside ``case/out`` and ``case/tmp``, and what is unpickled; stop at long work.

    Long work: a gradient, another process, a connection, a mode of the stability suite, and (seven times in eight) a drawing.
    """
    import torch
    from matplotlib.figure import Figure

    from eskin.golden.stability import suite as stability

    notes: list[str] = []
    allowed = (*(f"{os.path.realpath(case / name)}/" for name in ("out", "tmp")), "/dev/")

    def written(path: Any) -> None:
        if isinstance(path, (str, bytes, os.PathLike)):
            # a rename or removal acts on a link itself, so only its folder is followed
            name = os.fsdecode(path)
            real = os.path.join(os.path.realpath(os.path.dirname(name) or "."), os.path.basename(name))
            if not f"{real}/".startswith(allowed):
                notes.append(f"wrote outside: {real}")

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open" and isinstance(arguments[2], int) and arguments[2] & WRITING:
            written(arguments[0])
        elif event in CHANGING:
            for path in arguments[: CHANGING[event]]:
                written(path)
        elif event in PROCESSES or (event == "import" and arguments[0] == "distributed"):
            raise LongWork
        elif event == "pickle.find_class":
            notes.append(f"unpickled: {arguments[0]}.{arguments[1]}")

    def stop(*_: Any, **__: Any) -> NoReturn:
        raise LongWork

    torch.Tensor.backward = torch.autograd.grad = ProcessPoolExecutor.submit = stability.judge = stop
    if rng.random() < 0.875:
        Figure.__init__ = stop
    sys.addaudithook(hook)
    return notes


def _child(case: Path, corpus: Path, make: Any, seed: str) -> NoReturn:
    """Make the input, run it, write ``case/verdict.json``; never returns."""
    words: list[str] = []
    verdict: dict[str, Any] = {"outcome": "traceback", "detail": "the input could not be made"}
    handle = os.open(case / "said.txt", os.O_WRONLY | os.O_CREAT, 0o644)
    for number in (1, 2):
        os.dup2(handle, number)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    sys.stdout, sys.stderr = open(1, "w"), open(2, "w", errors="backslashreplace")  # noqa: SIM115
    try:
        rng = random.Random(seed)
        words = make(corpus, case, rng)
        before = _tree(case / "in")
        os.environ.update(HOME=str(case / "tmp"), TMPDIR=str(case / "tmp"), COLUMNS="200")
        os.environ["TORCHINDUCTOR_CACHE_DIR"] = str(case / "tmp" / "torch")  # torch settles it when it is imported, for good
        tempfile.tempdir = None
        os.chdir(case / "out")
        (case / "words.json").write_text(json.dumps(words))
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_CPU, (PROCESSOR_S, PROCESSOR_S))
        resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY_BYTES, used + MEMORY_BYTES))
        verdict = _call(case, words, rng)
        os.chdir(case)
        after = _tree(case / "in")
        if after != before:
            changed = sorted(name for name in before.keys() | after.keys() if before.get(name) != after.get(name))
            verdict = {"outcome": "input changed", "detail": ", ".join(changed)}
    except BaseException:
        verdict["detail"] += "\n" + traceback.format_exc()
    verdict["words"] = words
    (case / "verdict.json").write_text(json.dumps(verdict))
    os._exit(0)


def _call(case: Path, words: list[str], rng: random.Random) -> dict[str, Any]:
    """What one command line does in this process."""
    from eskin.cli import main as command_line

    notes = _watch(case, rng)
    sys.argv = ["eskin", *words]
    status: Any = 0
    try:
        command_line.main()
    except LongWork:
        status = "long work"
    except SystemExit as end:
        status = end.code
    except MemoryError:
        return {"outcome": "too much memory", "detail": traceback.format_exc()}
    except BaseException:
        return {"outcome": "traceback", "detail": traceback.format_exc()}
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
    said = (case / "said.txt").read_text(errors="replace")
    if notes:
        return {"outcome": notes[0].partition(":")[0], "detail": "\n".join(notes)}
    return _judged(status, said, case)


def _judged(status: Any, said: str, case: Path) -> dict[str, Any]:
    """The verdict on an end without an exception."""
    if status == "long work":
        return {"outcome": "long work", "detail": ""}
    if status not in ENDS:
        return {"outcome": "odd status", "detail": f"status {status}\n{said[-2000:]}"}
    if "Traceback (most recent call last)" in said:
        return {"outcome": "traceback", "detail": said[-4000:]}
    if status == 2 and not ("eskin: " in said or "Error" in said or "Usage" in said):
        return {"outcome": "no sentence", "detail": said[-2000:]}
    left = sorted(str(path.relative_to(case)) for path in (case / "tmp").rglob("*"))
    left += sorted(str(path.relative_to(case)) for path in (case / "out").rglob(".*") if path.name != "." and ".work" not in path.name)
    for keep in ("keep", "foreign/keep"):
        if (case / "out" / "foreign").exists() and (case / "out" / keep).read_text(errors="replace") != "keep" and status == 2:
            return {"outcome": "input changed", "detail": f"out/{keep}, which a refused command wrote over"}
    if left and status == 2:
        return {"outcome": "left behind", "detail": ", ".join(left)}
    return {"outcome": ENDS[status], "detail": said.strip().splitlines()[-1][:300] if said.strip() else ""}


def _tree(folder: Path) -> dict[str, str]:
    """Every entry below ``folder``: its kind, and of files the SHA-256."""
    entries = {}
    for path in sorted(folder.rglob("*")):
        kind = "link" if path.is_symlink() else "folder" if path.is_dir() else "file" if path.is_file() else "other"
        name = str(path.relative_to(folder)).encode("utf-8", "replace").decode()
        entries[name] = hashlib.sha256(path.read_bytes()).hexdigest() if kind == "file" else kind
    return entries


def _process(case: Path, corpus: Path, make: Any, seed: str) -> NoReturn:
    """As `_child`, the command line in a Python of its own; work that takes long is interrupted, as with Ctrl-C."""
    verdict: dict[str, Any] = {"outcome": "traceback", "detail": "the input could not be made"}
    words: list[str] = []
    import matplotlib

    signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background ignores it, and so would what it starts
    try:
        words = [word for word in make(corpus, case, random.Random(seed)) if "\0" not in word]
        before = _tree(case / "in")
        environment = {**os.environ, "HOME": str(case / "tmp"), "TMPDIR": str(case / "tmp"), "PYTHONPATH": str(ROOT), "COLUMNS": "200"}
        environment["XDG_CACHE_HOME"] = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")  # where Yosys is kept, compiled
        environment["MPLCONFIGDIR"] = matplotlib.get_configdir()  # its list of fonts is made once, not for every input
        with (
            (case / "said.txt").open("w") as said,
            subprocess.Popen(
                [sys.executable, "-m", "eskin.cli.main", *words],
                cwd=case / "out",
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=said,
                stderr=said,
                start_new_session=True,
            ) as process,
        ):
            status: Any = None
            interrupted = False
            try:
                for grace, number in ((12, signal.SIGINT), (20, None)):
                    try:
                        status = process.wait(grace)
                        break
                    except subprocess.TimeoutExpired:
                        if number:
                            interrupted = True
                            os.kill(process.pid, number)
            finally:
                with_children = process.pid
                for number in (signal.SIGTERM, signal.SIGKILL):
                    try:
                        os.killpg(with_children, number)
                    except ProcessLookupError:
                        break
                    time.sleep(0.05)
        if status is None:
            verdict = {"outcome": "hang", "detail": (case / "said.txt").read_text(errors="replace")[-2000:]}
        else:
            # While an interpreter that has said what it had to say shuts down, a signal ends it as one.
            late = interrupted and status == -signal.SIGINT
            verdict = _judged("long work" if status == 130 or late else status, (case / "said.txt").read_text(errors="replace"), case)
        if _tree(case / "in") != before:
            verdict = {"outcome": "input changed", "detail": ""}
    except BaseException:
        verdict["detail"] += "\n" + traceback.format_exc()
    verdict["words"] = words
    (case / "verdict.json").write_text(json.dumps(verdict))
    os._exit(0)


def _traffic(case: Path, corpus: Path, make: Any, seed: str) -> NoReturn:
    """Rubbish on the register bus and the frame stream, then a good host; or harmless traffic in the middle of a recording."""
    from eskin.cosim.runner import SimulationError

    verdict: dict[str, Any] = {"outcome": "traceback", "detail": "the input could not be made"}
    try:
        differing = make(seed, case / "out", corpus.parent / "simulators")
        verdict = {"outcome": "not golden" if differing else "done", "detail": "; ".join(differing)}
    except SimulationError as error:
        verdict = {"outcome": "hang", "detail": str(error)}
    except BaseException:
        verdict["detail"] += "\n" + traceback.format_exc()
    (case / "verdict.json").write_text(json.dumps({**verdict, "words": []}))
    os._exit(0)


# ---------------------------------------------------------------------- the job
class Job:
    """One run of the fuzzer over ``out``: what is done stands in ``done.jsonl`` and is not done again.

    Parameters
    ----------
    out:
        Folder of results.
    seed:
        Of all inputs.
    jobs:
        Inputs at a time.
    """

    def __init__(self, out: Path, seed: int, jobs: int) -> None:
        from scripts.fuzz_inputs import make_corpus

        self.out, self.seed, self.jobs = out.resolve(), seed, jobs
        self.out.mkdir(parents=True, exist_ok=True)
        self.corpus = Path(tempfile.mkdtemp(prefix="corpus.", dir=self.out))
        make_corpus(self.corpus)

    def run(self, inputs: list[tuple[str, int]], note: Any) -> list[dict[str, Any]]:
        """The records of ``inputs`` (group, number); ``note`` is called with each as it comes."""
        from scripts.fuzz_inputs import GROUPS

        todo, records = list(reversed(inputs)), []
        running: dict[int, Any] = {}
        try:
            while todo or running:
                while todo and len(running) < self.jobs:
                    group, number = todo.pop()
                    case = Path(tempfile.mkdtemp(prefix="case.", dir=self.out))
                    for name in ("in", "out", "tmp"):
                        (case / name).mkdir()
                    run = {"processes": _process, "bus traffic": _traffic}.get(group, _child)
                    pid = os.fork()
                    if not pid:
                        run(case, self.corpus, GROUPS[group][1], f"{self.seed}/{group}/{number}")
                    running[pid] = (group, number, case, time.monotonic())
                time.sleep(0.002)
                for pid in list(running):
                    group, number, case, begin = running[pid]
                    late = time.monotonic() - begin > LIMIT_S
                    if late:
                        os.kill(pid, signal.SIGKILL)
                    ended, status, usage = os.wait4(pid, 0 if late else os.WNOHANG)
                    if ended:
                        del running[pid]
                        record = self._record(group, number, case, status, late)
                        record |= {"seconds": round(time.monotonic() - begin, 3), "megabytes": usage.ru_maxrss // 1024}
                        records.append(record)
                        note(record)
        finally:
            for pid, (_, _, case, _) in running.items():
                os.kill(pid, signal.SIGKILL)
                os.waitpid(pid, 0)
                shutil.rmtree(case, ignore_errors=True)
            shutil.rmtree(self.corpus)
        return records

    def _record(self, group: str, number: int, case: Path, status: int, late: bool) -> dict[str, Any]:
        try:
            verdict = json.loads((case / "verdict.json").read_text())
        except (OSError, ValueError):
            late = late or (os.WIFSIGNALED(status) and os.WTERMSIG(status) in (signal.SIGXCPU, signal.SIGKILL))
            detail = "killed at the time limit" if late else f"the process died with wait status {status}"
            said = (case / "said.txt").read_text(errors="replace")[-2000:] if (case / "said.txt").exists() else ""
            words = json.loads((case / "words.json").read_text()) if (case / "words.json").exists() else []
            verdict = {"outcome": "hang" if late else "odd status", "detail": f"{detail}\n{said}", "words": words}
        strays = {entry.name for entry in case.iterdir()} - {"in", "out", "tmp", "said.txt", "verdict.json", "words.json"}
        if strays:
            verdict |= {"outcome": "wrote outside", "detail": ", ".join(sorted(strays))}
        if verdict["outcome"] in DEFECTS:
            kept = self.out / "failed" / f"{group} {number}"
            shutil.rmtree(kept, ignore_errors=True)
            kept.parent.mkdir(exist_ok=True)
            case.rename(kept)
        else:
            shutil.rmtree(case, ignore_errors=True)
        return {"group": group, "number": number, **verdict}


def spread(count: int) -> list[tuple[str, int]]:
    """The first inputs of every group, ``count`` in all, in proportion to the groups' shares."""
    from scripts.fuzz_inputs import GROUPS

    total = sum(share for share, _ in GROUPS.values())
    inputs = [(number / share, group, number) for group, (share, _) in GROUPS.items() for number in range(-(-share * count // total))]
    return [(group, number) for _, group, number in sorted(inputs)]  # a run that is broken off has seen every group


def code_version() -> str:
    """Hash of the code under test: results of other code are not taken over."""
    digest = hashlib.sha256()
    for folder in ("golden", "rtl", "cosim", "eskin"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def summary(records: list[dict[str, Any]], seed: int, version: str) -> dict[str, Any]:
    """Counts by group and outcome, the longest and largest input, every defect."""
    groups: dict[str, collections.Counter[str]] = {}
    for record in records:
        groups.setdefault(record["group"], collections.Counter())[record["outcome"]] += 1
    return {
        "inputs": len(records),
        "seed": seed,
        "of_earlier_code": sum(record["code"] != version for record in records),
        "groups": {group: dict(sorted(counts.items())) for group, counts in groups.items()},
        "longest_s": max((record["seconds"] for record in records), default=0.0),
        "largest_megabytes": max((record["megabytes"] for record in records), default=0),
        "defects": [record for record in records if record["outcome"] in DEFECTS],
    }


def main() -> None:
    """The command line of the job."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--inputs", type=int, default=10_000, help="how many, spread over the groups")
    parser.add_argument("--out", type=Path, default=Path("build/fuzz"))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=min(2, os.cpu_count() or 1))
    parser.add_argument("--keep", action="store_true", help="do not repeat inputs that passed with earlier code; the result says how many")
    parser.add_argument("--only", help="one input, such as 'archives 17', or one group")
    options = parser.parse_args()
    os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")  # a forked child must not inherit other threads' locks
    sys.dont_write_bytecode = True
    inputs = spread(options.inputs)
    if options.only:
        group, _, number = options.only.rpartition(" ")
        inputs = [(group, int(number))] if number.isdecimal() else [one for one in inputs if one[0] == options.only]
    options.out.mkdir(parents=True, exist_ok=True)
    done_file, version = options.out / "done.jsonl", f"{code_version()} {options.seed}"
    records = []
    if done_file.exists() and not options.only:
        wanted = dict.fromkeys(inputs)
        for line in done_file.read_text().splitlines():
            record = json.loads(line)
            old = record["code"] != version
            if (record["group"], record["number"]) in wanted and ((options.keep and record["outcome"] not in DEFECTS) or not old):
                wanted[record["group"], record["number"]] = record
        records = [record for record in wanted.values() if record]
    finished = {(record["group"], record["number"]) for record in records}
    todo = [one for one in inputs if one not in finished]
    begin, count = time.monotonic(), 0
    if todo:
        _warm()
    with done_file.open("a") as handle:

        def note(record: dict[str, Any]) -> None:
            nonlocal count
            count += 1
            handle.write(json.dumps({**record, "code": version}) + "\n")
            handle.flush()
            if record["outcome"] in DEFECTS:
                last = (record["detail"].strip().splitlines() or [""])[-1]
                print(f"{record['group']} {record['number']}: {record['outcome']}: {last[:200]}", flush=True)
            if count % 100 == 0:
                print(f"{count} of {len(todo)} inputs, {time.monotonic() - begin:.0f} s", file=sys.stderr, flush=True)

        if todo:
            records += [{**record, "code": version} for record in Job(options.out, options.seed, options.jobs).run(todo, note)]
    result = summary(records, options.seed, version) | {"wall_s": round(time.monotonic() - begin, 1)}
    (options.out / "fuzz.json").write_text(json.dumps(result, indent=2) + "\n")
    for group, counts in result["groups"].items():
        print(f"{group}: " + ", ".join(f"{count} {outcome}" for outcome, count in counts.items()))
    print(f"{result['inputs']} inputs, {len(result['defects'])} defects; {options.out / 'fuzz.json'}")
    sys.exit(1 if result["defects"] else 0)


def _warm() -> None:
    """Import once what children would import each for themselves."""
    import importlib
    import pkgutil

    import torch
    import typer

    import eskin

    torch.set_num_threads(1)
    for module in pkgutil.walk_packages(eskin.__path__, "eskin."):
        if not module.name.startswith("eskin.cosim.") or not module.name.endswith("bench"):
            importlib.import_module(module.name)
    from eskin.cli import main as command_line
    from eskin.golden.core.errors import InputError
    from eskin.golden.data import scene

    scene.synthetic_recordings = functools.cache(scene.synthetic_recordings)
    scene.synthetic_recordings()
    command_line.app = typer.main.get_command(command_line.app)
    with contextlib.redirect_stderr(io.StringIO()), contextlib.suppress(SystemExit, InputError):
        command_line.app(["inspect", "no such file", "--json", "x.json"])  # typer imports much of itself at the first call
    from tests.support.traffic_case import small_case

    small_case()
    gc.freeze()


if __name__ == "__main__":
    main()
