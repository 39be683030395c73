"""Stamps of serial monitors, grids of taxels, one taxel, hundreds of empty columns, files of other tools."""

import numpy as np
from scipy.io import savemat

from eskin.data import Reading, load_recordings
from eskin.data.archive import load_archive, save_archive
from eskin.data.text import read_text
from eskin.golden.data import Recordings
from tests.support.table import each_row, refused
from tests.support.written import by_class, texts

GRIDS = np.random.default_rng(5).integers(400, 600, (4, 40, 2, 3))
FLAT = GRIDS.reshape(4, 40, 6)
AT, NO_RATE = Reading(rate_hz=200), Reading()


def of_day(frame: int) -> str:
    """200 Hz, over midnight."""
    return f"23:59:59.9{5 * frame:02d}" if frame < 20 else f"00:00:00.{5 * frame - 100:03d}"


@each_row(
    "stamp, sign, reading",
    [
        (lambda k: f"{of_day(k)} -> ", ",", NO_RATE),
        (lambda k: f"[{of_day(k)}]\t", "\t", NO_RATE),
        (lambda k: f"2026-05-01T{of_day(k)}Z > ", " ", NO_RATE),
        (lambda k: f"[Wed May 01 {of_day(k)} 2026] ", ",", NO_RATE),
        (lambda k: f"01.05.2026;{of_day(k).replace('.', ',')};", ";", NO_RATE),
        (lambda k: f"{1.6e9 + k / 200:.3f}> ", ",", NO_RATE),
        (lambda k: "14:02:10,", ",", AT),  # 499 behind it is no fraction
    ],
)
def test_a_stamp_in_front_of_a_line_hides_no_taxel(tmp_path, stamp, sign, reading):
    def read(head, taxels, end=""):
        rows = lambda number: enumerate(FLAT[number, :, :taxels].tolist())
        line = lambda k, row: stamp(k) + sign.join(map(str, row))
        text = lambda number: "\n".join(
            [head.replace(",", sign), *(line(*each) for each in rows(number)), end]
        )
        made = texts(tmp_path, text, reading)
        assert np.array_equal(made.recording(1), FLAT[2, :, :taxels]) and made.sample_rate_hz == 200

    for head in ("", "a,b,c,d,e,f", "time,a,b,c,d,e,f", "a,b,c,d,e,f\nN,N,N,N,N,N"):
        read(head, 6)
    read("", 1)
    with refused("column 2 is time; the taxels are numbered without it"):
        load_recordings(tmp_path, reading=Reading(columns=("2",)))
    with refused("line 42: has no time stamp where other lines have one"):
        read("", 1, f"5\n{stamp(40)}5")


def lines(head, form):
    """The text of a recording: a head, and each frame's number and codes in a form."""
    return lambda n: "\n".join([head, *(form.format(k, *row) for k, row in enumerate(FLAT[n].tolist()))])


@each_row("head", ["time_ms,a,b", "time_ms -> a,b"])
def test_the_header_names_the_unit_of_the_stamps(tmp_path, head):
    made = texts(tmp_path, lines(head, "{0} -> {1},{2}"))
    assert made.sample_rate_hz == 1000 and made.channel_names == ("a", "b")


@each_row("form", ["T+{:02}ms | {},{}", "{:02} | {},{},{}", "14:02:{:02}.005:{},{}", "10{:02};{} {} {}"])
def test_a_number_behind_an_unknown_stamp_is_refused(tmp_path, form):
    with refused("column 1 holds a number behind a text; separate them"):
        texts(tmp_path, lines("", form), AT)


@each_row("form", ["{1};frame_{0:03};{2}", "{1};2026-05-01 14:02:{0:02}+02:00;{2}"])
def test_text_that_counts_is_left_out(tmp_path, form):
    assert "'when' increases like a time" in str(texts(tmp_path, lines("a;when;b", form), AT).notes)


def test_of_gaps_and_tabs(tmp_path):
    assert texts(tmp_path, lines(",10,20", "{},{},{}"), AT).channel_names == ("10", "20")
    assert texts(tmp_path, lines("", "{}\t{} {} {}"), AT).taxels == 3
    with refused("line 1: column 2 holds an empty cell"):
        texts(tmp_path, lines("5,,3", "{1},{2},{3}"), AT)


@each_row("ending, write", [("npy", np.save), ("mat", lambda path, array: savemat(path, {"skin": array}))])
def test_a_grid_and_one_taxel_are_read(tmp_path, ending, write):
    def read(parts, reading=AT):
        save = lambda path, number: write(path, parts[number])
        return load_recordings(by_class(tmp_path, save, f"r{{}}.{ending}"), reading=reading)

    save_archive(read(GRIDS), tmp_path / "x.npz")
    again = load_archive(tmp_path / "x.npz")
    assert np.array_equal(again.recording(1), FLAT[2]) and again.grid == (2, 3)
    assert read(GRIDS, Reading(rate_hz=200, columns=("1-2",))).grid == ()
    assert np.array_equal(read(FLAT[..., 0]).recording(3)[:, 0], FLAT[3, :, 0])
    with refused("shape 2 x 3 x 40; of three dimensions the first is the frames"):
        read(GRIDS.transpose(0, 2, 3, 1))
    with refused(r"is a grid \(3, 2\) where 'a/r0.* is \(2, 3\)"):
        read([GRIDS[0], FLAT[1].reshape(40, 3, 2), *GRIDS[2:]])


