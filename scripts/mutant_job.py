"""``make mutants``: breaks the code in many small ways, one at a time, and looks whether the tests of the broken file see it.

Each mutant is tested in a copy of the project, `jobs` copies at a time. Verdicts are kept by the content of the whole project with the
mutant in it, so an interrupted run goes on where it stopped, and a mutant is judged anew when its tests or the code below them change.

A mutant is killed when its tests fail, cannot be loaded, or take too long. One that survives is a hole in the tests, or equivalent: the
same function written otherwise, of which ``tests/mutants.toml`` says why. The score is the killed share of those that are not equivalent.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
import tomllib
import traceback
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from eskin.golden.core.files import replacing
from scripts.mutants import KINDS, Mutant, choose

ROOT = Path(__file__).resolve().parents[1]
SCOPE = Path("tests/mutants.toml")
PACKAGES = ("eskin", "golden", "rtl", "cosim", "scripts")
FOLDERS = (*PACKAGES, "formal", "tests")
OUTCOMES = ("killed", "timeout", "survived", "equivalent")
REQUIRED = 0.95
ASSERTED = re.compile(r":\d+: (AssertionError|assert )")
"""In a log: a test compared, and did not find what it wanted."""
BROKEN = 70
"""Exit status of a process that could not run pytest at all."""
HEAVY = ("pytest", "numpy", "amaranth.sim", "amaranth.lib.wiring", "torch")
"""Loaded once, before the test processes are forked: loading them takes longer than most mutants. (No plugins of pytest.)"""


@dataclass
class Scope:
    """Files with their tests, and what is said of survivors: tests/mutants.toml."""

    tests: dict[str, list[str]]
    skip: frozenset[str]
    reasons: dict[tuple[str, str, str], dict[str, Any]]

    @classmethod
    def load(cls, root: Path) -> Scope:
        """Read the file; a test that begins with ``group.`` stands for those under that name."""
        values = tomllib.loads((root / SCOPE).read_text())
        groups = values.get("group", {})
        tests = {
            file: [test for one in wanted for test in (groups[one[6:]] if one.startswith("group.") else [one])]
            for file, wanted in values["files"].items()
        }
        reasons = {(entry["file"], entry["was"], entry["now"]): entry for entry in values.get("survivor", [])}
        return cls(tests, frozenset(values.get("skip", [])), reasons)


@dataclass
class Run:
    """One pytest process on one copy."""

    mutant: Mutant | None
    file: str
    copy: Path
    pid: int
    until: float
    log: Path


def sources(root: Path) -> Iterator[Path]:
    """What a copy consists of, and what a verdict depends on."""
    for folder in FOLDERS:
        for path in sorted((root / folder).rglob("*")) if (root / folder).is_dir() else []:
            if path.is_file() and "__pycache__" not in path.parts and path != root / SCOPE:
                yield path
    yield root / "pyproject.toml"


def digest_of(root: Path, folders: tuple[str, ...]) -> str:
    """Of the content of these folders."""
    found = hashlib.sha256()
    for path in sources(root):
        if path.relative_to(root).parts[0] in folders:
            found.update(f"{path.relative_to(root)}\n".encode() + path.read_bytes())
    return found.hexdigest()


def key_of(root: Path, code: str, tests: list[str], mutant: Mutant | None, text: str) -> str:
    """Name of a verdict: code, tests and the mutant's content. Of the tests' own files only those that are run, and the helpers, count."""
    found = hashlib.sha256(f"{code} {tests}".encode())
    wanted = {test.partition("::")[0] for test in tests}
    for path in sources(root):
        name = str(path.relative_to(root))
        if name in wanted or (name.startswith("tests/") and not path.name.startswith("test_")):
            found.update(path.read_bytes())
    if mutant is not None:
        found.update(f"{mutant.file} {mutant.apply(text)}".encode())
    return found.hexdigest()[:24]


def copy_project(root: Path, copy: Path) -> None:
    """A copy, links included: found as ``eskin`` by whoever has ``copy`` on its path, whatever is installed."""
    for path in sources(root):
        target = copy / path.relative_to(root)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(path, target)
    for link in (path for path in (root / "eskin").iterdir() if path.is_symlink()):
        (copy / "eskin" / link.name).symlink_to(link.readlink())


@contextmanager
def copies(root: Path, count: int) -> Iterator[list[Path]]:
    """Temporary copies of the project."""
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        made = []
        for number in range(count):
            copy = Path(folder) / str(number) / root.name
            copy_project(root, copy)
            made.append(copy)
        yield made


class _Judges:
    """pytest as a judge of mutants. A failing example is enough: making it smaller would take longer than the test. And of slow tests those
    run that are named one by one; of a file that is named whole only the quick ones."""

    def __init__(self, tests: list[str]) -> None:
        self._named = tuple(test for test in tests if "::" in test)

    def pytest_collection_modifyitems(self, config, items) -> None:
        slow = [item for item in items if item.get_closest_marker("slow") and not item.nodeid.startswith(self._named)]
        if slow:
            config.hook.pytest_deselected(items=slow)
            items[:] = [item for item in items if item not in slow]

    def pytest_configure(self) -> None:
        try:
            from hypothesis import Phase, settings
        except ImportError:
            return
        settings.register_profile("mutants", phases=(Phase.explicit, Phase.generate))
        settings.load_profile("mutants")


def start(copy: Path, file: str, tests: list[str], limit: float, mutant: Mutant | None, text: str) -> Run:
    """Fork a pytest process on ``copy`` with the mutant in it; ``limit``: seconds of the processor, as the machine may be busy."""
    log = copy.parent / "log.txt"
    if mutant is not None:
        (copy / file).write_text(mutant.apply(text))
        os.utime(copy / file, (time.time() + 60,) * 2)  # no compiled file of the same second is taken for it
    pid = os.fork()
    if pid:
        return Run(mutant, file, copy, pid, time.monotonic() + max(600, 20 * limit), log)
    status = BROKEN
    try:  # the child: never returns
        os.setsid()
        resource.setrlimit(resource.RLIMIT_CPU, (int(limit), int(limit) + 5))
        with log.open("w") as output:
            os.dup2(output.fileno(), 1)
            os.dup2(output.fileno(), 2)
        os.chdir(copy)
        os.environ |= {"PYTHONPATH": str(copy), "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
        sys.dont_write_bytecode = True
        for name in [name for name in sys.modules if name.partition(".")[0] in FOLDERS]:
            del sys.modules[name]
        sys.path[:] = [str(copy), *(entry for entry in sys.path if entry not in ("", str(ROOT)))]
        import pytest

        words = ["-x", "-q", "-m", "", "-p", "no:cacheprovider", "--tb=line", f"--rootdir={copy}", *tests]
        status = int(pytest.main(words, plugins=[_Judges(tests)]))
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


def end(run: Run, status: int | None, seconds: float, text: str) -> dict[str, Any]:
    """The verdict of a process that ended after ``seconds`` of the processor (status ``None``: too late); the copy is whole again."""
    shown = run.log.read_text(errors="replace")[-20_000:]
    failed = [line for line in shown.splitlines() if line.startswith(("FAILED", "ERROR"))]
    if status == BROKEN and not failed:  # after a failed test pytest itself may stumble, over a simulation left open say
        raise RuntimeError(f"the tests of {run.file} could not be started:\n{shown}")
    if run.mutant is not None:
        (run.copy / run.file).write_text(text)
        os.utime(run.copy / run.file, (time.time() + 120,) * 2)
    outcome = "timeout" if status in (None, -signal.SIGXCPU) else "survived" if status == 0 else "killed"
    by = failed[0][:200] if failed else ""
    return {"outcome": outcome, "seconds": round(seconds, 1), "status": status, "by": by, "end": shown[-6000:]}


def play(
    root: Path, work: list[tuple[str, list[str], float, Mutant | None]], texts: dict[str, str], jobs: int, keep: Any, progress: Any
) -> None:
    """Run every piece of ``work``; ``keep(piece, verdict)`` as each is done."""
    with copies(root, jobs) as free:
        running: dict[int, tuple[Run, tuple]] = {}
        waiting = list(work)
        try:
            while waiting or running:
                while waiting and free:
                    piece = waiting.pop(0)
                    file, tests, limit, mutant = piece
                    run = start(free.pop(), file, tests, limit, mutant, texts.get(file, ""))
                    running[run.pid] = run, piece
                for pid, (run, piece) in list(running.items()):
                    done, code, used = os.wait4(pid, os.WNOHANG)
                    status: int | None = os.waitstatus_to_exitcode(code) if done else None
                    if not done and time.monotonic() < run.until:
                        continue
                    _end_group(pid)  # what it left behind, or itself
                    if not done:
                        os.waitpid(pid, 0)
                    del running[pid]
                    keep(piece, end(run, status, used.ru_utime + used.ru_stime, texts.get(run.file, "")))
                    free.append(run.copy)
                    progress(piece)
                time.sleep(0.05)
        finally:
            for pid in running:
                _end_group(pid)
                os.waitpid(pid, 0)


def _end_group(pid: int) -> None:
    try:
        os.killpg(pid, signal.SIGKILL)
    except ProcessLookupError:
        return


def write_json(path: Path, value: Any) -> None:
    """Written whole or not at all."""
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(value, indent=1, ensure_ascii=False) + "\n")


def judge(root: Path, out: Path, count: int, seed: int, jobs: int, least_limit: float = 60.0, only: str = "") -> dict[str, Any]:
    """Choose mutants, run what is not yet known, return the result.

    Parameters
    ----------
    least_limit:
        Seconds of the processor before a mutant's tests are ended at the earliest; otherwise three times what they take without it.
    only:
        All ``count`` mutants are of files whose path contains this.

    Raises
    ------
    RuntimeError
        Tests fail without a mutant: nothing would be known.
    """
    scope = Scope.load(root)
    texts = {file: (root / file).read_text() for file in scope.tests if only in file}
    chosen = choose(texts, count, seed, scope.skip)
    code = digest_of(root, ("golden", "rtl", "cosim"))

    def kept(tests: list[str], mutant: Mutant | None) -> Path:
        return out / "verdicts" / f"{key_of(root, code, tests, mutant, texts.get(mutant.file, '') if mutant else '')}.json"

    def known(path: Path) -> dict[str, Any]:
        """The verdict; nothing where there is none yet."""
        return json.loads(path.read_text()) if path.exists() else {}

    needed = sorted({test for mutant in chosen for test in scope.tests[mutant.file]})
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    # (No thread of its own: processes are forked beside it.)
    with Progress(*columns, auto_refresh=False, disable=not sys.stderr.isatty()) as bars:
        for name in HEAVY:
            __import__(name)

        def run_all(title: str, work: list) -> None:
            task = bars.add_task(title, total=len(work))

            def done(piece) -> None:
                bars.advance(task)
                bars.refresh()

            play(root, work, texts, jobs, lambda piece, verdict: write_json(kept(piece[1], piece[3]), verdict), done)

        unknown = [test for test in needed if known(kept([test], None)).get("status") != 0]
        run_all("tests as they are", [("", [test], 1200.0, None) for test in unknown])
        plain = {test: known(kept([test], None)) for test in needed}
        for test, verdict in plain.items():
            if verdict["status"] != 0:
                raise RuntimeError(f"{test} fails without a mutant:\n{verdict['end']}")
        limits = {
            file: max(least_limit, 3 * sum(plain[test]["seconds"] for test in tests))
            for file, tests in scope.tests.items()
            if all(test in plain for test in tests)
        }
        todo = [(one.file, scope.tests[one.file], limits[one.file], one) for one in chosen if not known(kept(scope.tests[one.file], one))]
        run_all("mutants", todo)
    rows = []
    for mutant in chosen:
        verdict = known(kept(scope.tests[mutant.file], mutant))
        was, now = mutant.lines(texts[mutant.file])
        said = scope.reasons.get((mutant.file, was, now), {})
        outcome = "equivalent" if verdict["outcome"] == "survived" and said.get("equivalent") else verdict["outcome"]
        rows.append(
            {
                "file": mutant.file,
                "line": mutant.line,
                "kind": mutant.kind,
                "was": was,
                "now": now,
                "outcome": outcome,
                "by": verdict["by"],
                "compared": bool(ASSERTED.search(verdict["end"])),
                "seconds": verdict["seconds"],
                "reason": said.get("reason", ""),
            }
        )
    counts = Counter(row["outcome"] for row in rows)
    judged = len(rows) - counts["equivalent"]
    score = (counts["killed"] + counts["timeout"]) / judged if judged else 0.0
    return {"seed": seed, "mutants": rows, "counts": {name: counts[name] for name in OUTCOMES}, "score": score, "passed": score >= REQUIRED}


def table(result: dict[str, Any]) -> str:
    """The result as Markdown: score, by kind, by file, survivors."""
    counts = result["counts"]
    compared = sum(row["outcome"] == "killed" and row["compared"] for row in result["mutants"])
    lines = [
        f"# Mutants: {result['score']:.1%} killed",
        "",
        f"{len(result['mutants'])} mutants (seed {result['seed']}): {counts['killed']} killed by a failing test ({compared} by a "
        f"comparison, the others by an error that the fault raised), {counts['timeout']} by the time limit, "
        f"{counts['survived']} survived, {counts['equivalent']} equivalent. Required: {REQUIRED:.0%} of the rest.",
        "",
    ]
    for title, field_name, order in (("kind", "kind", list(KINDS)), ("file", "file", sorted({row["file"] for row in result["mutants"]}))):
        groups: dict[str, Counter] = defaultdict(Counter)
        for row in result["mutants"]:
            groups[row[field_name]][row["outcome"]] += 1
        lines += [f"| {title} | {' | '.join(OUTCOMES)} |", "| :-- |" + " --: |" * len(OUTCOMES)]
        lines += [f"| {name} | {' | '.join(str(groups[name][outcome]) for outcome in OUTCOMES)} |" for name in order if name in groups]
        lines.append("")
    for outcome in ("survived", "equivalent"):
        rows = [row for row in result["mutants"] if row["outcome"] == outcome]
        lines += [f"## {outcome.capitalize()}", ""] if rows else []
        for row in rows:
            lines += [
                f"- {row['file']}:{row['line']} ({row['kind']}): {row['reason'] or 'no reason given'}",
                "  ```diff",
                f"  - {row['was']}",
                f"  + {row['now']}",
                "  ```",
            ]
    return "\n".join(lines) + "\n"


def main(words: list[str] | None = None, root: Path = ROOT) -> int:
    """The command; returns its exit status: 1 below the required score."""
    parser = argparse.ArgumentParser(prog="make mutants", description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=154, help="mutants (default 154)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2, help="at a time")
    parser.add_argument("--limit", type=float, default=60.0, help="least time limit of a mutant, in seconds")
    parser.add_argument("--only", default="", help="all mutants in files whose path contains this; the result is not written")
    parser.add_argument("--out", type=Path, default=Path("build/mutants"))
    given = parser.parse_args(words)
    try:
        result = judge(root, given.out, given.count, given.seed, given.jobs, given.limit, given.only)
    except RuntimeError as error:
        print(error, file=sys.stderr)
        return 2
    text = table(result)
    if not given.only:
        write_json(given.out / "mutants.json", result)
        (given.out / "mutants.md").write_text(text)
    print(text)
    return 0 if result["passed"] else 1


if __name__ == "__main__":
    sys.exit(main())
