"""The scoreboard sees every kind of difference, and says where it is."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

from eskin.cosim.latency import budgets, needed_clock, step_limit_frames
from eskin.cosim.results import Answer, Cycles
from eskin.cosim.scoreboard import DECISION_FIELDS, FLAT_STAGES, Mismatch, Recording, Scoreboard
from eskin.golden.core import PRESETS, AcceleratorConfig
from tests.support.link_flow import pack_decisions

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
MAP = {"longest_step": 9, "step_cycles": 11, "version": 5}
LOOKS = {"ARM": 9, "TOUCH": 2, "FINISH": 4}
TAKEN = range(20, 260, 20)
"""Cycle of the last taxel of each frame."""
DECISIONS = """
0 0 1 40 0 0
0 1 2 65535 0 0
0 2 2 7 0 0
1 2 2 1 0 1
0 0 0 3 0 0
0 1 1 9 0 0
1 1 0 0 1 0
"""
"""is_global, step, class, margin, partial, unsure. Recording 5: one whole touch of three steps in 12 frames. Recording 9:
two steps, then its end."""


@pytest.fixture
def expected() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(3)
    arrays: dict[str, np.ndarray] = {
        "numbers": np.array(NUMBERS),
        "offsets": np.array([0, 12, 22]),
        "touches": np.array([1, 257]),
        "status": np.array([1, 0]),
        "decision": np.loadtxt(DECISIONS.split("\n"), int),
        "decision_offsets": np.array([0, 4, 7]),
        "decision_frame": np.array([7, 10, 12, 12, 7, 10, 0]),
    }
    for stage, size in SIZES.items():
        arrays[stage] = rng.integers(-900, 900, 5 * size)
        arrays[f"{stage}_offsets"] = np.array([0, 3, 5]) * size
    return arrays


@pytest.fixture
def events(expected) -> dict:
    """What hardware that agrees says: (recording, stage) -> values; (recording, "end") -> registers."""
    values: dict = {}
    for position, number in enumerate(NUMBERS):
        recording = Recording(expected, position)
        values |= {(number, stage): recording[stage].copy() for stage in FLAT_STAGES}
        payloads = pack_decisions(CONFIG, recording["decision"])
        values[number, "decision"] = np.array(payloads, np.uint32)
        values[number, "step"] = np.full(3 - position, 11)
        values[number, "end"] = {
            "STATUS": 1 - position,
            "FAULTS": 0,
            "TOUCHES": 1,
            "LONGEST": 9,
            "VERSION": 5,
        }
        values[number, "looks"] = dict(LOOKS)
    return values


def judged(events, expected, config=CONFIG) -> Scoreboard:
    """The scoreboard behind all of it; value k of a stage came in cycle 100 + k."""
    scoreboard = Scoreboard(config, MAP)
    for position, number in enumerate(NUMBERS):
        scoreboard.begin(Recording(expected, position))
        for stage in (*FLAT_STAGES, "decision", "step"):
            values = events[number, stage]
            for part in (slice(0, 5), slice(5, None)):  # values come in pieces
                scoreboard.check(stage, values[part], 100 + np.arange(len(values))[part])
        for after, status in events[number, "looks"].items():
            scoreboard.look(after, status)
        scoreboard.faults = events.get((number, "faults"), 0)
        scoreboard.end(events[number, "end"], TAKEN)
    return scoreboard


def test_agreement_counts_every_value(expected, events):
    counted = {stage: 5 * size for stage, size in SIZES.items()} | {"decision": 7 * 6, "status": 2 * 8}
    assert judged(events, expected).compared == counted


def test_a_stage_that_the_design_does_not_have_is_not_listed(expected, events):
    expected["fault"], expected["fault_offsets"] = np.zeros(0), np.zeros(3, int)
    events |= {(number, "fault"): np.zeros(0, np.int32) for number in NUMBERS}
    assert "fault" not in judged(events, expected).compared
    events[5, "fault"] = np.ones(1, np.int32)  # a value that nobody expects is seen all the same
    with pytest.raises(Mismatch, match="stage fault, index 0 .*expected nothing more, got 1"):
        judged(events, expected)


def flipped(place: int, bits: int = 1):
    """These bits of one value."""
    return lambda values: values ^ np.where(np.arange(len(values)) == place, bits, 0).astype(values.dtype)


CHANGES = [
    *(
        (
            5,
            stage,
            flipped(2 * size + 1),
            f"frame 12, stage {stage}, index {2 * size + 1} {place}.*{101 + 2 * size}$",
        )
        for stage, size in SIZES.items()
        for place in [f".touch 0, step 2, {FLAT_STAGES[stage]} 1.: "]
    ),
    *(
        (5, "decision", flipped(1, 1 << low), f"index 1 .{name} of step 1")
        for name, (low, _) in DECISION_FIELDS.items()
    ),
    (
        9,
        "sum",
        lambda values: values[:-2],
        "recording 9, frame 10, stage sum, index 6 .*taxel 2.*got nothing",
    ),
    (9, "logit", lambda values: np.append(values, 1), "stage logit, index 6 .one too many.*got 1"),
    (9, "decision", lambda values: values[:-1], "recording 9, stage decision, index 2 .*missing"),
    (
        9,
        "step",
        flipped(1),
        "recording 9, frame 10, stage step, index 1 .touch 0, step 1.*expected 11, got 10",
    ),
    (9, "step", lambda values: values[:-1], "recording 9, frame 10, stage step, index 1 .*missing"),
    # ARMED, TOUCH, BUSY, NO_TOUCH, FAULT
    *((9, "end", lambda _, bit=bit: _ | {"STATUS": bit}, ".STATUS.: expected 0") for bit in (1, 2, 4, 8, 16)),
    (
        5,
        "end",
        lambda status: status | {"STATUS": 0},
        "recording 5, stage status, index 0 .STATUS.: expected 1",
    ),
    (9, "end", lambda status: status | {"TOUCHES": 2}, "recording 9, stage status, index 2 .TOUCHES"),
    (9, "end", lambda status: status | {"LONGEST": 8}, ".LONGEST.: expected 9, got 8"),
    (9, "end", lambda status: status | {"VERSION": 0}, ".VERSION.: expected 5, got 0"),
    *((9, "end", lambda _, bit=bit: _ | {"FAULTS": 1 << bit}, ".FAULTS.: expected 0") for bit in range(8)),
    (9, "faults", lambda _: 3, ".FAULTS.: expected 3, got 0"),
    (5, "looks", lambda looks: looks | {"ARM": 8}, ".STATUS behind ARM.: expected 9, got 8"),
    *((5, "looks", lambda _, bit=bit: {"TOUCH": 2 ^ bit}, "STATUS behind TOUCH") for bit in (1, 2, 8, 16)),
    (5, "looks", lambda looks: looks | {"FINISH": 0}, ".STATUS behind FINISH.: expected 4, got 0"),
]
"""Recording, stage, what becomes of what was said, and the mismatch."""
FLAGS = [
    (True, (0x40, 4), None),
    (True, (0x40, 5), "recording 5, stage status, index 5 .TAXEL_FAULTS"),
    (True, (0x00, 4), "recording 5, stage status, index 1 .FAULTS"),
    # a flag that nobody raised
    (False, (0x40, 0), "recording 5, stage status, index 1 .FAULTS"),
]
"""Is taxel 2 of recording 5 flagged; FAULTS and TAXEL_FAULTS behind it; the mismatch."""


@pytest.mark.parametrize(("number", "stage", "change", "sentence"), CHANGES)
def test_every_difference_is_told_with_its_place(expected, events, number, stage, change, sentence):
    aim, events[number, stage] = events.get((number, stage)), change(events.get((number, stage)))
    with pytest.raises(Mismatch, match=sentence) as found:
        judged(events, expected)
    if sentence.startswith("frame 12"):
        value = aim[found.value.index]
        assert (found.value.expected, found.value.got) == (value, value ^ 1)


@pytest.mark.parametrize(("flagged", "words", "sentence"), FLAGS)
def test_fault_flags_at_the_end(expected, events, flagged, words, sentence):
    expected["flags"] = np.array([[0, 0, flagged, 0], [0] * 4])
    for number, (faults, flags) in zip(NUMBERS, (words, (0, 0)), strict=True):
        events[number, "end"] |= {"FAULTS": faults, "TAXEL_FAULTS": flags}
    with pytest.raises(Mismatch, match=sentence) if sentence else nullcontext():
        judged(events, expected, CONFIG.replace(fault_frames=16))


def test_taught_touches_in_use_are_compared(expected, events):
    expected["taught"] = np.full(2, 3)
    for number, word in zip(NUMBERS, (0x203, 0x1FF), strict=True):
        events[number, "end"]["TAUGHT"] = word
    taught = CONFIG.replace(readout="prototypes", prototypes=1, taught=2, decision="last")
    with pytest.raises(Mismatch, match="recording 9.*TAUGHT.: expected 3, got 511"):
        judged(events, expected, taught)


def test_an_overrun_and_a_stalled_input_are_believed_only_where_they_can_be(expected, events):
    """The third window ends in frame 12, so its first sum comes behind frame 11, in cycle 220: it can have to wait for room
    only while the first one's step is not over. At a pace that is not known both are."""
    registers = events[5, "end"] | {"FAULTS": 8}
    for first, accepted, sentence in ((220, TAKEN, "expected 0, got 8"), (221, TAKEN, None), (9, None, None)):
        scoreboard = Scoreboard(CONFIG, MAP)
        scoreboard.begin(Recording(expected, 0))
        for stage in (*FLAT_STAGES, "step"):
            scoreboard.check(stage, events[5, stage])
        scoreboard.check("decision", events[5, "decision"], first + np.arange(4))
        with pytest.raises(Mismatch, match=sentence) if sentence else nullcontext():
            scoreboard.end(registers | {"FAULTS": 10 if accepted is None else 8}, accepted)


