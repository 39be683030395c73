"""Scales: one sensor written twice has one scale or is brought to it, and a scale that loses samples is named."""

import json
from dataclasses import replace

import numpy as np
import pytest

import eskin
from eskin.data.archive import load_archive, save_archive
from eskin.data.fit import check_fit, rescaled
from eskin.golden.core import AcceleratorConfig
from eskin.golden.data.codes import to_codes
from eskin.golden.data.recordings import recordings_of
from eskin.golden.model import Stream, load_config
from eskin.training.derive import for_recordings
from eskin.verbs import run_job
from tests.support.random_models import random_integer_model
from tests.support.recipes import few_updates
from tests.support.small_designs import TRACKED
from tests.support.table import each_row, refused

COLUMNS = ("left", "middle", "right")


def folder(path, gain: float, order=COLUMNS, classes=("press", "tap")):
    """A CSV file a recording, real samples; the middle taxel hardly moves."""
    rng = np.random.default_rng(1)
    for label, name in enumerate(classes):
        for number in range(4):
            time = np.arange(300)
            touch = np.where(time > 100, np.sin(0.02 * (label + 1) * time), 0.0)
            values = {column: gain * touch + rng.normal(0, 0.01, 300) for column in COLUMNS}
            values["left"] *= 1.2
            values["middle"] = 1e-5 * rng.normal(0, 1, 300)
            (path / name).mkdir(parents=True, exist_ok=True)
            rows = np.column_stack([time / 1000, *(values[column] for column in order)])
            np.savetxt(
                path / name / f"{number}.csv",
                rows,
                delimiter=",",
                header=",".join(("time", *order)),
                comments="",
            )
    return path


