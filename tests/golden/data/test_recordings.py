"""Archives and .lvm folders: recordings read, sentences of refusals, and splits that keep groups
apart."""

from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.data import Reading, load_recordings
from eskin.data.folds import grouped_folds
from eskin.golden.core import PRESETS
from eskin.golden.core.groups import MOST_CLASSES
from eskin.golden.data import Recordings
from tests.support.table import each_row, refused

LSB = PRESETS["thesis"].sensor.volt_per_code


def arrays(**changes) -> dict[str, Any]:
    """A good archive of three recordings, 4 taxels, with ``changes``; None leaves an array out."""
    rng = np.random.default_rng(3)
    good = {
        "samples": rng.integers(0, 65535, (30, 4)).astype(np.uint16),
        "offsets": [0, 8, 20, 30],
        "labels": [0, 1, 0],
        "class_names": ["rough", "smooth"],
        "sample_rate_hz": 250.0,
        "trial": [1, 2, 3],
    } | changes
    return {name: value for name, value in good.items() if value is not None}


def archive(folder: Path, **changes) -> Path:
    path = folder / "made.npz"
    np.savez(path, **arrays(**changes))
    return path


# ---------------------------------------------------------------------- archives
def test_an_archive_is_read_as_it_was_written(tmp_path):
    recordings = load_recordings(archive(tmp_path, lsb_volt=np.array(6.25e-5)))
    expected = arrays()
    assert len(recordings) == 3 and recordings.taxels == 4 and recordings.frames == 30
    assert np.array_equal(recordings.samples, expected["samples"])
    assert np.array_equal(recordings.recording(1), expected["samples"][8:20])
    seen = [recordings.lengths, recordings.labels, recordings.groups.pop("trial")]
    assert np.array_equal(seen, [[8, 12, 10], [0, 1, 0], [1, 2, 3]]) and not recordings.groups
    assert recordings.class_counts.tolist() == [2, 1]
    assert recordings.class_names == ("rough", "smooth") and recordings.sample_rate_hz == 250.0
    assert recordings.volt_per_code == 6.25e-5


@each_row(
    "kind, low, high, text",
    [
        ("uint8", 0, 255, "UQ(8,0)"),
        ("int8", -128, 127, "SQ(8,0)"),
        ("uint16", 0, 65535, "UQ(16,0)"),
        ("int16", -32768, 32767, "SQ(16,0)"),
        ("int64", 0, 65535, "UQ(16,0)"),
        ("int32", -32768, 100, "SQ(16,0)"),
    ],
)
def test_the_code_format_follows_the_type_and_beyond_16_bits_the_values(tmp_path, kind, low, high, text):
    samples = np.zeros((30, 4), dtype=kind)
    samples[0, 0], samples[1, 1] = low, high
    assert str(load_recordings(archive(tmp_path, samples=samples)).sample_format) == text


REFUSALS = [
    ("samples", None, "array samples: is missing"),
    ("offsets", None, "array offsets: is missing"),
    ("samples", np.full((30, 4), np.nan), "array samples: holds nan in recording 0, frame 0, taxel 0"),
    ("samples", np.zeros((30, 4), bool), "array samples: holds bool, not numbers"),
    ("samples", np.zeros((30, 2, 2, 1), np.int16), r"array samples: has shape \(30, 2, 2, 1\)"),
    ("samples", np.zeros((30, 0), np.int16), r"array samples: has shape \(30, 0\)"),
    ("samples", np.zeros((0, 4), np.int16), "array samples: holds no frame"),
    ("samples", np.full((30, 4), 65536), "array samples: runs from 65536 to 65536, beyond 16 bits"),
    ("samples", np.tile([-1, 40000, 0, 0], (30, 1)), "array samples: runs from -1 to 40000, beyond 16 bits"),
    ("offsets", [0], r"array offsets: is int64 of shape \(1,\)"),
    ("offsets", [1, 8, 20, 30], "array offsets: starts at 1"),
    ("offsets", [0, 8, 20, 29], "array offsets: ends at 29 but samples has 30 frames"),
    ("offsets", np.array([0, 20, 20, 30], np.uint64), "array offsets: does not rise after entry 1"),
    ("offsets", [0, 4, 8, 20, 30], r"array labels: .* must be integers, or names, of shape \(4,\)"),
    ("offsets", [0.0, 8, 20, 30], "array offsets: is float64"),
    ("labels", [0, 2, 1], r"array labels: gives recording 1 class 2; class_names has classes 0\.\.1"),
    ("labels", [0, 1, -1], "array labels: gives recording 2 class -1"),
    ("labels", [0.0, 1.0, 0.0], "array labels: is float64"),
    ("class_names", [1, 2], "array class_names: is int64"),
    ("class_names", ["a", "a"], "array class_names: has the name a twice"),
    ("class_names", ["a", " "], "array class_names: has an empty or unprintable name at 1"),
    ("sample_rate_hz", np.nan, "array sample_rate_hz: is nan"),
    ("sample_rate_hz", 0, "array sample_rate_hz: is 0"),
    ("sample_rate_hz", "3 kHz", "array sample_rate_hz: is 3 kHz"),
    ("sample_rate_hz", [1.0, 2.0], "array sample_rate_hz: is of shape"),
    ("lsb_volt", -1.0, "array lsb_volt: is -1"),
    ("grid_shape", [4, 1], r"array grid_shape: differs from the samples' own rows and columns, \[2, 2\]"),
    ("remark", np.array([None], dtype=object), "array remark: holds Python objects"),
    ("remark", np.zeros(1, dtype=[("a", object)]), "array remark: holds Python objects"),
    ("images", np.zeros((3, 2, 2), np.uint8), "array images: are 2 x 2 pixels; give 4 x 4 to 256 x 160"),
    ("images", np.full((3, 8, 8), 1.5), "array images: holds 1.5 in image 0; real pixels lie in 0..1"),
    ("images", np.full((3, 8, 8), 256), "array images: runs from 256 to 256; a pixel has 8 bits"),
    ("images", np.zeros((3, 64), np.uint8), r"array images: has shape \(3, 64\); it must be"),
]


