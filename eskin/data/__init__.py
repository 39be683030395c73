"""Public names of eskin.data: readers of every kind of file, and the synthetic scene."""

from eskin.data.load import load_recordings
from eskin.data.table import Reading
from eskin.data.turns import turn_recordings
