"""``make mutants``: breaks the code in many small ways, one at a time, and looks whether the tests of the
broken file see it.

A mutant replaces one expression, found in a file's syntax tree. Excluded are strings, type hints, ``raise``,
conditions that only lead to an error message, assertions (``strict`` too), ``reset_less``, the order of bits that
``any`` takes, decorators and default arguments: none of them changes what the hardware computes. Faults that somebody
thought of (``named`` in tests/mutants.toml) are judged beside those that are drawn.

Each mutant is tested in a copy of the project. Verdicts are kept by the content of all files that git knows and
of the mutant, so an interrupted run goes on where it stopped. A mutant is killed when its tests fail, cannot be
loaded, or take too long. One that survives is a hole in the tests, or equivalent: the same function written
otherwise; tests/mutants.toml gives the reason. The score is the killed share of those that are drawn and not equivalent.

No library does this: cosmic-ray knows four of the nine kinds of fault and one test command for all files,
mutmut neither.
"""

import ast
import contextlib
import gc
import importlib
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
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import typer

from eskin.cli.common import progress_bars
from eskin.golden.core import Record, content_key
from eskin.jobs import Jobs
from eskin.memo import Memo
from scripts import ROOT
from scripts.house import tracked

SCOPE, OUT = "tests/mutants.toml", "build/mutants"
REQUIRED = 0.95
PYTEST = "-x -q -p no:cacheprovider --hypothesis-profile=mutants --tb=line -W ignore::pytest.PytestAssertRewriteWarning".split()
LIMIT = 300
"""Seconds of the processor after which the tests of a mutant are ended."""
Fault = tuple[str, Any, str]
"""Kind, expression, text in its place."""
Work = tuple["Mutant", list[str]]
"""A mutant and its tests."""


def _signs(text: str) -> dict[str, str]:
    return dict(pair.split(":") for pair in text.split(","))


CHANGED = {
    "operator": _signs(
        "Add:-,Sub:+,Mult:+,FloorDiv:*,Div:*,Mod://,LShift:>>,RShift:<<,BitAnd:|,BitOr:&,BitXor:|,And:or,Or:and"
    ),
    "condition": _signs("Eq:!=,NotEq:==,Lt:>=,LtE:>,Gt:<=,GtE:<,Is:is not,IsNot:is,In:not in,NotIn:in"),
    "off-by-one": _signs("Lt:<=,LtE:<,Gt:>=,GtE:>"),
}
"""Another sign between two operands, by kind of fault."""
SWAPPED = _signs("Lt:<,LtE:<=,Gt:>,GtE:>=,Sub:-,FloorDiv://,Mod:%")


# ---------------------------------------------------------------------- faults
@dataclass(frozen=True, order=True)
class Mutant:
    """``new`` in place of characters ``begin`` to ``end`` of a file's text."""

    file: str
    text: str
    begin: int = 0
    end: int = 0
    kind: str = ""
    new: str = ""
    name: str = ""

    def applied(self) -> str:
        """The whole file with the fault in it."""
        return self.text[: self.begin] + self.new + self.text[self.end :]

    def is_fault(self) -> bool:
        """Is the mutated file a program, and another one?"""
        with contextlib.suppress(SyntaxError):
            return ast.dump(ast.parse(self.applied())) != ast.dump(ast.parse(self.text))
        return False

    def lines(self) -> tuple[str, str]:
        """The difference, as the stretch of lines before and after, blanks squeezed: names the mutant
        wherever the lines move to."""
        first, last = self.text.rfind("\n", 0, self.begin) + 1, self.text.find("\n", self.end)
        now = self.text[first : self.begin] + self.new + self.text[self.end : last]
        return " ".join(self.text[first:last].split()), " ".join(now.split())