LOOKED = [((0, 0), 0, {}), ((3, 19), 0, {}), ((3, 20), 11, {}), ((1, 900), 9, {})]
IMAGE = {"map": np.zeros(0)}


@pytest.mark.parametrize(("open_", "look", "more"), [*LOOKED, ((1, 8), 5, IMAGE)])
def test_a_touch_is_looked_at_where_it_is_open_for_certain(expected, open_, look, more):
    """8 frames behind its onset, those on their way and 16 beats, and as many before its end. An image is open to its
    decision."""
    arrays = expected | {"open": np.array([open_]), "samples": np.zeros((22, 4))} | more
    assert Recording(arrays, 0).look == look


@pytest.mark.parametrize(("finished", "latest"), [(-1, 10), (25, 15)])
def test_cycles_are_extremes_over_all_recordings(expected, events, finished, latest):
    """The last decision, in cycle 40, is brought by FINISH."""
    scoreboard = Scoreboard(CONFIG, MAP)
    for position, late in enumerate((9, 10)):
        recording = Recording(expected, position)
        scoreboard.begin(recording)
        frames = recording["decision_frame"]
        scoreboard.check("step", events[recording.number, "step"])
        for stage in FLAT_STAGES:
            scoreboard.check(stage, recording[stage])
        cycles = np.where(frames, 20 * frames + late, 40)
        scoreboard.check("decision", events[recording.number, "decision"], cycles)
        accepted = range(20, 20 * int(max(frames)) + 1, 20)
        scoreboard.end(events[recording.number, "end"], accepted, finished)
    result = Answer.of(
        scoreboard, frame_max=20, frames=0, simulated_cycles=0, overruns=0, input_stalls=0, probe=False
    )
    assert (result.steps, result.decisions) == (5, 7)
    extremes = {"frame_max": 20, "step_min": 11, "step_max": 11, "decision_latency_max": latest}
    assert dict(result.cycles) == extremes | {"step_ideal": CONFIG.step_ideal}


