"""The panel of disturbances that networks are chosen by: the suite's own figures, and the rule that heeds them."""

import json
from dataclasses import asdict, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pandas as pd
import pytest

from eskin.choose.candidate import (
    CLEAN_LOSS,
    DEARER,
    ENERGY,
    Candidate,
    ScoredCandidate,
    choose,
    choose_stable,
)
from eskin.choose.choice import configure, train_chosen
from eskin.choose.choice_table import where_it_fails
from eskin.choose.cost import EQUAL, Cost
from eskin.choose.front_ends import Screen
from eskin.choose.networks import INSIDE, STURDY, Effort, all_recordings, means_alone, more_scans
from eskin.choose.sturdy import BLOCKS, SELDOM, STILL, Hardening
from eskin.golden.core import AcceleratorConfig
from eskin.golden.core.groups import Faults
from eskin.golden.model import find_touches
from eskin.rtl.top import standby
from eskin.study.stability.core import At, Experiment, Scene
from eskin.study.stability.disturbances import noisy
from eskin.study.stability.panel import EXPERIMENTS, OSCILLATOR, OTHER_SEED, PANEL, Panel, panel_of
from eskin.study.stability.table import MODES
from eskin.training.datasets import Datasets
from eskin.training.judge import Decisions, FittedNetwork, Fold
from eskin.training.recipe import RECIPES
from eskin.training.record import Disturbed
from eskin.training.settings import TrainingSettings
from tests.support import stability_case
from tests.support.prices import cost_by_size, priced
from tests.support.result_case import but
from tests.support.table import each_row, refused

MASKED = "one taxel stuck at full scale, masked, worst"


def undetected():
    """Without the fault detector, which would mask what is masked anyway."""
    return stability_case.changed(stability_case.bench(), {"fault_frames": 0, "fault_activity": 0, "clip": 0})


@pytest.mark.parametrize("make", [stability_case.linear_bench, undetected])
def test_the_panel_gives_the_figures_of_the_suite(make):
    """Touches are found once for a front end there and here for each mode; all recordings in both."""
    bench, names = make(), [*PANEL, MASKED]
    panel = Panel(bench.recordings, dict.fromkeys(names, 1.0), seed=bench.seed)
    wrong = panel.wrong(bench.config, bench.model, np.arange(len(bench.recordings)))
    suite = replace(bench, few=len(bench.recordings))
    found = panel.figures(panel.cases(bench.config, wrong), bench.clean_accuracy)
    assert [row.mode for row in found.gate_modes] == [*PANEL[:3]]
    figures = [*found.gate_modes, *found.stress]
    assert [row.mode for row in figures] == names
    for row in figures:
        mode = MODES[row.mode]
        assert row.figure == pytest.approx(mode.run(suite).value), row.mode
        assert row.bound == mode.bound(suite) and row.held == mode.holds(row.figure, row.bound)
    told = ~np.isnan(wrong)
    assert told.mean(axis=1).max() == 1 and 0 < np.nanmean(panel.stressed(bench.config, wrong)) <= 1
    wrong[3:] = 1  # a gate that stays shut is no decision: a network that is always wrong has none right
    assert (wrong[:3] < 1).any() and np.nanmax(panel.stressed(bench.config, wrong)) == 0


def decisions(networks, correct):
    """Of networks on 36 recordings, by the share of networks that decided each correctly."""
    return SimpleNamespace(fitted=networks, correct=pd.Series(correct))


@each_row("folds", [1, 3])
def test_what_a_choice_has_not_seen_is_other_recordings_under_other_disturbances(folds):
    """The suite's own figures on recordings left over, with the seed that no choice meets. The front ends of some folds
    mask a taxel, so that these have a case less."""
    bench, scene = stability_case.linear_bench(), stability_case.recordings(36)
    panel, networks = Panel(scene), list[Any]()
    for fold in range(folds):
        config = bench.config.replace(masked_taxels=(5,)) if fold else bench.config
        network = SimpleNamespace(integer=bench.model, real=SimpleNamespace(config=config))
        networks.append((Fold(np.array([]), np.arange(fold, 36, folds), 0, fold), network))
    found = panel.unseen(decisions(networks, np.ones(36)))
    rows = np.setdiff1d(np.arange(36), panel.brief.rows)
    figures = {row.mode: row.figure for row in found.modes}
    assert len(rows) == 20 and figures.keys() == set(PANEL) and found.stress_modes == len(PANEL) - 3
    if folds == 1:
        suite = replace(bench, recordings=scene.subset(rows), few=len(rows), seed=OTHER_SEED)
        assert figures == pytest.approx({name: MODES[name].run(suite).value for name in PANEL})
        assert suite.rng(3).random() != bench.rng(3).random()
        assert EXPERIMENTS[OSCILLATOR][1].nominal == standby.TOLERANCE
        off: Any = replace(cast(Experiment, MODES["wrong sample rate"].run), nominal=0.1)
        assert found.oscillator and found.oscillator.figure == pytest.approx(off(suite).value)
    right = np.arange(36) % folds > 0.0  # where nothing is right there may be no touch to disturb
    assert panel.unseen(decisions(networks, right)).stressed_accuracy <= np.mean(right[rows])


