"""``make mutants``: breaks the code in many small ways, one at a time, and looks whether the tests of the
broken file see it.

A mutant replaces one expression, found in a file's syntax tree. Excluded are strings, type hints, ``raise``
and conditions that only lead to one (error messages), assertions, decorators and default arguments: none of
them changes what the hardware computes. Faults that somebody thought of (``named`` in tests/mutants.toml) are
judged beside those that are drawn.

Each mutant is tested in a copy of the project. Verdicts are kept by the content of the whole project with the
mutant in it, so an interrupted run goes on where it stopped. It is killed when its tests fail, cannot be loaded, or take too long. One that
survives is a hole in the tests, or equivalent: the same function written otherwise, of which
tests/mutants.toml says why. The score is the killed share of those that are drawn and not equivalent.

No library does this: cosmic-ray knows four of the nine kinds of fault and one test command for all files,
mutmut neither.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import hashlib
import itertools
import multiprocessing
import os
import random
import re
import resource
import shutil
import signal
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from eskin.golden.core import Record, content_key, write_json
from eskin.jobs import Jobs
from eskin.memo import Memo

ROOT = Path(__file__).resolve().parents[1]
SCOPE = Path("tests/mutants.toml")
FOLDERS = ("eskin", "golden", "rtl", "cosim", "scripts", "formal", "tests")
REQUIRED = 0.95
HEAVY = ["pytest", "numpy", "amaranth.sim", "amaranth.lib.wiring", "torch"]
"""Loaded once, before the test processes are forked: loading them takes longer than most mutants. (No plugins
of pytest.)"""
CONTEXT = multiprocessing.get_context("forkserver")
KINDS = (
    "operator",
    "condition",
    "off-by-one",
    "constant",
    "width",
    "reset",
    "swapped operands",
    "saturation",
    "signal",
)
Fault = tuple[str, int, str, str]
"""Kind, first character, text there, text in its place."""
Work = tuple[str, list[str], float, "Mutant | None"]
"""File, tests, seconds of the processor, fault."""


def _signs(text: str) -> dict[str, str]:
    return dict(pair.split(":") for pair in text.split(","))


OTHER = _signs(
    "Add:-,Sub:+,Mult:+,FloorDiv:*,Div:*,Mod://,LShift:>>,RShift:<<,BitAnd:|,BitOr:&,BitXor:|,And:or,Or:and"
)
INVERTED = _signs("Eq:!=,NotEq:==,Lt:>=,LtE:>,Gt:<=,GtE:<,Is:is not,IsNot:is,In:not in,NotIn:in")
ONE_OFF = _signs("Lt:<=,LtE:<,Gt:>=,GtE:>")
SIGN = _signs("Lt:<,LtE:<=,Gt:>,GtE:>=,Sub:-,FloorDiv://,Mod:%")
SIZED = ("signed", "unsigned", "Signal", "range", "QFormat", "replicate", "shape_of")
NARROWINGS = ("saturate", "clip", "clamp", "min", "max", "minimum", "maximum")
ROUNDINGS = ("narrow", "round_half_up", "shift_right", "_narrow")


# ---------------------------------------------------------------------- faults
@dataclass(frozen=True)
class Mutant:
    """``new`` in place of ``old``, from character ``begin`` of the file on; a named one (``begin`` -1)
    wherever ``old`` stands."""

    file: str
    kind: str
    begin: int
    old: str
    new: str
    line: int = 0
    name: str = ""

    def apply(self, text: str) -> str:
        """The whole file with the fault in it."""
        assert text.find(self.old, self.begin) == self.begin or (self.begin < 0 and self.old in text), (
            f"{self.file} has no '{self.old}'"
        )
        return (
            text.replace(self.old, self.new)
            if self.begin < 0
            else text[: self.begin] + self.new + text[self.begin + len(self.old) :]
        )

    def lines(self, text: str) -> tuple[str, str]:
        """The difference, as the stretch of lines before and after, blanks squeezed: names the mutant
        wherever the lines move to."""
        begin = text.index(self.old) if self.begin < 0 else self.begin
        first, last = text.rfind("\n", 0, begin) + 1, text.find("\n", begin + len(self.old))
        changed = text[first:begin] + self.new + text[begin + len(self.old) : last]
        return " ".join(text[first:last].split()), " ".join(changed.split())


class _Finder:
    """Faults of one file: (kind, begin, old, new)."""

    def __init__(self, text: str, skip: frozenset[str]) -> None:
        self.text, self.skip = text, skip
        self.rows = text.encode().splitlines(keepends=True)
        self.starts = [0, *itertools.accumulate(len(row.decode()) for row in self.rows)]

    def span(self, node: Any) -> tuple[int, int]:
        places = ((node.lineno, node.col_offset), (node.end_lineno, node.end_col_offset))
        begin, end = (
            self.starts[line - 1] + len(self.rows[line - 1][:byte].decode()) for line, byte in places
        )
        return begin, end

    def source(self, node: ast.AST) -> str:
        return self.text[slice(*self.span(node))]

    def replaced(self, kind: str, node: ast.AST, new: str) -> Fault:
        return kind, self.span(node)[0], self.source(node), new

    def between(self, kind: str, left: ast.AST, right: ast.AST, sign: str) -> Iterator[Fault]:
        """Another sign between two operands."""
        begin = self.span(left)[1]
        old = self.text[begin : self.span(right)[0]]
        bare = old.strip(" ()\n")
        if bare and "#" not in old and old.count(bare) == 1:
            yield kind, begin, old, old.replace(bare, sign)

    def walk(self, node: Any, names: Sequence[str] = ()) -> Iterator[Fault]:
        """The faults of a node and of everything below it that is not excluded. names: the signals of the
        function it is in."""
        below = list(ast.iter_child_nodes(node))
        match node:
            case ast.Raise() | ast.Assert() | ast.JoinedStr() | ast.Import() | ast.ImportFrom():
                return
            case ast.FunctionDef(name=name, body=body):
                special = name.startswith("__") and name not in ("__init__", "__post_init__")
                below = [] if special or name in self.skip else list(body)
                names = sorted(set(_signals(node)))
            case ast.ClassDef(body=body):
                below = [part for part in body if not isinstance(part, ast.AnnAssign | ast.Assign)]
            case ast.AnnAssign(value=value):
                below = [value] if value else []
            case ast.If(body=body, orelse=orelse) if all(map(_refuses, body)):
                below = list(orelse)
            case ast.If(test=ast.Name(id="TYPE_CHECKING")):
                pass
            case ast.If(test=test) | ast.IfExp(test=test):
                yield self.replaced("condition", test, f"not ({self.source(test)})")
            case ast.Call():
                yield from self.call_faults(node, names)
                words = [word.value for word in node.keywords if word.arg not in ("name", "dtype")]
                below = [node.func, *node.args, *words]
            case _:
                yield from self.value_faults(node)
        for part in below:
            yield from self.walk(part, names)

    def value_faults(self, node: Any) -> Iterator[Fault]:
        """Faults of an operation, a constant, the bounds of a slice."""
        source, op = self.source, type(getattr(node, "op", None)).__name__
        match node:
            case ast.BinOp(left=left, right=right):
                joined = (ast.List, ast.Tuple, ast.JoinedStr, ast.ListComp, ast.Dict)
                joins = any(isinstance(side, joined) or _is_text(side) for side in (left, right))
                if op in OTHER and not joins:
                    yield from self.between("operator", left, right, OTHER[op])
                    if op in SIGN:
                        swapped = f"(({source(right)}) {SIGN[op]} ({source(left)}))"
                        yield self.replaced("swapped operands", node, swapped)
            case ast.BoolOp(values=values):
                for left, right in itertools.pairwise(values):
                    yield from self.between("operator", left, right, OTHER[op])
            case ast.Compare(left=left, ops=[sign], comparators=[right]):
                op = type(sign).__name__
                yield from self.between("condition", left, right, INVERTED[op])
                if op in ONE_OFF:
                    yield from self.between("off-by-one", left, right, ONE_OFF[op])
                    swapped = f"{source(right)} {SIGN[op]} {source(left)}"
                    yield self.replaced("swapped operands", node, swapped)
            case ast.UnaryOp(op=ast.UAdd()) | ast.UnaryOp(op=ast.USub(), operand=ast.Constant()):
                pass
            case ast.UnaryOp(operand=operand):
                yield self.replaced("operator" if op == "USub" else "condition", node, f"({source(operand)})")
            case ast.Constant(value=bool(value)):
                yield self.replaced("constant", node, str(not value))
            case ast.Constant(value=int(value)):
                yield self.replaced("constant", node, str({0: 1, 1: 0}.get(value, value + 1)))
            case ast.Constant(value=float(value)):
                yield self.replaced("constant", node, repr(value * 1.5 + (value == 0)))
            case ast.Slice(lower=lower, upper=upper):
                for bound in (lower, upper):
                    if bound is not None and not _is_text(bound):
                        yield self.replaced("off-by-one", bound, f"{source(bound)} + 1")

    def call_faults(self, node: ast.Call, names: Sequence[str]) -> Iterator[Fault]:
        """Faults of a call by the name of what is called."""
        name, args, sources = _name(node.func), node.args, list(map(self.source, node.args))
        first, plain = (*args, None)[0], not any(isinstance(arg, ast.Starred) for arg in args)
        target = self.source(node.func.value) if isinstance(node.func, ast.Attribute) else ""
        if name in SIZED and len(args) == 1 and plain and not isinstance(first, ast.Call | ast.ListComp):
            yield self.replaced("off-by-one" if name == "range" else "width", args[0], f"({sources[0]}) - 1")
        if name == "If" and args:
            yield self.replaced("condition", args[0], f"~({sources[0]})")
        order = (0, 2, 1) if name in ("Mux", "where") and len(args) == 3 else ()
        if name in ("Cat", "concatenate") and plain and len(args) >= 2:
            order = (1, 0, *range(2, len(args)))
        if order:
            words = [f"{word.arg}={self.source(word.value)}" for word in node.keywords if word.arg]
            swapped = ", ".join([*(sources[place] for place in order), *words])
            yield self.replaced("swapped operands", node, f"{self.source(node.func)}({swapped})")
        if name in NARROWINGS and args and plain and not isinstance(first, ast.GeneratorExp):
            value = target if target and _name(node.func.value) not in ("np", "torch") else sources[0]  # type: ignore[attr-defined]
            yield self.replaced("saturation", node, f"({value})")
        if name in ROUNDINGS and len(args) >= 2:
            yield self.replaced("saturation", node, f"(({sources[0]}) >> ({sources[1]}))")
        for word in node.keywords:
            if name == "Signal" and word.arg == "init" and self.source(word.value) != "0":
                yield self.replaced("reset", word.value, "0")
        if name == "eq" and isinstance(first, ast.Constant) and first.value == 0:
            yield self.replaced("reset", node, f"{target}.eq({target})")
        driven: dict[str, list[ast.expr]] = {"eq": args, "drive": [word.value for word in node.keywords]}
        for given in driven.get(name, []):
            for read in ast.walk(given):  # another signal of the function
                if isinstance(read, ast.Name) and read.id in names and len(names) > 1:
                    others = [other for other in names if other != read.id]
                    number = hashlib.sha256(f"{read.id}{self.source(given)}".encode()).digest()[0]
                    yield self.replaced("signal", read, others[number % len(others)])


def _name(function: ast.expr) -> str:
    return getattr(function, "id", getattr(function, "attr", ""))


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def _refuses(statement: ast.stmt) -> bool:
    """Only reports a user's mistake."""
    match statement:
        case ast.Raise():
            return True
        case ast.Expr(value=ast.Call(func=function)):
            return _name(function) == "refuse"
    return False


