"""rtl/frontend/front_end.py: samples in, centred sums out, against the golden model of sections 2 and 3."""

import numpy as np
import pytest

from eskin.golden.data import Recordings
from eskin.golden.model.preprocess import find_touches
from eskin.rtl.frontend.front_end import FrontEnd
from tests.rtl.frontend.test_normaliser import centred_beats, means_of, shifted
from tests.support.front_end_cases import CASES, make_stream, sample_beats
from tests.support.stream_bench import SIDES, play, values


@pytest.mark.parametrize(
    ("name", "stalls"),
    [
        ("three end together", (0.0, 0.0)),
        ("two taxels", SIDES[0]),
        ("three end together", SIDES[1]),
        ("two taxels", SIDES[2]),
    ],
)
def test_centred_sums_of_a_stream(name, stalls):
    config = shifted(CASES[name]).replace(loadable=False)
    stream, means = make_stream(config, 200, seed=3), means_of(config)
    ends, labels = np.array([0, len(stream)]), np.array([0])
    touches = find_touches(config, Recordings(stream.astype(np.int32), ends, labels, ("any",), 1000.0))
    sums, lengths = [], []
    for count, of_touch in zip(touches.completed, touches.sums, strict=True):
        sums += [*of_touch[:count]]
        lengths += config.length_index[:count]
    assert len(touches) > 1 and touches.completed[0] == config.windows.steps
    expected = centred_beats(config, sums, lengths, means, masked=())
    dut = FrontEnd(config, means)
    out, accepted = play(dut, sample_beats(stream), stalls=stalls, seed=5)
    assert values(out) == expected and len(accepted) == stream.size
