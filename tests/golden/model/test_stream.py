"""golden/model/stream.py: frames one by one give what the run over whole recordings gives, at the frames at
which the hardware gives it."""

import numpy as np
from hypothesis import given

from eskin.golden.model import Stream, completing_frames, run
from eskin.training.made_up import random_recordings
from tests.support.front_end_cases import CASES
from tests.support.random_models import random_float_model, random_integer_model
from tests.support.strategies import designs, examples
from tests.support.table import each_row
from tests.support.touch_scenes import SMALL, scene


def whole_recordings(config, seed):
    """Recordings of a configuration: some with several touches, one that ends inside one, one too short for
    any."""
    rest, windows = config.rest_level.rest_frames, config.windows
    whole = rest + windows.pretrigger_frames + config.last_frame + 2 * windows.hop
    again = 2 * whole + config.onset_rule.rearm_frames + 20
    return random_recordings(config, (again, 3 * whole, whole + 10, whole // 2 + 3, rest + 3), seed)


def streamed(stream, samples, rng):
    """Decisions of one recording, its frames pushed in pieces of random lengths, many of them of one
    frame."""
    stream.arm()
    decisions, frame = [], 0
    while frame < len(samples):
        length = int(rng.choice([1, 1, 2, int(rng.integers(1, 60)), len(samples)]))
        piece = samples[frame : frame + length]
        decisions += stream.push(piece[0] if length == 1 else piece)
        frame += len(piece)
    return decisions + stream.finish()


def check_same(stream, trace, recordings, seed, *, stages=True):
    """Every decision, its frame and the stages behind it; the number of decisions compared."""
    rng = np.random.default_rng(seed)
    rows, offsets = trace.streams["decision"]
    frames = completing_frames(trace)
    compared = 0
    for index in range(len(recordings)):
        samples = recordings.recording(index)
        decisions = streamed(stream, samples, rng)
        span = slice(offsets[index], offsets[index + 1])
        assert [decision.row() for decision in decisions] == [tuple(row) for row in rows[span].tolist()]
        # the end of the recording brings it
        source_frame = trace.config.sensor.source_frame
        expected = [source_frame(frame) or len(samples) for frame in frames[span].tolist()]
        assert [decision.frame for decision in decisions] == expected
        assert stream.decision == trace.decision[index] and stream.touches == np.count_nonzero(
            trace.touches.recording == index
        )
        compared += len(decisions)
        for stage in ("sum", "fault", "feature", "state", "logit") if stages else ():
            values, bounds = trace.streams[stage]
            parts = [decision.stages[stage] for decision in decisions if stage in decision.stages]
            expected = values[bounds[index] : bounds[index + 1]].tolist()
            assert np.concatenate([np.zeros(0), *parts]).tolist() == expected
    return compared


def test_random_designs():
    compared = []

    @examples(40, 1000)
    @given(design=designs().filter(lambda design: not design.config.is_image))
    def check(design):
        model = design.model
        recordings = whole_recordings(model.config, design.seed)
        compared.append(check_same(Stream(model), run(model, recordings), recordings, design.seed))

    check()
    assert sum(compared) > 500


def test_a_float_model_streams_its_own_decisions():
    """Local classes and the global one at every recording equal the run over whole recordings."""
    model, rng = random_float_model(SMALL, 1), np.random.default_rng(1)
    recordings = scene(16)
    trace, stream = run(model, recordings), Stream(model)
    for index in range(len(recordings)):
        decisions = streamed(stream, recordings.recording(index), rng)
        assert stream.decision == trace.decision[index]
        local = [decision.label for decision in decisions if not decision.is_global and decision.touch == 0]
        assert local == [label for label in trace.first_local()[index] if label >= 0]
    assert set(trace.decision) > {-1}


@each_row("name", ["pvdf", "thesis"])
def test_what_is_kept_does_not_grow_and_is_enough(name):
    config = CASES[name].replace(feature_kinds=("activity",), activity_rule="change")
    model = random_integer_model(config, 3)
    recordings, stream = random_recordings(model.config, (4000,), 9), Stream(model)
    size = stream._kept.shape
    assert check_same(stream, run(model, recordings), recordings, 5) > 20
    assert stream._kept.shape == size and stream.frame == 4000 and stream.touches > 4


def test_the_state_of_the_detector_is_told():
    model = random_integer_model(SMALL, 3)
    stream, samples = Stream(model), scene(4).recording(2)
    states = []
    for frame in samples:
        stream.push(frame)
        states.append(stream.state)
        assert (stream.onset_frame is not None) == (stream.state == "touch")
    order = [state for index, state in enumerate(states) if index == 0 or state != states[index - 1]]
    assert order[:4] == ["settling", "armed", "touch", "rearm"]
