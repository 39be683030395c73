"""Both searches: class and margin of scores, ties, ends of the range, and the cycle in which they are there."""

import random
from itertools import product

import numpy as np

from eskin.golden.core import PRESETS
from eskin.golden.model.pipeline import first_maximum
from eskin.rtl.decision.score_search import SearchOnce, SearchTwice, make_search
from tests.support.stream_bench import simulate
from tests.support.table import each_row


def config_of(cell: str, lanes: int, classes: int):
    return PRESETS["thesis"].replace(
        cell=cell, lanes=lanes, decision="last", class_names=tuple(f"class{k}" for k in range(classes))
    )


@each_row("classes", [2, 3, 7, 8])
@each_row(
    ("cell", "lanes", "search", "latency"),
    [
        ("gru", 3, SearchTwice, lambda n: n + 3),
        ("gru", 4, SearchOnce, lambda n: 2),
        ("linear", 1, SearchOnce, lambda n: 2),
    ],
)
def test_class_and_margin_of_any_scores_in_their_cycle(cell, lanes, search, latency, classes):
    dut, rng, found = make_search(config_of(cell, lanes, classes)), random.Random(classes), []
    assert type(dut) is search
    most = (1 << len(dut.margin)) - 1
    steps = [[rng.choice((0, most, 5, rng.randint(0, most))) for _ in range(classes)] for _ in range(60)]
    if classes == 3:  # every order, every tie, distances of 1 and of the whole range
        steps += rng.sample(
            every := [list(scores) for scores in product((0, 1, 2, most), repeat=3)], len(every)
        )

    async def bench(ctx):
        for scores in steps:
            for number, score in enumerate(scores):
                for _ in range(rng.choice((0, 0, 2))):  # pauses
                    await ctx.tick()
                assert ctx.get(dut.number) == number
                ctx.set(dut.score, {"valid": 1, "value": score})
                await ctx.tick()
                ctx.set(dut.score, {"valid": 0, "value": rng.randint(0, most)})
            waited = 1
            while not ctx.get(dut.found):
                await ctx.tick()
                waited += 1
            assert waited == latency(classes)
            await ctx.tick()
            found.append((ctx.get(dut.best), ctx.get(dut.margin)))

    simulate(dut, bench)
    assert found == list(zip(*map(np.ndarray.tolist, first_maximum(np.array(steps))), strict=True))
