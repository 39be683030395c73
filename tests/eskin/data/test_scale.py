"""Scales: one sensor written twice has one scale or is brought to it, and a scale that loses samples is named."""

import numpy as np
import pytest

import eskin
from eskin.golden.data import load_archive
from eskin.golden.model import load_config
from eskin.verbs import main_job

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
    return load_archive(tmp_path / "a.npz")


def test_like_takes_scale_columns_classes_and_rate(first, tmp_path, call):
    folder(tmp_path / "b", 0.3, order=("right", "left", "middle"), classes=("tap",))
    assert call("convert", "b", "--out", "b.npz", "--like", "a.npz")[0] == 0
    second = load_archive(tmp_path / "b.npz")
    assert second.volt_per_code == first.volt_per_code and second.channel_names == COLUMNS
    assert second.class_names == ("press", "tap") and set(second.labels) == {1}
    assert second.sample_rate_hz == first.sample_rate_hz


def test_another_scale_is_brought_to_the_models_codes(first, tmp_path, call, monkeypatch):
    train = "train --data a.npz --cell linear --folds 0 --out m".split()
    assert call(*train)[0] == 0 and call("quantise", "m")[0] == 0
    folder(tmp_path / "b", 0.3)
    folder(tmp_path / "c", 9.0)
    for name, clips in (("b", False), ("c", True)):
        assert call("convert", name, "--out", f"{name}.npz")[0] == 0
        assert (
            load_archive(tmp_path / f"{name}.npz").volt_per_code
            != load_config(tmp_path / "m").sensor.volt_per_code
        )
        status, _, err = call("evaluate", "m", "--data", f"{name}.npz")
        assert status in (0, 1) and "brought to its codes" in err
        assert ("were held at its ends: taxels 0, 2" in err) == clips, err
    assert call("convert", "b", "--out", "d.npz", "--like", "m")[0] == 0
    assert load_archive(tmp_path / "d.npz").volt_per_code == first.volt_per_code

    # enrol, enrol --teach, run --test and recordings handed to Python refused them
    assert call("convert", "a", "--out", "e.npz", "--scale", "2e-4")[0] == 0
    other, model = load_archive(tmp_path / "e.npz"), eskin.Model.load(tmp_path / "m")
    status, _, err = call("enrol", "m", "--data", "e.npz", "--with", "a.npz", "--out", "enrolled")
    assert status in (0, 1) and "recordings 'e.npz': one code is" in err, err
    with pytest.warns(match="recordings '.*e.npz': one code is .*: brought to its codes"):
        read = model.recordings(other)
    assert read.volt_per_code == model.config.sensor.volt_per_code
    assert np.array_equal(read.labels, other.labels) and read.class_names == other.class_names

    kept = []
    monkeypatch.setattr(main_job._Steps, "all", lambda steps, *_: kept.append(steps.held) or {"passed": True})
    monkeypatch.setattr(main_job.report, "write_report", lambda folder: folder.mkdir())
    config = tmp_path / "m" / "config.json"
    status, _, err = call("run", "--data", "a.npz", "--config", config, "--test", "e.npz", "--out", "r")
    assert kept and kept[0].volt_per_code == first.volt_per_code and "recordings 'e.npz': one code is" in err

    assert call(*"quantise m --data a.npz --readout prototypes".split())[0] == 0
    status, _, err = call("enrol", "m", "--teach", "e.npz", "--out", "taught")
    assert status in (0, 1) and "recordings 'e.npz': one code is" in err, err


def test_a_scale_that_clips_is_refused_with_the_column_and_one_that_holds_it(first, call):
    status, _, err = call("convert", "a", "--out", "s.npz", "--scale", "1e-5")
    assert status == 2 and "taxel left: a scale of 1e-05 puts" in err and "give 5e-05, which holds all" in err
    assert call("convert", "a", "--out", "s.npz", "--scale", "5e-5")[0] == 0
