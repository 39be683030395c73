"""Recordings: the npz archive, the folder of ``.lvm`` text files, and splits that keep groups apart.

Every refusal is an InputError of one sentence that names the file, the array or line, and the fix. Nothing here guesses: an archive
that breaks the rules of README ("Your own recordings") is refused before any work starts.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from golden.config import PRESETS, AcceleratorConfig
from golden.errors import InputError
from golden.files import ArchiveError, read_arrays
from golden.formats import QFormat

ARCHIVE_ARRAYS = ("samples", "offsets", "labels", "class_names", "sample_rate_hz")
"""The arrays every archive must hold."""

NOT_GROUPS = (*ARCHIVE_ARRAYS, "channel_names", "lsb_volt", "sample_rate_is_inferred", "images")
"""Arrays that are never a group, whatever their length."""


@dataclass(frozen=True, eq=False)
class Recordings:
    """A set of labelled recordings, concatenated along time.

    Parameters
    ----------
    samples:
        A/D codes, int32, shape (frames of all recordings, taxels).
    offsets:
        int64, shape (recordings + 1): recording i is ``samples[offsets[i]:offsets[i+1]]``.
    labels:
        int64, shape (recordings): index into class_names.
    class_names:
        One name a class.
    sample_rate_hz:
        Frames a second.
    groups:
        What recordings have in common (person, trial, ...): name -> array of length recordings.
    source:
        Where they come from, for messages and the report.
    volt_per_code:
        Volt of one code; 0 when the samples are no voltage or it is not known.
    sample_bits, sample_signed:
        The A/D code's format.
    notes:
        Sentences about choices the loader made.
    """

    samples: np.ndarray
    offsets: np.ndarray
    labels: np.ndarray
    class_names: tuple[str, ...]
    sample_rate_hz: float
    groups: dict[str, np.ndarray] = field(default_factory=dict)
    source: str = "recordings"
    volt_per_code: float = 0.0
    sample_bits: int = 16
    sample_signed: bool = False
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.labels)

    @property
    def taxels(self) -> int:
        """Taxels of a frame."""
        return self.samples.shape[1]

    @property
    def frames(self) -> int:
        """Frames of all recordings together."""
        return len(self.samples)

    @property
    def sample_format(self) -> QFormat:
        """Format of one A/D code."""
        return QFormat(self.sample_bits, 0, self.sample_signed)

    @cached_property
    def lengths(self) -> np.ndarray:
        """Frames of each recording, int64, shape (recordings,)."""
        return np.diff(self.offsets)

    @cached_property
    def class_counts(self) -> np.ndarray:
        """Recordings of each class, int64, shape (classes,)."""
        return np.bincount(self.labels, minlength=len(self.class_names))

    def recording(self, index: int) -> np.ndarray:
        """Recording ``index`` (from 0) as a view, shape (frames, taxels)."""
        return self.samples[self.offsets[index] : self.offsets[index + 1]]

    def subset(self, indices: Sequence[int] | np.ndarray) -> Recordings:
        """The recordings ``indices``, in that order, as a set of their own."""
        indices = np.asarray(indices, dtype=np.int64)
        if not len(indices):
            raise InputError(f"{self.source}: a subset of no recordings was asked for; ask for at least one")
        return Recordings(
            samples=np.concatenate([self.recording(i) for i in indices]),
            offsets=np.concatenate([[0], np.cumsum(self.lengths[indices])]),
            labels=self.labels[indices],
            class_names=self.class_names,
            sample_rate_hz=self.sample_rate_hz,
            groups={name: values[indices] for name, values in self.groups.items()},
            source=self.source,
            volt_per_code=self.volt_per_code,
            sample_bits=self.sample_bits,
            sample_signed=self.sample_signed,
            notes=self.notes,
        )

    def evenly(self, n: int) -> np.ndarray:
        """Indices (ascending) of ``n`` recordings: the same every time, spread over the classes and over each class's list.

        A class with too few gives all of its recordings and the others give more; ``n`` of all or more gives every index.
        """
        if n < 1:
            raise InputError(f"{n} recordings were asked for; ask for at least 1")
        if n >= len(self):
            return np.arange(len(self))
        shares = np.zeros(len(self.class_names), dtype=np.int64)
        while shares.sum() < n:
            open_classes = np.flatnonzero(shares < self.class_counts)
            shares[open_classes[np.argmin(shares[open_classes])]] += 1
        chosen = []
        for label, share in enumerate(shares):
            members = np.flatnonzero(self.labels == label)
            chosen.append(members[(2 * np.arange(share) + 1) * len(members) // (2 * max(share, 1))])
        return np.sort(np.concatenate(chosen))


def load_recordings(data: str | Path, *, config: AcceleratorConfig | None = None) -> Recordings:
    """The recordings that ``--data`` names: an npz archive, the word ``synthetic``, or a folder of ``.lvm`` files by class.

    Parameters
    ----------
    data:
        Path or the word.
    config:
        Gives volt_per_code, the code's format and (without a usable time column) the rate of ``.lvm`` files (default: the thesis preset);
        array, classes and rate of ``synthetic`` (default: 4 x 4 taxels, 3 classes, 3 kHz).

    Raises
    ------
    InputError
        The data break a rule; the sentence names file, array or line, and the fix.
    """
    if str(data) == "synthetic":
        from golden.scene import scene_of, synthetic_recordings  # the scene is only built when asked for

        return synthetic_recordings() if config is None else scene_of(config)
    path = Path(data)
    try:
        if path.is_dir():
            return _load_lvm_folder(path, config or PRESETS["thesis"])
        if not path.exists():
            raise InputError(f"recordings '{path}': is not there; give an .npz archive, a folder of .lvm files or the word synthetic")
        return _load_archive(path)
    except OSError as error:
        raise InputError(f"recordings '{path}': cannot be read ({error.strerror or error}); check the path and its permissions") from None


def check_fit(recordings: Recordings, config: AcceleratorConfig) -> None:
    """Refuse recordings that this configuration's sensor did not give, before any long work.

    Raises
    ------
    InputError
        Other taxels, codes outside the sample format, a rate more than 2 % off, or other class names.
    """

    def refuse(what: str, why: str) -> None:
        raise InputError(f"recordings '{recordings.source}', {what}: {why}; use recordings and a model of one sensor and task")

    if recordings.taxels != config.taxels:
        refuse("array samples", f"has {recordings.taxels} taxels and configuration '{config.name}', field taxels, has {config.taxels}")
    low, high = int(recordings.samples.min()), int(recordings.samples.max())
    if low < config.sample_format.min_code or high > config.sample_format.max_code:
        span = f"{config.sample_format.min_code}..{config.sample_format.max_code}"
        refuse("array samples", f"runs from {low} to {high} and configuration '{config.name}', field sample_bits, takes {span}")
    if abs(recordings.sample_rate_hz / config.sample_rate_hz - 1.0) > 0.02:
        rates = f"is {recordings.sample_rate_hz:g} and configuration '{config.name}', field sample_rate_hz, has {config.sample_rate_hz:g}"
        refuse("array sample_rate_hz", rates)
    if recordings.class_names != config.class_names:
        names = f"is {', '.join(recordings.class_names)} and configuration '{config.name}' has {', '.join(config.class_names)}"
        refuse("array class_names", names)


# ---------------------------------------------------------------------- npz archive
def _load_archive(path: Path) -> Recordings:
    try:
        arrays = read_arrays(path)
    except ArchiveError as error:
        where = f", array {error.member}" if error.member else ""
        raise InputError(f"recordings '{path}'{where}: {error}; write the archive again, of numbers and text, with "
                         "numpy.savez_compressed") from None  # fmt: skip

    def refuse(array: str, why: str) -> None:
        raise InputError(f"recordings '{path}', array {array}: {why}")

    if "images" in arrays and "samples" not in arrays:
        refuse("images", "is an archive of still images, which have no time course; give an archive with samples and offsets")
    for name in ARCHIVE_ARRAYS:
        if name not in arrays:
            refuse(name, f"is missing; an archive holds {', '.join(ARCHIVE_ARRAYS)}")

    samples = arrays["samples"]
    if samples.dtype.kind not in "iu":
        refuse("samples", f"holds {samples.dtype}, not integers; save the A/D codes as an integer type")
    if samples.ndim != 2 or samples.shape[1] < 1:
        refuse("samples", f"has shape {samples.shape}; it must be (frames, taxels)")
    if not len(samples):
        refuse("samples", "holds no frame; an archive needs at least one recording")
    low, high = int(samples.min()), int(samples.max())
    if low < -32768 or high > (32767 if low < 0 else 65535):
        refuse("samples", f"runs from {low} to {high}, beyond 16 bits; give -32768..32767 or 0..65535")
    narrow_type = samples.dtype.itemsize <= 2
    bits = 8 * samples.dtype.itemsize if narrow_type else 16
    signed = samples.dtype.kind == "i" if narrow_type else low < 0

    offsets = arrays["offsets"]
    if offsets.dtype.kind not in "iu" or offsets.ndim != 1:
        refuse("offsets", f"is {offsets.dtype} of shape {offsets.shape}; it must be integers of shape (recordings + 1,)")
    if len(offsets) < 2:
        refuse("offsets", f"has {len(offsets)} value(s), so no recording; it needs recordings + 1 values")
    if offsets[0] != 0:
        refuse("offsets", f"starts at {offsets[0]}; it must start at 0")
    if offsets[-1] != len(samples):
        refuse("offsets", f"ends at {offsets[-1]} but samples has {len(samples)} frames; the last value must be the number of frames")
    if (offsets[1:] < offsets[:-1]).any():
        refuse("offsets", f"falls after entry {int(np.argmax(offsets[1:] < offsets[:-1]))}; it must not decrease")
    if (offsets[1:] == offsets[:-1]).any():
        refuse("offsets", f"makes recording {int(np.argmax(offsets[1:] == offsets[:-1]))} empty (0 frames); leave that recording out")
    recordings = len(offsets) - 1

    names = arrays["class_names"]
    if names.dtype.kind not in "US" or names.ndim != 1 or not len(names):
        refuse("class_names", f"is {names.dtype} of shape {names.shape}; it must be a list of text, one name a class")
    try:
        class_names = tuple(str(name.decode() if isinstance(name, bytes) else name) for name in names)
    except UnicodeDecodeError:
        refuse("class_names", "holds bytes that are not UTF-8; save the names as text")
    for index, name in enumerate(class_names):
        if not name.strip() or not name.isprintable():
            refuse("class_names", f"has an empty or unprintable name at {index}; give every class a readable name")
        if name in class_names[:index]:
            refuse("class_names", f"has the name {name} twice; names must differ")

    labels = arrays["labels"]
    if labels.dtype.kind not in "iu" or labels.shape != (recordings,):
        refuse("labels", f"is {labels.dtype} of shape {labels.shape}; it must be integers of shape ({recordings},), one a recording")
    outside = (labels < 0) | (labels >= len(class_names))
    if outside.any():
        first = int(np.argmax(outside))
        refuse("labels", f"gives recording {first} class {labels[first]}; class_names has classes 0..{len(class_names) - 1}")

    rate = _positive_number(arrays["sample_rate_hz"])
    if rate is None:
        refuse("sample_rate_hz", f"is {_shown(arrays['sample_rate_hz'])}; give one number above 0, in hertz")
    volt = 0.0
    if "lsb_volt" in arrays:
        volt = _positive_number(arrays["lsb_volt"])
        if volt is None:
            refuse("lsb_volt", f"is {_shown(arrays['lsb_volt'])}; give the volt of one code, above 0, or leave the array out")
    groups = {
        name: values for name, values in arrays.items()
        if name not in NOT_GROUPS and values.shape == (recordings,) and values.dtype.kind in "iubUSf"
    }  # fmt: skip
    return Recordings(
        samples=samples.astype(np.int32),
        offsets=offsets.astype(np.int64),
        labels=labels.astype(np.int64),
        class_names=class_names,
        sample_rate_hz=rate,
        groups=groups,
        source=str(path),
        volt_per_code=volt,
        sample_bits=bits,
        sample_signed=signed,
    )


def _positive_number(value: np.ndarray) -> float | None:
    """The one finite number above 0 that ``value`` holds, or None."""
    if value.size != 1 or value.dtype.kind not in "iuf":
        return None
    number = float(value.reshape(()))
    return number if np.isfinite(number) and number > 0 else None


def _shown(value: np.ndarray) -> str:
    return str(value.reshape(())) if value.size == 1 else f"of shape {value.shape}"


# ---------------------------------------------------------------------- .lvm folder
_HEADER_WORDS = {
    "channels", "samples", "date", "time", "y_unit_label", "x_dimension", "x0", "delta_x", "x_value", "notes", "y_dimension",
    "test_name", "test_numbers", "test_series", "uut_name", "uut_m/n", "uut_s/n", "model_number", "serial_number",
}  # fmt: skip
"""First words of the channel block that LabVIEW writes again at each segment."""


def _load_lvm_folder(folder: Path, config: AcceleratorConfig) -> Recordings:
    """One recording a file; class_names are the sub-folders in alphabetical order; groups: source_file and what names tell.

    A file name's parts of letters and a number (``p07_brush_t2``, ``Seq1_Sp300_t1``), separated by ``_`` or ``-``, become groups when
    every file has them: ``p`` is called person, ``t`` trial, others keep their letters.
    """
    if config.volt_per_code <= 0:
        raise InputError(f"recordings '{folder}': .lvm files hold volts; give a configuration whose field volt_per_code is above 0")
    class_folders = sorted(entry for entry in folder.iterdir() if entry.is_dir() and not entry.name.startswith("."))
    if not class_folders:
        raise InputError(f"recordings '{folder}': has no sub-folder; put each class's .lvm files into a folder named after the class")
    parts, labels, names, rates = [], [], [], []
    for label, class_folder in enumerate(class_folders):
        files = sorted(entry for entry in class_folder.iterdir() if entry.suffix.lower() == ".lvm" and not entry.name.startswith("."))
        if not files:
            raise InputError(f"recordings '{class_folder}': has no .lvm file; add the class's recordings or remove the folder")
        for file in files:
            time, volts, lines = _read_lvm(file)
            if parts and volts.shape[1] != parts[0].shape[1]:
                raise InputError(
                    f"recordings '{file}': has {volts.shape[1]} taxels where '{names[0]}' has {parts[0].shape[1]}; all files must agree"
                )
            codes = np.rint(volts / config.volt_per_code)
            fmt = config.sample_format
            wrong = (codes < fmt.min_code) | (codes > fmt.max_code)
            if wrong.any():
                row, taxel = np.argwhere(wrong)[0]
                raise InputError(
                    f"recordings '{file}', line {lines[row]}, column {taxel + 2}: {volts[row, taxel]:g} V is outside the converter's "
                    f"{fmt.min_code * config.volt_per_code:g} to {fmt.max_code * config.volt_per_code:g} V; set sample_bits, sample_signed "
                    "and volt_per_code of the configuration"
                )
            parts.append(codes.astype(np.int32))
            labels.append(label)
            names.append(f"{class_folder.name}/{file.name}")
            rates.append(_rate_of(time))
    if all(rate is not None for rate in rates) and max(rates) <= 1.005 * min(rates):
        rate, note = float(f"{np.median(rates):.5g}"), "the sample rate is that of the time columns"
    else:
        rate, note = config.sample_rate_hz, f"the time columns give no steady rate; taken from the configuration '{config.name}'"
    return Recordings(
        samples=np.concatenate(parts),
        offsets=np.concatenate([[0], np.cumsum([len(part) for part in parts])]).astype(np.int64),
        labels=np.array(labels, dtype=np.int64),
        class_names=tuple(entry.name for entry in class_folders),
        sample_rate_hz=rate,
        groups={"source_file": np.array(names)} | _groups_of_names([Path(name).stem for name in names]),
        source=str(folder),
        volt_per_code=config.volt_per_code,
        sample_bits=config.sample_bits,
        sample_signed=config.sample_signed,
        notes=(note, f"volts became codes of {config.volt_per_code:g} V"),
    )


def _groups_of_names(stems: list[str]) -> dict[str, np.ndarray]:
    tokens = [dict(re.findall(r"(?:^|[_\-. ])([A-Za-z]+)(\d+)(?=$|[_\-. ])", stem)) for stem in stems]
    everywhere = [word for word in tokens[0] if all(word in found for found in tokens)]
    called = {"p": "person", "t": "trial"}
    return {called.get(word.lower(), word.lower()): np.array([int(found[word]) for found in tokens]) for word in everywhere}


def _rate_of(time: np.ndarray | None) -> float | None:
    """Frames a second of a time column (seconds), or None unless its steps agree within 1 % and the last printed digit (1 us)."""
    if time is None or len(time) < 2:
        return None
    period = (time[-1] - time[0]) / (len(time) - 1)
    if not np.isfinite(period) or period <= 0 or np.abs(np.diff(time) - period).max() > 0.01 * period + 1.5e-6:
        return None
    return 1.0 / period


def _read_lvm(file: Path) -> tuple[np.ndarray | None, np.ndarray, list[int]]:
    """Time (s; None when the column is blank), volts (frames, taxels) and the line number (from 1) of each frame."""
    if not file.is_file():
        raise InputError(f"recordings '{file}': is no regular file; remove it or record it again")
    raw = file.read_bytes()
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    lines = text.splitlines()
    start = _after_headers(lines)
    separator, decimal_comma = _separator(lines[start:], file)
    plain = _read_plain(lines, start, separator, decimal_comma)
    if plain is not None:
        return plain

    rows: list[tuple[int, list[str]]] = []
    for number, line in enumerate(lines[start:], start + 1):
        if not line.strip(" \t;,"):
            continue
        line = line.strip(" \r") if separator.pattern in (" +", ", +") else line.rstrip()
        cells = [cell.strip() for cell in separator.split(line)]
        while cells and not cells[-1]:
            cells.pop()
        first = cells[0].lower()
        if first.startswith("***") or first in _HEADER_WORDS:
            continue
        if not rows and _number(cells[0], decimal_comma) is None and cells[0] and not any(_is_decimal(c, decimal_comma) for c in cells):
            continue  # column titles or units: text above the first frame
        rows.append((number, cells))
    if not rows:
        raise InputError(f"recordings '{file}': holds no frame; leave the file out or record it again")

    parsed = [(number, cells, [_number(cell, decimal_comma) for cell in cells]) for number, cells in rows]
    columns = Counter(_numeric_prefix(cells, values) for _, cells, values in parsed).most_common(1)[0][0]
    if columns < 2:
        raise InputError(f"recordings '{file}', line {rows[0][0]}: has no taxel column; column 1 is time, columns 2.. are taxels in volt")
    if len(parsed[-1][1]) < columns and len(parsed) > 1:
        parsed.pop()  # the writer was stopped inside the last row
    for number, cells, values in parsed:
        where = f"recordings '{file}', line {number}"
        if len(cells) < columns or (len(values) > columns and values[columns] is not None):
            count = min(len(cells), _numeric_prefix(cells, values)) if len(cells) > columns else len(cells)
            raise InputError(f"{where}: has {count} columns where the file has {columns}; repair or remove the line")
        for column in range(columns):
            if cells[column] == "" and column == 0:
                continue
            if values[column] is None:
                raise InputError(f"{where}, column {column + 1}: '{cells[column][:20]}' is no number; repair or remove the line")
            if not np.isfinite(values[column]):
                raise InputError(f"{where}, column {column + 1}: {cells[column]} is not a finite number; repair or remove the line")
    volts = np.array([values[1:columns] for _, _, values in parsed], dtype=np.float64)
    times = [values[0] for _, _, values in parsed]
    if any(time is None for time in times) and any(time is not None for time in times):
        number = parsed[next(i for i, time in enumerate(times) if time is None)][0]
        raise InputError(f"recordings '{file}', line {number}, column 1: the time is missing; fill it in or leave the whole column blank")
    return (None if times[0] is None else np.array(times)), volts, [number for number, _, _ in parsed]


def _read_plain(
    lines: list[str], start: int, separator: re.Pattern[str], decimal_comma: bool
) -> tuple[np.ndarray, np.ndarray, list[int]] | None:
    """The same quickly for a file that holds nothing but full rows of finite numbers from ``start`` on (a title apart); else None."""
    blank = None if separator.pattern != "\t" else "\r"
    numbered = [(number, line.rstrip().lstrip(blank)) for number, line in enumerate(lines[start:], start + 1) if line.strip()]
    if numbered and not re.search(r"^\s*[-+]?\d|\d[.,]\d", numbered[0][1]):
        numbered = numbered[1:]
    if not numbered or separator.pattern == ", +":
        return None
    rows = [line.replace(",", ".") if decimal_comma else line for _, line in numbered]
    try:
        values = np.loadtxt(rows, delimiter=None if separator.pattern == " +" else separator.pattern, comments=None, ndmin=2)
    except ValueError:
        return None
    if values.shape[1] < 2 or not np.isfinite(values).all():
        return None
    return values[:, 0], values[:, 1:], [number for number, _ in numbered]


def _after_headers(lines: list[str]) -> int:
    """Index of the line after the headers at the top: LabVIEW ends each (file, then channels) with a marker line."""
    start = 0
    for index, line in enumerate(lines):
        if line.strip().startswith("***End_of_Header***"):
            start = index + 1
        elif re.match(r"\s*[-+]?[\d.,]+[\t; ,]", line):
            break
    return start


def _separator(lines: list[str], file: Path) -> tuple[re.Pattern[str], bool]:
    """What separates this file's columns, and whether a comma is the decimal point.

    Tab before semicolon before comma-and-blank before blanks before comma. Only-commas rows without a single point are ambiguous.
    """
    body = [line.strip() for line in lines if re.match(r"\s*[-+]?[\d.,]", line)]
    sample = "\n".join(body[:200])
    for mark in ("\t", ";"):
        if mark in sample:
            return re.compile(mark), _uses_decimal_comma(sample, mark)
    if re.search(r", +", sample):
        return re.compile(r", +"), _uses_decimal_comma(re.sub(r", +", " ", sample), " ")
    if " " in sample:
        return re.compile(r" +"), _uses_decimal_comma(sample, " ")
    if "," in sample and "." not in sample:
        raise InputError(f"recordings '{file}': commas may be decimal points or separators; separate the columns by tabs or semicolons")
    return re.compile(","), False


def _uses_decimal_comma(sample: str, mark: str) -> bool:
    return re.search(r"\d,\d", sample.replace(mark, " ")) is not None


def _number(cell: str, decimal_comma: bool) -> float | None:
    """The cell's number (NaN and infinities included), or None."""
    try:
        return float(cell.replace(",", ".") if decimal_comma else cell)
    except ValueError:
        return None