class HalfDisturbed:
    """Stress on every second recording: of each network the recordings that it has right."""

    def stressed(self, config, wrong, gates=False):
        return 1 - wrong[0]

    def cases(self, config, wrong):
        return {"m": wrong}

    def figures(self, wrong, accuracy):
        figure = float(np.nanmean(1 - wrong["m"]))
        return Disturbed(stress=[{"mode": "m", "figure": figure, "bound": 0.95, "held": False}])


def judged(hidden: int, right: int, disturbed: int, count: int = 1000) -> ScoredCandidate:
    config = stability_case.CONFIG.replace(hidden=hidden)
    correct = (np.arange(count) < count * right / 1000).astype(float)
    wrong = np.where(np.arange(count) % 2, np.nan, np.arange(count) >= count * disturbed / 1000)[None]
    candidate = Candidate(stability_case.CONFIG, config, RECIPES["onset"])
    return ScoredCandidate(candidate, correct, stress=HalfDisturbed(), disturbed=lambda: wrong)  # type: ignore[arg-type]


def energy(dear: float, power: float = 1.0):
    """Prices by which 8 units take so many times the energy and the average power of 4."""

    def cost_of(config: AcceleratorConfig) -> Cost:
        joule, watt = (dear, power) if config.network.hidden == 8 else (1.0, 1.0)
        cells = 30  # as many for both
        return but(cost_by_size(config), energy_touch_j=1e-6 * joule, average_w=1e-4 * watt, cells=cells)

    return priced(cost_of=cost_of)


@each_row(
    "fragile, right, disturbed, dear, power, taken",
    [
        (600, 995, 1000, 1.3, 1.0, True),
        (600, 1000, 602, 1.3, 1.0, False),  # a thousandth better, and dearer
        (600, 1000, 602, 1.0, 1.0, True),  # as cheap
        (300, 1000 * (1 - CLEAN_LOSS), 1000, ENERGY, DEARER, True),
        (300, 1000 * (1 - CLEAN_LOSS) - 1, 1000, ENERGY, DEARER, False),
        (300, 1000, 1000, ENERGY + 0.01, 1.0, False),
        (300, 1000, 1000, 1.1, DEARER + 0.01, False),
    ],
)
def test_the_cheapest_level_one_is_taken_and_costs_no_more_than_the_rule_says(
    fragile, right, disturbed, dear, power, taken
):
    first, sturdy, prices = judged(4, 1000, fragile), judged(8, right, disturbed), energy(dear, power)
    assert (first.score, sturdy.score) == pytest.approx((0.5 + fragile / 2000, (right + disturbed) / 2000))
    assert first.scores.mean() == first.score and first.worst.figure == fragile / 1000
    assert dear == 1 or choose([first, sturdy], prices) is first
    assert choose_stable([first, sturdy], first, prices) is (sturdy if taken else first)


def test_average_powers_within_a_hundredth_are_equal_and_then_energy_decides():
    first, second = judged(4, 1000, 0), judged(8, 1000, 0)
    assert choose([first, second], energy(0.5, EQUAL)) is second
    assert choose([first, second], energy(0.5, EQUAL + 0.001)) is first


def test_a_tie_goes_to_a_candidate_that_is_beyond_in_hardly_more_modes(monkeypatch):
    first, second = judged(4, 1000, 900), judged(8, 1000, 900)
    counts = [judged(4, 1000, right).beyond for right in (900, 946, 948, 950)]
    assert (
        counts == [1, 1, 1, 0] and judged(4, 2, 900, 2).beyond == 0
    )  # of one disturbed recording a half is wrong
    for of_first, of_second, taken in ((1, 1, first), (2, 1, first), (3, 1, second), (0, 3, first)):
        beyond = {4: of_first, 8: of_second}
        count = lambda scored, beyond=beyond: beyond[scored.config.network.hidden]
        monkeypatch.setattr(ScoredCandidate, "beyond", property(count))
        assert choose_stable([second, first], first, energy(1.5)) is taken


