"""What no taxel is, is never taken for one in silence: it is understood and said, or refused with file and
line."""

import re

import numpy as np
import pandas as pd
import pytest

import eskin
from eskin.data import Reading, load_recordings
from eskin.data.archive import load_archive, save_archive
from eskin.data.table import Table
from eskin.golden.core import InputError
from eskin.golden.data import Recordings
from tests.support.table import each_row, refused
from tests.support.written import by_class, texts

FRAMES = 30
CODES = np.random.default_rng(1).integers(1900, 2100, (8, FRAMES, 3))
AT = Reading(rate_hz=100)


def table(names="t0,t1,t2", labels="ab", **extra) -> str:
    """Eight recordings of classes a and b as a long table; extra: a column's name -> its cell in frame k of
    recording r."""
    lines = [",".join(["recording", "class", *extra, names])]
    for r, frames in enumerate(CODES):
        for k, codes in enumerate(frames.tolist()):
            lines.append(
                ",".join(map(str, [f"r{r}", labels[r % 2], *(cell(r, k) for cell in extra.values()), *codes]))
            )
    return "\n".join(lines)


def read(tmp_path, text: str, reading: Reading = AT) -> Recordings:
    (tmp_path / "all.csv").write_text(text)
    return load_recordings(tmp_path / "all.csv", reading=reading)