def test_containers_and_lists_of_grids_and_of_one_taxel(tmp_path):
    cells, objects = np.empty(4, dtype=object), np.empty(2, dtype=object)
    names = np.array(["x", "y", "z"], dtype=object)
    for values, grid in ((GRIDS, (2, 3)), (FLAT[..., 0], ())):
        cells[:] = [*values]
        # numbers of classes tell where they begin
        savemat(
            tmp_path / "a.mat", {"samples": cells, "labels": [0, 1, 2, 1], "fs": 200.0, "class_names": names}
        )
        made = [
            load_recordings(tmp_path / "a.mat"),
            Recordings.of([*values], [0, 1, 2, 1], sample_rate_hz=200),
        ]
        for each in made:
            assert np.array_equal(each.samples, values.reshape(160, -1)) and each.grid == grid
            assert each.labels.tolist() == [0, 1, 2, 1]
        objects[:] = ragged = [values[0], values[1, :9]]
        assert len(Recordings.of(ragged, [0, 1], sample_rate_hz=200)) == 2
        with refused("ndarray of objects .* give .* a list of such arrays"):
            Recordings.of(objects, [0, 1], sample_rate_hz=200)
    hole, holes = FLAT[1].astype(float), np.ma.masked_equal(FLAT[1], FLAT[1, 3, 2])
    hole[3, 2] = np.nan
    for given, words in (
        ({0: FLAT[0]}, "dict is not an array of numbers"),
        ([FLAT[0], hole], "holds nan in recording 1, frame 3, taxel 2;"),
        (holes, "has masked values"),
        ([FLAT[0], holes], "has masked values"),
    ):
        with refused(words):
            Recordings.of(given, [0], sample_rate_hz=200)
    with refused("array 0 has shape .* more taxels than frames; frames come first: transpose"):
        Recordings.of(GRIDS.transpose(0, 2, 3, 1), [0, 1, 2, 1], sample_rate_hz=200)


@each_row("head", [",".join(f"s{k}" for k in range(406)), ",".join("abcdef") + "," * 400])
def test_hundreds_of_empty_columns_are_one_note(tmp_path, head):
    row = lambda codes: ",".join(map(str, codes)) + "," * 400
    made = texts(tmp_path, lambda n: "\n".join([head, *map(row, FLAT[n].tolist())]), AT)
    assert made.taxels == 6
    assert read_text(tmp_path / "a" / "r0.csv", AT).frame.shape == (40, 6)  # the empty ones are not parsed
    assert any("is empty and was left out (and 399 more)" in note for note in made.notes)
    seen = []
    load_recordings(tmp_path, reading=AT, progress=lambda *now: seen.append(now))
    assert seen[-1] == ("files read", 3, 4)
    (tmp_path / "b" / "r1.csv").write_text("\0")  # is not read before the rate is asked for
    with refused("r0.csv': has neither a time column nor a rate"):
        load_recordings(tmp_path)


def test_the_number_of_a_column_is_its_class(tmp_path):
    text = lambda n: "\n".join(f"{a},{b},{n % 2}" for a, b, *_ in FLAT[n].tolist())
    with refused("column 3 has one value .* or the class with --class 3"):
        texts(tmp_path, text, AT)
    by_number = Reading(rate_hz=200, label="3")
    assert "column 3 gives the class, the file the" in str(texts(tmp_path, text, by_number).notes)
    (tmp_path / "all.csv").write_text("\n\n".join(map(text, range(4))))
    with refused("no header: give the number of a column, 1 to 3: name it with --class"):
        load_recordings(tmp_path / "all.csv", reading=AT)
    made = load_recordings(tmp_path / "all.csv", reading=by_number)
    assert made.labels.tolist() == [0, 1, 0, 1] and made.taxels == 2
    with refused("--columns: column 3 says class or recording; leave it out of the taxels"):
        load_recordings(tmp_path / "all.csv", reading=Reading(label="3", columns=("1-3",)))
    part = lambda n: lines("", f"{{}}e-{2 + n // 3},{{}},{n % 2}")(n)
    (tmp_path / "all.csv").write_text("\n".join(map(part, range(4))))
    with refused("'recording 0' has 100 frames a second and 'recording 3' 1000"):
        load_recordings(tmp_path / "all.csv", reading=Reading(label="3"))
    savemat(tmp_path / "a.mat", {"data": np.column_stack([FLAT[0], np.arange(40) // 20])})
    by_number = Reading(rate_hz=200, label="7", recording="7")
    assert load_recordings(tmp_path / "a.mat", reading=by_number).taxels == 6


def test_files_of_edge_impulse_are_refused_with_what_to_do(tmp_path):
    by_class(tmp_path, lambda path, number: path.touch(), "r{}.json")
    for path in (tmp_path, tmp_path / "a", tmp_path / "a" / "r0.json"):
        with refused("Edge Impulse.* write each recording as CSV.* --rate 1000 / interval_ms"):
            load_recordings(path)