# ---------------------------------------------------------------------- a fragile scene
def gate_costs(config: AcceleratorConfig) -> Cost:
    """A clip costs something here, and a gate that is always open or a recurrent cell too much."""
    dear = 1e-6 * (1 + 0.2 * (config.rest_level.clip > 0) + 4 * (config.opens_at_once or config.recurrent))
    cells = 30 + (config.faults.fault_frames > 0)
    return but(cost_by_size(config), energy_touch_j=dear, average_w=1e-4, cells=cells)


def test_the_cheapest_is_refused_where_it_is_fragile_and_taken_without_stress(tmp_path, quick):
    """Touches that any network knows, behind a gate that one bad sample opens."""
    scene = stability_case.recordings(24)
    request = TrainingSettings(out=tmp_path / "model", folds=2, seeds=1, group="trial")
    prices = priced(cost_of=gate_costs)
    plan = configure(scene, None, prices, groups=["trial"], folds=2)
    panel = Panel(scene, {"one-sample glitch before the touch": 1.0, "one dead taxel, worst": 1.0}, 24)
    calm, heeded = (train_chosen(scene, None, prices, request, plan=plan, stress=of) for of in (None, panel))
    (plain,), (taken,) = ([row for row in rec.candidates if row.chosen] for rec in (calm, heeded))
    assert plain.energy_touch_j == 1e-6 and plain.front_end.clip == 0 and not plain.stress
    assert plain.score == plain.accuracy > 0.95
    assert taken.energy_touch_j > 1e-6 and taken.front_end.clip > 0
    assert taken.accuracy > 0.95 and taken.stressed_accuracy > 0.8
    refused = min((row for row in heeded.candidates if row.stress), key=lambda row: row.energy_touch_j)
    assert refused.energy_touch_j == 1e-6 and refused.worst.mode.startswith("one-sample glitch")
    assert refused.accuracy > 0.95 and refused.score < taken.score - 0.05
    masking = [row for row in heeded.candidates if row.front_end.fault_frames]
    assert masking and min(row.cells for row in masking) > max(row.cells for row in calm.candidates)
    unseen, without = (rec.cross_validation[0].nested.disturbed for rec in (heeded, calm))
    fails = where_it_fails(heeded.candidates, unseen)
    assert {row.mode for row in fails.rows} == set(panel.weights)
    assert unseen.stressed_accuracy > 0.5 and where_it_fails(calm.candidates, without) is None
    moved = [
        "another front end than the linear classifier: tracked" in rec.reasons[-1] for rec in (calm, heeded)
    ]
    assert moved == [False, True]
    assert heeded.front_end.chosen.clip == taken.front_end.clip
    assert heeded.cross_validation[0].nested.integer_accuracy > 0.9


def test_a_sturdier_gate_is_not_opened_by_a_glitch():
    recordings = stability_case.recordings()
    plain = stability_case.CONFIG.replace(fault_frames=0, fault_activity=0, clip=0, rest="initial")
    panel = Panel(recordings, {"one-sample glitch before the touch": 1.0})
    assert panel.false_onsets(plain) == 1.0
    hardening = Hardening(panel, Screen(recordings))
    *lighter, hard = hardening.sturdier(plain)
    opened = [hardening.false_onsets(on, plain.onset_rule.onset_threshold) for on in (*lighter, hard)]
    assert (
        opened == sorted(opened, reverse=True)
        and opened[-1] == 0
        and all(0 < share <= SELDOM for share in opened[:-1])
    )
    # the frames before a late onset hold the beginning of the touch
    assert panel.false_onsets(hard) > 0 and hard.onset_rule.onset_hits > plain.onset_rule.onset_hits
    assert hard.rest_level.rest == "tracked" and hard.rest_level.clip > hard.onset_rule.onset_threshold
    once = plain.replace(onset="immediate")
    levels = [on.rest_level for on in hardening.sturdier(once)]
    assert [level.rest_frames for level in levels] == [32, 32, 1, 1, 1]
    clips = [level.clip for level in levels]
    assert clips[1] == clips[2] and clips[0] > clips[1] > clips[3] > clips[4] > 0
    assert Hardening(panel).sturdier(plain) == []  # it was asked for


