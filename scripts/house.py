"""Size of a checkout: ``python -m scripts.house [ROOT]`` prints a table, folder by folder; ``--budget``
(``make budget``) compares this checkout with the caps of budget.toml. A token is one of Python's
tokenizer, without comments, line ends and indentation; names and phrases are words that say too little."""

import ast
import io
import re
import subprocess
import sys
import tokenize
import tomllib
from collections import ChainMap
from pathlib import Path
from typing import Annotated

import pandas as pd
import typer

from eskin.golden.core.groups import GROUP_OF

SHAPE = {"COMMENT", "NL", "NEWLINE", "INDENT", "DEDENT", "ENCODING", "ENDMARKER"}
BYTES = {
    "templates": ("*/templates/*",),
    "sv": ("*.sv", "*.svh", "*.v"),
    "cpp": ("*.cpp", "*.c", "*.h"),
    "toml": ("*.toml",),
}
"""Files whose bytes are counted too: git's patterns."""
NAMES = set("told said asked taken held came calm wary near behind alone kept fresh one".split())
"""Names of values, parameters and functions that do not say what they hold."""
PHRASES = re.compile(r"\b(those of|that of|the one|its own|what is|who)\b", re.IGNORECASE)
"""Stand in docstrings and comments where a noun belongs."""
LONG_STRING = 200
"""Characters of a string from which on it is counted, a docstring never."""


def tracked(root: Path, *patterns: str) -> list[Path]:
    """The files that git knows, relative to ``root``; links left out."""
    listed = subprocess.check_output(["git", "ls-files", "-z", *patterns], cwd=root, text=True)
    names = map(Path, listed.split("\0"))
    return [name for name in names if (root / name).is_file() and not (root / name).is_symlink()]


def tokens(text: str) -> int:
    """Tokens of a Python file."""
    each = tokenize.generate_tokens(io.StringIO(text).readline)
    return sum(tokenize.tok_name[token.type] not in SHAPE for token in each)


def long_strings(text: str) -> int:
    """Characters of the strings of a Python file that are longer than LONG_STRING."""
    lengths, skipped = [], set[ast.AST]()
    for node in ast.walk(ast.parse(text)):  # a node before its parts
        if isinstance(node, ast.Expr | ast.JoinedStr):
            skipped |= set(ast.iter_child_nodes(node))
        parts = node.values if isinstance(node, ast.JoinedStr) else {node} - skipped
        texts = (part.value for part in parts if isinstance(part, ast.Constant))
        lengths.append(sum(len(value) for value in texts if isinstance(value, str)))
    return sum(length for length in lengths if length > LONG_STRING)


def unclear(text: str) -> tuple[int, int]:
    """Names out of NAMES that a Python file binds, and PHRASES in its docstrings and comments."""
    each = tokenize.generate_tokens(io.StringIO(text).readline)
    names, prose = 0, [token.string.strip("#") for token in each if token.type == tokenize.COMMENT]
    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.arg(arg=name) | ast.FunctionDef(name=name) | ast.Name(id=name, ctx=ast.Store()):
                names += name in NAMES
            case ast.Attribute(attr=name, ctx=ast.Store()):
                names += name in NAMES
            case ast.Expr(value=ast.Constant(value=str(docstring))):
                prose.append(docstring)
    return names, len(PHRASES.findall(" ".join(" ".join(prose).split())))


def files(root: Path) -> pd.DataFrame:
    """A row for each Python file that git knows."""
    rows = []
    for path in tracked(root, "*.py"):
        text = (root / path).read_text()
        counts = (text.count("\n"), tokens(text), long_strings(text), *unclear(text))
        rows.append((path.parts[0], *counts))
    return pd.DataFrame(rows, columns=["folder", "lines", "tokens", "long_strings", "names", "phrases"])


def options() -> int:
    """Options and arguments of all verbs, ``--help`` not counted."""
    from eskin.cli.common import VERBS
    from eskin.cli.main import command_of

    return sum(len(command_of(verb).params) for verb in VERBS)


def figures(root: Path) -> dict[str, int]:
    """Current figures beside the caps of budget.toml."""
    python = files(root)
    today = python.groupby("folder")["tokens"].sum().to_dict()
    for kind, patterns in BYTES.items():
        today[kind] = sum((root / name).stat().st_size for name in tracked(root, *patterns))
    sums = python[["long_strings", "names", "phrases"]].sum().to_dict()
    return today | sums | {"options": options(), "fields": len(GROUP_OF)}


def over_budget(today: dict[str, int], caps: dict[str, int]) -> list[str]:
    """A sentence for each figure above its cap; what has no cap may not be there."""
    return [
        f"{name} is {figure}, above its cap of {cap}"
        for name, figure in today.items()
        if figure > (cap := caps.get(name, 0))
    ]


def lowered(text: str, today: dict[str, int]) -> str:
    """budget.toml with every cap lowered to today's figure: up to the next hundred, small ones exactly."""

    def least(cap: re.Match[str]) -> str:
        step = 100 if int(cap[2]) >= 1000 else 1
        return f"{cap[1]} = {min(int(cap[2]), -(-today[cap[1]] // step) * step)}"

    return re.sub(r"(?m)^(\w+) = (\d+)$", least, text)


def main(
    root: Annotated[Path, typer.Argument()] = Path("."), budget: bool = False, lower: bool = False
) -> None:
    """Print the table of the Python files that git knows in ROOT, links left out; with --budget today's
    figures beside the caps of budget.toml, with --lower after lowering them."""
    if not (budget or lower):
        print(files(root).groupby("folder").sum())
        return
    today, file = figures(root), root / "budget.toml"
    if lower:
        file.write_text(lowered(file.read_text(), today))
    caps = dict(ChainMap(*tomllib.loads(file.read_text()).values()))
    print(pd.DataFrame({"today": today, "cap": caps}))
    sys.exit("\n".join(over_budget(today, caps)) or 0)


if __name__ == "__main__":
    typer.run(main)
