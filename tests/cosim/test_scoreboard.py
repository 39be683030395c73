"""The scoreboard sees every kind of difference, and says where it is."""

from __future__ import annotations

import numpy as np
import pytest

from eskin.cosim.latency import budgets, cycle_table, decision_latencies, needed_clock, step_limit_frames
from eskin.cosim.scoreboard import DECISION_FIELDS, FLAT_STAGES, Mismatch, compare, read_capture
from eskin.golden.core.config import PRESETS, AcceleratorConfig

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
SIZES = {"sum": 4, "fault": 4, "feature": 4, "state": 4, "logit": 3}
NUMBERS = (5, 9)


def pack(row) -> int:
    return sum(int(value) << low for value, (low, _) in zip(row, DECISION_FIELDS.values(), strict=True))


@pytest.fixture
def expected() -> dict[str, np.ndarray]:
    """Recording 5: one whole touch of three steps in 12 frames. Recording 9: two steps, then its end."""
    rng = np.random.default_rng(3)
    arrays: dict[str, np.ndarray] = {
        "numbers": np.array(NUMBERS),
        "offsets": np.array([0, 12, 22]),
        "touches": np.array([1, 1]),
    }
    for stage in FLAT_STAGES:
        arrays[stage] = rng.integers(-900, 900, 5 * SIZES[stage])
        arrays[f"{stage}_offsets"] = np.array([0, 3, 5]) * SIZES[stage]
    arrays["decision"] = np.array(
        [
            [0, 0, 1, 40, 0, 0],
            [0, 1, 2, 65535, 0, 0],
            [0, 2, 2, 7, 0, 0],
            [1, 2, 2, 1, 0, 1],
            [0, 0, 0, 3, 0, 0],
            [0, 1, 1, 9, 0, 0],
            [1, 1, 0, 0, 1, 0],
        ]
    )
    arrays["decision_offsets"] = np.array([0, 4, 7])
    arrays["decision_frame"] = np.array([7, 10, 12, 12, 7, 10, 0])
    return arrays


@pytest.fixture
def work(tmp_path, expected):
    """A capture that agrees: frame f ends at cycle 20 f, a decision is offered 9 cycles after the frame that
    brings it."""
    for stage in FLAT_STAGES:
        lines = []
        for position, number in enumerate(NUMBERS):
            low, high = expected[f"{stage}_offsets"][position : position + 2]
            lines += [
                f"{number} {int(v) & 0xFFFFFFFF:08x} {100 + i}\n"
                for i, v in enumerate(expected[stage][low:high])
            ]
        (tmp_path / f"{stage}.txt").write_text("".join(lines))
    lines = []
    for position, number in enumerate(NUMBERS):
        low, high = expected["decision_offsets"][position : position + 2]
        for row, frame in zip(
            expected["decision"][low:high], expected["decision_frame"][low:high], strict=True
        ):
            at = 20 * (12 * position + frame) + 9 + row[0]
            lines.append(f"{number} {pack(row):08x} {at} {at}\n")
    (tmp_path / "decision.txt").write_text("".join(lines))
    (tmp_path / "step.txt").write_text(
        "5 0000000a 1\n5 0000000c 2\n5 0000000b 3\n9 0000000c 4\n9 0000000c 5\n"
    )
    (tmp_path / "status.txt").write_text("5 0001 0002 0001 3\n9 0001 000a 0001 300\n")
    (20 * np.arange(1, 23)).astype("<u4").tofile(tmp_path / "frames.bin")
    names = "cycles frames recordings input_stalls overruns frame_cycles_max protocol_errors unknown"
    names += " stuck stuck_recording stuck_frame armed_at"
    (tmp_path / "summary.txt").write_text(
        "".join(f"{name} {4 if name == 'frame_cycles_max' else 0}\n" for name in names.split())
    )
    return tmp_path


def replace_line(path, number: int, line: str | None) -> None:
    """Line ``number`` becomes ``line`` (None: is gone)."""
    lines = path.read_text().splitlines(keepends=True)
    lines[number : number + 1] = [] if line is None else [line + "\n"]
    path.write_text("".join(lines))


def verdict_of(expected, work):
    return compare(CONFIG, expected, read_capture(work))


def test_agreement_counts_every_value(expected, work):
    verdict = verdict_of(expected, work)
    assert verdict.bit_exact
    assert verdict.compared_values == 5 * sum(SIZES.values()) + 7 * 6 + 2 * 3
    counted = {stage: 5 * size for stage, size in SIZES.items()} | {"decision": 7 * 6, "status": 2 * 3}
    assert verdict.stages == {
        stage: {"compared_values": values, "mismatches": 0} for stage, values in counted.items()
    }


def test_a_stage_that_the_design_does_not_have_is_not_listed(expected, work):
    expected["fault"], expected["fault_offsets"] = np.zeros(0), np.zeros(3, dtype=int)
    (work / "fault.txt").write_text("")
    assert list(verdict_of(expected, work).stages) == [
        "sum",
        "feature",
        "state",
        "logit",
        "decision",
        "status",
    ]
    expected["flags"] = np.zeros((2, 4), dtype=bool)
    assert "fault" in compare(CONFIG.replace(fault_frames=16), expected, read_capture(work)).stages
    (work / "fault.txt").write_text("5 00000001 7\n")  # a value that nobody expects is seen all the same
    assert verdict_of(expected, work).stages["fault"]["mismatches"] == 1


