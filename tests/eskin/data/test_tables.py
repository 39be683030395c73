"""Recordings from text tables: the forms that people have are understood, and what is not certain is refused
with file and line."""

import re

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.data import Reading, load_recordings
from eskin.data.fit import check_fit
from eskin.golden.core import AcceleratorConfig
from eskin.golden.data.codes import round_step, to_codes
from tests.support.table import each_row, refused
from tests.support.written import by_class, texts

RATE = 200.0


def codes(number: int) -> np.ndarray:
    """The recording ``number``: (10 + number, 4) codes."""
    return np.random.default_rng(number).integers(100, 900, (10 + number, 4))


def written(samples, *, time="time", delimiter=",", comma=False, header=True, start=0.0) -> str:
    """A recording as a file of text."""
    rows = [
        [f"{start + frame / RATE:.4f}", *map(str, row)] if time else [*map(str, row)]
        for frame, row in enumerate(samples.tolist())
    ]
    names = [*([time] if time else []), "a", "b", "c", "d"]
    lines = ([delimiter.join(names)] if header else []) + [delimiter.join(row) for row in rows]
    text = "\n".join(lines) + "\n"
    return text.replace(".", ",") if comma else text


def make_folder(folder, **form):
    """Classes mat2 and mat10, three files each."""
    write = lambda path, number: path.write_text(written(codes(number), **form))
    return by_class(folder, write, "p{}_t1.csv", classes=("mat2", "mat10"), count=6)


def check_folder(recordings):
    order = [0, 2, 4, 1, 3, 5]  # class by class
    assert recordings.class_names == ("mat2", "mat10") and recordings.labels.tolist() == [0, 0, 0, 1, 1, 1]
    assert recordings.sample_rate_hz == RATE and recordings.groups["person"].tolist() == [0, 1, 2, 0, 1, 2]
    for index, number in enumerate(order):
        assert np.array_equal(recordings.recording(index), codes(number))
    assert recordings.volt_per_code == 0


@each_row(
    "form",
    [
        {},
        {"delimiter": ";", "comma": True},
        {"header": False, "delimiter": "\t"},
        {"time": "Time (s)"},
        {"time": "timestamp", "start": 1000.0},
    ],
)
def test_a_folder_of_files_by_class(tmp_path, form):
    check_folder(load_recordings(make_folder(tmp_path / "d", **form)))


def test_what_a_file_may_hold_beside_numbers(tmp_path):
    folder = make_folder(tmp_path / "d")
    for file in folder.rglob("*.csv"):
        lines = file.read_text().splitlines()
        head = ["# a comment", "", lines[0].replace("a", '"a"'), "(s),(N),(N),(N),(N)"]
        text = "\r\n".join([*head, *(line + "," for line in lines[1:]), "", ""])
        file.write_bytes(b"\xef\xbb\xbf" + text.encode())
    (folder / "mat2" / "notes.pdf").write_text("not a recording")
    recordings = load_recordings(folder)
    check_folder(recordings)
    assert any("1 files" in note for note in recordings.notes)


def test_time_in_milliseconds_and_an_index_column(tmp_path):
    def text(number, time="time_ms"):
        rows = [f"{k},{5 * k},{','.join(map(str, row))}" for k, row in enumerate(codes(number).tolist())]
        return "\n".join([f",{time},a,b,c,d", *rows])

    recordings = texts(tmp_path, text)
    assert recordings.sample_rate_hz == RATE and np.array_equal(recordings.recording(0), codes(0))
    plain = lambda number: text(number, "time")
    with refused("name its unit in the header"):
        texts(tmp_path, plain)
    assert texts(tmp_path, plain, Reading(rate_hz=50.0)).sample_rate_hz == 50


def test_columns_are_chosen_by_name_and_number(tmp_path):
    folder = make_folder(tmp_path / "d")
    some = load_recordings(folder, reading=Reading(columns=("b", "d")))
    assert np.array_equal(some.recording(0), codes(0)[:, [1, 3]]) and some.sample_rate_hz == RATE
    assert np.array_equal(
        load_recordings(folder, reading=Reading(columns=("3-4",))).recording(0), codes(0)[:, 1:3]
    )
    with refused("no such column; it has time, a, b, c, d"):
        load_recordings(folder, reading=Reading(columns=("e",)))