def _walk(node: ast.AST, skip: frozenset[str], names: list[str], loop: bool = False) -> Iterator[Fault]:
    """The faults of a node and of everything below it that is not excluded. names: the signals of the
    function it is in. loop: it is what a loop runs over; another ``range`` is a shape, which loses a bit."""
    below: list[Any] = list(ast.iter_child_nodes(node))
    match node:
        case ast.Raise() | ast.Assert() | ast.JoinedStr() | ast.Import() | ast.ImportFrom():
            return
        case ast.FunctionDef(name=name, body=body):
            special = name.startswith("__") and name not in ("__init__", "__post_init__")
            below = [] if special or name in skip else body
            names = sorted({*re.findall(r"(?<![.\w])(\w+) = (?:self\.\w+ = )?Signal\(", ast.unparse(node))})
        case ast.ClassDef(body=body):
            below = [part for part in body if not isinstance(part, ast.AnnAssign | ast.Assign)]
        case ast.AnnAssign(value=value):
            below = [value] if value else []
        case ast.Call(ast.Name("range"), [size]):
            kind, less = ("off-by-one", "- 1") if loop else ("width", "+ 1 >> 1")
            yield kind, size, f"({ast.unparse(size)}) {less}"
            below = [size] * loop
        case ast.If(body=body, orelse=orelse) if all(map(_refuses, body)):
            below = orelse
        case ast.If(test=test) | ast.IfExp(test=test):
            yield "condition", test, f"not ({ast.unparse(test)})"
        case ast.Call(ast.Attribute(ast.Call(ast.Name("Cat"), below), "any")):  # in any order
            pass
        case ast.Call(func=func, args=args, keywords=words):
            yield from _call_faults(node, names)
            below = [
                func,
                *args,
                *(word.value for word in words if word.arg not in ("name", "dtype", "strict", "reset_less")),
            ]
        case _:
            yield from _value_faults(node)
    for part in below:
        yield from _walk(part, skip, names, part is getattr(node, "iter", None))


def _value_faults(node: Any) -> Iterator[Fault]:
    """Faults of an operation, a constant, the bounds of a slice."""
    match node:
        case (
            ast.BinOp(left=left, op=op, right=right)
            | ast.BoolOp(values=[left, right], op=op)
            | ast.Compare(left=left, ops=[op], comparators=[right])
        ) if not (isinstance(op, ast.Add | ast.Mult | ast.BitOr) and (_is_text(left) or _is_text(right))):
            first, second, of = f"({ast.unparse(left)})", f"({ast.unparse(right)})", type(op).__name__
            for kind, signs in CHANGED.items():
                if of in signs:
                    yield kind, node, first + signs[of] + second
            if of in SWAPPED:
                yield "swapped operands", node, second + SWAPPED[of] + first
        case ast.UnaryOp(op=ast.USub(), operand=ast.Constant()):
            pass
        case ast.UnaryOp(op=op, operand=operand):
            yield "operator" if isinstance(op, ast.USub) else "condition", node, ast.unparse(operand)
        case ast.Constant(value=bool(value)):
            yield "constant", node, str(not value)
        case ast.Constant(value=int(value)):
            yield "constant", node, str({0: 1, 1: 0}.get(value, value + 1))
        case ast.Constant(value=float(value)):
            yield "constant", node, repr(value * 1.5 + (value == 0))
        case ast.Slice(lower=lower, upper=upper):
            for bound in (lower, upper):
                if bound is not None and not _is_text(bound):
                    yield "off-by-one", bound, f"{ast.unparse(bound)} + 1"


