"""``make coverage``: runs the tests, then random designs that begin with what no test has hit, until nothing is missing or the
time is over; writes build/coverage/coverage.html and what it shows as coverage.json.

Every session of pytest merges what it has covered (tests/support/covered.py); a test that runs again replaces
its bins. cocotb-coverage and pyvsc count bins in a simulator's process; neither keeps the tests behind a bin nor the reason why
it cannot be, and both know a case only once a simulator runs, while random designs ask for it before.
"""

import html
import itertools
import json
import subprocess
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Iterable
from typing import Any

import typer

from scripts import ROOT
from scripts.crosses import CROSSES

FOLDER, PLAN = ROOT / "build" / "coverage", ROOT / "tests" / "plan.toml"
PARTS, MERGED = FOLDER / "parts", FOLDER / "coverage.json"
REQUIRED = 0.99
STYLE = ROOT / "eskin" / "pages" / "templates" / "style.css"
CONVERTERS = "mcp3208x2", "ad7476", "spi", "ddc232", "matrix", "mpr121, 13 x 9"
"""Those that the quick tests do not play."""
PINS = [f"tests/cosim/test_converters.py::test_exact_from_the_pins[{name}]" for name in CONVERTERS]
PACES = "dsp", "dsp, stalls", "dsp, declared"
IMAGES = [f"tests/cosim/test_image_cosim.py::test_every_map_is_exact[{pace}]" for pace in PACES]
DESIGNS = [f"tests/test_random_designs.py::test_a_drawn_design_is_exact[{part}]" for part in (0, 1)]
"""A round of designs that begin with missing bins."""
ROUNDS = ["--dist", "worksteal"], ["-m", "slow", "tests/rtl/top/test_system_bus.py", *PINS, *IMAGES]
"""What pytest runs once, before DESIGNS."""
SHOWN = 8
"""Words of a list that the page shows."""


def read() -> dict[str, Any]:
    """hits: test -> bin -> comparisons. curve: tests so far and closed share, a pair for each session. bins: `rows`."""
    return json.loads(MERGED.read_text()) if MERGED.exists() else {"hits": {}, "curve": [], "bins": rows({})}


def merge() -> None:
    """Merge the parts that processes have left."""
    merged, parts = read(), sorted(PARTS.glob("*.json"))
    known = {f"{row['cross']}: {row['bin']}" for row in rows({}) if not row["never"]}
    for test, bins in merged["hits"].items():  # crosses may have changed since
        merged["hits"][test] = {name: count for name, count in bins.items() if name in known}
    for part in parts:
        for test, bins in json.loads(part.read_text()).items():
            counts = Counter(bins)
            if "test_random_designs" in test:  # other designs under the same name
                counts.update(merged["hits"].get(test, {}))
            merged["hits"][test] = counts
    if merged["hits"]:
        merged["bins"] = rows(merged["hits"])
        if parts:
            merged["curve"].append([len(merged["hits"]), round(share(merged["bins"]), 4)])
        MERGED.write_text(json.dumps(merged, indent=1))
    for part in parts:  # last: a wrong bin ends this, and the hits must not be lost
        part.unlink()


def rows(hits: dict[str, dict[str, int]]) -> list[dict[str, Any]]:
    """A row for each bin: cross, bin, its tests, and why it cannot be.

    Raises
    ------
    ValueError
        A bin that cannot be was hit, or one that no cross has.
    """
    tests: dict[str, list[str]] = {}
    for test, bins in sorted(hits.items()):
        for name in bins:
            tests.setdefault(name, []).append(test)
    table = []
    for cross in CROSSES:
        for name, case in cross.bins().items():
            found, never = tests.pop(f"{cross.name}: {name}", []), cross.never(case)
            if found and never:
                raise ValueError(f"{cross.name}: {name}: cannot be ({never}), and {found[0]} hits it")
            table.append({"cross": cross.name, "bin": name, "tests": found, "never": never})
    if tests:
        raise ValueError(f"bins that no cross has: {', '.join(sorted(tests)[:5])}; see scripts/crosses.py")
    return table


def share(table: list[dict[str, Any]]) -> float:
    """Share of the bins that can be that were hit."""
    reachable = [bool(row["tests"]) for row in table if not row["never"]]
    return sum(reachable) / len(reachable)


def wishes(hit: Iterable[str] = ()) -> list[dict[str, Any]]:
    """Fields of configurations that would hit a bin that is not hit."""
    return [
        cross.wish(case)
        for cross in CROSSES
        for name, case in cross.bins().items()
        if cross.wish(case) and f"{cross.name}: {name}" not in hit and not cross.never(case)
    ]


