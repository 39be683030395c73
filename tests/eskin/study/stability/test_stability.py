"""The failure-mode suite: every experiment reports its broken variant as failed, and what the suite says of a
run is what was measured."""

import json
import os
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from unittest.mock import MagicMock, Mock

import numpy as np
import pytest

from eskin.cosim.simulation import Simulation
from eskin.golden.core import QFormat
from eskin.golden.model import preprocess
from eskin.study.stability import core as stability
from eskin.study.stability import disturbances
from eskin.study.stability.core import GROUPS, Bench, Outcome, curve, judge, why_not
from eskin.study.stability.numbers import amplified, flipped
from eskin.study.stability.table import MODES
from eskin.verbs import stability_job
from eskin.verbs.stability import StabilityRequest
from tests.support import stability_case
from tests.support.broken_designs import BROKEN_DESIGNS, broken_design
from tests.support.broken_variants import BROKEN, broken
from tests.support.result_case import cosimulation
from tests.support.table import each_row, refused

GOLDEN = {name: mode for name, mode in MODES.items() if callable(mode.run)}
HARDWARE = [mode for mode in MODES.values() if isinstance(mode.run, str)]


NUMBERS = [
    name for name, mode in GOLDEN.items() if mode.group in ("numeric", "memory") and "state" not in mode.needs
]
"""Modes that ask nothing of the network's skill: a linear cell on all kinds of feature is judged by them, too."""


@pytest.mark.parametrize(
    "bench, name",
    [(stability_case.bench, name) for name in GOLDEN]
    + [(stability_case.linear_bench, name) for name in NUMBERS],
)
def test_a_broken_variant_fails_and_the_sound_one_holds(bench, name, monkeypatch):
    mode = MODES[name]
    sound, _ = judge(mode, bench())
    spoiled, _ = judge(mode, broken(name, bench(), monkeypatch.setattr))
    assert sound.passed, (sound.value, sound.bound, sound.worst_case)
    assert not spoiled.passed, (spoiled.value, spoiled.bound, spoiled.worst_case)
    json.dumps(sound.plain(), allow_nan=False)
    assert mode.description.endswith(".") and sound.reason
    if drawn := sound.curve:
        assert {len(line) for line in drawn.lines.values()} == {len(drawn.x)}


def in_hardware(case: Bench, design=None) -> stability_job.Hardware:
    """Icarus: it builds fastest."""
    how = Simulation(simulator="icarus", waves=False, hardware=design)
    return stability_job.Hardware(case, how)


@pytest.mark.slow
@pytest.mark.parametrize(
    "mode", [mode for mode in HARDWARE if mode.run in BROKEN_DESIGNS], ids=lambda mode: mode.run
)
def test_a_broken_design_fails_and_the_sound_one_holds(mode, tmp_path, monkeypatch):
    monkeypatch.setattr(stability_job, "STREAMED", 1)
    bench = stability_case.bench()
    design = broken_design(bench.model, mode.run, tmp_path / "broken")
    sound, broken = (in_hardware(bench, each).measure(mode.run) for each in (None, design))
    assert sound.value <= mode.bound(bench) < broken.value, (
        sound.rtl.mismatch_list,
        broken.rtl["mismatch_list"],
    )
    assert sound.rtl.compared_values > 100


def test_each_case_is_played_in_a_folder_of_its_own(monkeypatch):
    """Even the same mode, at the same time."""
    played = MagicMock()
    monkeypatch.setattr(stability_job.cosim, "cosimulate", played)
    for _ in range(2):
        in_hardware(Mock()).play_case(Mock(), "spikes")
    first, second = (call.kwargs["work"] for call in played.call_args_list)
    assert first != second and not first.parent.exists()


@pytest.mark.slow
def test_a_recording_that_is_left_leaves_nothing_behind_but_without_arm_or_reset_it_does(tmp_path):
    case = replace(stability_case.bench(), flips=200)
    hardware = in_hardware(case)
    assert hardware.measure("reset").value == 0 < hardware.leave(("neither",)).value


def test_there_are_modes_enough_in_every_group_and_each_has_a_broken_variant():
    groups = [mode.group for mode in MODES.values()]
    assert len(MODES) >= 40 and all(groups.count(group) >= 5 for group in GROUPS)
    assert set(BROKEN) == set(GOLDEN) and {mode.run for mode in HARDWARE} == {*BROKEN_DESIGNS, "reset"}


def a_mode(value: float = 2.0, name: str = "state bits", **bound):
    """A mode of the table with a figure and a bound of its own."""
    drawn = curve("x", "y", [1, 2, 3, 4], {"y": [0.0, 2.0, 2.5, 1.0]})
    bound = {"at_most": None, "at_least": None, **bound}
    return replace(MODES[name], run=lambda bench: Outcome(value, "seven <b>", drawn), **bound)


@each_row(
    "bound, passed, fails_at, room",
    [
        ({"at_most": 2.0}, True, 3, 0),
        ({"at_least": 2.0}, True, 1, 0),
        ({"at_most": 1.999}, False, 2, -0.001 / 1.999),
    ],
)
def test_a_bound_is_inclusive_and_the_first_point_beyond_it_is_named(bound, passed, fails_at, room):
    record, case = judge(a_mode(**bound), stability_case.bench())
    assert (record.passed, record.fails_at, case) == (
        passed,
        fails_at,
        None,
    ) and record.room == pytest.approx(room)
    for bounds in ({"at_most": 1.0, "at_least": 1.0}, {}):
        with pytest.raises(ValueError, match="give one bound and one of numeric, stream"):
            a_mode(**bounds)


