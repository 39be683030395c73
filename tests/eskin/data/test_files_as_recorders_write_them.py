"""Files as recorders write them, which were read wrongly once: understood, or refused by the option's name."""

from functools import partial

import h5py
import numpy as np
import pytest
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode
from scipy.io import savemat

from eskin.data import Reading, load_recordings
from eskin.data.folds import no_group
from eskin.golden.core import InputError
from eskin.golden.data import Recordings
from eskin.training.splits import check_split
from tests.support import doors
from tests.support.table import each_row, refused
from tests.support.written import by_class, texts

RNG = np.random.default_rng(5)
FRAMES = 40
SIGNALS = [np.round(RNG.normal(0, 0.3, (FRAMES, 3)), 4) for _ in range(4)]
CLASSES = ("felt", "silk")
files = partial(by_class, classes=CLASSES)


def check(recordings):
    """The recordings are the signals, class by class, at 100 Hz."""
    assert recordings.class_names == CLASSES and recordings.sample_rate_hz == 100
    assert len(recordings) == 4 and recordings.taxels == 3
    for index, number in enumerate((0, 2, 1, 3)):
        values = recordings.recording(index) * (recordings.volt_per_code or 1.0)
        assert np.abs(values - SIGNALS[number]).max() < 1e-3


# ---------------------------------------------------------------------- .lvm


@each_row(
    "clocks, runs_on, separator",
    [("One", True, ","), ("One", False, "\t"), ("No", True, "\t"), ("No", False, ","), ("No", False, ";")],
)
def test_segments_are_recordings_unless_the_clock_runs_on(tmp_path, clocks, runs_on, separator):
    word = {"\t": "Tab", ",": "Comma", ";": "Semicolon"}[separator]

    def write(path, number):
        text = doors.lvm(np.split(SIGNALS[number], 2), clocks=clocks, runs_on=runs_on)
        path.write_text(text.replace("Separator\tTab", f"Separator\t{word}").replace("\t", separator))

    recordings = load_recordings(files(tmp_path, write, "r{}.lvm"))
    assert len(recordings) == (4 if runs_on and clocks == "One" else 8) and recordings.frames == 4 * FRAMES
    assert recordings.sample_rate_hz == 100


@each_row(
    "old, new, said",
    [
        ("X_Value\tVoltage\tVoltage\t", "X_Value\t", "line 16: has 4 numbers where the header has 3 names"),
        ("Delta_X\t0.01\t0.01", "Delta_X\t0.01\t0.02", "several Delta_X"),
    ],
)
def test_a_head_that_does_not_fit_is_refused(tmp_path, old, new, said):
    text = doors.lvm([SIGNALS[0]]).replace(old, new)
    with refused(said):
        texts(tmp_path, lambda number: text, name="r{}.lvm")


# ---------------------------------------------------------------------- HDF5
def trials(path, **more):
    return doors.write_trials(SIGNALS, [CLASSES[n % 2] for n in range(4)], path, **more)


@each_row("more", [{"time_ms": np.arange(FRAMES) * 10}, {"on__sampling_rate": 100.0}])
def test_a_clock_has_the_unit_of_its_name_and_a_group_may_say_the_rate(tmp_path, more):
    path = trials(tmp_path / "a.h5", label=lambda n: CLASSES[n % 2], clock=False, **more)
    assert load_recordings(path).sample_rate_hz == 100


@each_row(
    "more, sentence",
    [
        ({}, "trial0, trial1, trial2, trial3 would be as many classes as recordings; .* --class"),
        ({"imu": lambda n: np.zeros((FRAMES, 6)), "label": "x"}, "skin 40 x 3.* --samples"),
        (
            {"force": lambda n: np.arange(FRAMES) % 7, "label": "x"},
            "force 40, label, skin 40 x 3.* --samples",
        ),
    ],
)
def test_what_hdf5_does_not_say_is_refused_with_what_there_is(tmp_path, more, sentence):
    with refused(sentence):
        load_recordings(trials(tmp_path / "a.h5", **more))


def test_names_that_are_no_unicode_are_replaced_or_refused(tmp_path):
    path = trials(tmp_path / "a.h5", label=lambda n: CLASSES[n % 2])
    with h5py.File(path, "r+") as file:
        file["trial0"].attrs[b"\xffnit"] = "mV"
    assert load_recordings(path).taxels == 3
    with h5py.File(path, "r+") as file:
        file[b"b\xff"] = SIGNALS[0]
    with refused("name is not UTF-8"):
        load_recordings(path)


