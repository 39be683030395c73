"""How large a checkout is, folder by folder: ``python -m scripts.house [ROOT]`` prints the table of
docs/changing.md. A token is what Python's tokenizer gives, comments, line ends and indentation left out."""

import argparse
import ast
import io
import subprocess
import tokenize
from pathlib import Path

COLUMNS = "folder | files | lines | tokens | longest file | longest function | lines over 110 (%) | tests"
SHAPE = {"COMMENT", "NL", "NEWLINE", "INDENT", "DEDENT", "ENCODING", "ENDMARKER"}


def row(texts: list[str]) -> tuple[float, ...]:
    """The columns of files behind their folder."""
    functions = [
        node for text in texts for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef)
    ]
    tokens = [token for text in texts for token in tokenize.generate_tokens(io.StringIO(text).readline)]
    lines = [text.splitlines() for text in texts]
    over = sum(len(line) > 110 for file in lines for line in file)
    return (
        len(texts),
        sum(map(len, lines)),
        sum(tokenize.tok_name[token.type] not in SHAPE for token in tokens),
        max(map(len, lines)),
        max((node.end_lineno or 0) - node.lineno + 1 for node in functions),
        round(100 * over / sum(map(len, lines)), 1),
        sum(node.name.startswith("test_") for node in functions),
    )


def main() -> None:
    """Print the table of the Python files that git knows, links left out."""
    parser = argparse.ArgumentParser(
        description=main.__doc__, epilog="example: scripts/house.py ../eskin-0.2.0"
    )
    parser.add_argument("root", nargs="?", default=".", help="a checkout (default: this folder)")
    root = parser.parse_args().root
    listed = subprocess.run(["git", "ls-files", "*.py"], cwd=root, capture_output=True, text=True, check=True)
    texts: dict[str, list[str]] = {}
    for name in listed.stdout.split():
        texts.setdefault(name.partition("/")[0], []).append((Path(root) / name).read_text())
    print(f"| {COLUMNS} |\n| --- |" + " --: |" * COLUMNS.count("|"))
    for folder, files in texts.items():
        print(f"| {' | '.join(map(str, (folder, *row(files))))} |")


if __name__ == "__main__":
    main()
