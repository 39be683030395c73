"""eskin/training/quantise.py: ranges, formats, the integers against the float network, and what is
refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.data.archive import save_archive
from eskin.golden.core import PRESETS, InputError, QFormat
from eskin.golden.model import (
    FloatModel,
    IntegerModel,
    find_touches,
    load_config,
    normalise,
    real_features,
    run,
)
from eskin.golden.model.pipeline import float_features
from eskin.training.evaluate import evaluate
from eskin.training.formats import with_network
from eskin.training.integers import quantise
from eskin.training.quantise import (
    COVERED_FEATURE,
    LAST_LOGIT,
    LAST_MARGIN,
    choose_formats,
    closest_range,
    covering_format,
    profile,
    quantise_model,
    range_records,
)
from eskin.training.record import Training, training_of
from tests.golden.model.test_cells import CELLS
from tests.support.folder import contents
from tests.support.random_models import random_float_model
from tests.support.table import each_row, refused
from tests.support.touch_scenes import SMALL, scene


def float_model(config=SMALL, seed=0):
    return random_float_model(config, seed, 0.6, 5.0, 40.0)


def saved(folder, config=SMALL):
    recordings, model = scene(20, seed=1), float_model(config)
    seen = profile(model, find_touches(config, recordings))
    model.save(folder, Training(ranges=range_records(config, seen), config=config.to_dict()))
    return recordings


@given(st.floats(-1000, 0), st.floats(0, 1000), st.integers(2, 16), st.none() | st.integers(-4, 12))
@settings(deadline=None, derandomize=True)
def test_a_covering_format_holds_the_range_and_no_finer_one_does(low, high, bits, max_frac):
    fmt = covering_format((low, high), bits, max_frac=max_frac)
    assert fmt.width == bits and (max_frac is None or fmt.frac_bits <= max_frac)
    lsb = 2.0**-fmt.frac_bits
    for value in (low, high):
        assert abs(fmt.to_real(fmt.quantise(value)) - value) <= lsb / 2
    if fmt.frac_bits < (2 * bits if max_frac is None else min(2 * bits, max_frac)):
        finer = 2.0 ** (fmt.frac_bits + 1)
        assert high * finer > fmt.max_code + 0.5 or low * finer < fmt.min_code - 0.5


@each_row("cell, reset", CELLS)
def test_integers_follow_the_float_network(cell, reset):
    """Wide formats give nearly the float logits: a wrong scale, name or merged bias would be far off."""
    config, recordings = with_network(SMALL, cell=cell, reset=reset), scene(40, seed=3)
    model = float_model(config, seed=7)
    touches = find_touches(config, recordings)
    integer = quantise_model(
        model, profile(model, touches), weight_bits=10, state_bits=16, table_entries=1024
    )
    ideal, exact = run(model, recordings, touches=touches), run(integer, recordings, touches=touches)
    formats = integer.config.formats
    assert np.abs(formats.logit_format.to_real(exact.logits) - ideal.logits).max() < 0.03 * np.ptp(
        ideal.logits
    )
    features = formats.feature_format.to_real(exact.features)
    done = np.arange(config.windows.steps) < touches.completed[:, None]
    assert np.abs(features - ideal.features)[done].max() < 2 * 2.0**-formats.feature_format.frac_bits
    assert exact.agreement(ideal) > 0.9


@given(st.integers(2, 6), st.integers(0, 2**32 - 1))
@settings(deadline=None, derandomize=True)
def test_the_closest_range_has_the_format_of_least_loss(bits, seed):
    values = np.random.default_rng(seed).normal(0, 1, 200) ** 3
    chosen = covering_format(closest_range(values, bits), bits)

    def loss(frac):
        codes = np.clip(np.rint(values * 2.0**frac), -(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
        return np.mean((codes / 2.0**frac - values) ** 2)

    assert loss(chosen.frac_bits) == min(loss(frac) for frac in range(-12, 2 * bits + 1))


def test_quantise_writes_the_integers_into_the_folder(tmp_path):
    folder = tmp_path / "model"
    recordings = saved(folder)
    integer = quantise(folder, recordings)
    assert load_config(folder) == integer.config
    record = {entry.signal: entry.format for entry in training_of(folder).ranges}
    assert record["state"] == "SQ(2,12)" and record["logit"] == str(integer.config.formats.logit_format)
    # ranges noted at training give the same integers without the recordings
    without = quantise(folder)
    assert without.config == integer.config
    for other in (without, IntegerModel.load(folder)):
        assert all((other.arrays[name] == integer.arrays[name]).all() for name in integer.arrays)


def edit(folder, **fields):
    (folder / "config.json").write_text(load_config(folder).replace(**fields).to_json())


def test_what_config_json_says_stays(tmp_path):
    """Edited before the first quantisation and between two; formats are chosen anew each time."""
    folder = tmp_path / "model"
    saved(folder)
    edit(folder, watchdog=True, class_names=("up", "down", "beat"))
    quantise(folder, weight_bits=6)
    edit(folder, lanes=2, onset_threshold=9, decision="early", early_steps=2, early_margin=5)
    for entries in (256, None):
        quantise(folder, table_entries=entries)
        after = load_config(folder)
        assert after.hardware.watchdog and after.network.class_names == ("up", "down", "beat")
        assert (after.hardware.lanes, after.onset_rule.onset_threshold) == (2, 9)
        assert (after.network.decision, after.network.early_margin) == ("early", 5)
        assert after.formats.table_entries == (entries or 512) and after.weight_bits == 8


@each_row(
    "fields, widths, words",
    [
        ({"hidden": 8}, {}, "field hidden: is 8 in config.json and was 6 in training"),
        (
            {"weight_format": QFormat(1, 7)},
            {},
            r"field weight_format: is SQ\(1,7\) in config.json and was .* as quantise",
        ),
        ({"table_entries": 256}, {"table_entries": 256}, "field table_entries: is 256 in config.json"),
        (
            {"hop": 9, "window": 18},
            {},
            r"field hop: is 9 .*, and so are the noted ranges; give recordings \(`data`\)",
        ),
        ({"taught": 2, "readout": "prototypes"}, {}, "field readout: is 'prototypes', which are made of"),
        ({}, {"weight_bits": 1}, "field weight_format: 1 bits"),
        ({}, {"weight_bits": 17}, "field weight_format: 17 bits"),
        ({}, {"state_bits": 3}, "field state_format: 3 bits"),
        ({}, {"feature_bits": 40}, "field feature_format: 40 bits"),
        ({}, {"table_entries": 100}, "table_entries"),
        ({}, {"gate_bits": 20}, "gate_frac"),
        ({}, {"aware": True}, "aware: needs the recordings"),
    ],
)
@each_row("quantised", [False, True])
def test_what_cannot_be_is_refused_by_name_and_nothing_changes(tmp_path, fields, widths, words, quantised):
    """In config.json before and after a first quantisation, and of the bits asked for."""
    saved(tmp_path / "model")
    if quantised:
        quantise(tmp_path / "model")
    edit(tmp_path / "model", **fields)
    before = contents(tmp_path)
    with refused(words):
        quantise(tmp_path / "model", **widths)
    assert contents(tmp_path) == before


def test_a_folder_that_changed_meanwhile_is_not_overwritten(tmp_path, monkeypatch):
    saved(tmp_path / "model")
    newer = float_model(seed=1)

    def slow(*given, **widths):
        newer.save(tmp_path / "model", {})
        return quantise_model(*given, **widths)

    monkeypatch.setattr("eskin.training.integers.quantise_model", slow)
    with refused("changed by another program"):
        quantise(tmp_path / "model")
    assert FloatModel.load(tmp_path / "model").content == newer.content


def test_weights_of_16_bits_widen_the_accumulator():
    model = float_model()
    ranges = profile(model, find_touches(SMALL, scene(20, seed=2)))
    config = quantise_model(model, ranges, weight_bits=16, feature_bits=16).config
    assert config.weight_bits == 16 and 32 < config.accumulator_bits <= 48 and config.addend_parts == 3


UNIT = dict.fromkeys(("weight", "recurrent", "dense", "bias", "dense bias", "logit"), (-1.0, 1.0))
UNIT |= {COVERED_FEATURE: (-7.0, 7.0)}


def in_words(formats) -> str:
    """Of features, recurrent weights and state."""
    return f"{formats.feature_format} {formats.recurrent_format} {formats.state_format}"


def test_the_rarest_features_get_bits_on_top_and_the_state_makes_room_for_recurrent_weights():
    def chosen(rarest: float, **widths):
        return choose_formats(PRESETS["fabric"], UNIT | {"feature": (-rarest, 7.0)}, **widths).formats

    assert in_words(chosen(7.5)) == "SQ(4,8) SQ(2,6) SQ(2,12)"
    finer = chosen(30.0)  # as fine as before, and nothing saturates
    assert in_words(finer) == "SQ(6,8) SQ(2,6) SQ(2,10)"
    # as in the preset: one table serves gates and states
    assert finer.gate_frac == finer.state_format.frac_bits + 1
    # no state gives up more, and recurrent weights nothing
    assert in_words(chosen(500.0)) == in_words(finer)
    # as asked for: the rarest saturate, or the state makes no room
    for widths in ({"feature_bits": 12}, {"state_bits": 14}):
        assert in_words(chosen(30.0, **widths)) == "SQ(4,8) SQ(2,6) SQ(2,12)"
    assert in_words(chosen(30.0, lean=True)).startswith("SQ(4,")
    assert chosen(7.5, weight_bits=4).state_format.width == 12


@each_row("cell", ["gru", "linear"])
def test_features_without_a_range_keep_a_format(cell):
    ranges = UNIT | {"feature": (0.0, 0.0), COVERED_FEATURE: (0.0, 0.0), LAST_LOGIT: (-1.0, 1.0)}
    chosen = choose_formats(with_network(PRESETS["fabric"], cell=cell), ranges, feature_frac_limit=-2)
    assert str(chosen.formats.feature_format) == "SQ(6,-2)"


@each_row(
    "last, changes, widths, dense",
    [
        ((-30.0, 30.0), {}, {}, "SQ(2,6)"),  # of a logistic regression: rounding is nothing beside them
        ((-2.0, 6.0), {}, {}, "SQ(2,9)"),  # 20 x 16 terms, each off by 2**-9 / sqrt(12)
        ((-2.0, 6.0), {}, {"weight_bits": 8}, "SQ(2,6)"),  # as asked for
        ((0.0, 0.0), {}, {}, "SQ(2,10)"),  # as far as an accumulator of DSP lanes goes
        ((-2.0, 6.0), {"name": "fabric"}, {"plain": True}, "SQ(2,6)"),
        ((-12.0, 12.0), {}, {}, "SQ(2,7)"),
        ((-12.0, 12.0), {"weight_sets": "one"}, {}, "SQ(2,9)"),  # the same error in each window
    ],
)
def test_weights_of_a_linear_cell_are_as_fine_as_its_last_logits_ask_for(last, changes, widths, dense):
    config = with_network(PRESETS["fabric"], cell="linear").replace(**{"name": "derived"} | changes)
    ranges = UNIT | {"dense": (-1.6, 1.6), "logit": (-20.0, 20.0), LAST_LOGIT: last}
    chosen = choose_formats(config, ranges, **widths)
    assert str(chosen.formats.dense_format) == dense and chosen.accumulator_bits <= 32
    # noted by a version that did not know the last logits
    del ranges[LAST_LOGIT]
    assert choose_formats(config, ranges).weight_bits == 8


@each_row("lead, dense", [(0.1, "SQ(2,6)"), (0.05, "SQ(2,7)"), (0.03, "SQ(2,8)")])
def test_rounded_weights_move_a_logit_by_no_more_than_close_decisions_lead(lead, dense):
    config = with_network(PRESETS["fabric"], cell="linear").replace(name="derived")
    ranges = UNIT | {"dense": (-1.6, 1.6), "logit": (-20.0, 20.0)}
    ranges |= {LAST_LOGIT: (-99.0, 99.0), LAST_MARGIN: (lead, 5.0)}
    assert str(choose_formats(config, ranges).formats.dense_format) == dense


def test_the_last_logits_of_a_linear_cell_are_those_of_the_last_window_that_ended():
    """Touch by touch, also where a touch has more windows than the network reads."""
    config = with_network(SMALL, cell="linear")
    touches = find_touches(config, scene(20, seed=2))
    for steps in (config.windows.steps, 3):
        model = float_model(config.replace(steps=steps))
        logits = model.forward(float_features(model, touches)[:, :steps])[1]
        for touch in np.flatnonzero(touches.completed)[:8]:
            last = logits[touch, min(touches.completed[touch], steps) - 1]
            seen = profile(model, touches.take([touch]))
            assert seen[LAST_LOGIT] == pytest.approx((last.min(), last.max()), rel=1e-12)
            second, first = np.sort(last)[-2:]
            assert seen[LAST_MARGIN] == pytest.approx((first - second, first - second), rel=1e-9)


def test_weak_signals_get_features_finer_than_their_sums():
    """A spread of 0.2 codes over 20 frames: 12-bit features would need a scale beyond 16 bits, so means get
    fraction bits; a preset's own formats are as coarse as the sums."""
    model = float_model()
    weak = FloatModel(SMALL, dict(model.arrays) | {"sigma": np.array(0.2), "mu": np.array(0.0)})
    ranges = profile(model, find_touches(SMALL, scene(20, seed=1)))
    integer = quantise_model(weak, ranges)
    assert integer.config.features.feature_shift == (-6,) and 2**14 <= integer.arrays["scale"][0] < 2**15
    assert integer.config.mean_frac == 6
    assert integer.config.formats == quantise_model(model, ranges).config.formats
    steps, fmt = SMALL.windows.steps, integer.config.formats.feature_format
    sums = np.random.default_rng(3).integers(
        0, 9, (1, steps, SMALL.inputs)
    )  # as of events, whose codes are 0 and 1
    codes = normalise(
        integer.config, sums, np.array([steps]), integer.arrays["mean"], integer.arrays["scale"]
    )
    ideal = weak.features(real_features(SMALL, sums))
    assert np.abs(fmt.to_real(codes) - ideal).max() < 2 * 2.0**-fmt.frac_bits
    preset = FloatModel(SMALL.replace(name="thesis"), weak.arrays, "made")
    plain = quantise_model(preset, ranges).config
    assert plain.mean_frac == 0 and plain.formats.feature_format.frac_bits < 8