@pytest.mark.parametrize("stage", FLAT_STAGES)
def test_one_wrong_value(expected, work, stage):
    index = 2 * SIZES[stage] + 1
    replace_line(work / f"{stage}.txt", index, f"5 {int(expected[stage][index]) + 1 & 0xFFFFFFFF:08x} 777")
    verdict = verdict_of(expected, work)
    assert verdict.mismatches == 1 and not verdict.bit_exact
    assert {name for name, counts in verdict.stages.items() if counts["mismatches"]} == {stage}
    want = int(expected[stage][index])
    assert verdict.first[0] == Mismatch(
        5, stage, index, f"touch 0, step 2, {FLAT_STAGES[stage]} 1", 12, want, want + 1, 777
    )
    for part in (
        "recording 5",
        "frame 12",
        f"stage {stage}",
        f"index {index}",
        f"expected {want}",
        f"got {want + 1}",
    ):
        assert part in str(verdict.first[0])


def test_sign_extension_counts(expected, work):
    index = int(np.flatnonzero(expected["state"][:12] < 0)[0])
    replace_line(work / "state.txt", index, f"5 {int(expected['state'][index]) & 0xFFFF:08x} 1")
    assert verdict_of(expected, work).mismatches == 1


def test_missing_values(expected, work):
    replace_line(work / "sum.txt", 19, None)
    replace_line(work / "sum.txt", 18, None)
    verdict = verdict_of(expected, work)
    assert verdict.mismatches == 2
    assert [(m.recording, m.index, m.actual) for m in verdict.first] == [(9, 6, None), (9, 7, None)]


def test_superfluous_value(expected, work):
    with (work / "logit.txt").open("a") as file:
        file.write("9 00000001 5\n")
    verdict = verdict_of(expected, work)
    assert verdict.mismatches == 1
    assert verdict.first[0].expected is None and verdict.first[0].place == "after the last step"


def test_value_of_a_recording_that_was_not_played(expected, work):
    with (work / "logit.txt").open("a") as file:
        file.write("6 00000001 5\n")
    assert verdict_of(expected, work).mismatches == 1


@pytest.mark.parametrize("word", ["0000000x", "xxxxxxxx", "0000000z", "0000X000"])
def test_unknown_bits(expected, work, word):
    expected["feature"][0] = 0  # an X is no 0
    replace_line(work / "feature.txt", 0, f"5 {word} 1")
    verdict = verdict_of(expected, work)
    assert verdict.mismatches == 1 and verdict.first[0].actual == word


@pytest.mark.parametrize("column", range(6))
def test_each_field_of_a_decision(expected, work, column):
    row = expected["decision"][1].copy()
    row[column] ^= 1
    replace_line(work / "decision.txt", 1, f"5 {pack(row):08x} 8 8")
    verdict = verdict_of(expected, work)
    assert verdict.mismatches == 1
    assert verdict.first[0].place.startswith(list(DECISION_FIELDS)[column]) and verdict.first[0].frame == 10


def test_decisions_missing_superfluous_unknown(expected, work):
    replace_line(work / "decision.txt", 6, "9 xxxxxxxx 8 8")
    replace_line(work / "decision.txt", 3, None)
    with (work / "decision.txt").open("a") as file:
        file.write("9 00000000 9 9\n")
    verdict = verdict_of(expected, work)
    assert verdict.mismatches == 3
    assert [(m.recording, m.index) for m in verdict.first] == [(5, 3), (9, 2), (9, 3)]


@pytest.mark.parametrize(
    ("line", "place"),
    [
        ("9 0009 0002 0001 3", "NO_TOUCH"),
        ("9 0001 0002 0002 3", "TOUCHES"),
        ("9 0001 0001 0001 3", "FAULTS"),
        ("9 0001 0004 0001 3", "FAULTS"),
        ("9 000x 0002 0001 3", "STATUS"),
        (None, "registers"),
    ],
)
def test_registers_at_the_end(expected, work, line, place):
    replace_line(work / "status.txt", 1, line)
    verdict = verdict_of(expected, work)
    assert verdict.mismatches == 1 and place in verdict.first[0].place and verdict.first[0].recording == 9


