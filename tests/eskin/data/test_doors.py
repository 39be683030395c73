"""Recordings of other people's tools: written with the format's own library, they are the recordings of the
archive; damaged ones are refused in a sentence."""

import io
import os
import sys
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
from rosbags.rosbag2 import StoragePlugin

from eskin.data import Reading, load_recordings
from eskin.golden.data import Recordings
from tests.support import doors
from tests.support.table import each_row, refused

RATE = 200.0


@pytest.fixture
def known(make_recordings) -> Recordings:
    """Six recordings of two classes, by three persons."""
    groups = {"person": np.array([0, 1, 2, 0, 1, 2])}
    made = make_recordings(
        [20, 25, 30, 22, 21, 24], labels=[0, 0, 0, 1, 1, 1], sample_rate_hz=RATE, groups=groups
    )
    return replace(made, samples=made.samples % 1000, class_names=("felt", "silk"))


def check(recordings: Recordings, known: Recordings, unit: str = "", groups: bool = True) -> None:
    """The samples, rate, classes and groups are those of ``known``."""
    assert np.array_equal(recordings.samples, known.samples) and np.array_equal(
        recordings.offsets, known.offsets
    )
    assert recordings.class_names == known.class_names and np.array_equal(recordings.labels, known.labels)
    assert recordings.sample_rate_hz == pytest.approx(RATE, rel=1e-4) and recordings.unit == unit
    if groups:
        assert recordings.groups["person"].tolist() == known.groups["person"].tolist()


def test_hdf5_that_says_its_classes_in_attributes(tmp_path, known):
    with h5py.File(tmp_path / "a.hdf5", "w") as file:
        for index, label in enumerate(known.labels):
            table = file.create_dataset(f"r{index}", data=known.recording(index) / 8)
            table.attrs["material"], table.attrs["person"] = (
                known.class_names[label],
                known.groups["person"][index],
            )
            table.attrs["fs"] = RATE if index < 5 else 2 * RATE
    reading = Reading(label="material")
    with refused("'fs of r0' has 200 frames a second and 'fs of r5' 400; .*--rate HZ"):
        load_recordings(tmp_path / "a.hdf5", reading=reading)
    with h5py.File(tmp_path / "a.hdf5", "a") as file:
        file["r5"].attrs["fs"] = RATE
    recordings = load_recordings(tmp_path / "a.hdf5", reading=replace(reading, scale=0.125))
    check(recordings, known)
    assert recordings.volt_per_code == 0.125
    check(load_recordings(tmp_path / "a.hdf5", reading=Reading(scale=0.125)), known)
    with h5py.File(tmp_path / "a.hdf5", "a") as file:
        for table in file.values():
            table.attrs["texture"] = "dry"
    with refused("material and texture may name the class; choose one with --class"):
        load_recordings(tmp_path / "a.hdf5")


def test_a_data_frame_and_a_folder_of_parquet(tmp_path, known):
    table = doors.long_table(known)
    check(load_recordings(table), known, "mV")
    for (recording, name, person), rows in table.groupby(["recording", "class", "person"]):
        file = tmp_path / "by" / name / f"p{person}_{recording}.parquet"
        file.parent.mkdir(parents=True, exist_ok=True)
        rows[["time", "t0", "t1", "t2", "t3"]].to_parquet(file)
    check(load_recordings(tmp_path / "by"), known, "mV")


@each_row(
    "kind, plugin",
    [
        ("std_msgs/msg/UInt16MultiArray", StoragePlugin.MCAP),
        ("std_msgs/msg/Float32MultiArray", StoragePlugin.SQLITE3),
        ("tactile_msgs/msg/TactileState", StoragePlugin.SQLITE3),
        ("std_msgs/msg/Int32MultiArray", None),
        ("tactile_msgs/msg/TactileState", None),
    ],
)
def test_a_bag_with_classes_by_topic_and_by_times(tmp_path, known, kind, plugin):
    sources = [tmp_path / ("touches" if plugin else "touches.bag")]  # a folder and the file in it, or a file
    doors.write_bag(known, sources[0], kind, plugin)
    sources += [path for path in sources[0].glob("*") if path.suffix != ".yaml"]
    (tmp_path / "times.csv").write_text(doors.times_table(known))
    for source in sources:
        check(load_recordings(source, reading=Reading(label="/touched")), known, groups=False)
        check(load_recordings(source, reading=Reading(labels=tmp_path / "times.csv")), known)
    with refused("no column or attribute that names the class .* --class, of a log also with --labels"):
        load_recordings(source)
    with refused(r"--samples /x: is not a topic of this log; choose one of /skin"):
        load_recordings(source, reading=Reading(label="/touched", samples="/x"))