def _call_faults(node: ast.Call, names: list[str]) -> Iterator[Fault]:
    """Faults of a call by the name of the called function."""
    name, args, show = _name(node.func), node.args, ast.unparse
    swapped: list[ast.expr] = []
    match name, args:
        case (
            ("signed" | "unsigned" | "Signal" | "QFormat" | "replicate" | "shape_of"),
            [ast.Name() | ast.BinOp() | ast.Constant() | ast.Attribute() as size],
        ):
            yield "width", size, f"({show(size)}) - 1"
        case "If", [test]:
            yield "condition", test, f"~({show(test)})"
        case (("Mux" | "where"), [test, yes, no]):
            swapped = [test, no, yes]
        case (("Cat" | "concatenate"), [first, second, *rest]):
            swapped = [second, first, *rest]
        case (("narrow" | "round_half_up" | "shift_right" | "_narrow"), [value, shift, *_]):
            yield "saturation", node, f"({show(value)}) >> ({show(shift)})"
        case (("saturate" | "clip" | "clamp" | "min" | "max" | "minimum" | "maximum"), [value, *_]):
            owner: Any = getattr(node.func, "value", None)
            yield "saturation", node, show(value if _name(owner) in ("", "np", "torch") else owner)
        case "eq", [ast.Constant(0) as zero]:
            yield "reset", zero, show(node.func.value)  # type: ignore[attr-defined]
    if swapped:
        yield "swapped operands", node, show(ast.Call(node.func, swapped, node.keywords))
    for word in node.keywords:
        if name == "Signal" and word.arg == "init" and show(word.value) != "0":
            yield "reset", word.value, "0"
    driven = {"eq": args, "drive": [word.value for word in node.keywords]}.get(name, [])
    for read in itertools.chain(*map(ast.walk, driven)):
        if isinstance(read, ast.Name) and read.id in names:  # another signal of the function
            yield "signal", read, names[names.index(read.id) - 1]


def _name(function: ast.expr) -> str:
    return getattr(function, "id", getattr(function, "attr", ""))


def _is_text(node: ast.AST) -> bool:
    """Text, or a list of things: what ``+`` joins."""
    joined = (ast.List, ast.Tuple, ast.JoinedStr, ast.ListComp, ast.Dict)
    return isinstance(node, joined) or isinstance(getattr(node, "value", None), str)


def _refuses(statement: ast.stmt) -> bool:
    """Only reports a user's mistake."""
    return bool(re.match(r"raise|yield \(['\w.]+, f?['\"]|(\w+\.)*refuse\(", ast.unparse(statement)))


def mutants(file: str, text: str, skip: frozenset[str] = frozenset()) -> list[Mutant]:
    """All mutants of a file but in the functions of ``skip``, in the order of its text; some may be no faults
    (`Mutant.is_fault`). The text is ASCII: columns of the syntax tree are bytes."""
    starts = [0, *itertools.accumulate(map(len, text.splitlines(keepends=True)))]
    found = set()
    for kind, node, new in _walk(ast.parse(text), skip, []):
        begin = starts[node.lineno - 1] + node.col_offset
        end = starts[node.end_lineno - 1] + node.end_col_offset
        found.add(Mutant(file, text, begin, end, kind, f"({new})"))
    return sorted(found)


def choose(texts: dict[str, str], count: int, seed: int, skip: frozenset[str] = frozenset()) -> list[Mutant]:
    """``count`` mutants of these files (or all): files in turn, in an order drawn by ``seed``; in a file its
    kinds in turn, those chosen least so far first."""
    draw = random.Random(seed)
    waiting = {file: mutants(file, texts[file], skip) for file in draw.sample(sorted(texts), len(texts))}
    for rest in waiting.values():
        draw.shuffle(rest)
    chosen: list[Mutant] = []
    drawn = Counter[Any]()
    while len(chosen) < count and any(waiting.values()):
        for file, rest in waiting.items():
            while rest and len(chosen) < count:
                mutant = min(rest, key=lambda fault: (drawn[file, fault.kind], drawn[fault.kind], fault.kind))
                rest.remove(mutant)
                if mutant.is_fault():
                    drawn.update([mutant.kind, (file, mutant.kind)])
                    chosen.append(mutant)
                    break
    return chosen


