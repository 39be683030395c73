"""`make formal`: every proof and every seeded bug, two at a time, and the table of what came out.

``python -m formal.run [--quick] [--jobs N] [WORD ...]``: only the proofs whose title has one of the words;
``--quick`` only those of ``make test``. A job whose circuit and task are those of an earlier run is not run
again, so an interrupted run goes on where it was. Exit status 0 where every proof passed and every bug was
found. The table is also build/formal/proofs.md and proofs.json.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

from rich.console import Console
from rich.table import Table

from eskin.rtl.fpga.tools import run_tool
from formal.job import BUILD, MODULES, ROOT, SECONDS, folder_of
from formal.proof import PROOFS, Proof

Job = tuple[str, int | None]
"""Title of a proof, number of its seeded bug or None."""


def proofs(words: list[str] | None = None, quick: bool = False) -> list[Proof]:
    """All proofs by title, or those asked for."""
    for module in MODULES.values():
        importlib.import_module(module)
    chosen = [PROOFS[title] for title in sorted(PROOFS)]
    if words:
        chosen = [one for one in chosen if any(word in one.title for word in words)]
    return [one for one in chosen if one.quick] if quick else chosen


class Runner:
    """Runs jobs in processes of their own, which end with it."""

    def __init__(self, jobs: int) -> None:
        self._jobs, self._running, self._stopped = jobs, set(), False
        self._lock = threading.Lock()

    def results(self, work: list[Job]):
        """(job, result) as they are done, the longest begun first."""
        with ThreadPoolExecutor(self._jobs) as pool:
            waiting = {pool.submit(self.run, job): job for job in sorted(work, key=_expected, reverse=True)}
            try:
                for done in as_completed(waiting):
                    yield waiting[done], done.result()
            finally:
                self._stop()
                pool.shutdown(cancel_futures=True)

    def run(self, job: Job) -> dict:
        """One job's result; formal/job.py imports the design anew, so never in this process."""
        title, number = job
        command = [sys.executable, "-m", "formal.job", title, *([] if number is None else [str(number)])]
        with self._lock:
            if self._stopped:
                return {"verdict": "STOPPED"}
            # in a session of its own: a Ctrl-C reaches this process alone, which then ends the others
            process = subprocess.Popen(
                command,
                cwd=ROOT,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                start_new_session=True,
            )
            self._running.add(process)
        try:
            said, complaint = process.communicate(timeout=SECONDS + 60)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGTERM)
            said, complaint = process.communicate()
        with self._lock:
            self._running.discard(process)
        if process.returncode:
            return {
                "verdict": "ERROR",
                "seconds": 0.0,
                "broken": [],
                "cycle": None,
                "kept": False,
                "said": complaint.strip(),
            }
        return json.loads(said.splitlines()[-1])

    def _stop(self) -> None:
        with self._lock:
            self._stopped = True
            for process in self._running:
                os.killpg(process.pid, signal.SIGTERM)


def _expected(job: Job) -> float:
    """Seconds of the last run; for a job that was never run, as if it were long."""
    try:
        return json.loads((folder_of(*job) / "result.json").read_text())["seconds"]
    except (OSError, ValueError, KeyError):
        return 1000.0 if job[1] is None else 500.0


def good(job: Job, result: dict) -> bool:
    """A proof passed; a bug was found."""
    return result["verdict"] == ("PASS" if job[1] is None else "FAIL")


def rows(chosen: list[Proof], results: dict[Job, dict]) -> list[dict]:
    """The table, one dict a proof."""
    found = []
    for one in chosen:
        result = results[one.title, None]
        bugs = [
            {"bug": bug.name, "file": bug.file, "found": good((one.title, number), kept)}
            | {key: kept[key] for key in ("verdict", "cycle", "broken", "seconds")}
            for number, bug in enumerate(one.bugs)
            for kept in [results[one.title, number]]
        ]
        found.append(
            {
                "proof": one.title,
                "claim": one.claim,
                "method": one.method,
                "depth": one.depth,
                "reduced": one.reduced,
                "verdict": result["verdict"],
                "seconds": result["seconds"],
                "bugs": bugs,
            }
        )
    return found