def test_step_limit_is_the_closest_pair_of_windows():
    assert step_limit_frames(PRESETS["thesis"]) == 3  # windows 19 and 20 end in frames 6141 and 6144
    assert step_limit_frames(PRESETS["pvdf"]) == 96
    shared = AcceleratorConfig.of(hop=24, window=49, steps=256, pretrigger_frames=0)
    assert [last for _, last in shared.window_spans][-3:] == [6121, 6144, 6144]
    assert step_limit_frames(shared) == 23
    assert step_limit_frames(AcceleratorConfig.of(hop=10, window=20, steps=1, pretrigger_frames=0)) == 10


def test_budgets_and_the_clock_that_meets_them():
    thesis = PRESETS["thesis"]
    cycles = Cycles(step_ideal=1, frame_max=20, step_min=300, step_max=310, decision_latency_max=400)
    clock = needed_clock(thesis, cycles)
    assert clock == 1200e3  # 400 cycles within 1/3000 s

    def table(clock_hz: float, pace: str = "declared", overruns: int = 0) -> list:
        played = SimpleNamespace(cycles=cycles, clock_hz=clock_hz, overruns=overruns, pace=pace)
        return [row for row in budgets(thesis, played) if not row.reference]

    def met(*given) -> dict:
        return {row.name: row.met for row in table(*given)}

    frame, step, _ = table(clock)
    assert (frame.measured_s, step.limit_s) == pytest.approx((20 / 1200e3, 1e-3))
    every = dict.fromkeys(("frame", "step", "decision"), True)
    assert met(clock) == every and met(clock - 1e4) == every | {"decision": False}
    assert met(clock, "declared", 1) == every | {"frame": False} and met(clock, "full", 9) == {"step": True}
