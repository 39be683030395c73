"""The front end chosen by evidence: the judge against brute force, missed touches, ties, and choices whose
truth is known."""

import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from sklearn.linear_model import Ridge

from eskin.choose.candidate import Candidate, ScoredCandidate, choose
from eskin.choose.choice import Plan, choose_front_end, choose_split, inner_folds, search_inside
from eskin.choose.first_touches import cut_windows, first_touches
from eskin.choose.front_ends import (
    PENALTIES,
    FrontEnds,
    FrontEndSearch,
    RidgeLearner,
    Screen,
    _fewer_scans,
    listed,
)
from eskin.choose.sturdy import Hardening
from eskin.data.folds import likely_groups
from eskin.golden.data import Recordings
from eskin.golden.model import find_touches
from eskin.training.judge import folds_of, judge
from eskin.training.linear_fit import discriminants
from eskin.training.splits import split_folds
from tests.support.gripped_scene import gripped_recordings
from tests.support.prices import priced
from tests.support.small_designs import TRACKED
from tests.support.table import each_row

archive = partial(Recordings.of, sample_rate_hz=200.0)


def touched_at_random(count: int = 48, seed: int = 3, *, silent: tuple[int, ...] = ()) -> Recordings:
    """A touch of 0.5 s somewhere in 3 s, on a rest level that differs by hundreds of codes: two periods of a
    wave whose phase is the class, so that it averages to nothing and only its course since the onset
    tells."""
    rng = np.random.default_rng(seed)
    patterns = rng.uniform(20, 80, 6) * np.sign(rng.standard_normal(6))
    parts = []
    for i in range(count):
        frames = 10000 + rng.integers(-400, 400, 6) + rng.normal(0, 1, (600, 6))
        start = rng.integers(80, 480)
        if i not in silent:
            wave = np.sin(2 * np.pi * (np.arange(100) / 50 + i % 3 / 3))
            frames[start : start + 100] += patterns * wave[:, None] * rng.uniform(0.8, 1.2)
        parts.append(np.rint(frames))
    return archive(parts, np.arange(count) % 3, groups={"day": np.arange(count) // 3 % 4})


@pytest.fixture(scope="module")
def at_random() -> Recordings:
    return touched_at_random(36)


@pytest.fixture(scope="module")
def found(at_random) -> Plan:
    return choose_front_end(at_random, priced())


def moving(count: int = 40, seed: int = 4) -> Recordings:
    """Same levels, same means: the classes differ by how much the taxels move from frame to frame."""
    rng, labels = np.random.default_rng(seed), np.arange(count) % 2
    spread = np.array([8.0, 11.0])[labels, None, None]
    levels = rng.normal(0, 3, (count, 1, 5))
    return archive(np.rint(500 + spread * rng.standard_normal((count, 400, 5)) + levels), labels)


BASE = TRACKED.replace(
    name="derived",
    taxels=6,
    sample_rate_hz=200.0,
    steps=10,
    rest_frames=13,
    onset_mean_frames=8,
    onset_check_frames=2,
    onset_threshold=10,
    rearm_frames=32,
    class_names=("class0", "class1", "class2"),
)


# ---------------------------------------------------------------------- the judge
@each_row("width", [8, 70])  # few features; more than recordings, which are turned
def test_ridge_regression_is_fitted_again_for_every_fold(width):
    rng = np.random.default_rng(0)
    labels = np.arange(60) % 3
    x = rng.normal(0, 1, (60, width)) + (0.8 if width == 8 else 2.0) * np.eye(width)[labels]
    folds = [np.arange(60)[k::4] for k in range(4)]
    indicators = np.eye(3)[labels]
    wide = np.concatenate([x, np.full((60, 1), 3.0)], axis=1)
    unit = (wide**2).sum() / 60
    decided = np.zeros((len(PENALTIES), 60), dtype=int)
    for row, penalty in enumerate(PENALTIES):
        for fold in folds:
            rest = np.setdiff1d(np.arange(60), fold)
            ridge = Ridge(penalty * unit, fit_intercept=False, solver="cholesky")
            weights = ridge.fit(wide[rest], indicators[rest]).coef_.T
            turn, bias = discriminants(wide[rest] @ weights, indicators[rest])
            decided[row, fold] = (wide[fold] @ weights @ turn + bias).argmax(axis=1)
    expected = np.zeros(60, dtype=int)
    for fold in folds:
        elsewhere = np.setdiff1d(np.arange(60), fold)
        expected[fold] = decided[np.argmax((decided == labels)[:, elsewhere].sum(axis=1)), fold]
    decisions = judge(RidgeLearner.on(x, labels, 3), folds_of(folds, [0], np.arange(60)), labels).table
    assert (decisions["integer"] == expected[decisions["recording"]]).all()
    assert 0.35 < decisions["integer_accuracy"].mean() < 1


@each_row(
    "changes",
    [
        {},
        dict(hop=5, window=10, steps=20),
        dict(
            feature_kinds=("mean", "activity", "integral"),
            activity_rule="change",
            activity_block=4,
            feature_scale="taxel",
        ),
        dict(rest="initial"),
        dict(rest="none", rest_frames=0, onset="immediate"),
        dict(
            window_mode="touch",
            pretrigger_frames=10,
            touch_frames=150,
            hop=12,
            window=25,
            steps=12,
            rearm_frames=64,
        ),
        dict(window_mode="whole", hop=4, window=8, steps=6, store_per_window=4, touch_frames=300),
    ],
)
def test_windows_cut_from_touches_found_once(changes):
    recordings, config = touched_at_random(12), BASE.replace(**changes)
    decisions = find_touches(config, recordings)
    first = decisions.first_touch()
    rows = first[first >= 0]
    again = cut_windows(config, Screen(recordings).touches(config))
    assert len(rows) >= 10
    for name in ("recording", "onset_frame", "start_frame", "completed", "sums"):
        assert np.array_equal(getattr(decisions, name)[rows], getattr(again, name)), name
    own = cut_windows(config, first_touches(config, recordings))
    assert np.array_equal(own.partial, decisions.partial[rows])


def test_missed_touches_count_as_wrong_and_a_gate_that_finds_nothing_decides_nothing():
    silent = (0, 7, 11, 30)
    recordings = touched_at_random(silent=silent)
    screen, folds = Screen(recordings), split_folds(recordings, ["day"], 5, None)
    judged = screen.judged(BASE, folds)
    assert judged.missed == len(silent) and not judged.correct[list(silent)].any()
    assert judged.accuracy == judged.correct.mean() <= 1 - len(silent) / len(recordings)
    assert judged.correct.sum() >= 0.9 * (len(recordings) - len(silent))
    nothing = screen.judged(BASE.replace(onset_threshold=5000), folds)
    assert nothing.missed == 48 and nothing.accuracy == 0


def judged(right: int, of: int = 100, **changes) -> ScoredCandidate:
    correct = np.zeros(of, dtype=bool)
    correct[:right] = True
    return ScoredCandidate(Candidate.screened(BASE.replace(**changes)), correct)


def test_networks_are_tried_on_the_best_and_the_cheapest_of_fewer_kinds_and_the_best_of_other_gates():
    kinds = ("mean", "activity", "integral")
    best, level = judged(95, feature_kinds=kinds), judged(94, feature_kinds=kinds, steps=4)
    two = judged(92, feature_kinds=kinds[:2])
    one, cheap, hopeless = judged(88), judged(88, steps=4), judged(60, steps=2)
    at_once = dict(onset="immediate", rest="none", rest_frames=0)
    gate, cheaper, shut = judged(80, **at_once), judged(79, steps=2, **at_once), judged(50, rest="initial")
    everything = [best, level, two, one, cheap, hopeless, gate, cheaper, shut]
    assert choose(everything, priced()) is level
    found = listed(everything, priced())
    taken, *smaller = (one.candidate.front_end for one in (level, cheap, level, two, best))
    assert found.taken == taken and list(found.smaller) == smaller
    assert found.rivals == (gate.candidate.front_end,)
    assert found.for_recurrent == [taken, smaller[0], *found.rivals, smaller[2]]
    extreme = replace(found, taken=BASE.replace(feature_kinds=("mean", "highest")))
    assert extreme.for_recurrent == [smaller[0], *found.rivals, *smaller[1:3]]


def test_trees_are_tried_on_few_windows_of_the_touch_with_all_scans_and_activity():
    def dividing(right, steps, every=1, kinds=("mean",), **changes):
        sizes = dict(hop=4, window=8, steps=steps, store_per_window=8, touch_frames=400, scan_every=every)
        return judged(right, window_mode="whole", feature_kinds=kinds, **sizes, **changes)

    other = dict(onset_threshold=20)
    means = [dividing(80, 1), dividing(85, 2), dividing(90, 20), dividing(88, 8, **other)]
    everything = [judged(99), *means, dividing(91, 2, every=2), dividing(70, 2, kinds=("mean", "highest"))]
    found = listed(everything, priced()).for_trees
    few = [scored.candidate.front_end for scored in means[:2]]
    assert list(found[:2]) == few
    active = dict(feature_kinds=("mean", "activity"), activity_rule="change")
    assert [on.replace(name="derived") for on in found[2:]] == [on.replace(**active) for on in few]
    scaled = listed([*everything, dividing(95, 20, feature_scale="taxel")], priced()).for_trees
    assert list(scaled) == [on.replace(feature_scale="taxel", name="derived") for on in found]
    assert listed([judged(99)], priced()).for_trees == ()


def test_a_part_is_judged_as_if_it_were_all_there_is(at_random, found):
    """tests/eskin/choose/test_choice.py shows that a whole choice does not look at the labels of the others."""
    front_ends = found.front_ends
    folds, everything = inner_folds(at_random, ["day"]), np.arange(len(at_random))
    for config in (BASE, found.config):
        of_all = front_ends.screen.judged(config, folds)
        rows = front_ends.part(everything)
        of_part = FrontEndSearch(prices=priced(), front_ends=front_ends, rows=rows, folds=folds).judge(config)
        assert (of_part.correct == of_all.correct).all() and of_part.missed == of_all.missed


# ---------------------------------------------------------------------- choices whose truth is known
def test_a_level_that_carries_the_class_is_left_in_and_the_gate_opens_at_once():
    front_end = choose_front_end(gripped_recordings(5, 8, classes=4), priced())
    chosen, rivals = front_end.record().chosen, front_end.record().rivals
    assert (chosen.rest, chosen.onset) == ("none", "immediate")
    without = max(row.accuracy for row in rivals if (row.rest, row.onset) == ("initial", "immediate"))
    assert chosen.accuracy > 0.9 and without < chosen.accuracy - 0.3
    (doubt,) = front_end.doubts
    assert doubt.code == "level_tells" and "level of the first 13 frames alone reveals" in doubt.text
    assert f"removes this level classifies {100 * without:.1f} %" in doubt.text


def test_a_level_that_tells_the_class_is_doubted_also_where_it_is_taken_off():
    recordings = touched_at_random(24)
    shifted = recordings.samples + 3000 * np.repeat(recordings.labels, recordings.lengths)[:, None]
    recordings = replace(recordings, samples=shifted)
    front_end = choose_front_end(recordings, priced())
    (doubt,), record = front_end.doubts, front_end.record()
    assert re.search("with day left out, .*record every class at every day", doubt.text)
    assert record.split == ["day"] and record.level_alone > 0.8


def test_columns_of_mixed_ranges_have_a_scale_each_and_share_no_clip():
    """An encoder turns by thousands of codes and tells nothing; what tells the class moves by forty."""
    rng = np.random.default_rng(6)
    parts = []
    for i in range(60):
        frames = rng.normal(300, 4, (120, 5)) + 40 * (np.arange(5) == i % 3)
        frames[:, 4] = 30_000 + rng.uniform(-9000, 9000)
        parts.append(np.rint(frames))
    labels = [i % 3 for i in range(60)]
    mixed = archive(parts, labels)
    front_end = choose_front_end(mixed, priced())
    assert {one.config.features.feature_scale for one in front_end.screened} == {"taxel"}
    assert front_end.screened[0].accuracy > 0.9
    assert any("per taxel is the only one tried" in reason for reason in front_end.reasons)
    plain = front_end.screened[0].candidate.front_end.replace(rest="none", clip=0)
    assert Hardening(None, Screen(mixed)).sturdier(plain) == []  # they share no clip
    alike = archive([part[:, :4] for part in parts], labels)
    fewer = choose_front_end(alike, priced()).screened
    assert {one.config.features.feature_scale for one in fewer} == {"array", "taxel"}
    assert Hardening(None, Screen(alike)).sturdier(fewer[0].candidate.front_end.replace(rest="none", clip=0))


def lasting(lengths, tells: int, seed: int = 5) -> Recordings:
    """Two classes on one level; a recording of class 1 moves up from frame ``tells`` on, if it lasts so
    long."""
    rng, labels = np.random.default_rng(seed), np.arange(len(lengths)) % 2
    parts = [rng.normal(500, 20, (length, 5)) + rng.normal(0, 5, 5) for length in lengths]
    for part, label in zip(parts, labels, strict=True):
        part[tells:] += 20 * label
    return archive([np.rint(part) for part in parts], labels)


def test_lengths_from_one_to_three_seconds_are_windows_for_most():
    """What tells the class comes late; a length that tells it too may not be read."""
    lengths = np.random.default_rng(0).permutation(np.linspace(200, 600, 60).astype(int))
    late = choose_front_end(lasting(lengths[:40], tells=300), priced())
    assert late.config.last_frame * late.config.sensor.scan_every > 300
    assert late.screened[0].correct[lengths[:40] > 400].mean() > 0.9
    of_class = np.where(np.arange(60) % 2 == 1, 500, 200) + lengths // 10
    told = choose_front_end(lasting(of_class, tells=10_000), priced())
    timed = [one.config for one in told.screened if not one.config.follows_touch]
    assert all(config.last_frame <= of_class.min() for config in timed)
    assert told.screened[0].accuracy < 0.75


def test_touches_at_random_times_want_an_onset(found):
    assert found.config.onset_rule.onset == "baseline" and found.config.rest_level.rest != "none"
    record = found.record()
    accuracy = record.chosen.accuracy
    at_once = max(row.accuracy for row in record.rivals if row.onset == "immediate")
    assert accuracy > 0.9 and at_once < accuracy - 0.1
    assert record.split == ["day"] and record.folds == 4


def test_touches_of_any_length_want_windows_that_divide_them():
    """A peak after a quarter, half or three quarters of a touch, whose length is any."""
    rng, parts = np.random.default_rng(8), []
    for i in range(60):
        time = np.linspace(0, 1, rng.integers(60, 400))
        peak = 60 * np.exp(-(((time - (1 + i % 3) / 4) / 0.1) ** 2))
        parts.append(np.rint(rng.normal(500, 2, (len(time), 5)) + peak[:, None]))
    front_end = choose_front_end(archive(parts, np.arange(60) % 3), priced())
    divided = {one: one.accuracy for one in front_end.screened if one.config.follows_touch}
    equal = max(one.accuracy for one in front_end.screened if one not in divided)
    assert front_end.config.follows_touch and max(divided.values()) > max(0.95, equal + 0.1)
    assert any(one.config.sensor.scan_every > 1 for one in divided)


def test_classes_that_only_move_differently_want_activity():
    front_end = choose_front_end(moving(), priced())
    assert "activity" in front_end.config.features.feature_kinds
    means = max(row.accuracy for row in front_end.record().rivals if row.feature_kinds == ["mean"])
    assert front_end.record().chosen.accuracy > 0.9 > means


def test_classes_that_only_reach_further_want_extremes():
    """Two dips after the onset, or one twice as deep, at any time: means and changes are alike."""
    rng, parts, labels = np.random.default_rng(2), [], np.arange(60) % 2
    for label in labels:
        frames = rng.normal(500, 2, (200, 5))
        dips = rng.choice(np.arange(60, 185, 20), 2 - label, replace=False)
        for centre, height in [(30, 90), *((centre, -30 * (1 + label)) for centre in dips)]:
            frames += height * np.exp(-(((np.arange(200) - centre) / 3) ** 2))[:, None]
        parts.append(np.rint(frames))
    front_end = choose_front_end(archive(parts, labels), priced())
    best = {True: 0.0, False: 0.0}
    for tried in front_end.screened:
        has = not {"highest", "lowest"}.isdisjoint(tried.config.features.feature_kinds)
        best[has] = max(best[has], tried.accuracy)
    assert best[True] > 0.95 > best[False] + 0.1 and front_end.screened[0].accuracy == best[True]
    assert not {"highest", "lowest"}.isdisjoint(front_end.config.features.feature_kinds)


def test_fewer_scans_keep_their_times_and_are_taken_where_they_suffice(at_random, found):
    front_ends, many = found.front_ends, BASE.windows.hop
    tried = list(_fewer_scans(BASE, front_ends.by_gate))
    assert {at.sensor.scan_every for at in tried} == {2, 4, 8}
    for at in tried:
        k, windows = at.sensor.scan_every, at.windows
        assert (k * windows.hop, k * windows.window, windows.steps) == (many, 2 * many, BASE.windows.steps)
        assert k * at.onset_rule.onset_mean_frames >= BASE.onset_rule.onset_mean_frames
        assert at.rest_level.rest_frames == BASE.rest_level.rest_frames
        touches, cut = find_touches(at, at_random), cut_windows(at, front_ends.screen.touches(at))
        first = touches.first_touch()
        touches = touches.take(first[first >= 0])
        assert (touches.sums == cut.sums).all() and (touches.onset_frame == cut.onset_frame).all()
    # a source that says everything twice
    parts = [np.repeat(at_random.recording(i), 2, axis=0) for i in range(24)]
    groups = {"day": at_random.groups["day"][:24]}
    twice = archive(parts, at_random.labels[:24], sample_rate_hz=400.0, groups=groups)
    judged, prices = search_inside(FrontEnds(twice), np.arange(24), ["day"], priced()), priced()
    chosen = choose(judged, prices).config
    dense = [one.config for one in judged if one.config.sensor.scan_every == 1]
    assert chosen.sensor.scan_every >= 2 and prices.price(chosen) < min(map(prices.price, dense))


# ---------------------------------------------------------------------- splits and refusals
def test_the_first_group_that_can_be_left_out_is_taken(at_random):
    count = np.arange(24)
    groups = {
        "file": count,
        "same": 0 * count,
        "session": count % 3,  # the class itself
        "day": count // 3 % 4,
        "other": count // 6,
    }
    recordings = replace(at_random.subset(count), groups=groups)
    assert choose_split(recordings, None) == (["day"], "the archive's first group")
    assert choose_split(recordings, ["other"])[0] == ["other"]
    assert choose_split(replace(recordings, groups={}), None)[0] == []
    # people are met anew, and a repetition is the last that tells
    names = {"trial": count % 4, "speed": count // 3 % 2, "subject_id": count // 3 % 3} | groups
    assert likely_groups(replace(recordings, groups=names)) == [
        "subject_id",
        "speed",
        "day",
        "other",
        "trial",
    ]
    assert choose_split(replace(recordings, groups=names), None)[0] == ["subject_id"]