# ---------------------------------------------------------------------- judging
@dataclass
class Scope:
    """tests/mutants.toml: texts and tests of the files, tests of the faults that somebody thought of; by file
    and line with the fault whether a survivor counts (``equivalent`` or ``survived``), and why."""

    texts: dict[str, str]
    tests: dict[str, list[str]]
    named: dict[Mutant, list[str]]
    skip: frozenset[str]
    reasons: dict[tuple[str, str], tuple[str, str]]

    @classmethod
    def load(cls, root: Path) -> "Scope":
        """Read the file; a test that begins with ``group.`` stands for all tests of that group above."""
        values = tomllib.loads((root / SCOPE).read_text())
        groups: dict[str, list[str]] = {}

        def spelled(tests: list[str]) -> list[str]:
            return [test for word in tests for test in groups.get(word, [word])]

        for name, tests in values.get("group", {}).items():
            groups[f"group.{name}"] = spelled(tests)
        named = {}
        for fault in values["named"]:
            text, old = (root / fault["file"]).read_text(), fault["old"]
            begin = text.index(old)
            place = (fault["file"], text, begin, begin + len(old))
            named[Mutant(*place, "named", fault["new"], fault["name"])] = spelled([fault["test"]])
        return cls(
            {file: (root / file).read_text() for file in values["files"]},
            {file: spelled(tests) for file, tests in values["files"].items()},
            named,
            frozenset(values.get("skip", [])),
            {
                (file, now): (outcome, reason)
                for outcome in ("equivalent", "survived")
                for file, lines in values.get(outcome, {}).items()
                for now, reason in lines.items()
            },
        )