def test_the_samples_of_several_sensors_are_named(tmp_path):
    path = trials(tmp_path / "a.h5", imu=lambda n: np.zeros((FRAMES, 6)), label=lambda n: CLASSES[n % 2])
    assert load_recordings(path, reading=Reading(samples="skin")).taxels == 3
    with refused("--samples nothing: names no array of samples; it has trial0/imu 40 x 6"):
        load_recordings(path, reading=Reading(samples="nothing"))


def test_more_taxels_than_frames_are_refused_unless_columns_are_named(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for number in range(4):
            file[f"{CLASSES[number % 2]}/r{number}"] = SIGNALS[number].T
    with refused(r"more taxels than frames \(3 x 40 in recording 0\)"):
        load_recordings(tmp_path / "a.h5", reading=Reading(rate_hz=100))
    assert load_recordings(tmp_path / "a.h5", reading=Reading(rate_hz=100, columns=("1-40",))).taxels == 40


def test_a_virtual_dataset_is_refused_by_name(tmp_path):
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["x"] = SIGNALS[0]
    layout = h5py.VirtualLayout((FRAMES, 3), "f8")
    layout[:] = h5py.VirtualSource(tmp_path / "secret.h5", "x", (FRAMES, 3))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["felt/r0"] = SIGNALS[1]
        file.create_virtual_dataset("silk/r0", layout)
    with refused("array silk/r0: has its samples in other files"):
        load_recordings(tmp_path / "a.h5", reading=Reading(rate_hz=100))


# ---------------------------------------------------------------------- logs
def log(path, **form):
    """Eight touches in turn, felt at 100 and silk at 200."""
    touches = [np.tile([100 + 100 * (number % 2), number % 7], (FRAMES, 1)) for number in range(8)]
    return doors.write_touches(touches, list(CLASSES) * 4, path, **form)


def pure(recordings) -> bool:
    """Whether every recording is of its class alone."""
    codes = [{*recordings.recording(index)[:, 0].tolist()} for index in range(len(recordings))]
    return codes == [{100 + 100 * int(label)} for label in recordings.labels]


@each_row(
    "form", [{"off": -0.25}, {"off": 2.5}, {"stamp": ("secs", "nsecs")}, {"zero": 5}, {"off": -2, "zero": 1}]
)
def test_frames_and_labels_go_by_the_logs_clock(tmp_path, form):
    recordings = load_recordings(log(tmp_path / "a.mcap", **form), reading=Reading(label="/touched"))
    assert len(recordings) == 8 and pure(recordings) and recordings.sample_rate_hz == 100
    notes = "\n".join(recordings.notes)
    assert ("s off the log's" in notes) == (abs(form.get("off", 0)) > 1)
    assert ("stamps in the headers of topic /skin are 0" in notes) == ("zero" in form)


def test_the_headers_clock_is_asked_for(tmp_path):
    reading = Reading(label="/touched", clock="header")
    assert pure(load_recordings(log(tmp_path / "a.mcap", off=-3, stamped_labels=True), reading=reading))
    for form, topic in (({}, "/touched"), ({"zero": 3}, "/skin")):
        with refused(f"--clock header: .* messages of topic {topic} have no stamp"):
            load_recordings(log(tmp_path / "a.mcap", **form), reading=reading)
    with refused("--clock is for one log"):
        load_recordings(tmp_path, reading=reading)


def test_rows_of_times_that_overlap_are_refused_with_both(tmp_path):
    (tmp_path / "t.csv").write_text("start,end,class\n1,1.5,felt\n0,0.5,silk\n0.4,1,felt\n1.5,2,silk\n")
    with refused(r"t.csv', line 4: begins at 0.4 s, before line 3 ends at 0.5 s"):
        load_recordings(log(tmp_path / "a.mcap"), reading=Reading(labels=tmp_path / "t.csv", samples="/skin"))


def test_a_log_that_unpacks_to_far_more_is_refused(tmp_path, monkeypatch):
    """Whatever a chunk says of its size."""
    monkeypatch.setattr("eskin.data.table.UNPACKED_BYTES", 1 << 20)
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file, compression=CompressionType.LZ4, chunk_size=1 << 30)
        writer.start()
        schema = writer.register_schema("MultiArray", "jsonschema", b"{}")
        skin = writer.register_channel("/skin", "json", schema)
        for at in range(3):
            writer.add_message(skin, at, b'{"data":[' + b"0," * (1 << 20) + b"0]}", at)
        writer.finish()
    with refused(r"a.mcap': has \d+ bytes and unpacks to"):
        load_recordings(tmp_path / "a.mcap", reading=Reading(rate_hz=100))


