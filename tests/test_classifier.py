"""argmax, margin, ties, votes, partial touches."""

from __future__ import annotations

import random

import pytest

from golden.config import PRESETS
from rtl.classifier import Classifier
from rtl.schedule import logit_to_decision
from tests.stream_bench import Bench, values


def top_two(numbers):
    """(index of the largest, lowest on ties; largest minus second)."""
    best = max(range(len(numbers)), key=lambda k: (numbers[k], -k))
    return best, numbers[best] - max(value for k, value in enumerate(numbers) if k != best)


def play(config, touches, *, partial=False, stall=0.0, seed=0):
    """Feed logits of touches (lists of steps); returns (decisions, cycles from last logit to local decision)."""
    dut = Classifier(config)
    bench = Bench(dut, seed=seed, quiet=3 * config.classes + 80)
    out = bench.collect(dut.o, stall=stall)
    last_logit = []

    async def feed(ctx):
        for steps in touches:
            for logits in steps:
                while not ctx.get(dut.idle):
                    await ctx.tick()
                for value in logits:
                    ctx.set(dut.logit, {"valid": 1, "value": value})
                    await ctx.tick()
                last_logit.append(bench.cycle)
                ctx.set(dut.logit, {"valid": 0, "value": 0})
                await ctx.tick()
        if partial:
            while not ctx.get(dut.idle):
                await ctx.tick()
            ctx.set(dut.finish, 1)
            await ctx.tick()
            ctx.set(dut.finish, 0)

    bench.process(feed)
    bench.run()
    return out, last_logit


def expected(config, touches, partial):
    rows = []
    for number, steps in enumerate(touches):
        votes = [0] * config.classes
        for step, logits in enumerate(steps):
            best, margin = top_two(logits)
            votes[best] += 1
            rows.append({"class": best, "margin": margin, "step": step, "is_global": 0, "partial": 0})
        open_touch = partial and number == len(touches) - 1
        if steps and (len(steps) == config.steps or open_touch):
            best, margin = top_two(votes) if config.decision == "vote" else (rows[-1]["class"], rows[-1]["margin"])
            rows.append({"class": best, "margin": margin, "step": len(steps) - 1, "is_global": 1, "partial": int(open_touch)})
    return rows


@pytest.mark.parametrize("decision", ["vote", "last"])
@pytest.mark.parametrize("classes", [2, 3, 32])
@pytest.mark.parametrize("stall", [0.0, 0.6])
def test_decisions(classes, decision, stall):
    config = PRESETS["thesis"].replace(steps=4, class_names=tuple(map(str, range(classes))), decision=decision)
    rng = random.Random(classes)
    low, high = config.logit_format.min_code, config.logit_format.max_code

    def logits():
        kind = rng.random()
        if kind < 0.3:  # ties
            return [rng.choice([-1, 0, 1]) for _ in range(classes)]
        return [rng.choice([low, high]) if kind < 0.5 else rng.randint(low, high) for _ in range(classes)]

    touches = [[logits() for _ in range(4)] for _ in range(4)] + [[logits(), logits()]]
    out, last_logit = play(config, touches, partial=True, stall=stall, seed=classes)
    assert values(out) == expected(config, touches, partial=True)
    if not stall:
        assert [beat.cycle for beat in out if not beat.value["is_global"]] == [cycle + logit_to_decision(config) for cycle in last_logit]


def test_finish_without_a_step_gives_no_decision():
    config = PRESETS["thesis"].replace(steps=2)
    assert values(play(config, [], partial=True)[0]) == []