def test_a_mode_that_does_not_apply_or_needs_hardware_says_why():
    bench = stability_case.bench()
    for mode in MODES.values():
        assert not why_not(mode, bench.config)
        assert why_not(mode, bench.config, hardware=False) == "needs a co-simulation" * (mode in HARDWARE)
    at_once = bench.config.replace(onset="immediate", rest="initial")
    for config, name, why in (
        (
            bench.config.replace(loadable=False),
            "weight write during a touch",
            "weights are in ROM: there is nothing to write",
        ),
        (at_once, "no touch", "the gate opens at once: no onset is looked for"),
        (
            stability_case.linear_bench().config,
            "state error without reset",
            "a linear cell has no state, no gates and no tables",
        ),
    ):
        assert why_not(MODES[name], config) == why and not why_not(MODES["feature bits"], config)


def test_a_strong_touch_has_more_of_every_sum_and_only_integrals_are_logarithms():
    sums = np.array([3_000_000, 2000] * 6)
    config = stability_case.CONFIG.replace(feature_kinds=("mean", "integral"), feature_shift=())
    louder = amplified(config, sums, 2.0)
    assert np.all(louder[::2] == 6_000_000) and np.all(abs(louder[1::2] - sums[1::2] - 256) < 4)  # an octave


def test_flipping_a_bit_is_twos_complement():
    for code in (-128, -1, 0, 5, 127):
        for bit in range(8):
            expected = np.array(code, np.int8).view(np.uint8) ^ np.uint8(1 << bit)
            assert flipped(np.array([code]), bit, QFormat(4, 4)) == [expected.view(np.int8)]


# ---------------------------------------------------------------------- the job and its files
STALLS = "stalls on both sides of the accelerator"
NAMES = ["state error without reset", "frames lost", "one dead taxel, mean", "state bit flips"]


def job(tmp_path, data=None, **options):
    folder = tmp_path / "model"
    if not folder.exists():
        stability_case.model_folder(folder)
    asked = {"mode": options.pop("names"), "few": 6, "cosim": False, **options}
    request = StabilityRequest(model=folder, data="made", out=tmp_path / "out", **asked)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "cpu_count", lambda: 1)  # no process of its own
        patch.setattr(stability_job, "CACHE", tmp_path / "cache")
        patch.setattr(stability_job, "Bench", partial(Bench, points=1, long=200, flips=60))
        return stability_job.run(request, data or stability_case.recordings())


@each_row(
    "spoiled, name, sentence",
    [
        ("labels", "mains hum", "0.0% of 'tiny' correctly, and always naming the most frequent class 33.3%"),
        ("labels", "feature bits", ""),  # refers to no accuracy
        (
            "samples",
            "slow ramp through the band",
            "no touch was found in tiny; give touches as strong",
        ),  # its height would be NaN
    ],
)
def test_recordings_with_which_every_bound_would_hold_are_refused(spoiled, name, sentence, tmp_path):
    data = stability_case.recordings()
    fields = {"labels": (data.labels + 1) % 3, "samples": 29000 + (data.samples - 29000) // 20}
    with refused(sentence) if sentence else nullcontext():
        job(tmp_path, data=replace(data, **{spoiled: fields[spoiled]}), names=[name])


def test_the_job_writes_its_files_and_takes_finished_experiments_over(tmp_path, monkeypatch):
    with refused("mode 'tie': is unknown; the modes are state error"):
        job(tmp_path, names=["tie"])
    result = job(tmp_path, names=[*NAMES, STALLS])
    written = json.loads((tmp_path / "out" / "stability.json").read_text())
    assert written == result.plain() and result.passed
    modes, page = written["modes"], (tmp_path / "out" / "stability.html").read_text()
    assert [mode["name"] for mode in modes] == NAMES and all(name in page for name in NAMES)
    assert written["not_run"] == [{"name": STALLS, "group": "stream", "why": "needs a co-simulation"}]
    assert {"name", "group", "value", "bound", "unit", "passed", "worst_case"} <= set(modes[0])
    curves = [mode["curve"]["lines"].values() for mode in modes]
    moving = sum(any(len(set(line)) > 1 for line in lines) for lines in curves)
    assert "http" not in page.replace("http-equiv", "") and page.count("<img") == moving > 0
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"stability.json", "stability.html"}
    monkeypatch.setattr(stability, "judge", lambda *args: pytest.fail("a finished experiment was run again"))
    again = job(tmp_path, names=NAMES)
    assert again.modes == result.modes
    with pytest.raises(pytest.fail.Exception):  # other recordings of a curve: another content
        job(tmp_path, names=NAMES, few=5)


def test_a_record_of_the_hardware_that_differs_fails_the_job(tmp_path, monkeypatch):
    def differs(hardware, case, name):
        return cosimulation(1, mismatches=1)

    monkeypatch.setattr(stability_job.Hardware, "play_case", differs)
    result = job(tmp_path, names=["state bits", "frames lost"], cosim=True)
    assert not result.passed
    assert result.modes[1].rtl.mismatches == 1
    assert result.modes[0].rtl is None
    assert "differ in frames lost" in (tmp_path / "out" / "stability.html").read_text()


def test_the_spread_of_the_features_is_looked_for_once(monkeypatch):
    fresh = replace(stability_case.linear_bench())
    find = Mock(wraps=preprocess.find_touches)
    monkeypatch.setattr(preprocess, "find_touches", find)
    assert len(disturbances.disturbed(fresh, disturbances.clipped, 1.0, [])) == 24
    assert find.call_count == 2