def test_a_parquet_file_of_one_long_text_is_refused_before_it_is_unpacked(tmp_path, monkeypatch):
    import pandas as pd

    monkeypatch.setattr("eskin.data.table.UNPACKED_BYTES", 1 << 20)
    frame = pd.DataFrame({"class": ["x" * 10_000] * 200, "t0": range(200)})
    frame.to_parquet(tmp_path / "a.parquet")
    with refused(r"a.parquet': has \d+ bytes and unpacks to 2 MB"):
        load_recordings(tmp_path / "a.parquet")


@each_row(
    "plugin, packed",
    [
        (doors.StoragePlugin.SQLITE3, (CompressionMode.MESSAGE, CompressionFormat.ZSTD)),
        (doors.StoragePlugin.SQLITE3, (CompressionMode.FILE, CompressionFormat.ZSTD)),
        (None, (doors.Writer1.CompressionFormat.BZ2,)),
    ],
)
def test_a_packed_bag_is_refused(tmp_path, make_recordings, plugin, packed):
    known = make_recordings([30, 30], labels=[0, 1], sample_rate_hz=100.0)
    doors.write_bag(known, tmp_path / "a.bag", plugin=plugin, packed=packed)
    path = (tmp_path / "a.bag").rename(tmp_path / "bag") if plugin else tmp_path / "a.bag"
    with refused("bag': is packed; unpack it with ROS's own tools"):
        load_recordings(path, reading=Reading(label="/touched"))


# ---------------------------------------------------------------------- text
def rows(number, time=True):
    return [
        ",".join([*([f"{k / 100:.2f}"] if time else []), *map(str, row)])
        for k, row in enumerate(SIGNALS[number])
    ]


@each_row("time", [True, False])
@each_row("parting, told", [("", False), (",,,", True), ("\n\n", False)])
def test_blank_lines_and_rows_of_separators_part_recordings(tmp_path, time, parting, told):
    head = "time,a,b,c" if time else "a,b,c"
    text = lambda place: "\n".join([head, *rows(place, time), parting, *rows(place + 2, time), ""])
    recordings = texts(tmp_path, text, Reading(rate_hz=100), classes=CLASSES, count=2)
    check(recordings)
    assert any("rows of separators alone, first line 42" in note for note in recordings.notes) == told


@each_row(
    "head, row, notes",
    [
        ("sep=;\ntime;a;b;c", lambda row: row.replace(",", ";"), []),
        ('"sep=,"\ntime,a,b,c', lambda row: row, []),
        ("sep=|\ntime|a|b|c", lambda row: row.replace(",", "|"), []),
        ("time,a,b,c,sampling_hz", lambda row: f"{row},100", ["'sampling_hz' is called like a rate"]),
        ("time,a,b,c,heart_rate", lambda row: f"{row},61.5", ["'heart_rate' is called like a rate"]),
        ("a,b,c,Fs", lambda row: f"{row.partition(',')[2]},100", ["'Fs' is called like a rate"]),
    ],
)
def test_heads_and_columns_that_are_no_taxels(tmp_path, head, row, notes):
    recordings = texts(tmp_path, lambda n: "\n".join([head, *map(row, rows(n))]), classes=CLASSES)
    check(recordings)
    assert all(any(said in note for note in recordings.notes) for said in notes)


def test_dates_in_words_name_the_option_and_columns_their_number_in_the_file(tmp_path):
    dated = lambda path, number: path.write_text(
        "\n".join(["time,a,b,c", *(f"26.11.2026 12:00:{row}" for row in rows(number))])
    )
    root = files(tmp_path / "dated", dated)
    with refused(r"line 2: column 'time' holds '26.11.2026 12:00:0.00'.* --rate HZ"):
        load_recordings(root)
    check(load_recordings(root, reading=Reading(rate_hz=100, columns=("a", "b", "c"))))
    odd = lambda path, number: path.write_text(
        "\n".join([*rows(number)[:9], "0.09,1,x,2", *rows(number)[10:]])
    )
    with refused("line 10: column 3 holds 'x', which is not a number"):
        load_recordings(files(tmp_path / "odd", odd), reading=Reading(columns=("3-4",), rate_hz=100))


# ---------------------------------------------------------------------- folders and .mat
def save_h5(path, number):
    with h5py.File(path, "w") as file:
        file["skin"], file.attrs["fs"] = SIGNALS[number], 100


