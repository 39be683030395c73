"""The scoreboard sees every kind of difference, and says where it is."""

import numpy as np
import pytest

from eskin.cosim.latency import budgets, cycle_table, decision_latencies, needed_clock, step_limit_frames
from eskin.cosim.scoreboard import DECISION_FIELDS, FLAT_STAGES, compare, read_capture
from eskin.golden.core import PRESETS, AcceleratorConfig
from tests.support.link_flow import pack_decisions
from tests.support.table import each_row

CONFIG = AcceleratorConfig.of(
    taxels=4,
    hidden=4,
    class_names=("a", "b", "c"),
    hop=3,
    window=7,
    touch_frames=12,
    steps=3,
    pretrigger_frames=0,
)
FLAGGED = CONFIG.replace(fault_frames=16)
SIZES = {"sum": 4, "fault": 4, "feature": 4, "state": 4, "logit": 3}
NUMBERS = (5, 9)


def pack(row) -> int:
    return pack_decisions(CONFIG, [row])[0]


@pytest.fixture
def expected() -> dict[str, np.ndarray]:
    """Recording 5: one whole touch of three steps in 12 frames. Recording 9: two steps, then its end."""
    rng = np.random.default_rng(3)
    rows = ["001", "012", "022", "122", "000", "011", "110"]  # global, step, class
    rest = [(40, 0, 0), (65535, 0, 0), (7, 0, 0), (1, 0, 1), (3, 0, 0), (9, 0, 0), (0, 1, 0)]
    arrays: dict[str, np.ndarray] = {
        "numbers": np.array(NUMBERS),
        "offsets": np.array([0, 12, 22]),
        "touches": np.array([1, 1]),
        "decision": np.array([[*map(int, row), *others] for row, others in zip(rows, rest, strict=True)]),
        "decision_offsets": np.array([0, 4, 7]),
        "decision_frame": np.array([7, 10, 12, 12, 7, 10, 0]),
    }
    for stage in FLAT_STAGES:
        arrays[stage] = rng.integers(-900, 900, 5 * SIZES[stage])
        arrays[f"{stage}_offsets"] = np.array([0, 3, 5]) * SIZES[stage]
    arrays["feature"][0], arrays["state"][0] = 0, -5
    return arrays


@pytest.fixture
def work(tmp_path, expected):
    """A capture that agrees: frame f ends at cycle 20 f, a decision is offered 9 cycles after the frame that
    brings it."""
    lines: dict[str, list[str]] = {stage: [] for stage in (*FLAT_STAGES, "decision")}
    for position, number in enumerate(NUMBERS):
        for stage in FLAT_STAGES:
            low, high = expected[f"{stage}_offsets"][position : position + 2]
            for index, value in enumerate(expected[stage][low:high]):
                lines[stage].append(f"{number} {int(value) & 0xFFFFFFFF:08x} {100 + index}")
        low, high = expected["decision_offsets"][position : position + 2]
        for row, frame in zip(
            expected["decision"][low:high], expected["decision_frame"][low:high], strict=True
        ):
            at = 20 * (12 * position + frame) + 9 + row[0]
            lines["decision"].append(f"{number} {pack(row):08x} {at} {at}")
    lines["step"] = ["5 0000000a 1", "5 0000000c 2", "5 0000000b 3", "9 0000000c 4", "9 0000000c 5"]
    lines["status"] = ["5 0001 0002 0001 3", "9 0001 000a 0001 300"]
    names = "cycles frames recordings input_stalls overruns protocol_errors unknown stuck stuck_recording"
    lines["summary"] = [f"{name} 0" for name in f"{names} stuck_frame armed_at".split()]
    lines["summary"].append("frame_cycles_max 4")
    for name, text in lines.items():
        (tmp_path / f"{name}.txt").write_text("".join(f"{line}\n" for line in text))
    (20 * np.arange(1, 23)).astype("<u4").tofile(tmp_path / "frames.bin")
    return tmp_path


def change(work, name: str, number: int, line: str | None) -> None:
    """Line ``number`` of a file becomes ``line``; None: it is gone; behind the last: it is added."""
    path = work / f"{name}.txt"
    lines = path.read_text().splitlines()
    lines[number : number + 1] = [] if line is None else [line]
    path.write_text("".join(f"{line}\n" for line in lines))


def test_agreement_counts_every_value(expected, work):
    verdict = compare(CONFIG, expected, read_capture(work))
    assert verdict.bit_exact
    counted = {stage: 5 * size for stage, size in SIZES.items()} | {"decision": 7 * 6, "status": 2 * 3}
    assert verdict.compared_values == sum(counted.values())
    assert verdict.stages == {
        stage: {"compared_values": values, "mismatches": 0} for stage, values in counted.items()
    }


