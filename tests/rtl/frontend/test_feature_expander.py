"""rtl/frontend/feature_expander.py: every kind of feature against loops over frames; the whole chain with
every subset, bit-exact."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.groups import FEATURE_KINDS
from eskin.golden.model.model import random_integer_model, with_network
from eskin.golden.model.pipeline import run
from eskin.golden.model.preprocess import companded
from eskin.rtl.frontend.feature_expander import SLOTS, FeatureExpander
from eskin.rtl.frontend.window_averager import WindowAverager
from eskin.rtl.program.memory_map import Fault
from eskin.rtl.program.schedule import frame_cycles, lowest_clock_hz
from tests.rtl.top.test_accelerator import CONFIGS, check, play, recordings
from tests.support.front_end_cases import CASES, detect, make_stream, window_beats
from tests.support.stream_bench import Bench, values
from tests.support.table import each_row

SUBSETS = [
    subset for size in (1, 2, 3) for subset in combinations(FEATURE_KINDS, size) if subset != ("mean",)
]
BLOCKS = {
    "thesis": 1,
    "even windows together": 1,
    "immediate touch": 1,
    "band initial": 3,
    "pvdf": 2,
    "pvdf faults": 6,
    "synthetic faults": 1,
    "two end together": 1,
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
                amounts = {"mean": column[t - 1], "activity": activity, "integral": integral}
                for kind in config.features.feature_kinds:
                    if {"mean": True, "activity": ends, "integral": beat["emit"]}[kind]:
                        found.append(beat | {"complement": ~amounts[kind], "block_last": int(ends)})
    return found


def expand(config, beats, stalls=(0.0, 0.0), seed=0):
    dut = FeatureExpander(config)
    bench = Bench(dut, seed=seed)
    taken = bench.drive(dut.i, beats, stall=stalls[0])
    out = bench.collect(dut.o, stall=stalls[1])
    bench.run()
    return out, taken


@pytest.mark.parametrize("name", BLOCKS)
def test_every_kind_of_every_deviation(name):
    """All kinds by one rule with stalls, and a subset by the other at full rate; touches come at any place of
    a hop."""
    number = list(BLOCKS).index(name)
    rules = ("sum", "change")[:: 1 - 2 * (number % 2)]
    for rule, subset, stalls in zip(
        rules, (FEATURE_KINDS, SUBSETS[number % 6]), ((0.3, 0.5), (0.0, 0.0)), strict=True
    ):
        config = config_of(name, subset, rule)
        seen = detect(config, make_stream(config, 130, seed=11 + number))
        assert seen.touches
        out, _ = expand(config, window_beats(config, seen), stalls, seed=3)
        assert values(out) == expected_beats(config, seen)


@each_row("subset", SUBSETS)
def test_documented_pace_and_latency(subset):
    """A deviation takes the slots up to that of the last kind that comes, the beat of a kind is there in the
    cycle after its slot."""
    config = config_of("pvdf", subset, "change")
    seen = detect(config, make_stream(config, 90, seed=5, touches=[20]))
    beats = window_beats(config, seen)
    out, taken = expand(config, beats)
    cycle, offered, slots = 0, [], []
    for beat, t in zip(beats, np.arange(len(beats)) // config.sensor.taxels, strict=True):
        comes = {"mean": True, "activity": t % 2 == 1, "integral": beat["emit"]}
        coming = [SLOTS[kind] for kind in subset if comes[kind]]
        offered += [cycle + slot + 1 for slot in coming]
        slots.append(1 + max(coming, default=0))
        cycle += slots[-1]
    assert set(slots) >= {1 + SLOTS[subset[-1]]} and [beat.cycle for beat in out] == offered
    assert taken == (np.cumsum(slots) - 1).tolist()


def test_extremes_neither_wrap_nor_saturate():
    """The largest and smallest deviations for a whole touch, and changes from one end to the other with every
    block."""
    for name in ("thesis", "pvdf", "immediate touch", "fabric"):
        config = config_of(name, FEATURE_KINDS, "change")
        bound, block = config.deviation_bound, config.features.activity_block
        low = config.sample_format.min_code if config.rest_level.rest == "none" else -bound
        frames = 2 * config.last_frame
        for pattern in (
            np.full(frames, bound),
            np.full(frames, low),
            np.where(np.arange(frames) // block % 2, bound, low),
        ):
            seen = detect(config, make_stream(config, frames, seed=5, touches=[20]))
            seen.values[:] = pattern[:, None]
            out, _ = expand(config, window_beats(config, seen))
            assert values(out) == expected_beats(config, seen)


@pytest.mark.parametrize("name", ["two end together", "pvdf", "immediate touch", "synthetic faults"])
def test_windows_of_all_kinds(name):
    """Expander and averager: the value that each window gives of each kind, further passes at the end of a
    touch included."""
    for rule, stall in (("sum", 0.0), ("change", 0.4)) if name == "two end together" else (("change", 0.4),):
        config = config_of(name, FEATURE_KINDS, rule)
        seen = detect(config, make_stream(config, 200, seed=8))
        beats = values(expand(config, window_beats(config, seen))[0])
        dut = WindowAverager(config)
        bench = Bench(dut, seed=4)
        bench.drive(dut.i, beats, stall=stall)
        out = bench.collect(dut.o, stall=stall)
        bench.run()
        wanted = []
        for _, start, _ in seen.touches:
            for k, (first, last) in enumerate(config.window_spans):
                if start - 1 + last <= len(seen.values):
                    for taxel in range(config.sensor.taxels):
                        wanted += kinds_of_window(config, seen, start, k, first, last, taxel)
        assert len(wanted) >= 3 * config.sensor.taxels * config.windows.steps
        assert [{name: beat[name] for name in wanted[0]} for beat in values(out)] == wanted


def kinds_of_window(config, seen, start, k, first, last, taxel) -> list[dict]:
    column, block = seen.values[:, taxel].tolist(), config.features.activity_block
    origin = start if config.windows.window_mode == "touch" else 1
    activity = 0
    for begin in range(start + first - 2, start + last - 1, block):
        here = sum(column[begin : begin + block])
        before = sum(column[begin - block : begin]) if begin > origin - 1 else here
        activity += abs(here) if config.features.activity_rule == "sum" else abs(here - before)
    total = np.array(sum(column[start - 1 : start - 1 + last]))
    amounts = (
        sum(column[start + first - 2 : start + last - 1]),
        activity,
        int(companded(total, config.features.integral_knee, config.features.integral_frac)),
    )
    where = {"taxel": taxel, "length": config.length_index[k], "final": int(k == config.windows.steps - 1)}
    return [{"complement": ~amount, "kind": kind} | where for kind, amount in enumerate(amounts)]


# ---------------------------------------------------------------------- the whole chain
WHOLE = {
    "tracked, free": dict(activity_block=5),
    "thesis, late touches partial": dict(activity_block=3),
    "two windows end together": {},
    "opens at once, hard sigmoid": dict(activity_block=2),
    "tracked, free, companded": dict(activity_block=10),
    "thesis, serial lane": {},
    "tracked, DSP lane, LSTM": {},
    "thesis, ROM, one lane": {},
    "tracked, defended, 20 taxels, companded": dict(activity_block=5),
    "two windows end together, defended": {},
}


SLOW = pytest.mark.slow
"""Where other cases that always run take the same ways through the design: see the random designs, too."""
QUICK = ("opens at once, hard sigmoid", "thesis, ROM, one lane")


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=SLOW) for name in WHOLE]
)
def test_every_subset_is_bit_exact_at_every_stage(name):
    """Every configuration with two of the subsets, rules and scales by turns, at full rate and with
    stalls."""
    number = list(WHOLE).index(name)
    for turn in range(2):
        subset = ("mean",) if turn == 1 and number % 4 == 0 else SUBSETS[(number + 3 * turn) % 6]
        scale, rule = ("array", "taxel")[(number + turn) % 2], ("sum", "change")[(number // 2 + turn) % 2]
        changes = (
            dict(
                feature_kinds=subset,
                activity_rule=rule,
                feature_scale=scale,
                integral_knee=5,
                integral_frac=7,
            )
            | WHOLE[name]
        )
        if subset == ("integral",):
            changes["compand"] = "none"
        if subset == ("mean",):
            changes["feature_scale"] = "taxel"
        config = CONFIGS[name].replace(**changes)
        model = random_integer_model(config, seed=number + 1)
        tried = (recordings(config, number + 40 + k, [150, 60, 33]) for k in range(20))
        # some have no touch
        data = next(made for made in tried if len(run(model, made).streams["decision"][0]) > 4)
        streams, statuses = play(model, data, stall=0.4 * (turn % 2))
        check(model, data, streams)
        assert not any(
            status[1] & ~(Fault.INPUT_STALLED | Fault.OVERRUN | Fault.TAXEL) for status in statuses
        )


@SLOW
@pytest.mark.parametrize(
    ("name", "subset"),
    [
        ("thesis", FEATURE_KINDS),
        ("thesis", ("integral",)),
        ("tracked, free", ("mean", "activity")),
        ("tracked, free", ("mean",)),
    ],
)
def test_frames_keep_up_at_the_lowest_clock(name, subset):
    """Frames, not steps, decide it with many lanes; the documented cycles of a frame are enough."""
    config = CONFIGS[name].replace(lanes=24, feature_kinds=subset, feature_scale="taxel", integral_knee=5)
    model = random_integer_model(config, seed=5)
    data = recordings(config, 42, [150, 60])
    assert lowest_clock_hz(config) >= frame_cycles(config) * config.sensor.sample_rate_hz
    streams, statuses = play(model, data, frame_cycles=lowest_clock_hz(config) / config.sensor.sample_rate_hz)
    check(model, data, streams)
    assert streams["decision"] and [status[1] for status in statuses] == [0, 0]


@pytest.mark.parametrize(
    ("lane_type", "scales"),
    [
        ("plain", ("taxel",)),
        pytest.param("plain", ("array",), marks=SLOW),
        pytest.param("dsp", ("array", "taxel"), marks=SLOW),
    ],
)
def test_several_lengths_with_a_checksum(lane_type, scales):
    """Means and scales by length, kind and taxel; check words for each length; no constant is called
    wrong."""
    for scale in scales:
        config = CONFIGS["two windows end together"].replace(
            feature_kinds=("mean", "integral"),
            feature_scale=scale,
            checksum=True,
            watchdog=True,
            lanes=2,
            lane_type=lane_type,
        )
        assert len(config.window_lengths) > 1
        model = random_integer_model(config, seed=6)
        data = recordings(config, 44, [150, 60])
        streams, statuses = play(model, data)
        check(model, data, streams)
        assert streams["decision"] and not any(
            status[1] & (Fault.CHECKSUM | Fault.WATCHDOG) for status in statuses
        )


@SLOW
@pytest.mark.parametrize(
    ("name", "hardware"),
    [
        ("tracked, free", dict(lanes=4, activity_block=5)),
        ("thesis", dict(lanes=1, lane_type="serial")),
        ("tracked, free", dict(lanes=1)),
    ],
)
def test_a_linear_cell_on_all_kinds(name, hardware):
    config = with_network(CONFIGS[name], cell="linear").replace(
        feature_kinds=FEATURE_KINDS,
        feature_scale="taxel",
        activity_rule="change",
        integral_knee=5,
        **hardware,
    )
    model = random_integer_model(config, seed=3)
    data = recordings(config, 41, [130, 60])
    streams, _ = play(model, data)
    check(model, data, streams)
    assert len(streams["decision"]) > 4
