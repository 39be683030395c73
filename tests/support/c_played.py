"""The exported C on recordings: models of every kind on a front end, compiled for this computer, each call compared
with the golden model."""

import ctypes
import math
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np

from eskin.exchange import plain_c
from eskin.golden.core import FEATURE_KINDS, PRESETS, AcceleratorConfig, QFormat, Record
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel, find_touches, images_of, run, run_images
from eskin.training.derive import derive_config, for_recordings
from eskin.verbs.export import export_c
from tests.support.random_models import random_integer_model

WIDE = {"state_format": QFormat(4, 12)}
MODELS: dict[str, Record] = {
    "linear, all kinds": {
        "cell": "linear", "decision": "last", "feature_kinds": FEATURE_KINDS,
        "activity_rule": "change", "feature_scale": "taxel",
    },
    "GRU, reset before": {"cell": "gru"},
    "GRU, reset after": {"cell": "gru", "reset": "after", "feature_kinds": ("mean", "activity"), **WIDE},
    "LSTM": {"cell": "lstm", "decision": "vote", **WIDE},
    "GRU, early": {"cell": "gru", "decision": "early", "early_steps": 2, "early_margin": 64},
    "GRU, taxels fail": {"cell": "gru", "fault_frames": 8},
}  # fmt: skip
"""Kinds of model: cells, decisions, kinds of feature. With ``fault_frames`` a taxel of each recording
fails."""
PLAY = """#include "eskin_model.c"
int play(const int32_t *codes, int frames, int32_t *calls)
{
    static eskin_state s;
    eskin_decision d = { 0, 0, 0, 0 };
    int t, said, n = 0;
    eskin_arm(&s);
    for (t = 0; t <= frames; t++) {
        said = t < frames ? eskin_frame(&s, codes + t * ESKIN_TAXELS, &d) : eskin_finish(&s, &d);
        if (said) {
            int32_t *c = calls + 6 * n++;
            c[0] = t < frames ? t + 1 : 0; c[1] = said;
            c[2] = d.cls; c[3] = d.margin; c[4] = d.step; c[5] = d.local_cls;
        }
    }
    return n;
}
"""
PLAY_IMAGE = """#include "eskin_model.c"
int play(const uint8_t *pixels, int32_t *c)
{
    eskin_decision d;
    c[0] = 0; c[1] = eskin_image(pixels, &d);
    c[2] = d.cls; c[3] = d.margin; c[4] = d.step; c[5] = d.local_cls;
    return 1;
}
"""


def front_end(name: str, recordings: Recordings) -> AcceleratorConfig:
    """Of the preset of that name and array, or derived."""
    preset = PRESETS.get(name)
    if preset and preset.sensor.taxels == recordings.taxels:
        return for_recordings(preset, recordings)
    return derive_config(recordings)[0]


def model_of(config: AcceleratorConfig, kind: str) -> IntegerModel:
    """A model of one of MODELS on a front end."""
    hop = math.gcd(config.windows.hop, *config.window_lengths)
    block = max(block for block in range(1, 9) if hop % block == 0)
    fields = {"feature_shift": (), "activity_block": block} | MODELS[kind]
    if "fault_frames" in fields and not config.opens_at_once:
        # windows that end before the onset, so that their frames are replayed when flags are older or younger
        short = max(config.windows.hop // 8, 4)
        windows = {"hop": short, "window": 2 * short, "pretrigger_frames": 5 * short, "window_mode": "touch"}
        fields |= windows | {"touch_frames": (config.windows.steps + 1) * short, "activity_block": 1}
    return random_integer_model(config.replace(**fields), 1)


def with_failing_taxels(config: AcceleratorConfig, recordings: Recordings) -> Recordings:
    """The recordings with a taxel in each that holds one code from some frame on: before the frames that the
    last onset replays, among them, or in the touch."""
    samples, touches = recordings.samples.copy(), find_touches(config, recordings)
    onsets = dict(zip(touches.recording.tolist(), touches.onset_frame.tolist(), strict=True))
    windows, count = config.windows, len(recordings)
    span = 2 * config.faults.fault_frames + windows.pretrigger_frames + windows.window
    for number, (first, end) in enumerate(zip(recordings.offsets, recordings.offsets[1:], strict=False)):
        frames, taxel = samples[first:end], number % config.sensor.taxels
        fails = onsets.get(number, len(frames) // 2) + windows.window - number * span // count
        fails = min(max(fails, 0), len(frames) - 1)
        frames[fails:, taxel] = frames[fails, taxel]
    return replace(recordings, samples=samples)


def differences(model: IntegerModel, recordings: Recordings, folder: Path) -> dict[str, int]:
    """Export, compile for this computer, play everything: recordings, decisions compared, different ones."""
    image = model.config.is_image
    if model.config.faults.fault_frames:
        recordings = with_failing_taxels(model.config, recordings)
    export_c(model, folder, recordings=recordings.subset(recordings.evenly(2)))
    library = folder.absolute() / "play.so"
    (folder / "play.c").write_text(PLAY_IMAGE if image else PLAY)
    subprocess.run(
        ["gcc", "-std=c99", "-O2", "-shared", "-fPIC", "play.c", "-o", str(library)], cwd=folder, check=True
    )
    play = ctypes.CDLL(str(library)).play
    if image:
        pixels = images_of(recordings)
        expected = plain_c.expected_of_images(run_images(model, pixels, maps=False))
    else:
        expected = plain_c.expected(run(model, recordings), recordings)
    compared = different = 0
    for number, calls in enumerate(expected):
        samples = pixels[number] if image else recordings.recording(number).astype(np.int32)
        samples = np.ascontiguousarray(samples)
        answers = np.zeros((len(samples) + 1, 6), dtype=np.int32)
        pointer = samples.ctypes.data_as(ctypes.c_void_p)
        into = answers.ctypes.data_as(ctypes.c_void_p)
        count = play(pointer, into) if image else play(pointer, len(samples), into)
        made, due = set(map(tuple, answers[:count].tolist())), set(calls)
        compared += len(due | made)
        different += len(due ^ made)
    return {"recordings": len(recordings), "decisions": compared, "different": different}
