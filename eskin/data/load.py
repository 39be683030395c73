"""The recordings that ``--data`` names, whatever their form."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from eskin.data import frames, hdf5
from eskin.data.logs import is_log
from eskin.data.matlab import load_matlab
from eskin.data.pictures import is_picture_folder, load_picture_folder
from eskin.data.scene import scene_of, synthetic_recordings
from eskin.data.tables import PARQUET, SUFFIXES, is_table_folder, load_folder, load_long_table
from eskin.data.text import Reading
from eskin.data.turns import turn_recordings
from eskin.golden.core import PRESETS, AcceleratorConfig, InputError
from eskin.golden.core.errors import without_extra
from eskin.golden.data.archive import load_archive
from eskin.golden.data.recordings import Recordings

if TYPE_CHECKING:
    import pandas as pd

FORMS = (
    "an .npz archive, a folder by class of .csv, .parquet, .lvm or .png files or logs, a long .csv or .parquet "
    "table, a .mat or .h5 file, a log (.mcap, or a ROS bag) or the word synthetic or synthetic-easy"
)

SCENES = {"synthetic": turn_recordings, "synthetic-easy": synthetic_recordings}
"""Words for made-up scenes."""


def load_recordings(
    data: str | Path | pd.DataFrame,
    *,
    config: AcceleratorConfig | None = None,
    reading: Reading | None = None,
) -> Recordings:
    """The recordings that ``--data`` names (docs/recordings.md): an npz archive, a folder by class of
    ``.csv``, ``.parquet``, ``.lvm`` or ``.png`` files or logs, one long table, a ``.mat`` or HDF5 file, a
    log, or a word of SCENES.

    Parameters
    ----------
    data:
        Path or the word; in Python also one long table as a pandas DataFrame.
    config:
        Gives volt_per_code, the code's format and (without a usable time column) the rate of ``.lvm`` files
        (default: the thesis preset); what one code is worth, and a rate that is not said, of real samples in
        other files; scene, array and rate of ``synthetic`` (``scene_of``).
    reading:
        What is said about text tables and ``.mat`` files; None: everything is found out.

    Raises
    ------
    InputError
        The data break a rule; the sentence names file, array or line, and the fix.
    """
    reading = reading or Reading()
    if type(data).__name__ == "DataFrame":  # by name: pandas need not be installed
        return load_long_table(data, reading, config)
    if not isinstance(data, str | Path):
        raise InputError(
            f"recordings: are of type {type(data).__name__}; give {FORMS}, or a pandas DataFrame"
        )
    if str(data) in SCENES:
        return SCENES[str(data)]() if config is None else scene_of(config, easy=str(data) != "synthetic")
    path = Path(data)
    if reading.labels is not None and not is_log(path):
        raise InputError(
            f"recordings '{path}': --labels is for one log, a .mcap file or a ROS bag; leave it out"
        )
    try:
        if is_log(path) and path.exists():
            return load_long_table(path, reading, config)
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
        if path.suffix.lower() in hdf5.SUFFIXES and path.is_file():
            return hdf5.load_hdf5(path, reading, config)
        if path.suffix.lower() in (*SUFFIXES, PARQUET):
            return load_long_table(path, reading, config)
        if path.suffix != ".npz":
            raise InputError(
                f"recordings '{path}': ends in '{path.suffix}', which is no format of recordings; give {FORMS}"
            )
        return load_archive(path, reading.scale or (config.sensor.volt_per_code or None if config else None))
    except ModuleNotFoundError as error:
        sentence = without_extra(error)
        if sentence is None:
            raise
        raise InputError(f"recordings '{path}': {sentence}") from None
    except OSError as error:
        raise InputError(
            f"recordings '{path}': cannot be read ({error.strerror or error}); check the path and its "
            "permissions"
        ) from None