def _signals(function: ast.FunctionDef) -> Iterator[str]:
    """Names that the function gives to ``Signal(...)``."""
    for node in (node for node in ast.walk(function) if isinstance(node, ast.Assign)):
        target, value = node.targets[0], node.value
        pairs = [(target, value)]
        if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
            pairs = list(zip(target.elts, value.elts, strict=False))
        for name, part in pairs:
            if isinstance(name, ast.Name) and isinstance(part, ast.Call) and _name(part.func) == "Signal":
                yield name.id


def mutants(file: str, text: str, skip: frozenset[str] = frozenset()) -> list[Mutant]:
    """All mutants of a file but in the functions of ``skip``, in the order of its text; some may be no faults
    (`is_fault`)."""
    faults = {
        Mutant(file, kind, begin, old, new, text.count("\n", 0, begin) + 1)
        for kind, begin, old, new in _Finder(text, skip).walk(ast.parse(text))
        if old != new
    }
    return sorted(faults, key=lambda mutant: (mutant.begin, mutant.kind, mutant.old, mutant.new))


def is_fault(mutant: Mutant, text: str) -> bool:
    """Is the mutated file a program, and another one?"""
    try:
        return ast.dump(ast.parse(mutant.apply(text))) != ast.dump(ast.parse(text))
    except SyntaxError:
        return False


