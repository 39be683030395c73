"""Lists in Parquet, and data sets in LeRobot's form: what was recorded, or a sentence with the option."""

import json

import numpy as np
import pandas as pd
import pytest

from eskin.data import Reading, load_recordings
from tests.support.doors import write_lerobot
from tests.support.table import each_row, refused

SHAPES = {"taxels": (6,), "a grid": (3, 2)}
LABELS = ["silk", "felt", "felt", "silk", "silk"]
TOUCH = Reading(samples="observation.touch")


def signals(shape: tuple[int, ...]) -> list[np.ndarray]:
    numbers = np.random.default_rng(1)
    return [np.round(numbers.normal(0, 1, (frames, *shape)), 3) for frames in (30, 41, 30, 55, 62)]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("files, fixed", [(1, False), (3, True)])
def test_episodes_are_recordings_and_tasks_classes(shape, files, fixed, tmp_path):
    due = signals(SHAPES[shape])
    write_lerobot(due, LABELS, tmp_path / "set", files=files, fixed=fixed and shape == "taxels")
    read = load_recordings(tmp_path / "set", reading=TOUCH)
    assert read.sample_rate_hz == 100 and read.class_names == ("felt", "silk")
    assert read.grid == (SHAPES[shape] if shape == "a grid" else ())
    assert [read.class_names[label] for label in read.labels] == LABELS
    assert read.groups["episode_index"].tolist() == [0, 1, 2, 3, 4]
    for index, signal in enumerate(due):
        codes = read.recording(index) * read.volt_per_code
        assert np.abs(codes - signal.reshape(len(signal), -1)).max() <= 0.51 * np.max(read.volt_per_code)


def test_names_rate_and_another_class_are_the_files(tmp_path):
    names = {"taxels": list("abcdef")}
    touch = {"dtype": "float32", "shape": [6], "names": names, "fps": 50}
    folder = write_lerobot(signals((6,)), LABELS, tmp_path / "set", features={"observation.touch": touch})
    with refused("stream observation.touch has 50 frames a second and a row of the data set 100", "--rate"):
        load_recordings(folder)
    read = load_recordings(folder, reading=Reading(rate_hz=100, label="task_index", columns=("b", "e")))
    assert read.channel_names == ("b", "e") and read.class_names == ("0", "1")
    (folder / "meta/tasks.parquet").unlink()  # classes of a column need no texts
    assert load_recordings(folder, reading=Reading(rate_hz=100, label="task_index")).taxels == 6


@each_row(
    "changes, reading, sentence",
    [
        (
            {},
            Reading(),
            r"2 streams of numbers \(observation.touch \(6, 100 Hz\), action \(2, 100 Hz\)\).*--samples",
        ),
        ({}, Reading(samples="view"), "--samples view: is no stream of numbers"),
        ({}, Reading(samples="touch"), "--samples touch: is no stream"),
        ({"codebase_version": "v2.1"}, TOUCH, "version v2.1"),
        ({"total_frames": 7}, TOUCH, "counts 7 frames"),
        ({"fps": "fast"}, TOUCH, "info.json is damaged"),
        ({"features": {"observation.touch": 3}}, TOUCH, "info.json is damaged"),
        ({"fps": 30}, TOUCH, "30 frames a second and.* 100"),
    ],
)
def test_what_is_not_clear_is_refused_with_the_option(changes, reading, sentence, tmp_path):
    folder = write_lerobot(signals((6,)), LABELS, tmp_path / "set", **changes)
    with refused(sentence):
        load_recordings(folder, reading=reading)


def test_files_that_are_missing_or_damaged(tmp_path):
    folder = write_lerobot(signals((6,)), ["felt"] * 5, tmp_path / "set", files=2)
    with refused("one task", "--class"):
        load_recordings(folder, reading=TOUCH)
    tasks, first = folder / "meta/tasks.parquet", folder / "data/chunk-000/file-000.parquet"
    tasks.write_bytes(b"PAR1")
    with refused("tasks.parquet is damaged"):
        load_recordings(folder, reading=TOUCH)
    tasks.unlink()
    with refused("has no meta/tasks.parquet.*--class"):
        load_recordings(folder, reading=TOUCH)
    first.write_bytes(first.read_bytes()[:100])
    by_column = Reading(samples="observation.touch", label="task_index")
    with refused("file of data is damaged"):
        load_recordings(folder, reading=by_column)
    for file in folder.glob("data/*/*"):
        file.unlink()
    with refused("has no data/"):
        load_recordings(folder, reading=by_column)
    (folder / "meta/info.json").write_text(json.dumps([]))
    with refused("info.json is damaged"):
        load_recordings(folder)


def test_a_file_alone_has_lists_too(tmp_path):
    """One column of lists needs no name; lists that differ in length are told with their row."""
    rows = [
        {"force": np.arange(4.0) + n % 20 + trial, "t": n % 20 / 50, "trial": trial, "label": "ab"[trial % 2]}
        for trial in range(4)
        for n in range(20)
    ]
    pd.DataFrame(rows).to_parquet(tmp_path / "a.parquet")
    read = load_recordings(tmp_path / "a.parquet", reading=Reading(recording="trial"))
    assert (read.taxels, len(read), read.channel_names[3]) == (4, 4, "force.3")
    assert (read.recording(2)[:, 1] == np.arange(20) + 3).all()
    pd.DataFrame(rows).assign(raw=b"\xff", label=b"a").to_parquet(tmp_path / "raw.parquet")
    assert load_recordings(tmp_path / "raw.parquet", reading=Reading(recording="trial")).class_names == ("a",)
    for odd in (np.arange(3.0), None):
        rows[7]["force"] = odd
        pd.DataFrame(rows).to_parquet(tmp_path / "b.parquet")
        with refused("'force' has lists of several lengths, or empty ones, from row 8 on"):
            load_recordings(tmp_path / "b.parquet")
    rows[7]["force"] = np.array([1.0, np.nan, 2.0, 3.0])
    pd.DataFrame(rows).to_parquet(tmp_path / "c.parquet")
    with refused("line 8: column 'force.1' holds 'nan'"):
        load_recordings(tmp_path / "c.parquet", reading=Reading(recording="trial"))
    with refused("--samples torque: is no column"):
        load_recordings(tmp_path / "a.parquet", reading=Reading(samples="torque"))
