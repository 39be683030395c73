"""examples/soc: the simulated system decides as the golden model, and a run that does not is told from one that does."""

import re
import subprocess
import sys

import pytest

from scripts import ROOT

WORDS = [1 | 3 << 7 | 749 << 15, 2 | 19 << 7 | 16383 << 15 | 1 << 29 | 1 << 31]
LINES = [
    "class 01 margin 00749 step 003 global 0 partial 0 unsure 0 time 0000815277 us",
    "class 02 margin 16383 step 019 global 1 partial 0 unsure 1 time 0001815277 us",
]
END = "cycles 8000 works 800 most 500 missed 0 violations 0"


@pytest.fixture(autouse=True)
def installed():
    for package in ("ziglang", "pythondata_cpu_serv"):
        pytest.importorskip(package, reason="ziglang (extra soc) is not installed")


def compare(folder, lines):
    (folder / "expected.txt").write_text("".join(f"{word:08x}\n" for word in WORDS))
    (folder / "simulation.f").write_text("-GFRAMES=2\n-GPERIOD=4000\n")
    (folder / "said.txt").write_text("\n".join(["ready", *lines]) + "\n")
    call = [sys.executable, "build.py", "compare", str(folder / "said.txt"), "--out", str(folder)]
    done = subprocess.run(call, cwd=ROOT / "examples/soc", capture_output=True, text=True, timeout=600)
    return done.returncode, done.stdout + done.stderr


@pytest.mark.parametrize(
    "lines, verdict",
    [
        ([*LINES, END], "2 decisions compared, 0 differ"),
        ([LINES[0].replace("00749", "00750"), LINES[1], END], "2 decisions compared, 1 differ"),
        ([*LINES, END.replace("missed 0", "missed 1")], "1 frames missed"),
        (LINES, "did not come to its end"),
    ],
    ids=["same", "other", "late", "broken-off"],
)
def test_each_decision_is_compared(tmp_path, lines, verdict):
    status, text = compare(tmp_path, lines)
    assert verdict in text and status == (lines != [*LINES, END])


def made(*words):
    """What `make` says of a target."""
    done = subprocess.run(
        ["make", *words], cwd=ROOT / "examples/soc", capture_output=True, text=True, timeout=3600
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def decided(output):
    """Names of the runs that compared decisions, none of which differs."""
    counts = re.findall(r"(\w+): (\d+) decisions compared, (\d+) differ", output)
    assert all(int(compared) > 0 and differ == "0" for _, compared, differ in counts)
    return [name for name, *_ in counts]


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_a_recording_each_way_through_the_simulated_system():
    assert decided(made("sim", "RECORDINGS=1")) == ["converter", "cpu"]
    assert decided(made("cpu", "CLOCK=24e6", "RECORDINGS=1", "BEGIN=1500", "FRAMES=1200")) == ["cpu"]


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_bitstreams_reach_their_clocks_and_the_netlist_decides():
    output = made("bitstream")
    clocks = re.findall(r"^(\w+): .*; ([\d.]+) MHz of ([\d.]+)", output, re.MULTILINE)
    assert [board for board, *_ in clocks] == ["icebreaker", "ulx3s"], output
    assert all(float(reached) > float(wanted) for _, reached, wanted in clocks)
    assert decided(made("netlist")) == ["icebreaker"]
