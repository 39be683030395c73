"""Mutants of the sources: single small faults, found in a file's syntax tree and made in its text.

A mutant replaces one expression. Left alone are docstrings and other texts, type hints, ``raise`` and the conditions that only lead to one
(what a user's mistake is told), assertions, decorators and default arguments: none of them says what the hardware computes.
"""

from __future__ import annotations

import ast
import hashlib
import random
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

KINDS = ("operator", "condition", "off-by-one", "constant", "width", "reset", "swapped operands", "saturation", "signal")
OTHER_OPERATOR = {
    ast.Add: "-",
    ast.Sub: "+",
    ast.Mult: "+",
    ast.FloorDiv: "*",
    ast.Div: "*",
    ast.Mod: "//",
    ast.LShift: ">>",
    ast.RShift: "<<",
    ast.BitAnd: "|",
    ast.BitOr: "&",
    ast.BitXor: "|",
    ast.And: "or",
    ast.Or: "and",
}
INVERTED = {
    ast.Eq: "!=",
    ast.NotEq: "==",
    ast.Lt: ">=",
    ast.LtE: ">",
    ast.Gt: "<=",
    ast.GtE: "<",
    ast.Is: "is not",
    ast.IsNot: "is",
    ast.In: "not in",
    ast.NotIn: "in",
}
ONE_OFF = {ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">"}
SYMBOL = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">="}
SIZED = {"signed", "unsigned", "Signal", "range", "QFormat", "replicate", "shape_of"}
CHOICES = {"Mux", "where"}
NARROWINGS = {"saturate", "clip", "clamp", "min", "max", "minimum", "maximum"}
ROUNDINGS = {"narrow", "round_half_up", "shift_right", "_narrow"}


@dataclass(frozen=True)
class Mutant:
    """``new`` in place of ``old``, from character ``begin`` of the file on."""

    file: str
    kind: str
    begin: int
    old: str
    new: str
    line: int

    def apply(self, text: str) -> str:
        """The whole file with the fault in it."""
        assert text.startswith(self.old, self.begin)
        return text[: self.begin] + self.new + text[self.begin + len(self.old) :]

    def lines(self, text: str) -> tuple[str, str]:
        """What is different, as the stretch of lines before and after, blanks squeezed: names the mutant wherever the lines move to."""
        first, last = text.rfind("\n", 0, self.begin) + 1, text.find("\n", self.begin + len(self.old))
        change = len(self.new) - len(self.old)
        return " ".join(text[first:last].split()), " ".join(self.apply(text)[first : last + change].split())


