"""Public names of golden.data: recordings, their archives and their folds."""

from eskin.golden.data.archive import load_archive, save_archive
from eskin.golden.data.recordings import Recordings, check_fit, for_model