@pytest.mark.parametrize(
    ("lines", "place"),
    [
        (["5 0001 0040 0001 3 0004", "9 0001 0040 0001 300 0000"], None),
        (["5 0001 0040 0001 3 0004", "9 0001 0000 0001 300 0000"], None),
        (["5 0001 0040 0001 3 0005", "9 0001 0040 0001 300 0000"], "TAXEL_FAULTS"),
        (["5 0001 0040 0001 3 0004", "9 0001 0040 0001 300 0001"], "TAXEL_FAULTS"),
        (["5 0001 0000 0001 3 0004", "9 0001 0000 0001 300 0000"], "TAXEL of FAULTS"),
        (["5 0001 0040 0001 3 000x", "9 0001 0040 0001 300 0000"], "TAXEL_FAULTS"),
        (["5 0001 0040 0001 3", "9 0001 0040 0001 300 0000"], "TAXEL_FAULTS"),
    ],
)
def test_fault_flags_at_the_end(expected, work, lines, place):
    """Recording 5 leaves the flag of taxel 2 raised, recording 9 none; bit TAXEL of FAULTS may be left of an
    earlier recording."""
    expected["flags"] = np.array([[False, False, True, False], [False] * 4])
    for number, line in enumerate(lines):
        replace_line(work / "status.txt", number, line)
    verdict = compare(CONFIG.replace(fault_frames=16), expected, read_capture(work))
    assert [mismatch.place.split(",")[-1].strip() for mismatch in verdict.first] == [place] * (
        place is not None
    )


def test_a_flag_that_nobody_raised(expected, work):
    expected["flags"] = np.zeros((2, 4), dtype=bool)
    replace_line(work / "status.txt", 0, "5 0001 0040 0001 3 0000")
    replace_line(work / "status.txt", 1, "9 0001 0000 0001 300 0000")
    verdict = compare(CONFIG.replace(fault_frames=16), expected, read_capture(work))
    assert [mismatch.place for mismatch in verdict.first] == ["TAXEL of FAULTS"]


@pytest.mark.parametrize("name", ["protocol_errors", "unknown", "stuck"])
def test_what_the_harness_saw(expected, work, name):
    text = (work / "summary.txt").read_text()
    (work / "summary.txt").write_text(text.replace(f"{name} 0", f"{name} 1"))
    assert verdict_of(expected, work).mismatches == 1


def test_nothing_compared_is_not_bit_exact(expected, work):
    empty = {name: array[:0] for name, array in expected.items()}
    for name in (*FLAT_STAGES, "decision", "step", "status"):
        (work / f"{name}.txt").write_text("")
    assert not verdict_of(empty, work).bit_exact


def test_latency_from_frames_and_decisions(expected, work):
    assert decision_latencies(expected, read_capture(work)).tolist() == [9, 9, 9, 10, 9, 9]
    cycles = cycle_table(CONFIG, expected, read_capture(work))
    assert cycles == {
        "frame_max": 4,
        "step_min": 10,
        "step_max": 12,
        "step_ideal": CONFIG.step_ideal,
        "decision_latency_max": 10,
    }


def test_latency_over_the_wrap_of_the_stamp(expected, work):
    stamps = (20 * np.arange(1, 23) + (1 << 32) - 150) % (1 << 32)
    stamps.astype("<u4").tofile(work / "frames.bin")
    lines = [line.split() for line in (work / "decision.txt").read_text().splitlines()]
    (work / "decision.txt").write_text(
        "".join(f"{r} {w} {int(a) + (1 << 32) - 150} 0\n" for r, w, a, _ in lines)
    )
    assert decision_latencies(expected, read_capture(work)).tolist() == [9, 9, 9, 10, 9, 9]


def test_step_limit_is_the_closest_pair_of_windows():
    assert step_limit_frames(PRESETS["thesis"]) == 3  # windows 19 and 20 end in frames 6141 and 6144
    assert step_limit_frames(PRESETS["pvdf"]) == 96
    # windows 255 and 256 both end in frame 6144
    shared = AcceleratorConfig.of(hop=24, window=49, steps=256, pretrigger_frames=0)
    assert [last for _, last in shared.window_spans][-3:] == [6121, 6144, 6144] and step_limit_frames(
        shared
    ) == 23
    assert step_limit_frames(AcceleratorConfig.of(hop=10, window=20, steps=1, pretrigger_frames=0)) == 10


def test_budgets_and_the_clock_that_meets_them():
    thesis = PRESETS["thesis"]
    cycles = {
        "frame_max": 20,
        "step_min": 300,
        "step_max": 310,
        "step_ideal": 267,
        "decision_latency_max": 400,
    }
    clock = needed_clock(thesis, cycles)
    assert clock == 1200e3  # 400 cycles within 1/3000 s
    rows = {row["name"]: row for row in budgets(thesis, cycles, clock, declared=True, overruns=0)}
    assert all(row["met"] for row in rows.values() if not row["reference"])
    assert rows["step"]["limit_s"] == pytest.approx(1e-3) and rows["frame"]["measured_s"] == pytest.approx(
        20 / 1200e3
    )
    slower = {
        row["name"]: row["met"] for row in budgets(thesis, cycles, clock - 1e4, declared=True, overruns=0)
    }
    assert not slower["decision"] and slower["step"] and slower["frame"]
    assert not next(
        row for row in budgets(thesis, cycles, clock, declared=True, overruns=1) if row["name"] == "frame"
    )["met"]
    full = [
        row["name"]
        for row in budgets(thesis, cycles, clock, declared=False, overruns=9)
        if not row["reference"]
    ]
    assert full == ["step"]
