"""golden/model/pipeline.py: the rules of decisions, and their times."""

import numpy as np

from eskin.golden.core import PRESETS
from eskin.golden.model import find_touches
from eskin.golden.model.pipeline import Decisions, decide
from eskin.training.times import step_times
from tests.support.touch_scenes import SMALL, scene


def test_votes_tie_to_the_lowest_class_and_uncompleted_steps_do_not_vote():
    logits = np.zeros((2, 4, 3), dtype=np.int64)
    logits[0, [0, 1, 2, 3], [2, 2, 1, 1]] = 9
    logits[1, [0, 1, 2, 3], [2, 1, 1, 1]] = 9
    config = SMALL.replace(decision="vote", steps=4)
    local, margin, overall, lead = decide(config, logits, np.array([4, 1]))
    assert overall.tolist() == [1, 2] and lead.tolist() == [0, 1]
    assert local[1].tolist() == [2, -1, -1, -1] and margin[1].tolist() == [9, 0, 0, 0]
    local, margin, overall, lead = decide(config.replace(decision="last"), logits, np.array([4, 0]))
    assert overall.tolist() == [1, -1] and lead.tolist() == [9, 0]


def test_step_times_count_from_the_onset():
    recordings = scene(20, seed=9)
    touches = find_touches(SMALL, recordings)
    times = step_times(SMALL, touches)
    assert np.allclose(np.diff(times), SMALL.windows.hop / SMALL.sensor.sample_rate_hz)
    # window 1 ends at the end of the hop after the onset's
    assert 0 < times[0] <= SMALL.windows.hop / SMALL.sensor.sample_rate_hz
    at_once = PRESETS["fabric"]
    empty = find_touches(SMALL, recordings.subset([0]))
    assert np.allclose(step_times(at_once, empty)[0], at_once.windows.window / at_once.sensor.sample_rate_hz)


def test_shares_of_decisions_count_none_as_wrong_and_as_agreement():
    first, other = Decisions(), Decisions()
    first.decision, other.decision = np.array([0, 1, -1, 2]), np.array([0, 2, -1, 2])
    assert first.agreement(other) == 0.75 and first.accuracy(np.array([0, 1, 1, 1])) == 0.5
