"""rtl/frontend/feature_expander.py: every kind of feature against loops over frames; the whole chain with
every subset, bit-exact."""

from itertools import combinations

import numpy as np

from eskin.golden.core import FEATURE_KINDS, AcceleratorConfig
from eskin.golden.model.preprocess import companded
from eskin.rtl.frontend.feature_expander import FeatureExpander, slots_of
from tests.support.front_end_cases import CASES, detect, make_stream, window_beats
from tests.support.stream_bench import SIDES, play, values
from tests.support.table import each_row

SUBSETS = [
    subset for size in (1, 2, 3) for subset in combinations(FEATURE_KINDS[:3], size) if subset != ("mean",)
] + [
    *(
        LAST := {
            ("highest",): 1,
            ("mean", "lowest"): 1,
            ("activity", "highest", "lowest"): 3,
            FEATURE_KINDS: 4,
        }
    )
]
"""LAST: the slot of the last kind of the subsets with extremes."""
BLOCKS = {
    "thesis": 1,
    "even windows together": 1,
    "immediate touch": 1,
    "band initial": 6,
    "pvdf": 2,
    "pvdf faults": 3,
    "synthetic faults": 1,
    "two taxels": 1,
    "fabric": 2,
    "band tracked": 1,
}
"""Front-end cases, and blocks that fill their hops."""


def config_of(name: str, subset: tuple[str, ...], rule: str, **changes) -> AcceleratorConfig:
    return CASES[name].replace(
        feature_kinds=subset,
        activity_rule=rule,
        activity_block=BLOCKS[name],
        integral_knee=4,
        integral_frac=6,
        **changes,
    )


def expected_beats(config: AcceleratorConfig, seen) -> list[dict]:
    """What the expander makes of the deviations, frame by frame: every kind that says something in it."""
    block, found = config.features.activity_block, []
    if config.windows.window_mode == "touch":
        runs = [(range(start, min(end, len(seen.values)) + 1), start) for _, start, end in seen.touches]
    else:
        runs = [(range(1, len(seen.values) + 1), 1)]
    given = iter(window_beats(config, seen))
    for frames, origin in runs:
        for t in frames:
            begin = (
                origin
                if config.windows.window_mode == "touch"
                else next((s for _, s, e in seen.touches if s + config.windows.hop <= t <= e), None)
            )
            for taxel in range(config.sensor.taxels):
                beat = next(given)
                column = seen.values[:, taxel].tolist()
                activity, place = 0, t - origin + 1
                ends = "activity" not in config.features.feature_kinds or place % block == 0
                if place % block == 0:
                    here = sum(column[t - block : t])
                    before = sum(column[t - 2 * block : t - block]) if place > block else here
                    activity = abs(here) if config.features.activity_rule == "sum" else abs(here - before)
                integral = None
                if begin is not None:
                    integral = int(
                        companded(
                            np.array(sum(column[begin - 1 : t])),
                            config.features.integral_knee,
                            config.features.integral_frac,
                        )
                    )
                of_touch = column[(begin or t) - 1 : t]
                amounts = {"mean": column[t - 1], "activity": activity, "integral": integral}
                amounts |= {"highest": max(of_touch), "lowest": min(of_touch)}
                for kind in config.features.feature_kinds:
                    if {"mean": True, "activity": ends}.get(kind, beat["emit"]):
                        found.append(beat | {"complement": ~amounts[kind], "block_last": int(ends)})
    return found


@each_row("name", BLOCKS)
def test_every_kind_of_every_deviation(name):
    """All kinds by one rule with stalls, and a subset by the other at full rate; touches come at any place of
    a hop."""
    number = list(BLOCKS).index(name)
    rules = ("sum", "change")[:: 1 - 2 * (number % 2)]
    for rule, subset, stalls in zip(
        rules, (FEATURE_KINDS, SUBSETS[number]), (SIDES[number % 3], (0.0, 0.0)), strict=True
    ):
        config = config_of(name, subset, rule)
        seen = detect(config, make_stream(config, 90, seed=11 + number))
        assert seen.touches
        out, _ = play(FeatureExpander(config), window_beats(config, seen), stalls, seed=3)
        assert values(out) == expected_beats(config, seen)


def test_the_first_hop_of_all_begins_with_its_first_deviation():
    config = config_of("band initial", ("lowest",), "sum", rest="none", rest_frames=0, clip=0)
    seen = detect(config, make_stream(config, 30, seed=1, touches=[3]))
    out, _ = play(FeatureExpander(config), window_beats(config, seen))
    assert values(out) == expected_beats(config, seen)


@each_row("subset", SUBSETS)
def test_documented_pace_and_latency(subset):
    """A deviation takes the slots up to the slot of the last kind that comes, the beat of a kind is there in the
    cycle after its slot."""
    config = config_of("pvdf", subset, "change")
    seen = detect(config, make_stream(config, 60, seed=5, touches=[20]))
    beats = window_beats(config, seen)
    out, accepted = play(FeatureExpander(config), beats)
    cycle, offered, slots, slot_of = 0, [], [], slots_of(config)
    assert slot_of[subset[-1]] == LAST.get(subset, slot_of[subset[-1]])
    for beat, t in zip(beats, np.arange(len(beats)) // config.sensor.taxels, strict=True):
        comes = {"mean": True, "activity": t % 2 == 1}
        coming = [slot_of[kind] for kind in subset if comes.get(kind, beat["emit"])]
        offered += [cycle + slot + 1 for slot in coming]
        slots.append(1 + max(coming, default=0))
        cycle += slots[-1]
    assert set(slots) >= {1 + slot_of[subset[-1]]} and [beat.cycle for beat in out] == offered
    assert accepted == (np.cumsum(slots) - 1).tolist()
