"""Labels that are words, held-back sets with fewer classes, and what people's tables hold beside samples."""

import dataclasses

import numpy as np
import pandas as pd

import eskin
from eskin.data import Reading, load_recordings
from eskin.data.archive import load_archive
from eskin.pages.inspect_data import in_rows, inspect
from eskin.pages.views import words
from tests.support.table import each_row, refused
from tests.support.written import texts

CODES = np.random.default_rng(3).integers(100, 900, (6, 20, 3))
AT = Reading(rate_hz=100)


def archive(path, **changes):
    arrays = {
        "samples": CODES.reshape(-1, 3),
        "offsets": 20 * np.arange(7),
        "labels": np.array(["silk", "felt"] * 3),
        "sample_rate_hz": 100.0,
    }
    np.savez(path, **arrays | changes)
    return load_archive(path)


def rows(index: int) -> list[str]:
    return [",".join(map(str, codes)) for codes in CODES[index].tolist()]


@each_row(
    "labels, names, expected",
    [
        (np.array(["m10", "m2"] * 3), None, ("m2", "m10")),
        (np.array([b"m10", b"m2"] * 3), None, ("m2", "m10")),
        (np.array(["m10", "m2"] * 3), np.array(["m10", "none", "m2"]), ("m10", "none", "m2")),
        (np.array([10, 2] * 3), None, ("2", "10")),  # numbers that count nothing
    ],
)
def test_labels_that_are_text_are_names(tmp_path, labels, names, expected):
    recordings = archive(
        tmp_path / "a.npz", labels=labels, **({} if names is None else {"class_names": names})
    )
    assert recordings.class_names == expected
    assert [expected[label] for label in recordings.labels] == labels.astype(str).tolist()


def test_text_labels_of_lists_series_and_images(tmp_path):
    for labels in (["b", "a"], np.array(["b", "a"], dtype=object), pd.Series(["b", "a"])):
        made = eskin.Recordings.of(CODES[:2], labels, sample_rate_hz=100)
        assert made.class_names == ("a", "b") and made.labels.tolist() == [1, 0]
    np.savez(tmp_path / "i.npz", images=np.zeros((2, 8, 8), np.uint8), labels=np.array(["cup", "ball"]))
    assert load_archive(tmp_path / "i.npz").class_names == ("ball", "cup")
    with refused("array labels: holds 'silk', which is not in class_names"):
        archive(tmp_path / "a.npz", class_names=np.array(["felt", "wool"]))


def test_classes_are_matched_by_name():
    held = eskin.Recordings.of(CODES, ["c", "a"] * 3, sample_rate_hz=100, class_names=["c", "a", "d"])
    matched = held.with_classes(("a", "b", "c"), "the model")
    assert matched.class_names == ("a", "b", "c") and matched.labels.tolist() == [2, 0] * 3


@each_row(
    "header, unit, rate",
    [
        ("time,a,b,c\nms,kPa,kPa,kPa", "kPa", 500.0),
        ("time (s),a [N],b [N],c [N]", "N", 0.5),
        ("time,a,b,c\ns,N,N,V", "N, N, V", 0.5),
        ("time (s),a [N],b,c [V]", "", 0.5),
        (",left,,right\ntime (s),a [N],b [N],a [N]", "N", 0.5),
    ],
)
def test_units_of_a_header(tmp_path, header, unit, rate):
    text = lambda index: "\n".join([header, *(f"{2 * k},{row}" for k, row in enumerate(rows(index)))])
    recordings = texts(tmp_path, text)
    assert recordings.unit == unit and recordings.sample_rate_hz == rate and recordings.taxels == 3


def test_names_above_names_are_joined(tmp_path):
    text = lambda index: "\n".join([",left,", "x,x,y", *rows(index)])
    recordings = texts(tmp_path, text, dataclasses.replace(AT, columns=("left x", "left y")))
    assert np.array_equal(recordings.recording(1), CODES[2][:, 1:])
    assert "columns left x, left y are the 2 taxels" in recordings.notes[0]


@each_row("end", ["512,40", "512", '"51'])
def test_a_cut_last_line_is_dropped_and_said(tmp_path, end):
    text = lambda index: "\n".join(["a,b,c", *rows(index), *([end] if index == 1 else [])])
    recordings = texts(tmp_path, text, AT)
    assert recordings.lengths.tolist() == [20] * 4
    assert "line 22, the last of 'r0.csv', is cut off and was dropped" in " ".join(recordings.notes)
    middle = lambda index: "\n".join(["a,b,c", *rows(index)[:5], "512,40", *rows(index)[5:]])
    with refused("line 7: has 2 cells"):
        texts(tmp_path, middle, AT)