def _tested(copy: Path, tests: list[str], limit: int) -> None:
    """Run tests until one fails, in a process forked from one that has the libraries: its status is pytest's."""
    os.setsid()
    os.chdir(copy)
    os.environ |= {"PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}
    sys.dont_write_bytecode = True
    sys.stdout = sys.stderr = (copy.parent / "log.txt").open("w")
    for name in [name for name in sys.modules if name.partition(".")[0] in ("eskin", "scripts", "tests")]:
        del sys.modules[name]  # the copy's come in their place
    sys.meta_path[:] = [finder for finder in sys.meta_path if getattr(finder, "__module__", "") != "eskin"]
    resource.setrlimit(resource.RLIMIT_CPU, (limit, resource.RLIM_INFINITY))
    for test in tests:
        # a slow test runs where it is named itself; of a file that is named whole only the quick ones
        words = [*PYTEST, f"--rootdir={copy}", "-m", "" if "::" in test else "not slow", test]
        if status := pytest.main(words):
            sys.exit(status)


def verdict(shared: tuple[Path, Path, int], work: Work) -> Record:
    """What the tests say of a mutant, in this process's own copy of the project: {outcome, compared}.
    shared: the project, the folder of copies, seconds of the processor that the tests may take.

    Raises
    ------
    ChildProcessError
        A test fails without a mutant: nothing would be known.
    """
    (root, folder, limit), (mutant, tests) = shared, work
    copy = folder / str(os.getpid()) / root.name
    if not copy.exists():  # with links: found as ``eskin`` by whoever has the copy on its path
        shutil.copytree(root, copy, symlinks=True, ignore=shutil.ignore_patterns(".*", "build"))
    for name in "amaranth.sim cocotb_tools.runner hypothesis pydantic torch".split():  # once for all mutants
        importlib.import_module(name)
    gc.freeze()
    (copy / mutant.file).write_text(mutant.applied())
    process: Any = multiprocessing.get_context("fork").Process(target=_tested, args=(copy, tests, limit))
    process.start()
    process.join(10 * limit)  # the machine may be busy
    with contextlib.suppress(ProcessLookupError):  # with what it left behind
        os.killpg(process.pid, signal.SIGKILL)
    process.join()
    status: Any = process.exitcode
    (copy / mutant.file).write_text(mutant.text)
    end = (copy.parent / "log.txt").read_text(errors="replace")[-6000:]
    if status and not mutant.kind:
        raise ChildProcessError(f"a test fails without a mutant:\n{end}")
    return {
        "outcome": "timeout"
        if status in (-signal.SIGXCPU, -signal.SIGKILL)
        else "killed"
        if status
        else "survived",
        # a test compared, and did not find what it asserts
        "compared": status > 0 and bool(re.search(r":\d+: (AssertionError|assert )", end)),
    }


def judge(root: Path, count: int, seed: int, only: str = "") -> pd.DataFrame:
    """Choose mutants, run those without a verdict, the tests as they are first: file, line, kind, was, now,
    outcome, compared and reason of each.

    Parameters
    ----------
    only:
        All ``count`` mutants are of files in whose path this regular expression is found, and none is a
        named one.
    """
    scope, out = Scope.load(root), root / OUT
    texts = {file: text for file, text in scope.texts.items() if re.search(only, file)}
    works = [(mutant, scope.tests[mutant.file]) for mutant in choose(texts, count, seed, scope.skip)]
    works += [] if only else scope.named.items()
    plain = Mutant("pyproject.toml", (root / "pyproject.toml").read_text())
    before = [(plain, [test]) for test in sorted({test for _, tests in works for test in tests})]
    content = content_key(*(root / name for name in tracked(root) if str(name) != SCOPE))
    keys = [content_key(content, mutant.file, mutant.applied(), tests) for mutant, tests in before + works]
    try:
        with progress_bars() as report:
            results = Jobs(workers=2, progress=report).results(
                verdict,
                dict(zip(keys, before + works, strict=True)),
                (root, out / "copies", LIMIT),
                keep=Memo(out / "verdicts"),
                what="tests as they are, then mutants",
            )
    except ChildProcessError:
        shutil.rmtree(out / "verdicts", ignore_errors=True)
        raise
    finally:
        shutil.rmtree(out / "copies", ignore_errors=True)
    rows = []
    for (mutant, _), key in zip(works, keys[len(before) :], strict=True):
        was, now = mutant.lines()
        line = mutant.text.count("\n", 0, mutant.begin) + 1
        row = results[key] | {"file": mutant.file, "line": line, "kind": mutant.kind}
        known = scope.reasons.get((mutant.file, now), ("survived", mutant.name or "no reason given"))
        if row["outcome"] == "survived":
            row["outcome"] = known[0]
        rows.append(row | {"was": was, "now": now, "reason": known[1]})
    return pd.DataFrame(rows)


def report(root: Path, count: int, seed: int, only: str = "") -> bool:
    """Judge and print the result as Markdown, which is kept but for ``only``: score, by kind, by file,
    survivors. False below the required score, or where a named fault is not found by a comparison."""
    rows = judge(root, count, seed, only)
    if rows.empty:
        sys.exit(f"--only {only}: matches the path of no file from which mutants are drawn")
    named, outcome = rows["kind"] == "named", rows["outcome"]
    score = (outcome[~named & (outcome != "equivalent")] != "survived").mean()
    found = f"{score:.1%} killed (seed {seed}), {(rows['compared'] & ~named).sum()} by a comparison"
    text = f"# Mutants: {found}; required {REQUIRED:.0%}\n"
    for by in ("kind", "file"):
        text += f"\n```\n{pd.crosstab(rows[by], outcome)}\n```\n"
    shown = rows[outcome.isin(["survived", "equivalent"]) | (named & ~rows["compared"])]
    for row in shown.sort_values("outcome").itertuples():
        text += f"- {row.outcome}: {row.file}:{row.line} ({row.kind}): {row.reason}\n"
        text += f"  ```diff\n  - {row.was}\n  + {row.now}\n  ```\n"
    if not only:
        (root / OUT / "mutants.md").write_text(text)
    print(text)
    return bool(score >= REQUIRED and rows["compared"][named].all())


def main(count: int = 154, seed: int = 1, only: str = "") -> None:
    """Break the code in COUNT small ways; with --only all in files in whose path this regular expression is
    found, and the table is not written. The status is 1 where the tests miss too many."""
    sys.exit(not report(ROOT, count, seed, only))


if __name__ == "__main__":
    typer.run(main)
