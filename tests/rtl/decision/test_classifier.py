"""argmax, margin, ties, votes, partial touches."""

import random

import numpy as np
import pytest

from eskin.golden.core import PRESETS, QFormat
from eskin.golden.model.pipeline import DECISION_FIELDS, decide, early_steps, global_steps
from eskin.rtl.decision.classifier import Classifier
from eskin.rtl.program.timing import logit_to_decision
from tests.support.stream_bench import Bench, values


def play(config, touches, *, stall=0.0, seed=0):
    """Feed logits of touches (lists of steps; too few: the recording ends); returns decisions, cycles of the
    last logits, and how many decisions were taken when a touch ended."""
    dut = Classifier(config)
    bench = Bench(dut, seed=seed, quiet=3 * config.classes + 80)
    out = bench.collect(dut.o, stall=stall)
    last_logit, ended = [], []

    async def watch(ctx):
        count = 0
        async for _, _, accepted, closed in ctx.tick().sample(dut.o.valid & dut.o.ready, dut.ended):
            count += accepted
            if closed:
                ended.append(count)

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
            if len(steps) < config.windows.steps:
                while not ctx.get(dut.idle):
                    await ctx.tick()
                ctx.set(dut.finish, 1)
                await ctx.tick()
                ctx.set(dut.finish, 0)
                await ctx.tick()

    bench._sim.add_testbench(watch, background=True)
    bench.process(feed)
    bench.run()
    return out, last_logit, ended


def expected(config, touches):
    """The golden model's decisions, and how many there are when each touch ends."""
    rows, ends = [], []
    for steps in filter(None, touches):
        logits = np.zeros((1, config.windows.steps, config.classes), dtype=int)
        logits[0, : len(steps)], done = steps, np.array([len(steps)])
        local, margin, (overall,), (lead,) = decide(config, logits, done)
        (end,), early = global_steps(config, local, margin, done), early_steps(config, local, margin, done)[1]
        for k in range(len(steps)):
            rows.append((0, k, local[0, k], margin[0, k], 0, 0))
            if k == end:
                partial = len(steps) < config.windows.steps and not early
                rows.append((1, k, overall, lead, partial, lead < config.network.margin_threshold))
        ends.append(len(rows))
    return [dict(zip(DECISION_FIELDS, map(int, row), strict=True)) for row in rows], ends


RULES = (
    {"decision": "vote"},
    {"decision": "last"},
    *({"decision": "early", "early_steps": m, "early_margin": 2} for m in (1, 2, 3, 4)),
    *({"decision": "vote", "margin_threshold": m} for m in (1, 2, 4, 8)),
    *({"decision": "last", "margin_threshold": m} for m in (1, 30000, 65535)),
    {"decision": "early", "early_steps": 2, "early_margin": 2, "margin_threshold": 3},
)


@pytest.mark.parametrize(
    "number", range(len(RULES)), ids=[" ".join(map(str, rule.values())) for rule in RULES]
)
def test_decisions(number):
    """Numbers of classes in turn, stalls in every other, both searches: votes, last and early decisions meet each of
    them."""
    rule, classes, stall = RULES[number], (2, 3, 32)[number % 3], 0.6 * (number % 2)
    config = PRESETS["thesis"].replace(
        lanes=(3, 4)[number // 2 % 2], steps=4, class_names=tuple(map(str, range(classes))), **rule
    )
    rng = random.Random(classes)
    low, high = config.formats.logit_format.min_code, config.formats.logit_format.max_code

    def logits(again):
        kind = rng.random()
        if kind < 0.3:  # ties
            return [rng.choice([-1, 0, 1]) for _ in range(classes)]
        if again:  # one class again and again
            return [3 * (k == 1) for k in range(classes)]
        return [rng.choice([low, high]) if kind < 0.5 else rng.randint(low, high) for _ in range(classes)]

    touches = [
        [logits(rule["decision"] == "early" and number % 3 > 0) for _ in range(count)]
        for number, count in enumerate((4, 4, 2, 4, 1, 3, 4, 3, 4, 4, 2))
    ]
    out, last_logit, ended = play(config, touches, stall=stall, seed=classes)
    assert (values(out), ended) == expected(config, touches)
    if not stall:
        assert [beat.cycle for beat in out if not beat.value["is_global"]] == [
            cycle + logit_to_decision(config) for cycle in last_logit
        ]


def test_more_votes_than_a_logit_has_codes():
    config = PRESETS["pvdf"].replace(steps=80, decision="vote", logit_format=QFormat(4, 2))
    touches = [[[3 * (number < 75), 0, 1, 1, 0] for number in range(80)]]
    out, _, ended = play(config, touches)
    assert (values(out), ended) == expected(config, touches)


def test_finish_without_a_step_gives_no_decision():
    config = PRESETS["thesis"].replace(steps=2)
    assert values(play(config, [[]])[0]) == []
