"""Public names of golden.data: recordings."""

from eskin.golden.data.recordings import Recordings