@pytest.fixture
def first(tmp_path, call, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder(tmp_path / "a", 1.0)
    status, out, err = call("convert", "a", "--out", "a.npz")
    assert status == 0 and "taxel middle: fewer than 16 codes" in out + err, (out, err)
    for said in ("2 folders are classes, 8 files recordings", "1000 Hz", "eskin inspect a.npz"):
        assert said in out
    return load_archive(tmp_path / "a.npz")


def test_like_takes_scale_columns_classes_and_rate(first, tmp_path, call):
    folder(tmp_path / "b", 0.3, order=("right", "left", "middle"), classes=("tap",))
    assert call("convert", "b", "--out", "b.npz", "--like", "a.npz")[0] == 0
    second = load_archive(tmp_path / "b.npz")
    assert second.volt_per_code == first.volt_per_code and second.channel_names == COLUMNS
    assert second.class_names == ("press", "tap") and set(second.labels) == {1}
    assert second.sample_rate_hz == first.sample_rate_hz


def test_another_scale_is_brought_to_the_models_codes(first, tmp_path, call, monkeypatch):
    def says(sentence: str, words: str) -> str:
        status, _, err = call(*words.split())
        assert status in (0, 1) and sentence in err, err
        return err

    told = "recordings 'e.npz': one code is"
    changes = dict(taxels=3, sample_signed=True, onset="immediate", rest="none", rest_frames=0)
    config = for_recordings(TRACKED, first, cell="linear", decision="last", **changes)
    (tmp_path / "c.json").write_text(config.to_json())
    few_updates(monkeypatch, 20)
    train = "train --data a.npz --config c.json --folds 0 --out m".split()
    assert call(*train)[0] == 0 and call("quantise", "m")[0] == 0
    folder(tmp_path / "b", 0.3)
    folder(tmp_path / "c", 9.0)
    for name, clips in (("b", False), ("c", True)):
        assert call("convert", name, "--out", f"{name}.npz")[0] == 0
        assert (
            load_archive(tmp_path / f"{name}.npz").volt_per_code
            != load_config(tmp_path / "m").sensor.volt_per_code
        )
        err = says("brought to its codes", f"evaluate m --data {name}.npz")
        assert ("were held at its ends: taxels 0, 2" in err) == clips, err
    assert call("convert", "b", "--out", "d.npz", "--like", "m")[0] == 0
    assert load_archive(tmp_path / "d.npz").volt_per_code == first.volt_per_code

    for data in "ad":
        seen = "accuracies are of the training data" in call("evaluate", "m", "--data", f"{data}.npz")[1]
        assert seen == (data == "a")

    # enrol, enrol --teach, run --test and recordings handed to Python refused them
    assert call("convert", "a", "--out", "e.npz", "--scale", "2e-4")[0] == 0
    other, model = load_archive(tmp_path / "e.npz"), eskin.Model.load(tmp_path / "m")
    says(told, "enrol m --data e.npz --with a.npz --out enrolled")
    with pytest.warns(match="recordings '.*e.npz': one code is .*: brought to its codes"):
        read = model.recordings(other)
    assert read.volt_per_code == model.config.sensor.volt_per_code
    assert np.array_equal(read.labels, other.labels) and read.class_names == other.class_names

    kept = []
    monkeypatch.setattr(
        run_job._Steps, "all", lambda steps, *_: kept.append(steps.held_back) or {"passed": True}
    )
    monkeypatch.setattr(run_job.report, "write_report", lambda folder: folder.mkdir())
    _, _, err = call(*"run --data a.npz --config m/config.json --test e.npz --out r".split())
    assert kept and kept[0].volt_per_code == first.volt_per_code and told in err

    assert call(*"quantise m --data a.npz --readout prototypes".split())[0] == 0
    says(told, "enrol m --teach e.npz --out taught")


def test_a_scale_that_clips_is_refused_with_the_column_and_one_that_holds_it(first, call):
    status, _, err = call("convert", "a", "--out", "s.npz", "--scale", "1e-5")
    assert status == 2 and "taxel left: a scale of 1e-05 puts" in err and "give 5e-05, which holds all" in err
    assert call("convert", "a", "--out", "s.npz", "--scale", "5e-5")[0] == 0


@each_row(
    "level, scale, fix",
    [(101300.5, None, "level at rest"), (0.5, 1.0, "level at rest, or give a scale of 0.0002")],
)
def test_a_smaller_scale_is_advised_where_it_holds_all_and_has_codes_enough(level, scale, fix):
    values = level + 5 * np.sin(0.1 * np.arange(500))[:, None]
    assert to_codes(values, "made", scale, requested=True)[2][-1].endswith(f"the least: subtract the {fix}")


# ---------------------------------------------------------------------- columns of different kinds
KINDS = ("encoder1", "encoder2", "acc_x", "acc_y", "acc_z")


def mixed(count: int = 24, seed: int = 3) -> dict:
    """An archive of encoders of some 3000 and accelerations of about 1, which alone tell the class."""
    rng = np.random.default_rng(seed)
    labels = np.arange(count) % 2
    encoders = rng.normal(0, 1000, (count, 80, 2))
    turned = np.stack([np.sin(0.3 * np.arange(80)) * side for side in (0.2, -0.2)])[labels]
    samples = np.concatenate([encoders, rng.normal(0, 0.05, (count, 80, 3)) + turned[..., None]], axis=2)
    return {
        "samples": samples.reshape(-1, 5).astype(np.float32),
        "offsets": 80 * np.arange(count + 1),
        "labels": labels,
        "class_names": np.array(["left", "right"]),
        "sample_rate_hz": np.array(50.0),
        "channel_names": np.array(KINDS),
    }


def test_columns_of_different_kinds_get_a_scale_each(tmp_path):
    """By their names or their units; of one kind, or where nothing tells kinds, one scale stays."""
    arrays = mixed()
    made = recordings_of(arrays, "mixed")
    encoder, other, *accelerations = made.volt_per_code
    assert encoder == other > 1000 * accelerations[0] and len(set(accelerations)) == 1
    assert np.ptp(made.samples, axis=0).min() > 10_000
    units = np.array(["deg", "deg", "g", "g", "g"])
    by_unit = recordings_of(arrays | {"unit": units, "channel_names": np.array(list("abcde"))}, "units")
    assert by_unit.volt_per_code == made.volt_per_code and by_unit.unit == "deg, deg, g, g, g"
    for stem in ("taxel", "col", "A", "sensor", "name"):  # a word of taxels; of nothing; five words
        names = np.array(list("abcde") if stem == "name" else [f"{stem}{number}" for number in range(5)])
        scale = recordings_of(arrays | {"channel_names": names}, "one").volt_per_code
        assert isinstance(scale, float) if stem == "taxel" else scale == made.volt_per_code
    touch = np.sin(np.arange(500) / 9)[:, None] * (5, 90, 1600, 60_000)  # most neighbours are 18 apart
    assert len(set(to_codes(touch, "unnamed")[1])) == 3
    noise = np.random.default_rng(1).normal(size=(500, 1))
    touch = np.hstack([touch[:, :1] * 100] * 3 + [noise])  # vibration, or a dead taxel
    _, scale, notes = to_codes(touch, "unnamed")
    assert isinstance(scale, float) and "taxel 3: far below the others" in notes[1]
    save_archive(by_unit, tmp_path / "kept.npz")
    with np.load(tmp_path / "kept.npz") as kept:
        assert kept["lsb_volt"].shape == (5,) and kept["unit"].tolist() == units.tolist()
    again = load_archive(tmp_path / "kept.npz")
    assert again.volt_per_code == made.volt_per_code and again.unit == by_unit.unit
    assert again.content == by_unit.content


def test_a_model_of_mixed_columns_reads_codes_streams_and_other_scales(tmp_path):
    recordings = recordings_of(mixed(), "mixed")
    config = AcceleratorConfig.of(
        taxels=5,
        sample_rate_hz=50.0,
        sample_signed=True,
        volt_per_code=recordings.volt_per_code,
        class_names=recordings.class_names,
    )
    assert AcceleratorConfig.from_dict(json.loads(config.to_json())) == config
    finer = replace(
        recordings,
        samples=2 * recordings.samples // 3,
        volt_per_code=tuple(1.5 * worth for worth in recordings.volt_per_code),
    )
    brought = rescaled(finer, config)
    assert (
        brought.volt_per_code == config.sensor.volt_per_code and "brought to its codes" in brought.notes[-1]
    )
    assert np.abs(brought.samples - recordings.samples).max() <= 1
    check_fit(brought, config)
    with refused("array lsb_volt: has a code worth .* to .* and configuration"):
        check_fit(finer, config)
    stream = Stream(random_integer_model(config, 1))
    real = recordings.recording(0) * np.array(recordings.volt_per_code)
    assert stream.push(real) == Stream(random_integer_model(config, 1)).push(recordings.recording(0))
    with refused("volt_per_code: has 2 values for 5 taxels; give one for each"):
        config.replace(volt_per_code=(1.0, 2.0))
    with refused("array lsb_volt: is of shape"):
        recordings_of(mixed() | {"lsb_volt": np.array([1.0, 2, 3, 4, -5])}, "bad")
