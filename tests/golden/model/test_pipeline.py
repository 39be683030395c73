"""golden/model/pipeline.py: the trace against a plain walk through the specification, and the rules of
decisions."""

import dataclasses

import numpy as np

from eskin.golden.core import PRESETS
from eskin.golden.model import find_touches, random_integer_model, run, step_times, with_network
from eskin.golden.model.pipeline import STAGES, decide, global_steps
from tests.golden.model.test_cells import CELLS, Plain
from tests.support.table import each_row
from tests.support.touch_scenes import SMALL, scene


def plain_decision(config, logits):
    """Class and margin of each step and of the touch, one number at a time."""
    locals_ = []
    for row in logits:
        best = max(range(len(row)), key=lambda c: (row[c], -c))
        locals_.append((best, row[best] - max(row[c] for c in range(len(row)) if c != best)))
    if config.network.decision != "vote":
        return locals_, locals_[-1]
    votes = [sum(best == c for best, _ in locals_) for c in range(len(config.network.class_names))]
    best = max(range(len(votes)), key=lambda c: (votes[c], -c))
    return locals_, (best, votes[best] - max(votes[c] for c in range(len(votes)) if c != best))


def plain_early(config, locals_):
    """Step after which the global decision of these local (class, margin) is given early; None: never."""
    streak, before = 0, None
    for step, (best, margin) in enumerate(locals_):
        streak = 0 if margin < config.network.early_margin else streak + 1 if streak and best == before else 1
        before = best
        if config.network.decision == "early" and streak == config.network.early_steps:
            return step
    return None


@each_row("decision", ["vote", "last", "early"])
@each_row(("cell", "reset"), CELLS)
def test_the_trace_is_the_specification_walked_through(cell, reset, decision):
    config = with_network(SMALL, cell=cell, reset=reset).replace(
        decision=decision, early_steps=3, masked_taxels=(2,), fault_frames=16, fault_activity=17
    )
    model, recordings = random_integer_model(config, 7), scene(20, seed=6)
    before = run(model, recordings)
    config = model.config.replace(
        early_margin=int(np.quantile(before.margin, 0.7)),
        margin_threshold=int(np.median(before.global_margin)),
    )
    model = dataclasses.replace(model, config=config)
    trace = run(model, recordings)
    touches = find_touches(config, recordings)
    assert set(np.bincount(touches.recording, minlength=20)) == {0, 1, 2}
    assert touches.partial.any() and not touches.partial.all()
    assert touches.faults.any() and not touches.faults.all()
    plain, bits = Plain(config, model.arrays), config.formats.feature_format.width
    mean, scale = (int(model.arrays[name][0]) for name in ("mean", "scale"))
    shift, seen_early = config.features.feature_shift[0], []

    def feature(d, out_of_use):
        centred = plain.narrow((d - mean) // 2**shift, 0, 16)
        return 0 if out_of_use else plain.narrow(centred * scale, config.formats.gate_frac, bits)

    for recording in range(20):
        expected = {stage: [] for stage in STAGES}
        for touch in np.flatnonzero(touches.recording == recording):
            done = int(touches.completed[touch])
            sums, faults = touches.sums[touch, :done].tolist(), touches.faults[touch, :done] | [0, 0, 1, 0]
            features = [list(map(feature, *row)) for row in zip(sums, faults.tolist(), strict=True)]
            states, logits = plain.touch(np.array(features))
            locals_, overall = plain_decision(config, logits)
            stages = {"sum": sums, "fault": faults, "feature": features, "state": states, "logit": logits}
            for stage, values in stages.items():
                expected[stage] += np.array(values).reshape(-1).tolist()
            rows = [[0, k, best, margin, 0, 0] for k, (best, margin) in enumerate(locals_)]
            early = plain_early(config, locals_)
            step, (label, margin) = (done - 1, overall) if early is None else (early, locals_[early])
            partial = int(touches.partial[touch]) if early is None else 0
            unsure = int(margin < config.network.margin_threshold)
            rows.insert(step + 1, [1, step, label, margin, partial, unsure])
            expected["decision"] += rows
            seen_early.append(early is not None and early < done - 1)
        for stage, (values, offsets) in trace.streams.items():
            assert values.dtype == np.int64 and len(offsets) == 21
            span = slice(offsets[recording], offsets[recording + 1])
            assert values[span].tolist() == expected[stage], (stage, recording)
        label, unsure = next(((row[2], row[5]) for row in expected["decision"] if row[0]), (-1, 1))
        assert trace.decision[recording] == label and trace.confident[recording] == (not unsure)
        assert trace.not_touched[recording] == (not (touches.recording == recording).any())
    assert set(trace.streams) == set(STAGES) and 0 in trace.decision[trace.confident]
    assert decision != "early" or set(seen_early) == {False, True}


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


@each_row("steps", [1, 2, 3])
def test_an_early_decision_is_the_first_that_held_in_codes_as_in_real_logits(steps):
    rng = np.random.default_rng(steps)
    logits, completed = rng.integers(-9, 10, (400, 6, 3)), rng.integers(0, 7, 400)
    config = SMALL.replace(decision="early", early_margin=4, early_steps=steps, steps=6)
    local, margin, overall, lead = decide(config, logits, completed)
    given = global_steps(config, local, margin, completed)
    when = []
    for row, done in enumerate(completed):
        steps_of = zip(local[row, :done].tolist(), margin[row, :done].tolist(), strict=True)
        early = plain_early(config, list(steps_of))
        when.append(done - 1 if early is None else early)
        decided = (local[row, when[-1]], margin[row, when[-1]]) if done else (-1, 0)
        assert (overall[row], lead[row]) == decided
    assert given.tolist() == when and set(when) == set(range(-1, 6))
    real = decide(config, config.formats.logit_format.to_real(logits), completed)
    np.testing.assert_array_equal(real[2], overall)


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