@each_row("times, same", [(1.015, True), (1.03, False)])
def test_rates_within_two_in_a_hundred_are_one(tmp_path, times, same):
    """Of two recordings, and of recordings and what was asked for."""

    def text(number):
        frames = range(20)
        rows = (f"{k / (RATE, RATE * times)[number]:.6f},{k % 7},{k % 5}" for k in frames)
        return "\n".join(["time,a,b", *rows])

    if same:
        assert RATE <= texts(tmp_path, text, count=2).sample_rate_hz <= RATE * times
    else:
        with refused("has 200 frames a second and .* 206;"):
            texts(tmp_path, text, count=2)
    asked = load_recordings(make_folder(tmp_path / "d"), reading=Reading(rate_hz=RATE * times))
    said = f"the sample rate is the given one, {RATE * times:g} Hz; but the recordings say {RATE:g} Hz"
    assert asked.sample_rate_hz == RATE * times
    assert (said.partition(",")[0] if same else said) in asked.notes


def test_a_rate_is_asked_for_where_no_column_says_it(tmp_path):
    folder = make_folder(tmp_path / "d", time=None)
    with refused("--rate HZ"):
        load_recordings(folder)
    assert load_recordings(folder, reading=Reading(rate_hz=31.0)).sample_rate_hz == 31
    config = AcceleratorConfig.of(taxels=4, sample_rate_hz=77.0)
    assert load_recordings(folder, config=config).sample_rate_hz == 77


def long_table() -> list[str]:
    """Six recordings of two classes and three persons, as lines."""
    lines = ["recording,person,class,time,a,b,c,d"]
    for number in range(6):
        for frame, row in enumerate(codes(number).tolist()):
            lines.append(
                f"r{number},{number // 2},{('silk', 'felt')[number % 2]},{frame / RATE},"
                + ",".join(map(str, row))
            )
    return lines


def test_columns_of_one_long_table_are_named(tmp_path):
    path = tmp_path / "all.csv"
    path.write_text("\n".join(long_table()).replace("recording,person,class", "nr,who,what"))
    with refused("--class"):
        load_recordings(path)
    named = load_recordings(path, reading=Reading(label="what", recording="nr"))
    assert named.class_names == ("felt", "silk") and named.labels.tolist() == [1, 0, 1, 0, 1, 0]
    assert named.groups["who"].tolist() == [0, 0, 1, 1, 2, 2] and named.groups["nr"][5] == "r5"
    assert named.sample_rate_hz == RATE and np.array_equal(named.recording(5), codes(5))


def broken_folder(tmp_path, change):
    """A good folder whose file mat10/p1_t1.csv has other lines."""
    folder = make_folder(tmp_path / "d")
    file = folder / "mat10" / "p1_t1.csv"
    lines = file.read_text().splitlines()
    file.write_bytes(change(lines) if callable(change) else change)
    return folder


def line_of(number, text):
    return lambda lines: "\n".join([*lines[: number - 1], text, *lines[number:]]).encode()


BROKEN = [
    (line_of(5, "0.015,1,2,3"), "line 5: has 4 cells where the header has 5"),
    (line_of(6, "0.02,1,,3,4"), "line 6: column 'b' holds an empty cell"),
    (
        lambda lines: "\n".join(line.replace(",", "|") for line in lines).encode(),
        "one column when it is split at",
    ),
    (line_of(8, "0.001,1,2,3,4"), "line 8: column 'time' does not go up"),
    (
        lambda lines: "\n".join([*lines[:6], *lines[9:]]).encode(),
        "line 7: column 'time' jumps, from 0.02 to 0.04 where others go by 0.005",
    ),
    (
        lambda lines: written(codes(3)).replace("time", "time_ms").encode(),
        "p0_t1.csv' has 200 frames a second and 'mat10/p1_t1.csv' 200000",
    ),
    (
        lambda lines: "\n".join(line.rpartition(",")[0] for line in lines).encode(),
        "has 4 columns where 'mat2/p0_t1.csv' has 5",
    ),
    (lambda lines: "\n".join(lines).replace("d", "x", 1).encode(), "differ from those of 'mat2/p0_t1.csv'"),
    (b"", "holds no row of samples"),
    (b"time,a,b,c,d\n", "line 1: holds a header and no row"),
    ("time,ä\n".encode("utf-16"), "not UTF-8 text"),
    (b"time,a\n0,\x001\n", "holds a zero byte"),
]


@each_row("change, said", BROKEN)
def test_a_broken_file_is_refused_with_its_place(tmp_path, change, said):
    with refused(said, "p1_t1.csv"):
        load_recordings(broken_folder(tmp_path, change))


