"""Size of a checkout: ``python -m scripts.house [ROOT]`` prints a table, folder by folder; ``--budget``
(``make budget``) compares this checkout with the caps of budget.toml. A token is one of Python's
tokenizer, without comments, line ends and indentation."""

import ast
import io
import re
import subprocess
import sys
import tokenize
import tomllib
from pathlib import Path
from typing import Annotated

import typer

COLUMNS = "folder | files | lines | tokens | longest file | longest function | tests"
SHAPE = {"COMMENT", "NL", "NEWLINE", "INDENT", "DEDENT", "ENCODING", "ENDMARKER"}
BUDGET = "budget.toml"
BYTES = {
    "templates": ("*/templates/*",),
    "sv": ("*.sv", "*.svh", "*.v"),
    "cpp": ("*.cpp", "*.c", "*.h"),
    "toml": ("*.toml",),
}
"""Files whose bytes are counted too: git's patterns."""
LONG_STRING = 200
"""Characters of a string from which on it is counted, a docstring never."""


def tracked(root: Path, *patterns: str) -> list[Path]:
    """The files that git knows, relative to ``root``; links left out."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", *patterns], cwd=root, capture_output=True, text=True, check=True
    )
    names = [Path(name) for name in listed.stdout.split("\0") if name]
    return [name for name in names if (root / name).is_file() and not (root / name).is_symlink()]


def tokens(text: str) -> int:
    """Tokens of a Python file."""
    each = tokenize.generate_tokens(io.StringIO(text).readline)
    return sum(tokenize.tok_name[token.type] not in SHAPE for token in each)


def long_strings(text: str) -> int:
    """Characters of the strings of a Python file that are longer than LONG_STRING."""
    tree = ast.parse(text)
    skipped = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    lengths = []
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            parts = [part for part in node.values if isinstance(part, ast.Constant)]
            skipped |= set(map(id, parts))
            lengths.append(sum(len(str(part.value)) for part in parts))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in skipped:
            lengths.append(len(node.value))
    return sum(length for length in lengths if length > LONG_STRING)


def row(texts: list[str]) -> tuple[float, ...]:
    """The columns of files behind their folder."""
    functions = [
        node for text in texts for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef)
    ]
    lines = [text.count("\n") for text in texts]
    return (
        len(texts),
        sum(lines),
        sum(map(tokens, texts)),
        max(lines),
        max((node.end_lineno or 0) - node.lineno + 1 for node in functions),
        sum(node.name.startswith("test_") for node in functions),
    )


def options() -> int:
    """Options and arguments of all verbs and their sub-commands, ``--help`` not counted."""
    from eskin.cli.main import app

    def count(command) -> int:
        return len(command.params) + sum(map(count, getattr(command, "commands", {}).values()))

    whole = typer.main.get_command(app)
    return count(whole) - len(whole.params)


def fields() -> int:
    """Fields of a configuration."""
    from eskin.golden.core.groups import GROUP_OF

    return len(GROUP_OF)


def figures(root: Path, texts: dict[str, list[str]]) -> dict[str, int]:
    """Current figures beside the caps of budget.toml."""
    every = [text for folder in texts.values() for text in folder]
    sizes = {
        kind: sum((root / name).stat().st_size for name in tracked(root, *patterns))
        for kind, patterns in BYTES.items()
    }
    counted = {folder: sum(map(tokens, files)) for folder, files in texts.items()} | sizes
    return counted | {"long_strings": sum(map(long_strings, every)), "options": options(), "fields": fields()}


def over_budget(today: dict[str, int], caps: dict[str, int]) -> list[str]:
    """A sentence for each figure above its cap; what has no cap may not be there."""
    return [
        f"{name} is {figure}, above its cap of {caps.get(name, 0)}"
        for name, figure in today.items()
        if figure > caps.get(name, 0)
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
    texts: dict[str, list[str]] = {}
    for path in tracked(root, "*.py"):
        texts.setdefault(path.parts[0], []).append((root / path).read_text())
    if not (budget or lower):
        print(f"| {COLUMNS} |\n| --- |" + " --: |" * COLUMNS.count("|"))
        for folder, files in texts.items():
            print(f"| {' | '.join(map(str, (folder, *row(files))))} |")
        return
    today, file = figures(root, texts), root / BUDGET
    if lower:
        file.write_text(lowered(file.read_text(), today))
    caps = {name: cap for table in tomllib.loads(file.read_text()).values() for name, cap in table.items()}
    for name, figure in today.items():
        print(f"{name:14}{figure:8} of {caps.get(name, 0):8}")
    sys.exit("\n".join(over_budget(today, caps)) or 0)


if __name__ == "__main__":
    typer.run(main)