@each_row(
    "suffix, write, rate",
    [
        (".npy", lambda path, number: np.save(path, SIGNALS[number]), 100),
        (".mat", lambda path, number: savemat(path, {"x": SIGNALS[number], "fs": 100}), None),
        (".h5", save_h5, None),
        (".csv", lambda path, number: path.write_text("\n".join(["time,a,b,c", *rows(number)])), None),
    ],
)
def test_levels_between_class_and_file_are_groups(tmp_path, suffix, write, rate):
    for group in ("session", "d"):
        root = files(tmp_path / group, write, f"r{{}}{suffix}", between=f"{group}{{}}")
        recordings = load_recordings(root, reading=Reading(rate_hz=rate))
        check(recordings)
        assert recordings.groups[group].tolist() == [0, 1, 0, 1]
    (root / "felt" / "d0" / f"a{'.mat' if suffix == '.npy' else '.npy'}").write_bytes(b"")
    with refused("holds files of several kinds") if suffix == ".csv" else pytest.raises(InputError):
        load_recordings(root, reading=Reading(rate_hz=rate))


def test_levels_in_another_order_are_refused(tmp_path):
    for number in range(4):
        path = tmp_path / f"p{number // 2}" / CLASSES[number % 2] / "r.csv"
        path.parent.mkdir(parents=True)
        path.write_text("\n".join(["time,a,b,c", *rows(number)]))
    with refused("p0, p1 stand above other folders and are called as groups are"):
        load_recordings(tmp_path)


def test_an_array_of_structs(tmp_path):
    touches = np.zeros(4, dtype=[("emg", "O"), ("material", "O"), ("person", "O")])
    for number, signal in enumerate(SIGNALS):
        touches[number] = (signal, CLASSES[number % 2], number // 2)
    savemat(tmp_path / "a.mat", {"touches": touches, "Fs": 100.0})
    for reading in (Reading(), Reading(samples="touches.emg", label="touches.material")):
        recordings = load_recordings(tmp_path / "a.mat", reading=reading)
        assert [recordings.class_names[label] for label in recordings.labels] == ["felt", "silk"] * 2
        assert recordings.groups["person"].tolist() == [0, 0, 1, 1] and recordings.sample_rate_hz == 100
    with refused("--class touches: is not an attribute or column; .* of a struct or group name a field"):
        load_recordings(tmp_path / "a.mat", reading=Reading(label="touches"))
    touches["material"] = [1, 2, 1, 2]
    savemat(tmp_path / "b.mat", {"touches": touches, "Fs": 100.0, "class_names": [*CLASSES, "wool"]})
    recordings = load_recordings(tmp_path / "b.mat")
    assert recordings.class_names == (*CLASSES, "wool")
    assert "numbered from 1; none is 0 or 3, which would tell" in str(recordings.notes)
    assert load_recordings(tmp_path / "b.mat", reading=Reading(label="touches.person")).class_names[0] == "0"


@each_row(
    "values, why",
    [
        ([1, 1, 2, 2], "tells the class, too,"),
        ([4, 7, 8, 8], "has each of its values in one class alone, so is not a group,"),
        ([3, 1, 2, 4], "has another value in each recording, so is not a group,"),
        ([0, 1, 0, 1], ""),
        ([0, 1, 1, 1], ""),
    ],
)
def test_what_is_no_group_is_not_left_out(values, why):
    labels = np.array([0, 0, 1, 1])
    assert no_group(np.array(values), labels) == why
    assert "one value in each class" in no_group(np.array([5, 5, 7, 7, 7, 5]), np.array([0, 1, 2, 2, 2, 0]))
    made = Recordings.of(SIGNALS, labels, sample_rate_hz=100, groups={"hand": values})
    if why:
        with refused(f"array hand {why.rstrip(',')}.* `group`"):
            check_split(made, ["hand"], 2)
    else:
        check_split(made, ["hand"], 2)


def test_the_class_in_file_names_is_no_group(tmp_path):
    for number in range(8):
        path = tmp_path / f"gesture{number % 2}" / f"gesture{number % 2}_p{number // 4}_n{number}.csv"
        path.parent.mkdir(exist_ok=True)
        path.write_text("\n".join(["time,a,b,c", *rows(number % 4)]))
    recordings = load_recordings(tmp_path)
    assert {*recordings.groups} == {"person", "source_file"}
    assert any("'gesture' in the names of files tells the class" in note for note in recordings.notes)
