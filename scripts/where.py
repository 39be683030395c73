"""``make where NAME=onset_detector``: all that belongs to a block, a stage of the comparison or a verb. No second folder has to be opened.

A name is a file's (``classifier``), a stage's (``feature``) or a verb's (``cosim``); one that fits several is answered for each.
"""

from __future__ import annotations

import ast
import difflib
import inspect
import sys
import textwrap
from pathlib import Path

from eskin.cli.main import app
from scripts import docs_site

STAGES = {
    "sum": "rtl/frontend/window_averager.py",
    "fault": "rtl/frontend/fault_detector.py",
    "feature": "rtl/frontend/normaliser.py",
    "state": "rtl/engine/compact_engine.py",
    "logit": "rtl/engine/compact_engine.py",
    "decision": "rtl/decision/classifier.py",
}
"""The block that gives each compared stage."""
SHARED = ("golden/core/errors.py", "golden/core/files.py", "golden/core/jobs.py", "golden/data/load.py", "golden/model/model.py")
"""What nearly every verb calls: not what a search for one verb is after."""


def verbs() -> dict[str, list[Path]]:
    """Every verb of the command line: the file of its options, then the modules that its body calls."""
    found = {}
    for command in app.registered_commands:
        call = command.callback
        assert call is not None
        body = ast.parse(textwrap.dedent(inspect.getsource(call)))
        taken = [node for node in ast.walk(body) if isinstance(node, ast.ImportFrom) and node.module]
        names = [name for node in taken for name in (node.module, *(f"{node.module}.{one.name}" for one in node.names)) if name]
        called = [(docs_site.ROOT / (name.replace(".", "/") + ".py")).resolve() for name in names]
        called = [path for path in called if path.exists() and path.relative_to(docs_site.ROOT).as_posix() not in SHARED]
        home = docs_site.ROOT / Path(call.__code__.co_filename).resolve().relative_to(docs_site.ROOT)
        found[command.name or call.__name__.strip("_").replace("_", "-")] = [home, *called]
    return found


def files_of(name: str) -> list[Path]:
    """The modules that ``name`` stands for: files of that name, the block of that stage, the modules of that verb."""
    found = [path for paths in docs_site.packages().values() for path in paths if path.stem == name]
    if name in STAGES:
        found.append(docs_site.ROOT / STAGES[name])
    return list(dict.fromkeys([*found, *verbs().get(name, [])]))


def card(name: str) -> list[str]:
    """Lines to read: each module of ``name`` with its first sentence, its test, its proof and its golden model."""
    lines = []
    for path in files_of(name):
        said = (ast.get_docstring(ast.parse(path.read_text())) or "").split("\n")[0]
        lines.append(f"{path.relative_to(docs_site.ROOT)}: {said}")
        for kind, others in docs_site.companions(path).items():
            lines += [f"    {kind:6} {other.relative_to(docs_site.ROOT)}" for other in others]
    return lines


def main(names: list[str]) -> int:
    """Print the card of every name; 2 when a name is not known, with the nearest ones."""
    known = {path.stem for paths in docs_site.packages().values() for path in paths} | set(STAGES) | set(verbs())
    if not names:
        print("give a block, a stage or a verb, for example: make where NAME=classifier", file=sys.stderr)
        return 2
    for name in names:
        if name not in known:
            near = ", ".join(difflib.get_close_matches(name, sorted(known), 4)) or ", ".join(STAGES)
            print(f"nothing is called {name}; near it: {near}", file=sys.stderr)
            return 2
        print("\n".join(card(name)))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