def choose(texts: dict[str, str], count: int, seed: int, skip: frozenset[str] = frozenset()) -> list[Mutant]:
    """``count`` mutants of these files (or all): files in turn, in a file its kinds in turn, those chosen
    least so far first."""
    waiting: dict[str, list[Mutant]] = {}
    for file, text in texts.items():
        of_file = mutants(file, text, skip)
        waiting[file] = random.Random(f"{seed} {file}").sample(of_file, len(of_file))[::-1]
    chosen: list[Mutant] = []
    here, overall = Counter[tuple[str, str]](), Counter[str]()
    rank = lambda mutant: (here[mutant.file, mutant.kind], overall[mutant.kind], KINDS.index(mutant.kind))
    while len(chosen) < count and any(waiting.values()):
        for file in (file for file, rest in waiting.items() if rest):
            mutant = min(waiting[file], key=rank)
            waiting[file].remove(mutant)
            if len(chosen) < count and is_fault(mutant, texts[file]):
                here[file, mutant.kind] += 1
                overall[mutant.kind] += 1
                chosen.append(mutant)
    return chosen


# ---------------------------------------------------------------------- judging
@dataclass
class Scope:
    """Files with their tests, faults that somebody thought of with theirs, what is said of survivors:
    tests/mutants.toml."""

    tests: dict[str, list[str]]
    named: dict[Mutant, list[str]]
    skip: frozenset[str]
    reasons: dict[tuple[str, str, str], Record]

    @classmethod
    def load(cls, root: Path) -> Scope:
        """Read the file; a test that begins with ``group.`` stands for all tests of that group."""
        values = tomllib.loads((root / SCOPE).read_text())
        groups = {f"group.{name}": tests for name, tests in values.get("group", {}).items()}

        def spelled(tests: list[str]) -> list[str]:
            return [test for word in tests for test in groups.get(word, [word])]

        named = {
            Mutant(fault["file"], "named", -1, fault["old"], fault["new"], name=fault["name"]): spelled(
                [fault["test"]]
            )
            for fault in values.get("named", [])
        }
        reasons = {(entry["file"], entry["was"], entry["now"]): entry for entry in values.get("survivor", [])}
        tests = {file: spelled(tests) for file, tests in values["files"].items()}
        return cls(tests, named, frozenset(values.get("skip", [])), reasons)