@each_row("cell, recurrent, most", [("linear", 1.0, 16), ("gru", 1.0, 16), ("gru", 64.0, 12)])
def test_bits_of_a_feature_are_given_or_refused(cell, recurrent, most, tmp_path):
    """Recurrent weights that are far larger than the others leave products, and so features, fewer bits."""
    model = float_model(with_network(SMALL, cell=cell))
    factor = {"U": recurrent, "W": 1 / recurrent}
    arrays = {name: factor.get(name[0], 1.0) * array for name, array in model.arrays.items()}
    model = FloatModel(model.config, arrays | {"sigma": np.array(0.2), "mu": np.array(0.05)})
    model.save(tmp_path / "model", {})
    given, recordings = [], scene(20, seed=1)
    for bits in range(4, 17):
        try:
            integer = quantise(tmp_path / "model", recordings, feature_bits=bits)
            assert integer.config.formats.feature_format.width == bits
            given.append(bits)
        except InputError as error:
            assert f"{bits} bits are too many" in str(error) and f"at most {given[-1]} feat" in str(error)
    assert given == list(range(4, most + 1))


# ---------------------------------------------------------------------- evaluation
def test_evaluate_counts_what_it_says(tmp_path):
    folder = tmp_path / "model"
    recordings = saved(folder)
    quantise(folder)
    result = evaluate(folder, recordings)
    trace, ideal = run(IntegerModel.load(folder), recordings), run(FloatModel.load(folder), recordings)
    assert (result.recordings, result.not_touched, result.partial) == (20, 1, 1)
    right = np.sum(trace.decision == recordings.labels)
    assert result.integer_accuracy == pytest.approx(right / 20)
    assert result.agreement == pytest.approx(np.mean(trace.decision == ideal.decision))
    confusion = np.array(result.confusion)
    assert (confusion.sum(), np.trace(confusion), confusion.sum(axis=0)[-1]) == (20, right, 1)
    classes = result.per_class.values()
    assert sum(c.recordings * c.integer_accuracy for c in classes) == pytest.approx(right)
    assert [row.step for row in result.per_step] == [1, 2, 3, 4, 5, 6]
    touched = trace.first >= 0
    last = trace.local[trace.first[touched], 5] == recordings.labels[touched]
    # no touch, or cut short: wrong
    assert result.per_step[5].integer_accuracy == pytest.approx(last.sum() / 20)