# ---------------------------------------------------------------------- the plan and the page
def plan() -> list[dict[str, Any]]:
    """The rows of tests/plan.toml: section, property, crosses, tests, proofs."""
    return tomllib.loads(PLAN.read_text())["row"]


def _files(tests: Iterable[str]) -> set[str]:
    return {test.split("::")[0] for test in tests}


def page(merged: dict[str, Any]) -> str:
    """coverage.html: holes first, then the plan with all that stands behind a row, then every bin."""
    import pandas as pd  # here, because every session of pytest loads this file

    from scripts.mutants import Scope

    table = pd.DataFrame(merged["bins"])
    missing = table[(table.tests.str.len() == 0) & (table.never == "")]
    closed = {name: f"{share(rows.to_dict('records')):.0%}" for name, rows in table.groupby("cross")}
    planned = pd.DataFrame(plan()).fillna("")
    broken = {file: _files(tests) for file, tests in Scope.load(ROOT).tests.items()}
    planned["files of make mutants"] = [
        [file for file, judges in broken.items() if judges & _files(tests)] for tests in planned.tests
    ]
    planned.crosses = [[f"{name}: {closed[name]}" for name in names] for names in planned.crosses]
    parts = [
        f"<h1>Coverage: {share(merged['bins']):.1%} of {(table.never == '').sum()} bins that can be</h1>",
        f"<p>{len(missing)} are missing, {(table.never != '').sum()} cannot be. Closed share by session:</p>",
        _curve(merged["curve"]),
        f"<h2>Missing</h2>{_table(missing[['cross', 'bin']])}<h2>Plan</h2>{_table(planned)}<h2>Crosses</h2>",
    ]
    for cross in CROSSES:
        bins = table[table.cross == cross.name][["bin", "tests", "never"]]
        parts += [
            f"<h3>{cross.name} (section {cross.section}): {closed[cross.name]}</h3><p>{cross.reason}</p>",
            f"<details><summary>{len(bins)} bins</summary>{_table(bins)}</details>",
        ]
    head = '<!doctype html><meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>Coverage</title>'
    wide = f"{STYLE.read_text()} body {{ max-width: 96vw }} td {{ min-width: 9em; overflow-wrap: anywhere }}"
    return f"{head}<style>{wide}</style>{''.join(parts)}"


def _table(frame: Any) -> str:
    """Rows of words and of lists of words; of a long list the first."""

    def cell(value: Any) -> str:
        words = value if isinstance(value, list) else [value]
        more = [f"and {len(words) - SHOWN} more"] * (len(words) > SHOWN)
        return "<br>".join(html.escape(str(word)) for word in [*words[:SHOWN], *more])

    return frame.map(cell).to_html(index=False, escape=False, border=0)


def _curve(points: list[list[float]]) -> str:
    """The closed share by session, as a picture and in words."""
    step = 600 / max(len(points) - 1, 1)
    line = " ".join(
        f"{step * place:.0f},{160 - 150 * closed:.0f}" for place, (_, closed) in enumerate(points)
    )
    words = ", ".join(f"{closed:.1%} after {tests} tests" for tests, closed in points)
    return (
        '<svg viewBox="0 0 600 170" style="max-width: 600px; width: 100%"><path d="M0,10H600M0,160H600" stroke="#888"/>'
        f'<polyline points="{line}" fill="none" stroke="#0072B2" stroke-width="3"/></svg><p>{words}</p>'
    )


def main(minutes: float = 0) -> None:
    """Merge and write the page; with --minutes first the tests, then random designs, so long at most. The status is 1
    below the required share."""
    end = time.monotonic() + 60 * minutes
    if minutes:
        MERGED.unlink(missing_ok=True)
    rounds = itertools.chain(ROUNDS, itertools.repeat(["--hypothesis-profile=long", *DESIGNS]))
    while (left := end - time.monotonic()) > 0 and share(read()["bins"]) < REQUIRED:
        command = [sys.executable, "-m", "pytest", "-n2", *next(rounds)]
        running = subprocess.Popen(command, cwd=ROOT, start_new_session=True)
        try:
            if running.wait(left):
                sys.exit("a test fails: see above")
        except subprocess.TimeoutExpired:
            running.kill()
            time.sleep(5)  # its processes that have no test write their parts
            break
        finally:  # simulators have groups of their own
            subprocess.call(["pkill", "-KILL", "-s", str(running.pid)])
    merge()
    merged = read()
    FOLDER.mkdir(parents=True, exist_ok=True)
    (FOLDER / "coverage.html").write_text(page(merged))
    closed = share(merged["bins"])
    print(f"{closed:.1%} closed; {FOLDER / 'coverage.html'}")
    sys.exit(closed < REQUIRED)


if __name__ == "__main__":
    typer.run(main)