@each_row(
    "name, write, options",
    [
        ("a.h5", doors.write_hdf5, []),
        ("sets.hdf5", doors.write_hdf5_by_dataset, []),
        ("a.parquet", lambda known, path: doors.long_table(known).to_parquet(path), []),
        ("bag", doors.write_bag, ["--labels", "times.csv"]),
        ("a.bag", lambda known, path: doors.write_bag(known, path, plugin=None), ["--class", "/touched"]),
    ],
)
def test_convert_gives_the_archive_that_it_came_from(
    tmp_path, monkeypatch, call, known, name, write, options
):
    monkeypatch.chdir(tmp_path)
    write(known, Path(name))
    Path("times.csv").write_text(doors.times_table(known))
    status, out, err = call("convert", name, *options, "--out", "made.npz")
    assert status == 0, out + err
    check(load_recordings("made.npz"), known, "" if options else "mV", groups="--class" not in options)


def test_a_folder_of_ros_2_with_a_name_of_ros_1(tmp_path, known):
    doors.write_bag(known, tmp_path / "a.bag")
    with refused("rename it without .bag"):
        load_recordings(tmp_path / "a.bag", reading=Reading(label="/touched"))


def test_times_of_the_logs_own_clock(tmp_path, known):
    doors.write_bag(known, tmp_path / "bag")
    table = pd.read_csv(io.StringIO(doors.times_table(known)))
    table[["start", "end"]] += 1e9
    table.to_csv(tmp_path / "times.csv", index=False)
    check(load_recordings(tmp_path / "bag", reading=Reading(labels=tmp_path / "times.csv")), known)


def test_a_log_a_recording_in_a_folder_by_class(tmp_path, known):
    """MCAP of JSON beside bags of ROS 2."""
    for index, label in enumerate(known.labels):
        place = tmp_path / known.class_names[label] / f"p{known.groups['person'][index]}_{index}"
        place.parent.mkdir(exist_ok=True)
        if index % 2:
            doors.write_json_mcap(known.subset([index]), place.with_suffix(".mcap"))
        else:
            doors.write_bag(known.subset([index]), place)
    check(load_recordings(tmp_path), known)


@each_row("name", ["a.npz", "a.csv", "a.mat", "a.h5", "a.mcap", "bag/bag.db3"])
def test_a_pipe_is_refused(tmp_path, known, name):
    doors.write_bag(known, tmp_path / "bag", plugin=StoragePlugin.SQLITE3)
    (tmp_path / name).unlink(missing_ok=True)
    os.mkfifo(tmp_path / name)
    with refused("is not a regular file"):
        load_recordings(tmp_path / name.partition("/")[0], reading=Reading(label="/touched"))


@each_row(
    "name, package, extra",
    [
        ("a.h5", "h5py", "hdf5"),
        ("a.parquet", "pyarrow", "parquet"),
        ("a.mcap", "mcap", "ros"),
        ("a.bag", "rosbags", "ros"),
    ],
)
def test_without_its_extra_the_sentence_names_it(tmp_path, monkeypatch, name, package, extra):
    (tmp_path / name).write_bytes(b"x")
    for module in [module for module in sys.modules if module.partition(".")[0] == package]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, package, None)
    with refused(rf"needs {package}, .* pip install 'eskin\[{extra}\]'"):
        load_recordings(tmp_path / name, reading=Reading(label="/x"))


def test_a_table_of_times_is_for_a_log(tmp_path, known):
    doors.write_hdf5(known, tmp_path / "a.h5")
    for source in (tmp_path / "a.h5", tmp_path):
        with refused("--labels is for one log"):
            load_recordings(source, reading=Reading(labels=tmp_path / "times.csv"))


def test_an_unknown_ending_is_refused_with_the_formats_there_are(tmp_path):
    (tmp_path / "a.xlsx").write_bytes(b"PK")
    with refused(r"ends in '.xlsx', which is not a format .* \.npz .*\.h5 .*\.mcap"):
        load_recordings(tmp_path / "a.xlsx")