def unguarded(panel: Panel) -> ScoredCandidate:
    """A network without a fault detector, under this panel."""
    plain, recordings = undetected(), stability_case.recordings()
    fold = Fold(np.arange(0), np.arange(len(recordings)), 0)
    fitted = FittedNetwork(plain.real, plain.model, Datasets(recordings).of(plain.config, RECIPES["robust"]))
    decisions = Decisions.of([(fold, fitted)], recordings.labels)
    candidate = Candidate(plain.config, plain.config, RECIPES["robust"])
    return ScoredCandidate.of(candidate, decisions, fold.test, panel)


def moving(scored: ScoredCandidate, panel: Panel, **more: Any) -> Any:
    """What moves read of a search that has tried this candidate."""
    prices, rows = priced(cost_of=cost_by_size), np.arange(len(panel.everything))
    state = dict(calm=scored, tried=[scored], comparable=[scored], prices=prices, rows=rows, finalists=[])
    return SimpleNamespace(**state | {"effort": Effort(fits=()), "hardening": Hardening(panel)} | more)


def test_candidates_that_tie_for_the_best_are_disturbed_on_all_recordings():
    recordings = stability_case.recordings()
    panel = Panel(recordings, {"one dead taxel, worst": 1.0}, count=8)
    few = unguarded(panel)
    search = moving(few, panel)
    all_recordings(search)
    (finalist,) = search.finalists
    assert search.tried == [finalist] and finalist.candidate is few.candidate
    assert [int((~np.isnan(each.stressed)).sum()) for each in (few, finalist)] == [8, len(recordings)]
    inside = moving(few, panel, effort=INSIDE)
    all_recordings(inside)
    assert not inside.finalists
    assert panel.whole.whole is panel.whole


def moved(move: Any, monkeypatch, on: AcceleratorConfig, **plain: Any) -> Any:
    """The front ends and fits that a move requests where a candidate on this front end is the best so far."""
    recordings = stability_case.recordings()
    panel = Panel(recordings, {"one dead taxel, worst": 1.0}, count=8)
    best = replace(judged(4, 1000, 900), candidate=Candidate(on, on, RECIPES["robust"]))
    monkeypatch.setattr("eskin.choose.networks.ahead_of", lambda _: [best])
    search = moving(
        best, panel, calm=SimpleNamespace(**plain), hardening=Hardening(panel, Screen(recordings))
    )
    search.with_calm = lambda front_ends, fits: [(config, fit) for config in front_ends for fit in fits]
    return move(search)


def test_a_linear_cell_is_tried_with_four_times_the_scans(monkeypatch):
    at = dict(scan_every=4, window_mode="free", fault_frames=0, fault_activity=0)
    on = stability_case.CONFIG.replace(**at, rest="initial", rest_frames=1)
    found = moved(more_scans, monkeypatch, on, is_linear=True)
    assert [fit for _, fit in found] == list(STURDY)
    assert {(config.sensor.scan_every, config.rest_level.rest_frames) for config, _ in found} == {(1, 1)}
    assert {config.windows.window for config, _ in found} == {8 * on.windows.hop}


def test_a_recurrent_cell_is_tried_with_means_alone_under_the_tightest_clips(monkeypatch):
    at = dict(onset="immediate", fault_frames=0, fault_activity=0, window_mode="free")
    on = stability_case.CONFIG.replace(
        **at, rest="initial", feature_kinds=("mean", "activity"), activity_block=24
    )
    found = [
        config for config, _ in moved(means_alone, monkeypatch, on, config=SimpleNamespace(recurrent=True))
    ]
    assert {(config.features.feature_kinds, config.rest_level.rest_frames) for config in found} == {
        (("mean",), 1)
    }
    first, second = (config.rest_level.clip for config in found)
    assert on.rest_level.clip > first > second > 0
    assert not moved(means_alone, monkeypatch, on, config=SimpleNamespace(recurrent=False)).candidates
    assert Hardening(None).means(on) == []  # type: ignore[arg-type] # it was asked for