def markdown(table: list[dict]) -> str:
    """The table as Markdown."""
    lines = [
        "| proof | what it proves | method | configuration reduced to | seconds | seeded bug: broken "
        "property, cycle |",
        "|" + " --- |" * 6,
    ]
    for row in table:
        verdict = "proved" if row["verdict"] == "PASS" else row["verdict"]
        method = f"{'k-induction' if row['method'] == 'induction' else row['method']}, depth {row['depth']}"
        bugs = "<br>".join(_bug(bug) for bug in row["bugs"])
        lines.append(
            f"| {row['proof']} ({verdict}) | {row['claim']} | {method} | {row['reduced']} | "
            f"{row['seconds']} | {bugs} |"
        )
    return "\n".join(lines) + "\n"


def _bug(bug: dict) -> str:
    if not bug["found"]:
        return f"{bug['bug']}: NOT FOUND ({bug['verdict']})"
    where = f"{'; '.join(bug['broken'])}, {bug['cycle']}" if bug["broken"] else "found"
    return f"{bug['bug']}: {where}"


def show(table: list[dict], console: Console) -> None:
    """The table on a terminal."""
    shown = Table(show_lines=True)
    for name in (
        "proof",
        "what it proves",
        "method, depth",
        "reduced to",
        "s",
        "seeded bug: cycle in which it is found",
    ):
        shown.add_column(name, overflow="fold")
    for row in table:
        verdict = "" if row["verdict"] == "PASS" else f" [red]{row['verdict']}[/red]"
        bugs = "\n".join(
            f"{bug['bug']}: {bug['cycle'] if bug['found'] else '[red]NOT FOUND[/red]'}" for bug in row["bugs"]
        )
        shown.add_row(
            row["proof"] + verdict,
            row["claim"],
            f"{row['method']} {row['depth']}",
            row["reduced"],
            str(row["seconds"]),
            bugs,
        )
    console.print(shown)


def write(path: Path, text: str) -> None:
    """A whole file or none."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    part.write_text(text)
    part.replace(path)


def main(arguments: list[str] | None = None) -> int:
    """The command; its exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m formal.run", description="Prove the hardware's properties; find the seeded bugs."
    )
    parser.add_argument("words", nargs="*", help="only proofs whose title has one of these")
    parser.add_argument("--quick", action="store_true", help="only the proofs of make test")
    parser.add_argument("--jobs", type=int, default=2, help="at a time (2)")
    options = parser.parse_args(arguments)
    chosen = proofs(options.words, options.quick)
    if not chosen:
        parser.error("no proof has that in its title")
    work: list[Job] = [(one.title, number) for one in chosen for number in (None, *range(len(one.bugs)))]
    signal.signal(signal.SIGTERM, signal.getsignal(signal.SIGINT))  # ends the jobs, too
    console, began, results = Console(), time.monotonic(), {}
    console.width = max(console.width, 140)  # where there is no terminal, too
    try:
        run_tool("yosys", ["-V"], ROOT)  # compiles itself on its first use, not in two jobs at once
        for job, result in Runner(options.jobs).results(work):
            results[job] = result
            what = "proof" if job[1] is None else f"bug '{PROOFS[job[0]].bugs[job[1]].name}'"
            ok = good(job, result)
            wanted = "proved" if job[1] is None else "found"
            said = wanted if ok else f"NOT {wanted.upper()}: {result['verdict']}"
            kept = " (kept)" if result["kept"] else f" {result['seconds']} s"
            print(f"[{len(results)}/{len(work)}] {job[0]}, {what}: {said}{kept}", flush=True)
            if not ok:
                print(
                    result.get("said")
                    or f"    {'; '.join(result['broken'])}  log: {folder_of(*job) / 'log.txt'}",
                    flush=True,
                )
    except KeyboardInterrupt:
        print(
            f"stopped after {len(results)} of {len(work)}; run it again to go on from there", file=sys.stderr
        )
        return 130
    table = rows(chosen, results)
    failed = [job for job in work if not good(job, results[job])]
    show(table, console)
    count = sum(len(one.bugs) for one in chosen)
    print(
        f"{len(chosen)} proofs, {count} seeded bugs, {len(failed)} not as they should be; "
        f"{time.monotonic() - began:.0f} s"
    )
    if not options.words and not options.quick:
        write(BUILD / "proofs.json", json.dumps(table, indent=1) + "\n")
        write(BUILD / "proofs.md", markdown(table))
        print(f"written: {BUILD / 'proofs.md'}, {BUILD / 'proofs.json'}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