def _is_decimal(cell: str, decimal_comma: bool) -> bool:
    return ("." in cell or "," in cell) and _number(cell, decimal_comma) is not None


def _numeric_prefix(cells: list[str], values: list[float | None]) -> int:
    """Leading cells that are numbers; a blank time cell counts as one."""
    for index, value in enumerate(values):
        if value is None and not (index == 0 and cells[0] == ""):
            return index
    return len(values)


# ---------------------------------------------------------------------- splits
def grouped_folds(recordings: Recordings, groups: Sequence[str], folds: int, seed: int | None) -> list[np.ndarray]:
    """Test indices (ascending) of each fold; together they are all recordings, each once.

    Parameters
    ----------
    recordings:
        What to split.
    groups:
        Names of group arrays: recordings that share all their values are never on both sides. Empty: every recording is its own
        group, and folds are stratified by class.
    folds:
        Number of folds, at least 2. With no more groups than folds each group is left out in turn (so there may be fewer folds).
    seed:
        Order in which groups are dealt; None: as they stand in the archive.

    Raises
    ------
    InputError
        An unknown group, a single group, or a number of folds that cannot be made.
    """
    if folds < 2:
        raise InputError(f"{folds} folds were asked for; cross-validation needs at least 2")
    for name in groups:
        if name not in recordings.groups:
            known = ", ".join(sorted(recordings.groups)) or "none"
            raise InputError(f"recordings '{recordings.source}': has no group array '{name}'; it has {known}")
    keys = np.zeros(len(recordings), dtype=np.int64)
    if groups:
        for name in groups:
            _, codes = np.unique(recordings.groups[name], return_inverse=True)
            _, keys = np.unique(keys * (codes.max() + 1) + codes, return_inverse=True)
    else:
        keys = np.arange(len(recordings))
    count = int(keys.max()) + 1
    if count < 2:
        what = f"group {' and '.join(groups)} has one value" if groups else "there is one recording"
        raise InputError(f"recordings '{recordings.source}': {what}; nothing can be left out, so choose another group or add recordings")
    if groups and count <= folds:
        return [np.flatnonzero(keys == key) for key in range(count)]
    if count < folds:
        raise InputError(f"recordings '{recordings.source}': {folds} folds were asked for and there are {count} recordings; ask for fewer")

    table = np.zeros((count, len(recordings.class_names)), dtype=np.int64)
    np.add.at(table, (keys, recordings.labels), 1)
    order = np.arange(count) if seed is None else np.random.default_rng(seed).permutation(count)
    order = order[np.argsort(-table[order].max(axis=1), kind="stable")]
    wanted = np.maximum(recordings.class_counts, 1) / folds
    filled = np.zeros((folds, table.shape[1]))
    fold_of = np.zeros(count, dtype=np.int64)
    for group in order:
        # The fold that this group leaves closest to an even share of every class; ties go to the emptiest, then the first.
        unevenness = (((filled + table[group]) / wanted) ** 2).sum(axis=1) - ((filled / wanted) ** 2).sum(axis=1)
        fold = np.lexsort((filled.sum(axis=1), np.round(unevenness, 9)))[0]
        fold_of[group] = fold
        filled[fold] += table[group]
    return [np.flatnonzero(fold_of[keys] == fold) for fold in range(folds)]