class _Finder(ast.NodeVisitor):
    """Collects mutants while it walks; `self.names` are the signals of the function it is in."""

    def __init__(self, file: str, text: str, skip: frozenset[str]) -> None:
        self.file, self.text, self.skip = file, text, skip
        self.starts = [0]
        for line in text.encode().splitlines(keepends=True):
            self.starts.append(self.starts[-1] + len(line.decode()))
        self.byte_lines = text.encode().splitlines(keepends=True)
        self.names: list[str] = []
        self.found: list[Mutant] = []

    # ------------------------------------------------------------------ text
    def at(self, line: int, byte: int) -> int:
        return self.starts[line - 1] + len(self.byte_lines[line - 1][:byte].decode())

    def source(self, node: ast.AST) -> str:
        return self.text[self.at(node.lineno, node.col_offset) : self.at(node.end_lineno, node.end_col_offset)]

    def replace(self, kind: str, node: ast.AST, new: str) -> None:
        old = self.source(node)
        if new != old:
            self.found.append(Mutant(self.file, kind, self.at(node.lineno, node.col_offset), old, new, node.lineno))

    def between(self, kind: str, left: ast.AST, right: ast.AST, sign: str) -> None:
        """Another sign between two operands."""
        begin, end = self.at(left.end_lineno, left.end_col_offset), self.at(right.lineno, right.col_offset)
        old = self.text[begin:end]
        bare = old.strip(" ()\n")
        if bare and "#" not in old and old.count(bare) == 1:
            self.found.append(Mutant(self.file, kind, begin, old, old.replace(bare, sign), self.text.count("\n", 0, begin) + 1))

    # ------------------------------------------------------------------ what is left alone
    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        if node.name in self.skip or (node.name.startswith("__") and node.name not in ("__init__", "__post_init__")):
            return
        outer, self.names = self.names, sorted(set(_signals(node)))
        for statement in node.body:
            self.visit(statement)
        self.names = outer

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        for statement in node.body:
            if not isinstance(statement, (ast.AnnAssign, ast.Assign)):
                self.visit(statement)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    def skipped(self, node: ast.AST) -> None:
        """Nothing in here is mutated."""

    visit_Raise = visit_Assert = visit_JoinedStr = visit_Import = visit_ImportFrom = skipped

    def visit_If(self, node: ast.If) -> None:
        if all(isinstance(part, ast.Raise) or _refuses(part) for part in node.body):
            for statement in node.orelse:
                self.visit(statement)
            return
        if not isinstance(node.test, ast.Name) or node.test.id != "TYPE_CHECKING":
            self.replace("condition", node.test, f"not ({self.source(node.test)})")
        self.generic_visit(node)

    # ------------------------------------------------------------------ faults
    def visit_BinOp(self, node: ast.BinOp) -> None:
        joins = any(
            isinstance(side, (ast.List, ast.Tuple, ast.JoinedStr, ast.ListComp, ast.Dict)) or _is_text(side)
            for side in (node.left, node.right)
        )
        if type(node.op) in OTHER_OPERATOR and not joins:
            self.between("operator", node.left, node.right, OTHER_OPERATOR[type(node.op)])
            if isinstance(node.op, (ast.Sub, ast.FloorDiv, ast.Mod)):
                self.replace("swapped operands", node, f"(({self.source(node.right)}) {_sign(node.op)} ({self.source(node.left)}))")
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        for left, right in zip(node.values, node.values[1:], strict=False):
            self.between("operator", left, right, OTHER_OPERATOR[type(node.op)])
        self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:
        if len(node.ops) == 1:
            op, left, right = node.ops[0], node.left, node.comparators[0]
            self.between("condition", left, right, INVERTED[type(op)])
            if type(op) in ONE_OFF:
                self.between("off-by-one", left, right, ONE_OFF[type(op)])
                self.replace("swapped operands", node, f"{self.source(right)} {SYMBOL[type(op)]} {self.source(left)}")
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        if isinstance(node.op, (ast.Invert, ast.Not)):
            self.replace("condition", node, f"({self.source(node.operand)})")
        elif isinstance(node.op, ast.USub) and not isinstance(node.operand, ast.Constant):
            self.replace("operator", node, f"({self.source(node.operand)})")
        self.generic_visit(node)

    def visit_IfExp(self, node: ast.IfExp) -> None:
        self.replace("condition", node.test, f"not ({self.source(node.test)})")
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        if isinstance(node.value, bool):
            self.replace("constant", node, str(not node.value))
        elif isinstance(node.value, int):
            self.replace("constant", node, "1" if node.value == 0 else "0" if node.value == 1 else str(node.value + 1))
        elif isinstance(node.value, float):
            self.replace("constant", node, repr(node.value * 1.5 + (node.value == 0)))

    def visit_Slice(self, node: ast.Slice) -> None:
        for bound in (node.lower, node.upper):
            if bound is not None and not _is_text(bound):
                self.replace("off-by-one", bound, f"{self.source(bound)} + 1")
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        name, args = _name(node.func), node.args
        plain = [arg for arg in args if not isinstance(arg, ast.Starred)]
        if name in SIZED and len(plain) == 1 == len(args) and not isinstance(args[0], (ast.Call, ast.ListComp)):
            self.replace("off-by-one" if name == "range" else "width", args[0], f"({self.source(args[0])}) - 1")
        if name == "If" and args:
            self.replace("condition", args[0], f"~({self.source(args[0])})")
        if name in CHOICES and len(args) == 3:
            self.replace("swapped operands", node, self.call(node, [args[0], args[2], args[1]]))
        if name in ("Cat", "concatenate") and len(plain) == len(args) >= 2:
            self.replace("swapped operands", node, self.call(node, [args[1], args[0], *args[2:]]))
        if name in NARROWINGS and args and len(plain) == len(args) and not isinstance(args[0], ast.GeneratorExp):
            of_value = isinstance(node.func, ast.Attribute) and _name(node.func.value) not in ("np", "torch")
            self.replace("saturation", node, f"({self.source(node.func.value if of_value else args[0])})")
        if name in ROUNDINGS and len(args) >= 2:
            self.replace("saturation", node, f"(({self.source(args[0])}) >> ({self.source(args[1])}))")
        for word in node.keywords:
            if name == "Signal" and word.arg == "init" and self.source(word.value) != "0":
                self.replace("reset", word.value, "0")
        if name == "eq" and len(args) == 1:
            if isinstance(args[0], ast.Constant) and args[0].value == 0:
                self.replace("reset", node, f"{self.source(node.func.value)}.eq({self.source(node.func.value)})")
            self.signals(args[0])
        self.visit(node.func)
        for arg in args:
            self.visit(arg)
        for word in node.keywords:
            if word.arg not in ("name", "dtype"):
                self.visit(word.value)

    def call(self, node: ast.Call, args: list[ast.expr]) -> str:
        words = [f"{word.arg}={self.source(word.value)}" for word in node.keywords if word.arg]
        return f"{self.source(node.func)}({', '.join([*map(self.source, args), *words])})"

    def signals(self, value: ast.expr) -> None:
        """Each signal read in what is assigned, exchanged for another one of the function."""
        for node in ast.walk(value):
            if isinstance(node, ast.Name) and node.id in self.names:
                others = [name for name in self.names if name != node.id]
                if others:
                    pick = hashlib.sha256(f"{node.id}{self.source(value)}".encode()).digest()[0]
                    self.replace("signal", node, others[pick % len(others)])