@each_row("name, value, sentence", REFUSALS)
def test_a_bad_archive_is_refused_with_file_array_and_fix(tmp_path, name, value, sentence):
    samples = {"images": None, "grid_shape": np.zeros((30, 2, 2), np.int16)}
    path = archive(tmp_path, **{name: value}, **({"samples": samples[name]} if name in samples else {}))
    with refused(sentence, str(path)):
        load_recordings(path)


# ---------------------------------------------------------------------- sets
def test_a_subset_keeps_frames_labels_and_groups_together(make_recordings):
    recordings = make_recordings(lengths=(5, 6, 7, 8), groups={"trial": np.array([1, 2, 3, 4])})
    part = recordings.subset([3, 1])
    seen = [part.lengths, part.groups["trial"], part.labels]
    assert np.array_equal(seen, [[8, 6], [4, 2], [1, 1]])
    assert np.array_equal(part.samples, np.vstack([recordings.recording(3), recordings.recording(1)]))
    with refused("subset is empty"):
        recordings.subset([])


@settings(max_examples=60, deadline=None, derandomize=True)
@given(counts=st.lists(st.integers(0, 12), min_size=2, max_size=5).filter(any), data=st.data())
def test_evenly_is_balanced_and_repeatable(counts, data):
    labels = np.concatenate([np.full(count, label) for label, count in enumerate(counts)]).astype(np.int64)
    total = len(labels)
    recordings = Recordings(
        np.zeros((total, 4), np.int32), np.arange(total + 1), labels, tuple(map(str, range(len(counts)))), 1.0
    )
    n = data.draw(st.integers(1, total + 2))
    chosen = recordings.evenly(n)
    assert len(chosen) == min(n, total) == len(set(chosen)) and np.array_equal(chosen, recordings.evenly(n))
    shares = np.bincount(labels[chosen], minlength=len(counts))
    full = shares == counts
    # classes with more to give differ by one at most, and no exhausted class has more than they
    if not full.all():
        assert np.ptp(shares[~full]) <= 1 and shares[full].max(initial=0) <= shares[~full].min() + 1
    with refused("at least 1"):
        recordings.evenly(0)


# ---------------------------------------------------------------------- splits


@each_row("seed", [None, 0, 1])
def test_without_groups_folds_are_stratified(make_recordings, seed):
    recordings = make_recordings(lengths=[4] * 33, labels=[0] * 20 + [1] * 13)
    split = grouped_folds(recordings, [], 5, seed)
    counts = np.array([np.bincount(recordings.labels[test], minlength=2) for test in split])
    assert sorted(np.concatenate(split)) == list(range(33))
    assert (np.ptp(counts, axis=0) <= 1).all() and np.ptp(counts.sum(axis=1)) <= 1


def test_folds_that_cannot_be_made_are_refused(make_recordings):
    recordings = make_recordings(groups={"trial": np.array([1, 1, 1, 1]), "speed": np.array([1, 1, 2, 2])})
    for groups, folds, sentence in (
        (["person"], 5, "has no group array 'person'; it has speed, trial"),
        (["trial"], 5, "group trial has one value"),
        (["speed"], 1, "needs at least 2"),
        ([], 5, "5 folds need as many recordings and there are 4"),
    ):
        with refused(sentence):
            grouped_folds(recordings, groups, folds, 0)