def sources(root: Path) -> list[Path]:
    """Files on which a verdict depends."""
    paths = [path for folder in FOLDERS for path in sorted((root / folder).rglob("*"))]
    kept = (path for path in paths if path.is_file() and "__pycache__" not in path.parts)
    return [*(path for path in kept if path != root / SCOPE), root / "pyproject.toml"]


class _Judges:
    """pytest as a judge of mutants. A failing example is enough: making it smaller would take longer than the
    test. And of slow tests those run that are named one by one; of a file that is named whole only the quick
    ones."""

    def __init__(self, tests: list[str]) -> None:
        self._named = tuple(test for test in tests if "::" in test)

    def pytest_collection_modifyitems(self, items) -> None:
        items[:] = [
            item
            for item in items
            if item.nodeid.startswith(self._named) or not item.get_closest_marker("slow")
        ]

    def pytest_configure(self) -> None:
        from hypothesis import Phase, settings

        settings.register_profile("mutants", phases=(Phase.explicit, Phase.generate))
        settings.load_profile("mutants")


def _child(copy: Path, tests: list[str], limit: float) -> None:
    """pytest on the copy, in a separate process; its status and processor time go to a file beside the
    copy."""
    os.setsid()
    resource.setrlimit(resource.RLIMIT_CPU, (int(limit), int(limit) + 5))
    with (copy.parent / "log.txt").open("w") as output:
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
    try:
        status = int(pytest.main(words, plugins=[_Judges(tests)]))
    finally:
        sys.stdout.flush()
        used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
        seconds = sum(process.ru_utime + process.ru_stime for process in used)
        (copy.parent / "seconds").write_text(str(seconds))
    os._exit(status)


