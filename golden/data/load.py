"""The recordings that ``--data`` names, whatever their form."""

from __future__ import annotations

from pathlib import Path

from eskin.golden.core.config import PRESETS, AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.golden.data.archive import load_archive
from eskin.golden.data.lvm import load_lvm_folder
from eskin.golden.data.recordings import Recordings
from eskin.golden.data.scene import scene_of, synthetic_recordings


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
        return synthetic_recordings() if config is None else scene_of(config)
    path = Path(data)
    try:
        if path.is_dir():
            return load_lvm_folder(path, config or PRESETS["thesis"])
        if not path.exists():
            raise InputError(f"recordings '{path}': is not there; give an .npz archive, a folder of .lvm files or the word synthetic")
        return load_archive(path)
    except OSError as error:
        raise InputError(f"recordings '{path}': cannot be read ({error.strerror or error}); check the path and its permissions") from None