def _name(function: ast.expr) -> str:
    return function.id if isinstance(function, ast.Name) else function.attr if isinstance(function, ast.Attribute) else ""


def _sign(op: ast.operator) -> str:
    return {ast.Sub: "-", ast.FloorDiv: "//", ast.Mod: "%"}[type(op)]


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def _refuses(statement: ast.stmt) -> bool:
    """Only tells the user of a mistake."""
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Call) and _name(statement.value.func) == "refuse"


def _signals(function: ast.FunctionDef) -> Iterator[str]:
    """Names that the function gives to ``Signal(...)``."""
    for node in ast.walk(function):
        if isinstance(node, ast.Assign):
            target, value = node.targets[0], node.value
            both = isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple)
            pairs = zip(target.elts, value.elts, strict=False) if both else [(target, value)]
            for name, made in pairs:
                if isinstance(name, ast.Name) and isinstance(made, ast.Call) and _name(made.func) == "Signal":
                    yield name.id


def mutants(file: str, text: str, skip: frozenset[str] = frozenset()) -> list[Mutant]:
    """All mutants of a file, in the order of its text; some may be no Python, or the same program (`is_fault`).

    Parameters
    ----------
    skip:
        Functions that are left alone.
    """
    finder = _Finder(file, text, skip)
    finder.visit(ast.parse(text))
    return sorted(set(finder.found), key=lambda one: (one.begin, one.kind, one.old, one.new))


def is_fault(mutant: Mutant, text: str) -> bool:
    """Is the mutated file a program, and another one?"""
    try:
        return ast.dump(ast.parse(mutant.apply(text))) != ast.dump(ast.parse(text))
    except SyntaxError:
        return False


def choose(texts: dict[str, str], count: int, seed: int, skip: frozenset[str] = frozenset()) -> list[Mutant]:
    """``count`` mutants of these files (or all): files in turn, in a file its kinds in turn, those chosen least so far first."""
    pools: dict[str, dict[str, list[Mutant]]] = {}
    for file, text in texts.items():
        pools[file] = defaultdict(list)
        found = mutants(file, text, skip)
        for mutant in random.Random(f"{seed} {file}").sample(found, len(found)):
            pools[file][mutant.kind].append(mutant)
    chosen: list[Mutant] = []
    here: dict[tuple[str, str], int] = defaultdict(int)
    overall: dict[str, int] = defaultdict(int)
    while len(chosen) < count and any(pool for kinds in pools.values() for pool in kinds.values()):
        for file, kinds in pools.items():
            ready = [kind for kind in KINDS if kinds[kind]]
            if not ready or len(chosen) == count:
                continue
            kind = min(ready, key=lambda one: (here[file, one], overall[one], KINDS.index(one)))
            mutant = kinds[kind].pop()
            if is_fault(mutant, texts[file]):
                here[file, kind] += 1
                overall[kind] += 1
                chosen.append(mutant)
    return chosen
