"""golden/model/prototypes.py: distances against a plain walk through the specification; what teaching and
forgetting leave, in a model and in the middle of a stream."""

from dataclasses import replace

import numpy as np

from eskin.golden.core import AcceleratorConfig
from eskin.golden.model import IntegerModel, Stream, run
from eskin.golden.model.prototypes import forget, taught_in_use, teach
from eskin.training.formats import with_network
from tests.support.random_models import random_integer_model
from tests.support.table import each_row, refused
from tests.support.touch_scenes import SMALL, scene

RULE = {"readout": "prototypes", "prototypes": 2, "taught": 3, "state_code_bits": 4}
SHIFTS = {"gru": 9, "lstm": 9, "linear": 7}


def taught_model(cell: str, decision: str = "last", seed: int = 3, **rule: int) -> IntegerModel:
    """Random weights and prototypes, some places in use."""
    config = with_network(SMALL, cell=cell).replace(decision=decision)
    return random_integer_model(config.with_readout(**RULE, state_code_shift=SHIFTS[cell], **rule), seed)


def test_a_touch_further_from_all_than_its_step_allows_is_unsure():
    model = taught_model("gru", "last")
    nearest = -run(model, scene(20, seed=6)).scores.max(axis=-1)
    limit = int(np.median(nearest[:, -1])) // SMALL.windows.steps
    rule = replace(model.config.readout_rule, unknown_above=limit)
    model = replace(model, config=replace(model.config, readout_rule=rule))
    trace, rows = run(model, scene(20, seed=6)), np.arange(len(nearest))
    far = nearest[rows, trace.global_step] > limit * (trace.global_step + 1)
    whole = trace.touches.completed > 0
    assert set(far[whole]) == {False, True} and trace.unsure[whole].tolist() == far[whole].tolist()


def test_the_oldest_taught_touch_goes_and_a_class_is_forgotten_alone():
    model = forget(taught_model("gru", seed=4))
    touches = np.random.default_rng(5).integers(-8, 8, (8, *model.arrays["taught"].shape[2:]))
    trained = {name: model.arrays[name] for name in model.arrays if not name.startswith("taught")}
    for number, codes in enumerate(touches):
        model = teach(model, codes, 1)
        assert taught_in_use(model).tolist() == [0, min(number + 1, 3), 0]
        stored = {place.tobytes() for place in model.arrays["taught"][1, : min(number + 1, 3)]}
        assert stored == {place.tobytes() for place in touches[max(0, number - 2) : number + 1]}
    model = teach(model, touches[0], 2)
    assert taught_in_use(forget(model, 1)).tolist() == [0, 0, 1]
    assert not taught_in_use(forget(model)).any()
    for name, array in trained.items():
        np.testing.assert_array_equal(model.arrays[name], array)
    with refused("array taught_count: holds 6..6, outside 0..5"):
        replace(model, arrays=model.arrays | {"taught_count": np.full(3, 6)})


def test_a_stream_is_not_taught_during_a_touch():
    model = taught_model("gru")
    stream, samples = Stream(model), scene(20, seed=6).recording(5)
    for frame in samples:
        stream.push(frame)
        if stream.onset_frame is not None:
            break
    for act in (lambda: stream.teach(0), lambda: stream.teach(0, following=True), stream.forget):
        with refused("a touch is under way"):
            act()


@each_row(
    "fields, rule, words",
    [
        (
            {"steps": 20},
            RULE | {"state_code_bits": 8, "hidden": 32},
            "field state_code_bits: is 8: distances",
        ),
        ({}, RULE | {"taught": 16, "classes": 17}, "field taught: is 16 for each of 17 classes"),
        (
            {"decision": "vote"},
            RULE | {"unknown_above": 3},
            "field unknown_above: is set with decision 'vote'",
        ),
        ({}, RULE | {"unknown_above": 181}, "field unknown_above: is 181, and no touch.* at most 180"),
        ({}, RULE | {"taught": 0, "taught_shift": 1}, "field taught_shift: is 1, but there are no slots"),
        (
            {"loadable": False},
            RULE,
            "field loadable: is false, but the host must fill the memory of prototypes",
        ),
        ({}, RULE | {"state_code_shift": 15}, "field state_code_shift: is 15 and the values have 14 bits"),
        ({}, RULE | {"state_code_bits": 2}, "field state_code_bits: is 2; it must lie in 3..8"),
    ],
)
def test_a_readout_that_cannot_be_is_refused(fields, rule, words):
    rule = dict(rule)
    classes, hidden = rule.pop("classes", 3), rule.pop("hidden", 12)
    with refused(words):
        AcceleratorConfig.of(
            **{"decision": "last", "hidden": hidden} | fields,
            **rule,
            class_names=tuple(f"class {k}" for k in range(classes)),
        )


def test_a_class_is_taught_by_index_or_name_and_nothing_else():
    """None, 1.5 and True ended in numpy's own errors, or taught class 1."""
    model = taught_model("gru")
    names, touch = model.config.network.class_names, model.arrays["taught"][0, 0]
    for wrong in (3, -1, None, 1.5, float("nan"), True, np.True_, "nobody", [1], np.array([1])):
        stream = Stream(model)
        for act, *arguments in ((teach, model, touch, wrong), (stream.teach, wrong)):
            with refused("class .*: is none of the model's"):
                act(*arguments)
        with refused("class .*: is none of the model's"):
            stream.teach(wrong, following=True)
    by_name = teach(model, touch, names[1])
    for right in (1, np.int64(1), 1.0):
        assert by_name.content == teach(model, touch, right).content
    assert forget(by_name, names[1]).content == forget(by_name, 1).content != by_name.content