def test_a_stage_that_the_design_does_not_have_is_not_listed(expected, work):
    expected["fault"], expected["fault_offsets"] = np.zeros(0), np.zeros(3, dtype=int)
    (work / "fault.txt").write_text("")
    there = ["sum", "feature", "state", "logit", "decision", "status"]
    assert list(compare(CONFIG, expected, read_capture(work)).stages) == there
    expected["flags"] = np.zeros((2, 4), dtype=bool)
    assert "fault" in compare(FLAGGED, expected, read_capture(work)).stages
    change(work, "fault", 0, "5 00000001 7")  # a value that nobody expects is seen all the same
    assert compare(CONFIG, expected, read_capture(work)).stages["fault"]["mismatches"] == 1


@each_row("stage", FLAT_STAGES)
def test_one_wrong_value_is_told_with_its_place(expected, work, stage):
    index = 2 * SIZES[stage] + 1
    value, kept = int(expected[stage][index]), (work / f"{stage}.txt").read_text()
    change(work, stage, index, f"5 {value + 1 & 0xFFFFFFFF:08x} 777")
    verdict = compare(CONFIG, expected, read_capture(work))
    (work / f"{stage}.txt").write_text(kept)
    assert verdict.mismatches == verdict.stages[stage]["mismatches"] == 1 and not verdict.bit_exact
    place = f"recording 5, frame 12, stage {stage}, index {index} (touch 0, step 2, {FLAT_STAGES[stage]} 1)"
    assert str(verdict.first[0]) == f"{place}: expected {value}, got {value + 1} at cycle 777"


DECISION = [0, 1, 2, 65535, 0, 0]
CHANGES = [
    # sign extension counts
    ([("state", 0, "5 0000fffb 1")], [(5, "state", 0, "unit 0")]),
    # missing, and then superfluous values
    ([("sum", 19, None), ("sum", 18, None)], [(9, "sum", 6, "taxel 2"), (9, "sum", 7, "taxel 3")]),
    ([("logit", 99, "9 00000001 5")], [(9, "logit", 6, "after the last step")]),
    ([("logit", 99, "6 00000001 5")], [(6, "logit", 0, "not played")]),
    # an X is no 0
    *(
        ([("feature", 0, f"5 {word} 1")], [(5, "feature", 0, "taxel 0")])
        for word in ("0000000x", "xxxxxxxx", "0000000z", "0000X000")
    ),
    # each field of a decision
    *(
        (
            [("decision", 1, f"5 {pack([v ^ (k == column) for k, v in enumerate(DECISION)]):08x} 8 8")],
            [(5, "decision", 1, f"{name} of step 1")],
        )
        for column, name in enumerate(DECISION_FIELDS)
    ),
    (
        [("decision", 6, "9 xxxxxxxx 8 8"), ("decision", 3, None), ("decision", 99, "9 00000000 9 9")],
        [(5, "decision", 3, "whole"), (9, "decision", 2, "payload"), (9, "decision", 3, "whole")],
    ),
    # registers at the end
    *(
        ([("status", 1, line)], [(9, "status", index, place)])
        for line, index, place in (
            ("9 0009 0002 0001 3", 0, "NO_TOUCH"),
            ("9 0001 0002 0002 3", 2, "TOUCHES"),
            ("9 0001 0001 0001 3", 1, "FAULTS"),
            ("9 0001 0004 0001 3", 1, "FAULTS"),
            ("9 000x 0002 0001 3", 0, "STATUS"),
            (None, 0, "registers"),
        )
    ),
    # what the harness saw
    ([("summary", 5, "protocol_errors 1")], [(5, "handshake", 0, "changed before")]),
    ([("summary", 6, "unknown 1")], [(5, "handshake", 0, "an X")]),
    ([("summary", 7, "stuck 1")], [(0, "input", 0, "no beat")]),
]
"""Changes (file, line, what it becomes) and the mismatches: recording, stage, index, words of the place."""


def differs(config, expected, work, changes, mismatches) -> None:
    kept = {path: path.read_text() for path in work.glob("*.txt")}
    for part in changes:
        change(work, *part)
    verdict = compare(config, expected, read_capture(work))
    for path, text in kept.items():
        path.write_text(text)
    told = [(m.recording, m.stage, m.index, m.place) for m in verdict.first]
    assert verdict.mismatches == len(told) == len(mismatches), told
    for seen, wanted in zip(told, mismatches, strict=True):
        assert seen[:3] == wanted[:3] and wanted[3] in seen[3]


@each_row(("changes", "mismatches"), CHANGES)
def test_every_difference_is_told(expected, work, changes, mismatches):
    differs(CONFIG, expected, work, changes, mismatches)


