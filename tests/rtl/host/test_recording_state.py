"""A recording is finished when nothing is under way; touches are counted; `due` says what the watchdog waits
for."""

import operator

from eskin.golden.core import PRESETS
from eskin.rtl.host.recording_state import RecordingState
from tests.support.stream_bench import simulate

CONFIG = PRESETS["thesis"].replace(watchdog=True)
SEEN = ("finish", "busy", "touch", "touched", "touches", "due")


def play(*cycles: tuple[int, dict]) -> list[dict[str, int]]:
    """The outputs of every cycle; ``cycles``: how many with these inputs, the classifier idle if it is not
    said."""
    dut, seen = RecordingState(CONFIG), []

    async def bench(ctx):
        for count, levels in cycles:
            for name, level in ({"decider_idle": 1} | levels).items():
                ctx.set(operator.attrgetter(name)(dut), level)
            for _ in range(count):
                seen.append({name: ctx.get(getattr(dut, name)) for name in SEEN})
                await ctx.tick()
            for name in levels:
                ctx.set(operator.attrgetter(name)(dut), 0)

    simulate(dut, bench)
    return seen


BEGINS, DECIDED = (1, {"detector.started": 1}), (1, {"global_taken": 1})


def test_finish_waits():
    """What `moving` sees is settled 3 cycles later."""
    for name in ("passing", "moving", "engine.working", "decider_idle"):
        waits = {name: int(name != "decider_idle")}
        seen = play((1, {"finish_asked": 1} | waits), (40, waits), (30, {}))
        finishes = [cycle["finish"] for cycle in seen]
        assert finishes.index(1) == 41 + 3 * waits[name] and sum(finishes) == 1, waits
        assert seen[40]["busy"] and not seen[-1]["busy"]


def test_touches_are_counted_until_each_is_decided():
    seen = play(BEGINS, (5, {}), BEGINS, (5, {}), DECIDED, (5, {}))
    assert [cycle["touch"] for cycle in seen[:3]] == [0, 0, 1]
    assert seen[-1]["touch"] and seen[-1]["touches"] == 2
    both = (1, {"detector.started": 1, "global_taken": 1})
    seen = play(BEGINS, BEGINS, both, DECIDED, (2, {}), DECIDED, (2, {}), (1, {"clear": 1}), (2, {}))
    assert seen[5]["touch"] and not seen[8]["touch"] and seen[8]["touched"]
    assert (seen[-1]["touched"], seen[-1]["touches"]) == (0, 0)
    seen = play(
        (4, {"detector.started": 1}), *[DECIDED] * 3, (2, {}), DECIDED, (2, {}), (252, BEGINS[1]), (2, {})
    )
    assert seen[8]["touch"] and not seen[11]["touch"] and seen[-1]["touches"] == 256 - 256


def test_due_while_detector_and_decision_are_apart_or_the_recording_is_finished():
    apart = [cycle["due"] for cycle in play(BEGINS, (5, {"detector.touch": 1}), (5, {}), DECIDED, (5, {}))]
    assert not any(apart[3:6]) and all(apart[6:11]) and not apart[-1]
    seen = play((20, {}), (1, {"finish_asked": 1}), (10, {}))
    assert seen[21]["due"] and not seen[-1]["due"]