@each_row("cell", ["x", "", "nan", "9" * 400])
def test_with_columns_no_other_is_read(tmp_path, cell):
    """Its cells may be anything, in a folder and in a long table."""
    reading = dataclasses.replace(AT, columns=("a", "b", "c"))
    text = lambda index: "\n".join(["note,person,a,b,c", *(f"{cell},{cell},{row}" for row in rows(index))])
    assert np.array_equal(texts(tmp_path / "d", text, reading).recording(1), CODES[2])
    lines = ["recording,class,note,person,a,b,c"]
    lines += [f"{r},{'xy'[r % 2]},{cell},{cell if r else 1},{row}" for r in range(4) for row in rows(r)]
    (tmp_path / "all.csv").write_text("\n".join(lines))
    recordings = load_recordings(tmp_path / "all.csv", reading=reading)
    assert np.array_equal(recordings.recording(1), CODES[1])
    # what a name says to be a group stays one, where it has a value everywhere
    assert {*recordings.groups} == {"recording", *(() if cell in ("", "nan") else ("person",))}


def test_inspect_says_one_class_and_tells_groups_from_values(tmp_path):
    groups = {"mass": np.arange(6), "day": np.arange(6) // 2}
    recordings = archive(tmp_path / "a.npz", labels=np.array(["silk"] * 6), **groups)
    figures = inspect(recordings)
    text = words("inspect", **figures, **in_rows(recordings, figures, "a.npz"), picture="p.png")
    assert "the only class is silk" in text
    assert "day (3 values)" in text and "| one value a recording | mass |" in text and "mass (6" not in text


def test_a_data_card(tmp_path, monkeypatch, call):
    """A README.md with what the archive says and fields to fill, which a second call does not overwrite."""
    monkeypatch.chdir(tmp_path)
    archive("mine.npz", samples=CODES.reshape(-1, 3) / 8, lsb_volt=0.125, unit="mN", day=np.arange(6) // 2)
    status, out, _ = call("inspect", "mine.npz", "--card")
    card = (tmp_path / "build/inspect/mine/README.md").read_text()
    assert status == 0 and "build/inspect/mine/README.md" in out
    for line in (
        "# mine",
        "| sample rate | 100 Hz |",
        "| taxels | 3 |",
        "| one code | 0.125 mN |",
        "| felt | 3 |",
        "| day | 3 |",
        "| licence | TO FILL IN |",
    ):
        assert line in card.splitlines()
    status, _, err = call("inspect", "mine.npz", "--card")
    assert status == 2 and "README.md: exists already" in err


@each_row(
    "names, header, classes",
    [
        ("soft_ball soft_cup", "a,b,c,d", ["soft_ball", "soft_cup"] * 3),
        ("anna bert", "a,b,c,label", ["0", "0", "1", "1", "2", "2"]),
        ("x x", "a,b,c,label", ["0", "0", "1", "1", "2", "2"]),
        ("x x", "a,b,c,d", None),
    ],
)
def test_files_in_no_folder_begin_with_their_class(tmp_path, names, header, classes):
    for number in range(6):
        name = f"{names.split()[number % 2]}_p{number // 3}-{number}.csv"
        text = "\n".join([header, *(f"{row},{number // 2}" for row in rows(number))])
        (tmp_path / name).write_text(text)
    if classes is None:
        with refused("has no column or attribute that names the class"):
            load_recordings(tmp_path, reading=AT)
        return
    recordings = load_recordings(tmp_path, reading=AT)
    order = np.argsort([int(file[-5]) for file in recordings.groups["source_file"]])
    assert [recordings.class_names[recordings.labels[place]] for place in order] == classes
    assert recordings.groups["person"][order].tolist() == [0, 0, 0, 1, 1, 1]


def test_runs_of_a_class_are_recordings_below_folders_of_sessions(tmp_path):
    for session in ("s1", "s2"):
        path = tmp_path / session / "all.csv"
        path.parent.mkdir()
        path.write_text("\n".join(f"{row},{'01020'[run]}" for run in range(5) for row in rows(run)))
    with refused("changes inside a recording; .* --recording .the class, where each of its runs is one"):
        load_recordings(tmp_path, reading=dataclasses.replace(AT, label="4"))
    recordings = load_recordings(tmp_path, reading=dataclasses.replace(AT, label="4", recording="4"))
    assert recordings.lengths.tolist() == [20] * 10 and recordings.labels.tolist() == [0, 1, 0, 2, 0] * 2
    assert {*recordings.groups} == {"session", "source_file"}
    assert recordings.groups["session"].tolist() == [1] * 5 + [2] * 5
