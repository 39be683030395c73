"""Every subset of the kinds of feature on recordings of three data sets, with every cell and lane type in turn:
bit-exact at every stage, and the cycles of the program."""

from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eskin.data import load_recordings
from eskin.golden.core import FEATURE_KINDS, PRESETS, QFormat
from eskin.golden.model import (
    IntegerModel,
    find_touches,
    normaliser_constants,
    random_integer_model,
    real_features,
    with_network,
)
from eskin.rtl.program.schedule import schedule
from eskin.training.datasets import scaling
from eskin.training.derive import derive_config
from eskin.training.quantise import _feature_frac_limit
from eskin.verbs.flow import cosimulate

BUILDS = Path(__file__).resolve().parents[3] / "build" / "simulators"
CELLS: list[dict[str, Any]] = [
    dict(cell="gru", reset="before"),
    dict(cell="gru", reset="after"),
    dict(cell="lstm"),
    dict(cell="linear"),
]
LANES = [(1, "plain"), (2, "plain"), (4, "dsp"), (6, "plain"), (12, "plain"), (1, "dsp")]
SUBSETS = [subset for size in (1, 2, 3) for subset in combinations(FEATURE_KINDS, size)]
RECORDINGS = 20
BLOCKS = {"pvdf_indent": 24, "fabric_slide": 3, "biotac_slide": 1}
KNEES = {"pvdf_indent": 9, "fabric_slide": 6, "biotac_slide": 8}


def model_for(recordings, config, seed: int) -> IntegerModel:
    """Random weights behind the normaliser that these recordings ask for."""
    touches = find_touches(config, recordings)
    mu, sigma = scaling(config, real_features(config, touches.sums), touches.completed)
    # activity of small counts is coarser than 8 fraction bits
    fraction = min(8, _feature_frac_limit(config, np.asarray(sigma), {}))
    products = config.formats.dense_format.frac_bits + fraction
    config = config.replace(
        feature_format=QFormat(4, fraction),
        logit_format=QFormat(6, min(10, products - 1)),
        dense_bias_format=QFormat(5, min(11, products)),
    )
    filled, mean, scale = normaliser_constants(config, mu, sigma)
    return IntegerModel(
        filled, {**random_integer_model(filled, seed).arrays, "mean": mean, "scale": scale}, "random weights"
    )


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("subset", SUBSETS, ids="+".join)
@pytest.mark.parametrize("name", BLOCKS)
def test_bit_exact_on_recordings(shared_data, tmp_path, name, subset):
    recordings = load_recordings(shared_data / name / "recordings.npz")
    recordings = recordings.subset(recordings.evenly(RECORDINGS))
    place = list(BLOCKS).index(name)
    number = SUBSETS.index(subset) + place
    lanes, lane_type = LANES[(number + place) % len(LANES)]
    cell = CELLS[number % len(CELLS)]
    preset = {"pvdf_indent": PRESETS["pvdf"], "fabric_slide": PRESETS["fabric"]}.get(name) or derive_config(
        recordings
    )[0]
    config = with_network(preset, **cell, **{} if cell["cell"] == "linear" else dict(hidden=6)).replace(
        lanes=lanes,
        lane_type=lane_type,
        feature_kinds=subset,
        activity_rule=("sum", "change")[number % 2],
        activity_block=BLOCKS[name],
        feature_scale=("array", "taxel")[number // 2 % 2],
        integral_knee=KNEES[name],
        feature_shift=(),
    )
    model = model_for(recordings, config, number)
    result = cosimulate(model, recordings, work=tmp_path, builds=BUILDS, stalls=number % 2 == 1, seed=number)
    assert result["recordings"] == RECORDINGS and result["bit_exact"] and result["mismatches"] == 0, result[
        "mismatch_list"
    ]
    assert result["compared_values"] > 10 * RECORDINGS * config.inputs
    if number % 2 == 0:
        cycles = schedule(model.config).step_cycles
        assert result["cycles"]["step_min"] == result["cycles"]["step_max"] == cycles