RAISED = [[False, False, True, False], [False] * 4]
FLAGS = [
    (RAISED, "5 0001 0040 0001 3 0004", "9 0001 0040 0001 300 0000", None),
    (RAISED, "5 0001 0040 0001 3 0004", "9 0001 0000 0001 300 0000", None),
    (RAISED, "5 0001 0040 0001 3 0005", "9 0001 0040 0001 300 0000", (5, 3, "TAXEL_FAULTS")),
    (RAISED, "5 0001 0040 0001 3 0004", "9 0001 0040 0001 300 0001", (9, 3, "TAXEL_FAULTS")),
    (RAISED, "5 0001 0000 0001 3 0004", "9 0001 0000 0001 300 0000", (5, 4, "TAXEL of FAULTS")),
    (RAISED, "5 0001 0040 0001 3 000x", "9 0001 0040 0001 300 0000", (5, 0, "TAXEL_FAULTS")),
    (RAISED, "5 0001 0040 0001 3", "9 0001 0040 0001 300 0000", (5, 3, "TAXEL_FAULTS")),
    # a flag that nobody raised
    ([[False] * 4] * 2, "5 0001 0040 0001 3 0000", "9 0001 0000 0001 300 0000", (5, 4, "TAXEL of FAULTS")),
]


@each_row(("flags", "first", "second", "mismatch"), FLAGS)
def test_fault_flags_at_the_end(expected, work, flags, first, second, mismatch):
    """Recording 5 leaves the flag of taxel 2 raised, recording 9 none; bit TAXEL of FAULTS may be left of an
    earlier recording."""
    expected["flags"] = np.array(flags)
    wanted = [(mismatch[0], "status", *mismatch[1:])] if mismatch else []
    differs(FLAGGED, expected, work, [("status", 0, first), ("status", 1, second)], wanted)


def test_nothing_compared_is_not_bit_exact(expected, work):
    empty = {name: array[:0] for name, array in expected.items()}
    for name in (*FLAT_STAGES, "decision", "step", "status"):
        (work / f"{name}.txt").write_text("")
    assert not compare(CONFIG, empty, read_capture(work)).bit_exact


@each_row("later", [0, (1 << 32) - 150])
def test_latency_from_frames_and_decisions(expected, work, later):
    """Also over the wrap of the stamp."""
    kept = (work / "decision.txt").read_text()
    ((20 * np.arange(1, 23) + later) % (1 << 32)).astype("<u4").tofile(work / "frames.bin")
    lines = [line.split() for line in kept.splitlines()]
    text = "".join(f"{number} {word} {int(at) + later} 0\n" for number, word, at, _ in lines)
    (work / "decision.txt").write_text(text)
    capture = read_capture(work)
    (work / "decision.txt").write_text(kept)
    assert decision_latencies(expected, capture).tolist() == [9, 9, 9, 10, 9, 9]
    assert cycle_table(CONFIG, expected, capture) == {
        "frame_max": 4,
        "step_min": 10,
        "step_max": 12,
        "step_ideal": CONFIG.step_ideal,
        "decision_latency_max": 10,
    }


def test_step_limit_is_the_closest_pair_of_windows():
    assert step_limit_frames(PRESETS["thesis"]) == 3  # windows 19 and 20 end in frames 6141 and 6144
    assert step_limit_frames(PRESETS["pvdf"]) == 96
    shared = AcceleratorConfig.of(hop=24, window=49, steps=256, pretrigger_frames=0)
    assert [last for _, last in shared.window_spans][-3:] == [6121, 6144, 6144]
    assert step_limit_frames(shared) == 23
    assert step_limit_frames(AcceleratorConfig.of(hop=10, window=20, steps=1, pretrigger_frames=0)) == 10


def test_budgets_and_the_clock_that_meets_them():
    thesis = PRESETS["thesis"]
    cycles = {"frame_max": 20, "step_min": 300, "step_max": 310, "decision_latency_max": 400}
    clock = needed_clock(thesis, cycles)
    assert clock == 1200e3  # 400 cycles within 1/3000 s

    def rows(clock_hz: float, declared: bool = True, overruns: int = 0) -> dict:
        table = budgets(thesis, cycles, clock_hz, declared=declared, overruns=overruns)
        return {row["name"]: row for row in table if not row["reference"]}

    assert {name: row["met"] for name, row in rows(clock).items()} == dict.fromkeys(
        ("frame", "step", "decision"), True
    )
    assert rows(clock)["step"]["limit_s"] == pytest.approx(1e-3)
    assert rows(clock)["frame"]["measured_s"] == pytest.approx(20 / 1200e3)
    assert [name for name, row in rows(clock - 1e4).items() if not row["met"]] == ["decision"]
    assert not rows(clock, overruns=1)["frame"]["met"]
    assert list(rows(clock, declared=False, overruns=9)) == ["step"]
