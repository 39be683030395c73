"""A recording is finished when nothing is under way; touches are counted; `due` says what the watchdog waits
for."""

from __future__ import annotations

from amaranth.sim import Simulator

from eskin.golden.core.config import PRESETS
from eskin.rtl.host.recording_state import RecordingState

CONFIG = PRESETS["thesis"].replace(watchdog=True)
LEVELS = (
    "clear",
    "finish_asked",
    "moving",
    "engine_busy",
    "touch_started",
    "global_taken",
    "decider_idle",
    "detector_touch",
)
SEEN = ("finish", "busy", "touch", "touched", "touches", "due")


def play(*cycles: tuple[int, dict]) -> list[dict[str, int]]:
    """The outputs of every cycle; ``cycles``: how many with these inputs, the classifier idle if it is not
    said."""
    dut, seen = RecordingState(CONFIG), []

    async def bench(ctx):
        for count, levels in cycles:
            for name in LEVELS:
                ctx.set(getattr(dut, name), ({"decider_idle": 1} | levels).get(name, 0))
            for _ in range(count):
                seen.append({name: ctx.get(getattr(dut, name)) for name in SEEN})
                await ctx.tick()

    sim = Simulator(dut)
    sim.add_clock(1e-6)
    sim.add_testbench(bench)
    sim.run()
    return seen


def test_finish_waits_for_beats_engine_and_classifier():
    for waits in ({"moving": 1}, {"engine_busy": 1}, {"decider_idle": 0}):
        seen = play((1, {"finish_asked": 1} | waits), (40, waits), (30, {}))
        assert not any(one["finish"] for one in seen[:41]) and sum(one["finish"] for one in seen) == 1, waits
        assert seen[40]["busy"] and not seen[-1]["busy"]


def test_a_finish_in_the_cycle_of_the_clear_is_the_next_recordings():
    seen = play((20, {}), (1, {"clear": 1, "finish_asked": 1}), (30, {}))
    assert sum(one["finish"] for one in seen) == 1


def test_touches_are_counted_until_each_is_decided():
    seen = play(
        (1, {"touch_started": 1}),
        (5, {}),
        (1, {"touch_started": 1}),
        (5, {}),
        (1, {"global_taken": 1}),
        (5, {}),
    )
    assert [one["touch"] for one in seen[:3]] == [0, 0, 1] and seen[-1]["touch"] and seen[-1]["touches"] == 2
    seen = play(
        (1, {"touch_started": 1}), (5, {}), (1, {"global_taken": 1}), (5, {}), (1, {"clear": 1}), (2, {})
    )
    assert (
        not seen[10]["touch"] and seen[10]["touched"] and (seen[-1]["touched"], seen[-1]["touches"]) == (0, 0)
    )


def test_due_while_detector_and_decision_are_apart_or_the_recording_is_finished():
    apart = play(
        (1, {"touch_started": 1}), (5, {"detector_touch": 1}), (5, {}), (1, {"global_taken": 1}), (5, {})
    )
    assert (
        not any(one["due"] for one in apart[3:6])
        and all(one["due"] for one in apart[6:11])
        and not apart[-1]["due"]
    )
    seen = play((20, {}), (1, {"finish_asked": 1}), (10, {}))
    assert seen[21]["due"] and not seen[-1]["due"]