def verdict(shared: tuple[Path, Path, list[str]], work: Work) -> Record:
    """What the tests say of a piece of work, in this process's own copy of the project: {outcome, seconds, by, compared,
    end}. shared: the project, the folder of copies, modules to load before tests are forked."""
    (root, folder, heavy), (file, tests, limit, mutant) = shared, work
    copy = folder / str(os.getpid()) / root.name
    if not copy.exists():  # links included: found as ``eskin`` by whoever has the copy on its path
        for path in sources(root):
            (copy / path.relative_to(root)).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(path, copy / path.relative_to(root))
        for link in (path for path in (root / "eskin").iterdir() if path.is_symlink()):
            (copy / "eskin" / link.name).symlink_to(link.readlink())
    CONTEXT.set_forkserver_preload(heavy)
    if mutant:
        (copy / file).write_text(mutant.apply((root / file).read_text()))
    (copy.parent / "seconds").write_text(str(limit))
    process = CONTEXT.Process(target=_child, args=(copy, tests, limit))
    process.start()
    process.join(max(600, 20 * limit))  # the machine may be busy
    status = process.exitcode
    assert process.pid
    with contextlib.suppress(ProcessLookupError):  # with what it left behind
        os.killpg(process.pid, signal.SIGKILL)
    process.join()
    if mutant:
        shutil.copy2(root / file, copy / file)
    end = (copy.parent / "log.txt").read_text(errors="replace")[-6000:]
    failed = [line[:200] for line in end.splitlines() if line.startswith(("FAILED", "ERROR"))]
    outcome = "survived" if status == 0 else "killed"
    if status in (None, -signal.SIGXCPU, -signal.SIGKILL):
        outcome = "timeout"
    return {
        "outcome": outcome,
        "seconds": round(float((copy.parent / "seconds").read_text()), 1),
        "by": (*failed, "")[0],
        # a test compared, and did not find what it asserts
        "compared": outcome == "killed" and bool(re.search(r":\d+: (AssertionError|assert )", end)),
        "end": end,
    }


