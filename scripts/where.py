"""``make where NAME=onset_detector``: the files that belong to a block, a stage of the comparison or a verb.

A name is a file's (``classifier``), a stage's (``feature``) or a verb's (``cosim``). A name that fits several
is answered for each.
"""

import difflib
import sys
from collections import defaultdict
from pathlib import Path

from scripts import ROOT
from scripts.docs_site import companions, packages, summary_of

STAGES = {
    "sum": "frontend/window_averager",
    "fault": "frontend/fault_detector",
    "feature": "frontend/normaliser",
    "state": "engine/engine",
    "logit": "engine/engine",
    "decision": "decision/classifier",
}
"""The block of rtl/ that produces each compared stage."""


def index() -> dict[str, list[Path]]:
    """The modules of every name: files of that name, then the block of that stage, then the file of that
    verb's command, and its job."""
    files = defaultdict(list)
    for path in (path for paths in packages().values() for path in paths):
        files[path.stem].append(path)
    for stage, block in STAGES.items():
        files[stage].append(ROOT / "rtl" / f"{block}.py")
    for path in (ROOT / "eskin/verbs").glob("*.py"):
        verb, job = path.stem.strip("_"), path.with_name(f"{path.stem}_job.py")
        files[verb] = [path, *([job] if job.exists() else []), *files[verb]]
    return {name: list(dict.fromkeys(paths)) for name, paths in files.items()}


def card(paths: list[Path]) -> list[str]:
    """Text lines: each module with its summary, test, proof and golden model."""
    lines = []
    for path in paths:
        lines.append(f"{path.relative_to(ROOT)}: {summary_of(path)}")
        for kind, files in companions(path).items():
            lines += [f"    {kind:6} {file.relative_to(ROOT)}" for file in files]
    return lines


def main(names: list[str]) -> int:
    """Print the card of every name; 2 where a name is unknown, with the nearest ones."""
    files = index()
    if not names:
        print("give a block, a stage or a verb, for example: make where NAME=classifier", file=sys.stderr)
        return 2
    for name in names:
        if name not in files:
            alike = ", ".join(difflib.get_close_matches(name, sorted(files), 4) or STAGES)
            print(f"nothing is called {name}; near it: {alike}", file=sys.stderr)
            return 2
        print("\n".join(card(files[name])))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
