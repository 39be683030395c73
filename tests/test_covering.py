"""Few small designs that together have every bin of a configuration (`scripts.coverage.wishes`), each in Amaranth's
simulator against the golden model at every stage."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from eskin.rtl.program.schedule import lowest_clock_hz
from eskin.training.made_up import decided_recordings
from eskin.verbs import cosim
from scripts.coverage import wishes
from scripts.crosses import build
from tests.rtl.top.test_accelerator import STAGES, play
from tests.support.covered import note, observe
from tests.support.random_models import random_integer_model
from tests.support.strategies import together

PARTS = 12
"""Tests, each with every twelfth design."""


@cache
def designs():
    """Fields of configurations of recordings; tests/cosim has images and the largest array."""
    return [wish for wish in together(wishes()) if wish.get("cell") != "image" and len(wish) > 1]


@pytest.mark.parametrize("part", range(PARTS))
def test_every_bin_of_a_configuration_is_exact(part, tmp_path):
    for number, wish in [*enumerate(designs(), 1)][part::PARTS]:
        model = random_integer_model(build(wish), number)
        config = model.config
        if config.network.cell in ("lstm", "linear") or config.network.decision == "vote":  # two classes tie
            of_class = {"V", "b_y", "prototypes", "taught", "taught_count"} & {*model.arrays}
            second = min(2, config.classes - 1)
            places = [*range(second), second - 1, *range(second + 1, config.classes)]
            axes = {"V": -2}
            alike = {name: model.arrays[name].take(places, axes.get(name, 0)) for name in of_class}
            if config.network.early_steps > 1:  # every step has one class
                alike["b_y"][0] = config.formats.dense_bias_format.max_code
            model = replace(model, arrays=model.arrays | alike)
        rest, rearm = config.rest_level.rest_frames, config.onset_rule.rearm_frames
        touch = rest + config.last_frame + 2 * config.windows.hop
        lengths = [2 * (touch + rearm), rest + 3, max(rest - 1, 1), rest + 2]
        if number % 3 == 1:  # the end of a recording cuts a touch
            lengths += [touch // 2, touch * 2 // 3, rest + 5, touch]
        if config.follows_touch:  # the end of a recording is near the onset
            lengths += [rest + frames for frames in range(4, 9)]
        pace = wish.get("pace", ("full", "stalls")[number % 2])
        size = touch * config.inputs * config.sensor.scan_every * config.network.hidden
        if size > 4000 or pace == "declared":  # what takes long
            lengths = [touch + rearm, rest + 2]
        data, _ = decided_recordings(model, lengths)
        period = lowest_clock_hz(config) / config.sensor.sample_rate_hz * (pace == "declared")
        expected = dict(np.load(cosim.expected_of(model, data, tmp_path / "vectors.npz")))
        ends = np.minimum(expected["open"][:, 1], np.diff(expected["offsets"]))
        spans = (ends - expected["open"][:, 0]) * (expected["touches"] > 0)
        begun = data.recording(int(np.argmax(spans)))
        # a touch of one step is soon over
        begun = begun[: len(begun) * bool(max(spans) > 2 and config.windows.steps > 1)]
        stalls = dict(stall=0.3 * (pace == "stalls"), reader=0.3 * (pace == "full" and number % 4 == 1))
        streams, statuses = play(model, data, **stalls, frame_cycles=period, begun=begun)
        assert len(expected["decision"]), wish
        for stage in (*STAGES, "decision"):
            assert streams[stage] == expected[stage].tolist(), (stage, wish)
        flags = int(np.bitwise_or.reduce([status[1] for status in statuses]))
        played = dict(bit_exact=True, pace=pace, stalls=pace == "stalls", probe=None)
        observe(
            SimpleNamespace(config=config, expected=expected),
            SimpleNamespace(**played, registers={"FAULTS": flags}),
        )
        if len(begun):
            note("commands", "ARM", "touch", config.windows.window_mode)
        note("register access", "busy", "write")
