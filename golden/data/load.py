"""The recordings that ``--data`` names, whatever their form."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from eskin.golden.core.config import PRESETS, AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.golden.data import frames
from eskin.golden.data.archive import load_archive
from eskin.golden.data.matlab import load_matlab
from eskin.golden.data.pictures import is_picture_folder, load_picture_folder
from eskin.golden.data.recordings import Recordings
from eskin.golden.data.scene import scene_of, synthetic_recordings
from eskin.golden.data.tables import SUFFIXES, is_table_folder, load_folder, load_long_table
from eskin.golden.data.text import Reading

if TYPE_CHECKING:
    import pandas as pd

FORMS = (
    "an .npz archive, a folder of .csv, .lvm or .png files by class, a long .csv table, a .mat file or the "
    "word synthetic"
)


def load_recordings(
    data: str | Path | pd.DataFrame,
    *,
    config: AcceleratorConfig | None = None,
    reading: Reading | None = None,
) -> Recordings:
    """The recordings that ``--data`` names (docs/recordings.md): an npz archive, a folder of ``.csv``,
    ``.lvm`` or ``.png`` files by class, one long table, a ``.mat`` file, or the word ``synthetic``.

    Parameters
    ----------
    data:
        Path or the word; in Python also one long table as a pandas DataFrame.
    config:
        Gives volt_per_code, the code's format and (without a usable time column) the rate of ``.lvm`` files
        (default: the thesis preset); what one code is worth, and a rate that is not said, of real samples in
        other files; array, classes and rate of ``synthetic`` (default: 4 x 4 taxels, 3 classes, 3 kHz).
    reading:
        What is said about text tables and ``.mat`` files; None: everything is found out.

    Raises
    ------
    InputError
        The data break a rule; the sentence names file, array or line, and the fix.
    """
    reading = reading or Reading()
    if type(data).__name__ == "DataFrame":  # its class would have to be imported
        return load_long_table(data, reading, config)
    if not isinstance(data, str | Path):
        raise InputError(
            f"recordings: are of type {type(data).__name__}; give {FORMS}, or a pandas DataFrame"
        )
    if str(data) == "synthetic":
        return synthetic_recordings() if config is None else scene_of(config)
    path = Path(data)
    try:
        if path.is_dir() and is_picture_folder(path):
            return load_picture_folder(path)
        if path.is_dir():
            lvm = not is_table_folder(path)
            return load_folder(path, reading, config or PRESETS["thesis"] if lvm else config, lvm)
        if not path.exists():
            raise InputError(f"recordings '{path}': is not there; give {FORMS}")
        if path.suffix.lower() == ".mat" and path.is_file():
            return load_matlab(path, reading, config)
        if path.suffix == frames.SUFFIX and path.is_file():
            return frames.load_frames(path)
        if path.suffix.lower() in SUFFIXES:
            return load_long_table(path, reading, config)
        return load_archive(path, reading.scale or (config.sensor.volt_per_code or None if config else None))
    except OSError as error:
        raise InputError(
            f"recordings '{path}': cannot be read ({error.strerror or error}); check the path and its "
            "permissions"
        ) from None
