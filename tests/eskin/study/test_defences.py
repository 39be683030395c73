"""What defences save and cost: the failures are what they say, the margin is chosen on training data, the
table is counted by hand."""

import dataclasses

import numpy as np
import pytest

from eskin.golden.model import find_onsets, find_touches, run
from eskin.study import defences
from eskin.training import crossval
from eskin.training import recipe as recipes
from tests.support import stability_case
from tests.support.stability_case import CONFIG


def test_the_threshold_keeps_the_coverage_and_no_larger_one_does():
    rng = np.random.default_rng(3)
    for _ in range(50):
        margins = rng.integers(0, 20, rng.integers(1, 60))
        threshold = defences.choose_margin(margins, 0.9)
        assert np.mean(margins >= threshold) >= 0.9 > np.mean(margins > threshold)


def test_smallest_activity_is_that_of_the_quietest_block():
    data = stability_case.recordings(3)
    least = min(
        int(np.abs(np.diff(stream.astype(int), axis=0))[end - 17 : end - 1, taxel].sum())
        for stream in (data.recording(i) for i in range(3))
        for end in range(CONFIG.rest_level.rest_frames + 16, len(stream) + 1, 16)
        for taxel in range(CONFIG.sensor.taxels)
    )
    assert defences.smallest_activity(data, CONFIG, 16) == least


def test_recommended_defences_leave_sound_recordings_alone():
    data = stability_case.recordings()
    config = defences.recommended(data, CONFIG.replace(fault_frames=0, clip=200))
    assert config.faults.fault_frames == 64
    assert config.faults.fault_activity > 0
    assert config.onset_rule.onset_threshold == 5
    assert config.network.hidden == 16
    assert (config.onset_rule.onset_hits, config.onset_rule.onset_span) == (3, 4)
    assert not find_touches(config, data).flagged.any()


def test_failures_are_what_they_say():
    data = stability_case.recordings(4)
    onsets, top = find_onsets(CONFIG, data), CONFIG.sample_format.max_code
    for name, (config, spoiled) in defences.failures(data, CONFIG, 2).items():
        assert (config.sensor.masked_taxels == (2,)) == (name == "stuck, masked")
        for i in range(4):
            before, after = data.recording(i), spoiled.recording(i)
            assert np.array_equal(np.delete(before, 2, axis=1), np.delete(after, 2, axis=1))
            since = int(onsets[i]) - 1 + round(0.25 * CONFIG.last_frame)
            if name == "dead":
                assert len(set(after[:, 2].tolist())) == 1
                assert abs(int(after[0, 2]) - before[:20, 2].mean()) < 3
            else:
                assert np.array_equal(after[:since, 2], before[:since, 2]) and np.all(after[since:, 2] == top)


def test_decisions_are_those_of_the_pipeline():
    bench = stability_case.bench()
    _, spoiled = defences.failures(bench.clean, CONFIG, 2)["stuck"]
    touches, trace = find_touches(CONFIG, spoiled), run(bench.model, spoiled)
    assert touches.faults.any()
    order = np.array([3, 0, 7])
    decisions, margins = defences._decisions(bench.model, CONFIG, touches.first_touch()[order], touches)
    assert decisions.tolist() == trace.decision[order].tolist() == bench.decide(spoiled)[order].tolist()
    assert margins.tolist() == trace.global_margin[trace.first[order]].tolist()
    none = defences._decisions(bench.model, CONFIG, np.array([-1, -1]), touches)
    assert none[0].tolist() == [-1, -1] and none[1].tolist() == [0, 0]


def test_the_margin_record_is_counted_over_the_confident():
    labels = np.array([0, 1, 0, 1])
    outcome = [(0, np.arange(4), np.array([0, 1, 1, -1]), np.array([9, 3, 6, 0]), np.array([4, 6, 8, 9]))]
    # a margin of the threshold itself is confident
    record = defences.margin_record(["trial"], labels, outcome, 0.75)
    figures = [record[key] for key in ("threshold", "coverage", "accuracy", "without")]
    assert figures == [6, 0.5, 0.5, 0.5]
    outcome = [(0, np.arange(4), np.array([0, 1, 1, -1]), np.array([9, 3, 5, 0]), np.array([0, 0, 0, 5]))]
    record = defences.margin_record(["trial"], labels, outcome, 1.0)
    assert (record["threshold"], record["coverage"]) == (0, 0.75)
    assert record["accuracy"] == pytest.approx(2 / 3)


def test_the_comparison_counts_what_unseen_recordings_get():
    data = stability_case.recordings()
    recipe = dataclasses.replace(recipes.RECIPES["onset"], updates=60)
    variant = defences.Variant("one", CONFIG, recipe)
    front_ends: dict = {}
    calls, names = [], ("dead", "stuck", "stuck, masked")

    def compared(front_ends):
        options = dict(folds=2, front_ends=front_ends, progress=lambda *line: calls.append(line))
        return defences.compare_defences(data, [variant], [["trial"]], [0], **options)[0]

    record = compared(front_ends)
    (reference,) = crossval.cross_validate(data, CONFIG, [["trial"]], [0], folds=2, recipe=recipe)
    assert record["clean"][0]["accuracy"] == pytest.approx(reference["integer_accuracy"])
    ((key, front_end),) = front_ends.items()
    taxels = range(CONFIG.sensor.taxels)
    assert calls == [("defences", 1, 1)]
    assert set(front_end) == {"clean"} | {f"{name} {taxel}" for name in names for taxel in taxels}
    assert all(0 <= record[name]["worst"] <= record[name]["mean"] <= 1 for name in names)
    config, rows, touches = front_end["dead 3"]
    again = compared({key: front_end | {"dead 3": (config, np.full_like(rows, -1), touches)}})
    assert (again["dead"]["worst"], again["dead"]["worst_taxel"]) == (0.0, 3)
    assert again["stuck"] == record["stuck"]