BROKEN_TABLES = [
    (lambda lines: lines[1:], "has no header"),
    (lambda lines: [line.replace("recording", "what") for line in lines], "--recording"),
    (lambda lines: [*lines, lines[1]], "line 77: recording r0 goes on here after another one"),
    (
        lambda lines: [
            *lines[:-15],
            *(re.sub(r"(.*?,.*?,.*?,)[^,]*", rf"\g<1>{k / 50}", line) for k, line in enumerate(lines[-15:])),
        ],
        "'recording r5' has 50 frames a second and",
    ),
]


@each_row("change, said", BROKEN_TABLES)
def test_a_broken_table_is_refused_with_its_place(tmp_path, change, said):
    path = tmp_path / "all.csv"
    path.write_text("\n".join(change(long_table())))
    with refused(said):
        load_recordings(path)


# ---------------------------------------------------------------------- real samples
def test_real_samples_get_a_scale_or_that_of_the_configuration(tmp_path):
    folder, volts = tmp_path / "d", [(codes(number) - 400) / 977 for number in range(4)]
    text = lambda number: "\n".join(
        ["a,b,c,d", *(",".join(f"{v:.9f}" for v in row) for row in volts[number])]
    )
    recordings = texts(folder, text, Reading(rate_hz=RATE))
    step = recordings.volt_per_code
    assert recordings.sample_signed and recordings.sample_bits == 16 and step == 5e-5
    assert np.abs(recordings.recording(0) * step - volts[0]).max() <= 0.5 * step
    assert any(f"one code is {step:g}" in note for note in recordings.notes)
    config = AcceleratorConfig.of(
        taxels=4,
        sample_rate_hz=RATE,
        volt_per_code=1e-3,
        sample_signed=True,
        class_names=("a", "b"),
        band_low=-2000,
        band_high=2000,
    )
    scaled = load_recordings(folder, config=config)
    assert scaled.volt_per_code == 1e-3 and np.array_equal(scaled.recording(0), np.rint(volts[0] / 1e-3))
    check_fit(scaled, config)
    with refused("has a code worth 5e-05"):
        check_fit(recordings, config)


def test_whole_numbers_are_codes_and_others_are_not():
    table = np.array([[1.0, 65535.0], [7000.0, 0.0]])
    assert to_codes(table, "x")[0].tolist() == table.tolist() and to_codes(table, "x")[1] == 0
    assert to_codes(table - 1, "x")[1] == 5  # signed codes end at 32767
    wide, step, notes = to_codes(table * 10, "x")
    assert step == 20 and wide.max() == round(655350 / 20) and "one code is" in notes[0]
    assert to_codes(table, "x", 2.0)[0].tolist() == [[0, 32768], [3500, 0]]
    held, _, notes = to_codes(table, "x", 0.5)
    assert held.max() == 65535 and "0.25 of the samples lie beyond" in notes[1]
    with refused("every sample is 0"):
        to_codes(np.array([[0.0, 1e-310]]), "x")
    level = 1e5 + np.random.default_rng(1).normal(0, 0.1, (500, 4))
    assert any("taxels 0, 1, 2, 3: fewer than 16 codes" in note for note in to_codes(level, "x")[2])


@given(st.floats(1e-12, 1e12), st.integers(100, 65535))
@settings(max_examples=200, deadline=None)
def test_a_round_step_is_enough_and_not_twice_too_large(largest, top):
    step = round_step(largest, top)
    assert largest / step <= top * (1 + 1e-5) and step <= 2.51 * largest / top
    assert f"{step:e}"[0] in "125" and float(f"{step:.0e}") == step


@given(
    st.integers(1, 9),
    st.sampled_from([",", ";", "\t", " "]),
    st.booleans(),
    st.booleans(),
    st.integers(0, 2**31),
)
@settings(max_examples=60, deadline=None)
def test_any_recording_written_as_text_is_read_back(tmp_path_factory, rows, delimiter, header, real, seed):
    rng = np.random.default_rng(seed)
    samples = rng.normal(0, 100, (rows, 4)) if real else rng.integers(-500, 500, (rows, 4))
    text = lambda number: written(samples, time=None, delimiter=delimiter, header=header)
    reading = Reading(rate_hz=10.0, columns=("1-4",))
    recordings = texts(tmp_path_factory.mktemp("any"), text, reading, count=1)
    step = np.array(recordings.volt_per_code or 1.0)
    assert recordings.samples.shape == samples.shape
    assert (np.abs(recordings.samples * step - samples) <= 0.5000001 * step * real).all()
