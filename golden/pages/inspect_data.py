"""What an archive holds, before anything is trained on it: figures, the onset of each recording, a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.golden.core.files import replacing
from eskin.golden.data.recordings import Recordings
from eskin.golden.model.preprocess import find_onsets
from eskin.golden.training.derive import derive_config

EXTREME_SHARE = 0.05
"""Share of a taxel's samples at its own largest or smallest code from which it is called saturated."""

EXTREME_SPAN = 16
"""Codes a taxel must span for that: a quiet sensor of few codes is at its extremes all the time."""


def inspect(recordings: Recordings, config: AcceleratorConfig | None = None) -> dict[str, Any]:
    """Plain figures about ``recordings``, ready for JSON.

    Parameters
    ----------
    config:
        Whose onset rule is applied; None: the derived configuration. Recordings that give none (two taxels, say) are described without
        onsets, and ``configuration.reasons`` says why.

    Returns
    -------
    dict with source, recordings, frames, taxels, sample_rate_hz, sample_format, volt_per_code, sample_min, sample_max, classes (name ->
    recordings), lengths (min, median, max; frames), groups (name -> number of values), taxel (list of min, max, deviation (codes), state:
    ok, constant, saturated), configuration (name, onset rule, reasons), onset_frames (one a recording: 1-based, 0 open at once, -1 none; or
    None).
    """
    reasons: list[str] = []
    if config is None:
        try:
            config, reasons = derive_config(recordings)
        except InputError as error:
            reasons = [str(error)]
    onsets = None if config is None else find_onsets(config, recordings)
    lengths, samples = recordings.lengths, recordings.samples
    low, high = samples.min(axis=0), samples.max(axis=0)
    at_extreme = np.maximum((samples == low).mean(axis=0), (samples == high).mean(axis=0))
    deviation = samples.std(axis=0)
    return {
        "source": recordings.source,
        "recordings": len(recordings),
        "frames": recordings.frames,
        "taxels": recordings.taxels,
        "sample_rate_hz": recordings.sample_rate_hz,
        "sample_format": str(recordings.sample_format),
        "volt_per_code": recordings.volt_per_code,
        "sample_min": int(low.min()),
        "sample_max": int(high.max()),
        "classes": {name: int(count) for name, count in zip(recordings.class_names, recordings.class_counts, strict=True)},
        "lengths": {"min": int(lengths.min()), "median": float(np.median(lengths)), "max": int(lengths.max())},
        "groups": {name: len(np.unique(values)) for name, values in recordings.groups.items()},
        "taxel": [
            {
                "min": int(low[t]),
                "max": int(high[t]),
                "deviation": float(deviation[t]),
                "state": _state(int(high[t]) - int(low[t]), float(at_extreme[t])),
            }
            for t in range(recordings.taxels)
        ],
        "configuration": {
            "name": config.name if config else None,
            "onset": config.onset_rule.onset if config else None,
            "reasons": reasons,
        },
        "onset_frames": None if onsets is None else [int(frame) for frame in onsets],
    }


def _state(span: int, at_extreme: float) -> str:
    if span == 0:
        return "constant"
    return "saturated" if span >= EXTREME_SPAN and at_extreme >= EXTREME_SHARE else "ok"


def draw(recordings: Recordings, onset_frames: list[int] | None, path: str | Path, count: int = 6) -> None:
    """A PNG of ``count`` recordings, spread over the classes: every taxel from its level in the first frames, the onset marked.

    Raises
    ------
    OSError
        The file cannot be written; nothing is left behind.
    """
    from matplotlib.figure import Figure  # slow to import, and only a picture needs it

    chosen = recordings.evenly(count)
    volts = recordings.volt_per_code
    figure = Figure(figsize=(11, 2.1 * len(chosen) + 0.8), layout="constrained")
    for row, (axes, index) in enumerate(zip(figure.subplots(len(chosen), 1, squeeze=False)[:, 0], chosen, strict=True)):
        samples = recordings.recording(index)
        level = np.median(samples[: max(1, min(64, len(samples) // 8))], axis=0)
        time_s = np.arange(len(samples)) / recordings.sample_rate_hz
        axes.plot(time_s, (samples - level) * (1000 * volts if volts else 1), linewidth=0.6)
        title = f"recording {index}: {recordings.class_names[recordings.labels[index]]}"
        onset = onset_frames[index] if onset_frames is not None else None
        if onset is not None and onset > 0:
            axes.axvline((onset - 1) / recordings.sample_rate_hz, color="black", linestyle="--", linewidth=1)
            title += f", onset at frame {onset} (dashed)"
        elif onset is not None:
            title += ", gate open at once" if onset == 0 else ", no onset found"
        axes.set_title(title, fontsize=9, loc="left", parse_math=False)
        axes.set_ylabel("mV from rest" if volts else "codes from rest", fontsize=8)
        axes.margins(x=0)
        if row == len(chosen) - 1:
            axes.set_xlabel(f"time (s); one line a taxel, {recordings.taxels} taxels")
    figure.suptitle(f"{recordings.source}: {len(recordings)} recordings, {recordings.sample_rate_hz:g} Hz", fontsize=10, parse_math=False)
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png", dpi=90)