@each_row(
    "extra, groups, note",
    [
        ({"class_id": lambda r, k: 7 * (r % 2)}, {}, "column 'class_id' tells the class, too,"),
        (
            {"operator": lambda r, k: r // 3},
            {"operator": [0, 0, 0, 1, 1, 1, 2, 2]},
            "column 'operator' has one value in each recording",
        ),
        (
            {"person": lambda r, k: r // 2},
            {"person": [0, 0, 1, 1, 2, 2, 3, 3]},
            "column 'class' gives the class",
        ),
        ({"tick": lambda r, k: 1000 * r + k**3}, {}, "column 'tick' increases like a time"),
        ({"clock": lambda r, k: k // 4}, {}, "column 'clock' increases like a time"),
        ({"byte": lambda r, k: (250 + k) % 256}, {}, "column 'byte' increases like a time"),
        ({"time": lambda r, k: k / 100, "elapsed": lambda r, k: 9 + k}, {}, "column 'elapsed' is time, too,"),
        (
            {".header.stamp.nsecs": lambda r, k: (k * 7**9) % 10**9},
            {},
            "column '.header.stamp.nsecs' is time, too,",
        ),
        ({"remark": lambda r, k: ""}, {}, "column 'remark' is empty"),
        ({"b": lambda r, k: "NaN", "c": lambda r, k: "-"}, {}, "'b' is empty and was left out (and 1 more)"),
        ({"": lambda r, k: FRAMES * r + k}, {}, "increases like a time or numbers the rows"),
        ({"time": lambda r, k: f"2026-05-01T12:00:0{k / 100:.2f}"}, {}, "the sample rate is the given one"),
    ],
)
def test_another_column_is_understood_and_said(tmp_path, extra, groups, note):
    recordings = read(tmp_path, table(**extra))
    assert np.array_equal(recordings.samples, CODES.reshape(-1, 3))
    assert recordings.labels.tolist() == [0, 1] * 4
    assert {
        name: values.tolist() for name, values in recordings.groups.items() if name != "recording"
    } == groups
    assert any(note in sentence for sentence in recordings.notes), recordings.notes


def test_what_moves_as_a_signal_or_is_named_as_a_taxel_stays_one(tmp_path):
    wave = read(
        tmp_path,
        table(force=lambda r, k: int(50 * np.sin(k / 3)), t3=lambda r, k: r % 2, dead=lambda r, k: 5),
    )
    assert wave.taxels == 6 and "columns force, t3, dead, t0, t1, t2 are the 6 taxels" in wave.notes[0]
    constant = "column 't3' is constant in each recording and was taken as a taxel (and 1 more)"
    assert constant == wave.notes[1]
    named = read(tmp_path, table(tick=lambda r, k: k), Reading(rate_hz=100, columns=("tick", "t1")))
    assert named.samples[:3, 0].tolist() == [0, 1, 2]


@each_row(
    "text, reading, sentence",
    [
        (table(speed=lambda r, k: 0.1 * k), AT, "line 3: column 'speed' is a group and changes inside "
                                                "a recording; name what one is"),
        (table(labels=["nan", "x"]), AT, "line 2: column 'class' holds nan, which is not a value"),
        (table(labels=["a", ""]), AT, "line 32: column 'class' holds an empty cell"),
        (table(x=lambda r, k: "12_30"[k % 2 :]), AT, "line 2: column 'x' holds '12_30', which is not a number"),
        (table(names=f't0,t1,"t2"\n,,,,"{"1" * 131_073}"'), AT, "line 2: has more than 100000 letters"),
        (table(names='t0,t1,t2\nr0,a,1,2,"3'), AT, "line 2: has an unmatched quotation mark"),
        (table(), Reading(rate_hz=100, columns=("9" * 5000,)), "the file has no such column"),
        (table(), Reading(rate_hz=100, scale=1e-320), "a scale of 1e-320 makes infinite codes"),
        (table(names="t0,t1,t2\nr0,a,1,2,1e308").replace(",2,1e308\n", ",2,1e308\n"), AT, "samples run from "
                                                                                          "1 to 1e+308"),
        ("\n".join(["recording;class;a;b", *(f"{r};{'ab'[r % 2]};1,65{k};2,00{k}" for r in (0, 1) for k in range(9))]), AT,
         "line 2: '1,650' may have a decimal comma or separators of thousands"),
        (table().replace("r1,b", "r0,b"), AT, "line 32: column 'class' is the class and changes inside a recording"),
        ("0,1,2\n5,7,6", AT, "line 1: numbers the columns or is a frame; name the columns in it"),
    ],
)  # fmt: skip
def test_what_is_not_certain_is_refused_with_its_line(tmp_path, text, reading, sentence):
    with refused(re.escape(sentence), "all.csv"):
        read(tmp_path, text, reading)


def test_long_numbers_and_numbers_as_names(tmp_path):
    assert read(tmp_path, table(labels=["1234567", "1234568"])).class_names == ("1234567", "1234568")
    assert read(tmp_path, table(labels=["x" + "1" * 5000, "x" + "2" * 5000])).labels.tolist() == [0, 1] * 4
    assert read(tmp_path, table(names="0,1,2")).taxels == 3


def test_decimal_commas_of_three_digits_beside_a_zero(tmp_path):
    rows = "\n".join(f"0,{500 + 7 * k % 91};1,{250 + 5 * k % 83}" for k in range(30))
    recordings = texts(tmp_path, lambda number: f"a;b\n{rows}", AT)
    assert recordings.recording(0)[0] @ [1, 1] * recordings.volt_per_code == pytest.approx(1.75)


@each_row("stem", ["labels", "file", "samples", "offsets", "images", "lsb_volt"])
def test_groups_never_replace_arrays_of_an_archive(tmp_path, stem):
    save = lambda path, number: np.savetxt(path, CODES[number], delimiter=",", fmt="%d")
    by_class(tmp_path, save, f"{stem.replace('_', '')}{{}}_t1.csv")
    groups = {stem: [1, 0], f"group_{stem}": [2, 3]}
    made = Recordings.of(list(CODES[:2]), [0, 1], sample_rate_hz=100, groups=groups)
    assert any(f"group {stem} is called group_{stem}_, because {stem} has" in note for note in made.notes)
    for recordings in (load_recordings(tmp_path, reading=AT), made):
        save_archive(recordings, tmp_path / "x.npz")
        again = load_archive(tmp_path / "x.npz")
        assert np.array_equal(again.labels, recordings.labels) and set(again.groups) == set(recordings.groups)
        assert np.array_equal(again.samples, recordings.samples)


def test_a_data_frame_is_a_long_table(monkeypatch):
    part, rows = Table.part, []
    monkeypatch.setattr(Table, "part", lambda table, row: rows.append(row) or part(table, row))
    frame = pd.DataFrame(CODES.reshape(-1, 3), columns=["a", "b", "c"]).assign(
        recording=np.repeat(range(8), FRAMES)
    )
    frame = frame.assign(
        time=pd.Timestamp("2026-05-01") + pd.to_timedelta(np.arange(len(frame)) / 250, unit="s")
    )
    frame["class"] = pd.Categorical(np.where(frame.recording % 2, "wool", "felt"))
    recordings = eskin.load(frame.set_index("recording"))
    assert np.array_equal(recordings.samples, CODES.reshape(-1, 3)) and recordings.sample_rate_hz == 250
    assert recordings.class_names == ("felt", "wool") and recordings.source == "DataFrame"
    assert len(rows) < 8 * 8  # of eight recordings: the work does not grow with their square
    frame.loc[70, "class"] = np.nan
    with refused("'DataFrame', line 71: column 'class' holds an empty cell"):
        eskin.load(frame)
    with refused("column 'lists' holds lists; give a column for each place"):
        eskin.load(frame.assign(lists=CODES.reshape(-1, 3).tolist()))
    for nothing in (None, 5, frame.iloc[:0]):
        with pytest.raises(InputError):
            eskin.load(nothing)
