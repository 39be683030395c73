"""What other folders take of the data: recordings, from wherever they come, and their folds."""

from eskin.golden.data.archive import load_archive, save_archive
from eskin.golden.data.folds import grouped_folds
from eskin.golden.data.load import load_recordings
from eskin.golden.data.pictures import image_size, resized
from eskin.golden.data.recordings import Recordings, check_fit
from eskin.golden.data.scene import synthetic_recordings
from eskin.golden.data.text import Reading