def test_evaluate_and_compare_fail_where_nothing_is_decided_or_the_networks_differ(tmp_path, call):
    folder, data = tmp_path / "model", tmp_path / "data.npz"
    recordings = saved(folder)
    quantise(folder)
    arrays = FloatModel.load(folder).arrays
    for played, weights, words in (
        (recordings, arrays, ""),
        (recordings.until(np.full(20, 5)), arrays, "no recording was decided"),
        (recordings, arrays | {"V": -arrays["V"]}, "must agree on at least 98 %"),
    ):
        save_archive(played, data)
        np.savez(folder / "float.npz", **weights)
        for verb in ("evaluate", "compare"):
            status, _, errors = call(verb, folder, "--data", data)
            assert status == bool(words) and words in errors, (verb, words, errors)


@each_row("cell, reset", CELLS)
def test_lean_formats_need_no_saturated_logit_and_one_shift(cell, reset, tmp_path):
    config, recordings = with_network(SMALL, cell=cell, reset=reset), scene(30, seed=4)
    model = float_model(config)
    ranges = profile(model, find_touches(config, recordings))
    plain, lean = quantise_model(model, ranges), quantise_model(model, ranges, lean=True)
    chosen, formats = lean.config, lean.config.formats
    assert chosen.features.aligned_means and not plain.config.features.aligned_means
    (shift,) = set(chosen.features.feature_shift)
    assert not (lean.arrays["mean"] % (1 << shift)).any() and chosen.operand_bits <= 16
    assert formats.feature_format.frac_bits >= plain.config.formats.feature_format.frac_bits
    # every weight, bias and state at its worst: the logit still fits
    worst = chosen.network.hidden * 2 ** (formats.dense_format.width + formats.state_format.width - 2)
    worst += 2 ** (formats.dense_bias_format.width - 1) << chosen.dense_bias_shift
    worst += 1 << chosen.logit_shift - 1
    assert chosen.logit_proven and worst >> chosen.logit_shift <= formats.logit_format.max_code
    decided = [run(integer, recordings).decision for integer in (plain, lean)]
    assert np.mean(decided[0] == decided[1]) >= 0.9, "hardly another network"
    if shift:
        arrays = dict(lean.arrays) | {"mean": lean.arrays["mean"] + 1}
        IntegerModel(chosen, arrays).save(tmp_path / "model")
        with refused(r"array mean: is not a multiple of 2\*\*\d+, which aligned_means requires"):
            IntegerModel.load(tmp_path / "model")