# ---------------------------------------------------------------------- .lvm folders
VOLTS = np.array(
    [[1.65, 1.70, 1.5, 0.25], [1.66, 1.69, 1.5, 0.25], [1.64, 1.68, 1.5, 0.5], [1.63, 1.67, 1.5, 4.0]]
)
HEADER = (
    "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t,\nDate\t2017/05/03\n"
    "***End_of_Header***\t\n\t\n"
    "Channels\t4\t\t\t\nSamples\t4\t4\t4\t4\nDate\t2017/05/03\t2017/05/03\nY_Unit_Label\tVolts\tVolts\n"
    "X_Dimension\tTime\tTime\n"
    "X0\t0,0\t0,0\nDelta_X\t0,000333\t0,000333\n***End_of_Header***\t\t\n"
)

SECOND_HEADER = "\n" + HEADER.partition("***End_of_Header***\t\n\t\n")[2] + "0,000667"


def text_of(separator="\t", comma=True, header="", newline="\n", titles="", comment="") -> str:
    """VOLTS at 3 kHz as the text of an .lvm file."""
    lines = [*header.splitlines(), *titles.splitlines()]
    for row, volts in enumerate(VOLTS):
        numbers = [f"{value:.6f}" for value in (row / 3000, *volts)]
        lines.append(separator.join(n.replace(".", ",") if comma else n for n in numbers) + comment)
    return newline.join([*lines, ""])


def folder_of(tmp_path: Path, text: str | bytes, name="p01_t2.lvm", classes=("brush", "roll")) -> Path:
    root = tmp_path / "lvm"
    for entry in classes:
        (root / entry).mkdir(parents=True, exist_ok=True)
        (root / entry / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    return root


GOOD_TEXTS = [
    text_of(),
    text_of(comma=False),
    text_of(";"),
    text_of(",", comma=False),
    text_of("  "),
    text_of(" ", comma=False),
    text_of(header=HEADER, titles="X_Value\tVoltage\tVoltage (2)\tVoltage (3)\tVoltage (4)\tComment"),
    text_of(header=HEADER, newline="\r\n"),
    text_of(";", titles="Time;T 1;T 2;T 3;T 4"),
    text_of(";", titles="Time;T1;T2;T3;T4\ns;V;V;V;V"),
    text_of(comment="\t"),
    text_of(comment="\tgood contact"),
    text_of().replace("1,500000\t0,500000", "1,500000\t0,500000\tslipped"),
    text_of().replace("\n", "\n\n") + "\n\t\t\t\n  \n",
    "\ufeff" + text_of(),
    text_of() + "0,001333\t1,65\t1,6",
    text_of() + "0,0013",
    SECOND_HEADER.join(text_of().partition("0,000667")[::2]),
    text_of(comma=False).replace("1.500000", "1.5E+0"),
]


@each_row("text", GOOD_TEXTS)
def test_lvm_texts_of_every_habit_give_the_same_codes(tmp_path, text):
    recordings = load_recordings(folder_of(tmp_path, text), reading=Reading(scale=LSB))
    assert len(recordings) == 2
    assert recordings.class_names == ("brush", "roll")
    assert list(recordings.labels) == [0, 1]
    assert np.array_equal(recordings.recording(1), np.rint(VOLTS / LSB))
    assert recordings.sample_rate_hz == 3000.0
    assert str(recordings.sample_format) == "UQ(16,0)"
    assert recordings.volt_per_code == LSB


def test_a_first_row_of_whole_numbers_is_a_frame(tmp_path):
    recordings = load_recordings(
        folder_of(tmp_path, "T\tA\tB\n0\t2\t1\n0.001\t1.5\t1.25\n0.002\t1.5\t1.25\n"),
        reading=Reading(scale=LSB),
    )
    assert recordings.recording(0).tolist() == [[32000, 16000], [24000, 20000], [24000, 20000]]


def test_names_become_groups(tmp_path):
    root = folder_of(tmp_path, text_of(), "Press_Sp300_P07_t2.lvm")
    folder_of(tmp_path, text_of(), "Press_Sp450_P11_t1.lvm", classes=("roll",))
    groups = load_recordings(root).groups
    assert {name: values.tolist() for name, values in groups.items() if name != "source_file"} == {
        "sp": [300, 300, 450],
        "person": [7, 7, 11],
        "trial": [2, 2, 1],
    }
    assert groups["source_file"].tolist() == [
        "brush/Press_Sp300_P07_t2.lvm",
        "roll/Press_Sp300_P07_t2.lvm",
        "roll/Press_Sp450_P11_t1.lvm",
    ]


def test_folders_that_are_no_data_set_are_refused(tmp_path):
    with refused("has no file of recordings"):
        load_recordings(tmp_path)
    root = folder_of(tmp_path, text_of())
    (root / "slide").mkdir()
    with refused("slide': has no file of recordings"):
        load_recordings(root)
    (root / "slide" / "a.lvm").write_text("0,0\t1,65\n0,1\t1,65\n")
    with refused("has 2 columns where 'brush/p01_t2.lvm' has 5"):
        load_recordings(root)
    for number in range(MOST_CLASSES):  # before any of a large tree's files is read
        (root / f"run {number}").mkdir()
    with refused("has 131 sub-folders, one per class"):
        load_recordings(root)