def judge(
    root: Path, out: Path, count: int, seed: int, jobs: int, least_limit: float = 60.0, only: str = ""
) -> Record:
    """Choose mutants, run what is not yet known, return the result.

    Parameters
    ----------
    least_limit:
        Seconds of the processor before a mutant's tests are ended at the earliest; otherwise three times what
        they take without it.
    only:
        All ``count`` mutants are of files in whose path this regular expression is found, and none is a
        named one.

    Raises
    ------
    RuntimeError
        Tests fail without a mutant: nothing would be known.
    """
    scope, copies, keep = Scope.load(root), out / "copies", Memo(out / "verdicts")
    texts = {file: (root / file).read_text() for file in scope.tests if re.search(only, file)}
    tests_of = {mutant: scope.tests[mutant.file] for mutant in choose(texts, count, seed, scope.skip)} | (
        {} if only else scope.named
    )
    content = content_key(*(part for path in sources(root) for part in (str(path.relative_to(root)), path)))

    def judged(work: dict[Any, Work], what: str) -> dict[Any, Record]:
        keys = {
            name: content_key(content, repr((tests, mutant))) for name, (_, tests, _, mutant) in work.items()
        }
        pieces = {keys[name]: piece for name, piece in work.items()}
        runs = Jobs(workers=jobs, progress=lambda *told: print("{}: {} of {}".format(*told), file=sys.stderr))
        try:
            results = runs.results(verdict, pieces, (root, copies, HEAVY), keep=keep, what=what)
        finally:
            shutil.rmtree(copies, ignore_errors=True)
        return {name: results[key] for name, key in keys.items()}

    every = sorted({test for tests in tests_of.values() for test in tests})
    seconds = {}
    for test, found in judged(
        {test: ("", [test], 1200.0, None) for test in every}, "tests as they are"
    ).items():
        if found["outcome"] != "survived":
            keep.forget([path.stem for path in (out / "verdicts").glob("*.json")])
            raise RuntimeError(f"{test} fails without a mutant:\n{found['end']}")
        seconds[test] = found["seconds"]
    work: dict[Any, Work] = {
        mutant: (mutant.file, tests, max(least_limit, 3 * sum(seconds[test] for test in tests)), mutant)
        for mutant, tests in tests_of.items()
    }
    rows = []
    for mutant, row in judged(work, "mutants").items():
        was, now = mutant.lines((root / mutant.file).read_text())
        reason = scope.reasons.get((mutant.file, was, now), {})
        if row["outcome"] == "survived" and reason.get("equivalent"):
            row["outcome"] = "equivalent"
        del row["end"]
        where = {"file": mutant.file, "line": mutant.line, "kind": mutant.kind, "was": was, "now": now}
        rows.append(row | where | {"reason": mutant.name or reason.get("reason", "")})
    counts = Counter(row["outcome"] for row in rows if row["kind"] != "named")
    killed = counts["killed"] + counts["timeout"]
    score = killed / (killed + counts["survived"]) if killed else 0.0
    passed = score >= REQUIRED and all(row["compared"] for row in rows if row["kind"] == "named")
    return {"seed": seed, "mutants": rows, "counts": dict(counts), "score": score, "passed": passed}


def table(result: Record) -> str:
    """The result as Markdown: score, by kind, by file, survivors."""
    rows = pd.DataFrame(result["mutants"])
    compared = (rows["compared"] & (rows["kind"] != "named")).sum()
    lines = [
        f"# Mutants: {result['score']:.1%} killed (seed {result['seed']}), {compared} by a comparison; "
        f"required {REQUIRED:.0%}"
    ]
    lines += [f"\n```\n{pd.crosstab(rows[by], rows['outcome'])}\n```\n" for by in ("kind", "file")]
    for row in sorted(result["mutants"], key=lambda row: row["outcome"]):
        if row["outcome"] in ("survived", "equivalent") or (row["kind"] == "named" and not row["compared"]):
            where = f"{row['outcome']}: {row['file']}:{row['line']} ({row['kind']})"
            reason = row["reason"] or "no reason given"
            lines.append(f"- {where}: {reason}\n  ```diff\n  - {row['was']}\n  + {row['now']}\n  ```")
    return "\n".join(lines) + "\n"


def main(words: list[str] | None = None, root: Path = ROOT) -> int:
    """The command; returns its exit status: 1 below the required score, or where a named fault is not found
    by a comparison."""
    parser = argparse.ArgumentParser(prog="make mutants", description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=154, help="mutants that are drawn (default 154)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2, help="at a time")
    parser.add_argument("--limit", type=float, default=60.0, help="least time limit of a mutant, in seconds")
    only = "all mutants in files in whose path this regular expression is found; the result is not written"
    parser.add_argument("--only", default="", help=only)
    parser.add_argument("--out", type=Path, default=Path("build/mutants"))
    asked = parser.parse_args(words)
    try:
        result = judge(
            root, asked.out.absolute(), asked.count, asked.seed, asked.jobs, asked.limit, asked.only
        )
    except RuntimeError as error:
        print(error, file=sys.stderr)
        return 2
    if not asked.only:
        write_json(asked.out / "mutants.json", result)
        (asked.out / "mutants.md").write_text(table(result))
    print(table(result))
    return 0 if result["passed"] else 1


if __name__ == "__main__":
    sys.exit(main())
