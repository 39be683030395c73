"""The engine of trees: bit for bit against the golden forest, in its cycles; its memories; no multiplier."""

from itertools import accumulate

import numpy as np
import pytest
from amaranth.back import rtlil

from eskin.golden.core import QFormat
from eskin.rtl.engine.forest import ForestEngine
from eskin.rtl.program.memory_map import Memory, memory_images, node_fields
from tests.rtl.engine import test_engine
from tests.rtl.engine.test_engine import check_exact, check_exact_and_cycles, run, small, windows
from tests.support.random_models import random_integer_model
from tests.support.table import each_row

TWO, THREE = ("mean", "activity"), ("mean", "activity", "integral")


def forest(**changes):
    """`small` as trees."""
    sizes = {"trees": 4, "nodes": 19, "depth": 4, "decision": "last"}
    return small("trees", "before", 1, **sizes | changes)


@each_row(
    "changes",
    [
        {},
        {
            "checksum": True,
            "window": 9,
            "touch_frames": 16,
            "feature_kinds": THREE,
            "feature_format": QFormat(3, 5),
        },
        {"feature_kinds": TWO, "feature_scale": "taxel", "checksum": True, "decision": "vote", "steps": 1},
        {"trees": 1, "nodes": 1, "depth": 1, "taxels": 1, "class_names": ("a", "b"), "steps": 4},
        {"trees": 3, "nodes": 3, "depth": 1, "gate_frac": 4, "class_names": tuple(map(str, range(32)))},
    ],
)
def test_bit_exact_in_cycles(changes):
    check_exact_and_cycles(forest(**changes), touches=4)


def test_bit_exact_with_stalls():
    model = random_integer_model(
        forest(decision="vote", trees=7, nodes=22, logit_format=QFormat(7, 4)), seed=3
    )
    leaf = model.arrays["child"] < 0  # the largest sum of votes, too
    model.arrays.update(child=np.where(leaf, -1, model.arrays["child"]), vote=np.where(leaf, 127, 0))
    check_exact(model, windows(model.config, touches=3, seed=3), stall=0.98, seed=3)


def test_bits_of_a_node_and_a_scale_count(monkeypatch):
    """A turned bit of a word that a step uses is seen by its parity: the first of each field, and the last."""
    model = random_integer_model(forest(checksum=True, trees=1, nodes=1, depth=1, steps=1, taxels=1), seed=4)
    config, images = model.config, memory_images(model.config, model.arrays)
    monkeypatch.setattr(test_engine, "memory_images", lambda *_: images)
    fields = accumulate(node_fields(config).values(), initial=0)
    for memory, bits in ((Memory.NODES, fields), (Memory.CONSTANTS, (0, 15))):
        for bit in bits:
            images[memory][0] ^= 1 << bit
            with pytest.raises(AssertionError, match="every word is the image's"):
                run(model, windows(config, touches=1, seed=bit))
            images[memory][0] ^= 1 << bit
    run(model, windows(config, touches=1, seed=1))


def test_no_multiplier_is_elaborated():
    config = random_integer_model(forest(), seed=1).config
    assert "$mul" not in rtlil.convert(ForestEngine(config))
