"""Vectors: which live frame completes which window, the file, and stimulus that exercises a configuration."""

import numpy as np

from eskin.golden.data import Recordings
from eskin.golden.model import completing_frames, run
from eskin.training.times import decision_times
from tests.support.random_models import random_integer_model
from tests.support.small_designs import SMALL
from tests.support.table import each_row

CONFIG = SMALL.replace(
    hop=4, window=9, touch_frames=60, steps=6, pretrigger_frames=20, rearm_frames=40, decision="last"
)


def one_touch(onset: int, frames: int) -> Recordings:
    """At rest but for one sample in frame ``onset``."""
    samples = np.full((frames, 4), 26400, dtype=np.int32)
    samples[onset - 1, 1] = 30000
    return Recordings.of(samples, sample_rate_hz=3000.0, class_names=CONFIG.network.class_names)


# start frame 30: windows end in 38, 42, 46, 50, 54, 58; the first three were over before the onset was seen
@each_row(
    "frames, early, expected",
    [
        (90, {}, [50, 50, 50, 50, 54, 58, 58]),
        (55, {}, [50, 50, 50, 50, 54, 0]),
        (90, dict(decision="early", early_steps=5), [50, 50, 50, 50, 54, 54, 58]),
        (55, dict(decision="early", early_steps=5), [50, 50, 50, 50, 54, 54]),
    ],
)
def test_the_frame_that_completes_each_decision(frames, early, expected):
    """Of replayed frames the onset's; 0: the end of the recording brings it, unless it was given early."""
    trace = run(random_integer_model(CONFIG.replace(**early), 1), one_touch(50, frames))
    assert completing_frames(trace).tolist() == expected and trace.partial[0] == (frames == 55)
    if early:
        assert len(set(trace.local[0, :5])) == 1, "the model changes its mind: choose another seed"
        assert trace.streams["decision"][0][5].tolist()[:2] == [1, 4] and not trace.global_partial.any()
        assert decision_times(trace).tolist() == [4 / 3000.0]
