"""Weights of 16 bits: accumulators of more than 32, addends in three words of the host's, bit-exact from the
frames to the decisions."""

from pathlib import Path

import numpy as np
import pytest

from eskin.golden.core import AcceleratorConfig, InputError, QFormat, signed_bits
from eskin.golden.model import Fixed, IntegerModel, run
from eskin.rtl.program.memory_map import Memory, load_words, load_writes, memory_images
from eskin.training.made_up import random_recordings
from eskin.verbs.flow import cosimulate
from tests.support.random_models import random_integer_model
from tests.support.small_designs import SMALL

BUILDS = Path(__file__).resolve().parents[2] / "build" / "simulators"
WIDE = SMALL.replace(
    name="wide",
    taxels=6,
    hidden=5,
    weight_format=QFormat(3, 13),
    recurrent_format=QFormat(4, 12),
    dense_format=QFormat(3, 13),
    feature_format=QFormat(3, 11),
    state_format=QFormat(2, 14),
    logit_format=QFormat(6, 10),
)
LENGTHS = (400, 700, 30)


class Peak(Fixed):
    """The plain arithmetic, which notes the largest sum of a row."""

    peak = 0.0

    def _narrow(self, value, shift, fmt):  # type: ignore[override]
        self.peak = max(self.peak, float(np.abs(value).max()))
        return Fixed._narrow(value, shift, fmt)


def model_at_the_ends(config: AcceleratorConfig, seed: int) -> IntegerModel:
    """Random weights; half of the rows of W at an end of their format and features three times as large, so
    that sums leave 32 bits."""
    rng, model = np.random.default_rng(seed), random_integer_model(config, seed)
    arrays = dict(model.arrays)
    for name in (name for name in arrays if name[0] == "W"):
        ends = np.where(rng.random((config.network.hidden, 1)) < 0.5, -(1 << 15), (1 << 15) - 1)
        arrays[name] = np.where(rng.random(ends.shape) < 1 / 2, ends, arrays[name])
    arrays["scale"] = np.minimum(3 * arrays["scale"], config.scale_format.max_code)
    return IntegerModel(model.config, arrays)


@pytest.mark.parametrize(
    ("changes", "simulator"),
    [
        ({"lanes": 4}, "icarus"),
        ({"lanes": 1, "checksum": True}, "icarus"),
        pytest.param({"lanes": 4, "cell": "lstm", "checksum": True}, "verilator", marks=pytest.mark.slow),
    ],
    ids=lambda value: value if isinstance(value, str) else " ".join(map(str, value.values())),
)
def test_weights_of_16_bits_are_exact_from_the_frames_to_the_decisions(tmp_path, changes, simulator):
    model = model_at_the_ends(WIDE.replace(**changes), seed=3)
    config = model.config
    assert config.weight_bits == 16 and config.accumulator_bits > 32 and config.addend_parts == 3
    recordings = random_recordings(config, LENGTHS, seed=4)
    trace, peak = run(model, recordings), Peak(config)
    model.run(peak, trace.features)
    assert peak.peak >= 1 << 31, "no sum of these recordings needs more than 32 bits"
    result = cosimulate(model, recordings, work=tmp_path, builds=BUILDS, simulator=simulator)
    assert result["bit_exact"] and result["recordings"] == len(LENGTHS), result["mismatch_list"]
    assert result["decisions"] > 8


def test_the_host_loads_an_addend_in_three_words_where_it_has_more_than_32_bits():
    model = random_integer_model(WIDE, seed=1)
    addends = memory_images(model.config, model.arrays)[Memory.ADDENDS]
    writes = load_writes(model.config, model.arrays)
    begin = next(k for k, (_, word) in enumerate(writes) if word == Memory.ADDENDS) + 1
    words = [word for _, word in writes[begin : begin + 3 * len(addends)]]
    read = [
        sum(word << 16 * k for k, word in enumerate(words[3 * n : 3 * n + 3])) for n in range(len(addends))
    ]
    assert [word - (word >> 47 << 48) for word in read] == addends and max(map(abs, addends)) > 1 << 24
    assert writes[begin + 3 * len(addends)][1] == Memory.CONSTANTS and load_words(model.config) >= 3 * len(
        addends
    )


@pytest.mark.parametrize(
    "formats",
    [
        {},
        {"feature_format": QFormat(2, 12)},
        {"dense_format": QFormat(1, 15), "taxels": 160, "hidden": 32},
        {"logit_format": QFormat(4, 4)},
    ],
)
def test_the_accumulator_holds_the_worst_row_and_a_bit_less_does_not(formats):
    """By construction: every operand at the end of its format that is largest, all signs agreeing, added up
    one by one."""
    config = WIDE.replace(**formats)
    c = config.formats
    feature, state = c.feature_format.min_code << config.feature_align, c.state_format.min_code
    gate = [c.weight_format.min_code * feature] * config.sensor.taxels + [
        c.recurrent_format.min_code * state
    ] * config.network.hidden
    gate += [
        -c.bias_format.min_code << config.bias_shift,
        1 << max(config.sigmoid_shift, config.tanh_shift, config.value_shift) - 1,
    ]
    dense = [c.dense_format.min_code * state] * config.network.hidden
    dense += [-c.dense_bias_format.min_code << config.dense_bias_shift, 1 << config.logit_shift - 1]
    worst = max(sum(gate), sum(dense))
    assert signed_bits(worst) == config.accumulator_bits
    assert worst < 1 << config.accumulator_bits - 1 and worst >= 1 << config.accumulator_bits - 2


def test_what_no_hardware_holds_is_refused_in_a_sentence():
    with pytest.raises(
        InputError,
        match="field weight_format: needs a .*-bit accumulator in the worst case, above the limit of 48",
    ):
        WIDE.replace(bias_format=QFormat(31, -15))