def test_a_fault_detector_masks_dead_taxels_and_no_sound_one():
    recordings, plain = stability_case.recordings(), undetected()
    hardening = Hardening(Panel(recordings, {"one dead taxel, worst": 1.0}), Screen(recordings))
    guarded = hardening.guarded(plain.config)
    assert guarded == plain.config.replace(name="derived", **asdict(guarded.faults))
    assert guarded.faults == Faults(fault_frames=BLOCKS[0], fault_activity=BLOCKS[0] // STILL)
    assert not find_touches(guarded, recordings, steps=0).flagged.any()
    scene = Scene(config=guarded, recordings=recordings, turns=8, seed=1)
    for taxel, played in enumerate(EXPERIMENTS["one dead taxel, worst"][1].cases(scene).values()):
        flagged = find_touches(guarded, played.recordings, steps=0).flagged > 0
        assert flagged[:, taxel].all() and flagged.sum() == len(flagged)
    masked = unguarded(hardening.stress).guarded(guarded, np.arange(len(recordings)))
    assert masked.config == plain.config.replace(**asdict(guarded.faults))
    assert masked.candidate.front_end == guarded and masked.score == 1
    still = replace(recordings, samples=recordings.samples // 1000)  # a sound taxel would be masked
    assert Hardening(Panel(still), Screen(still)).guarded(plain.config) is None
    assert hardening.guarded(guarded) is None and Hardening(hardening.stress).guarded(plain.config) is None


def test_windows_that_divide_a_touch_are_sturdy_with_more_scans_and_without_the_level():
    recordings = stability_case.recordings()
    at = stability_case.CONFIG.replace(fault_frames=0, fault_activity=0, window_mode="free")
    once = at.replace(onset="immediate", rest="none", rest_frames=0, clip=0, scan_every=4)
    found, gated = map(Hardening(None, Screen(recordings)).dividing, (once, at))  # type: ignore[arg-type]
    assert [on.sensor.scan_every for on in found] == [4, 4, 2, 2, 1, 1]
    assert {on.windows.steps for on in found} == {20}
    assert {on.rest_level.rest_frames for on in found} == {1} and found[0].rest_level.clip > found[
        1
    ].rest_level.clip
    for on in found:
        assert on.follows_touch and on.rest_level.rest == "initial" and on.rest_level.clip > 0
        assert on.windows.touch_frames * on.sensor.scan_every >= recordings.lengths.max()
    assert {(on.onset_rule, on.follows_touch) for on in gated} == {(at.onset_rule, True)}


# ---------------------------------------------------------------------- what is asked for
def test_weights_come_from_a_file_and_what_is_wrong_in_it_is_named(tmp_path):
    recordings, file = stability_case.recordings(), tmp_path / "modes.json"
    assert panel_of(recordings, "off") is None
    on = panel_of(recordings, "on")
    assert on is not None and tuple(on.weights) == PANEL
    file.write_text(json.dumps({"spikes": 2, "mains hum": 0}))
    some = panel_of(recordings, str(file))
    assert some is not None and some.weights == {"spikes": 2}
    for text, words in (
        ('{"spike": 1}', "mode 'spike': is unknown here; the modes are no touch"),
        ('{"weight bits": 1}', "mode 'weight bits': is unknown"),
        ('{"spikes": -1}', "mode 'spikes': has the weight -1; give 0 or more"),
        ('{"spikes": 0}', "gives no mode a weight above 0"),
        ('["spikes"]', "holds no table of failure modes and weights"),
        ('{"spikes": true}', "holds no table"),
        ("spikes", "is neither on nor off, nor a JSON file"),
    ):
        file.write_text(text)
        with refused(words):
            panel_of(recordings, str(file))


def test_columns_of_different_kinds_are_disturbed_by_their_own_deviations():
    """One taxel in codes 1000 times as large, and a recording of one frame, which has no noise."""
    bench = stability_case.bench()
    few = bench.recordings.subset(range(8))
    few = few.until([1, *few.lengths[1:]])
    mixed = replace(few, samples=few.samples * np.where(np.arange(few.taxels) == 3, 1000, 1))
    config = bench.config.replace(onset="immediate", rest="initial", fault_frames=0, fault_activity=0, clip=0)
    alike, apart = (Scene(config=config, recordings=these, turns=0) for these in (few, mixed))
    assert np.ptp(alike.sigma) == np.ptp(alike.rest_noise) == 0 < alike.rest_noise[0]
    for name in ("sigma", "rest_noise"):
        own = getattr(apart, name)
        assert own[3] > 100 * np.delete(own, 3).max() > 0, name
    added = noisy(np.zeros((2000, few.taxels)), At(apart, 3.0, [2, 3], 0, 1, apart.rng())).std(axis=0)
    assert np.allclose(added[[2, 3]], 3 * apart.rest_noise[[2, 3]], rtol=0.1) and not added[:2].any()
