"""Content of an archive before any training: figures, the onset of each recording, a picture; of images
each class's mean."""

from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from eskin.data.folds import likely_groups, no_group
from eskin.data.rate import wrong_rate
from eskin.golden.core import InputError, Record, replacing
from eskin.golden.data import Recordings
from eskin.golden.model import images_of
from eskin.pages.charts import STYLE
from eskin.training.derive import derive_config, find_onsets

HELD_SHARE, HELD_SPAN = 0.05, 16
"""Share of a taxel's samples at an end of its range from which it is called saturated, and steps (the least difference of
its codes) that the range must have: a quiet sensor of few codes is at its ends all the time."""
LISTED, PICTURED = 10, 6
"""Highest numbers of recordings that are listed, and drawn."""
CLASSES_SHOWN = 32
"""Classes of images that the picture has room for."""


def inspect(recordings: Recordings) -> Record:
    """Plain figures about ``recordings``, or images, ready for JSON.

    Onsets are by the derived configuration. Recordings that give none (two taxels, say) are described without
    onsets, and ``configuration.reasons`` says why.

    Returns
    -------
    dict with source, recordings, sample_min, sample_max, classes (name -> recordings), groups (name -> number
    of values), values (arrays of one value a recording that are no groups: ``no_group``).

    Of recordings also frames, taxels, sample_rate_hz, sample_format, volt_per_code, unit, lengths (min,
    median, max; frames), taxel (list of min, max, deviation (codes), held (``held_shares``), state: ok,
    constant, saturated), configuration (name, onset rule, reasons), onset_frames (one a recording: 1-based, 0
    open at once, -1 none; or None).

    Of images also image_height, image_width, zeros (share of pixels that are 0), copies (images that are
    equal to an earlier one), reasons (what the loader chose).
    """
    values = {name: len(np.unique(array)) for name, array in recordings.groups.items()}
    why_none = {name: no_group(array, recordings.labels) for name, array in recordings.groups.items()}
    common = {
        "source": recordings.source,
        "recordings": len(recordings),
        "sample_min": int(recordings.samples.min()),
        "sample_max": int(recordings.samples.max()),
        "classes": {
            name: int(count)
            for name, count in zip(recordings.class_names, recordings.class_counts, strict=True)
        },
        "groups": {name: count for name, count in values.items() if not why_none[name]},
        "values": [name for name in values if why_none[name]],
    }
    return common | (_of_images(recordings) if recordings.image_shape else _of_recordings(recordings))


def _of_images(recordings: Recordings) -> Record:
    images = images_of(recordings)
    count, height, width = images.shape
    return {
        "image_height": height,
        "image_width": width,
        "zeros": float(np.mean(images == 0)),
        "copies": count - len(np.unique(images.reshape(count, -1), axis=0)),
        "reasons": list(recordings.notes),
    }


def _of_recordings(recordings: Recordings) -> Record:
    config, onsets = None, None
    try:
        config, reasons = derive_config(recordings)
    except InputError as error:
        reasons = [str(error)]
    if config is not None:
        onsets = [config.sensor.source_frame(frame) for frame in find_onsets(config, recordings).tolist()]
    lengths, samples = recordings.lengths, recordings.samples
    each = (samples.min(axis=0), samples.max(axis=0), samples.std(axis=0), held_shares(recordings))
    part = samples[:: 1 + len(samples) // 100_000]
    steps = [np.diff(np.unique(column)).min(initial=1 << 16) for column in part.T]
    taxels = zip(*(figures.tolist() for figures in each), steps, strict=True)
    return {
        "frames": recordings.frames,
        "taxels": recordings.taxels,
        "sample_rate_hz": recordings.sample_rate_hz,
        "sample_format": str(recordings.sample_format),
        "volt_per_code": recordings.volt_per_code,
        "unit": recordings.unit,
        "lengths": {
            "min": int(lengths.min()),
            "median": float(np.median(lengths)),
            "max": int(lengths.max()),
        },
        "taxel": [
            {
                "min": low,
                "max": high,
                "deviation": deviation,
                "held": held,
                "state": _state(high - low, held, step),
            }
            for low, high, deviation, held, step in taxels
        ],
        "configuration": {
            "name": config.name if config else None,
            "onset": config.onset_rule.onset if config else None,
            "reasons": reasons,
        },
        "rate_doubts": wrong_rate(recordings),
        "onset_frames": onsets,
    }


def held_shares(recordings: Recordings) -> np.ndarray:
    """(taxels) share of each taxel's samples at its smallest or largest code, which is what an amplifier or
    converter at its end looks like; an end at which a taxel rests (its median) does not count."""
    samples = recordings.samples
    rest, shares = np.median(samples, axis=0), np.zeros(samples.shape[1])
    for end in (samples.min(axis=0), samples.max(axis=0)):
        shares += np.where(rest == end, 0.0, (samples == end).mean(axis=0))
    return shares


def _state(span: int, held: float, step: float) -> str:
    if span == 0:
        return "constant"
    return "saturated" if span >= HELD_SPAN * step and held >= HELD_SHARE else "ok"


def in_rows(recordings: Recordings, figures: Record, data: str) -> Record:
    """Rows of the terminal beside the figures: class_rows, onset_rows (number, class, onset, frames;
    few of many), and as advice saturated (taxels), lost, few (classes), group."""
    onsets, names, labels = figures["onset_frames"], recordings.class_names, recordings.labels
    class_rows = []
    for label, (name, count) in enumerate(figures["classes"].items()):
        frames = [] if onsets is None else np.array(onsets)[labels == label].tolist()
        seen = sorted(frame for frame in frames if frame >= 0)
        row = {"name": name, "recordings": count, "lost": None if onsets is None else len(frames) - len(seen)}
        row["span"] = [seen[0], seen[len(seen) // 2], seen[-1]] if seen else []
        class_rows.append(row)
    order = sorted(range(len(onsets)), key=onsets.__getitem__) if onsets and any(onsets) else []
    return {
        "class_rows": class_rows,
        "onset_rows": [
            (index, names[labels[index]], onsets[index], recordings.lengths[index])
            for index in order[:LISTED]
        ],
        "saturated": [taxel for taxel, row in enumerate(figures["taxel"]) if row["state"] == "saturated"],
        "lost": sum(frame < 0 for frame in onsets or ()),
        "few": [name for name, count in figures["classes"].items() if count < 5],
        "group": next(iter(likely_groups(recordings)), None),
        "data": data,
        "stem": Path(data).stem or "run",
    }


def draw(recordings: Recordings, onset_frames: list[int] | None, path: str | Path) -> None:
    """A PNG of PICTURED recordings, spread over the classes: a heat map of every taxel from its level in the first
    frames, over time; the onset marked. Of images the mean of each class.

    Raises
    ------
    OSError
        The file cannot be written; nothing is left behind.
    """
    with rc_context(STYLE), replacing(path) as temporary:
        images = recordings.image_shape
        figure = _image_picture(recordings) if images else _picture(recordings, onset_frames)
        figure.savefig(temporary, format="png", dpi=90)


def _image_picture(recordings: Recordings) -> Figure:
    images, shown = images_of(recordings), recordings.class_names[:CLASSES_SHOWN]
    across = min(len(shown), 8)
    rows = -(-len(shown) // across)
    figure = Figure(figsize=(2.6 * across, 1.9 * rows), layout="constrained")
    axes = figure.subplots(rows, across, squeeze=False)
    for place in axes.flat:
        place.axis("off")
    for label, (name, place) in enumerate(zip(shown, axes.flat, strict=False)):
        members = images[recordings.labels == label]
        place.set_title(name if len(members) else f"{name}: no image")
        if len(members):
            place.imshow(members.mean(axis=0), cmap="viridis", vmin=0)
    return figure


def _picture(recordings: Recordings, onset_frames: list[int] | None) -> Figure:
    chosen = recordings.evenly(PICTURED)
    unit = recordings.volt_per_code
    from_rest = f"{recordings.unit or 'unit of the samples'} from rest" if unit else "codes from rest"
    figure = Figure(figsize=(11, 2.1 * len(chosen) + 0.8), layout="constrained")
    for axes, index in zip(figure.subplots(len(chosen), 1, squeeze=False)[:, 0], chosen, strict=True):
        samples = recordings.recording(index)
        level = np.median(samples[: max(1, min(64, len(samples) // 8))], axis=0)
        values = (samples - level) * np.array(unit or 1)
        bound = float(np.quantile(np.abs(values), 0.999)) or 1.0
        extent = (0, len(samples) / recordings.sample_rate_hz, recordings.taxels - 0.5, -0.5)
        image = axes.imshow(values.T, aspect="auto", cmap="RdBu_r", vmin=-bound, vmax=bound, extent=extent)
        figure.colorbar(image, ax=axes, pad=0.01).set_label(from_rest)
        title = f"recording {index}: {recordings.class_names[recordings.labels[index]]}"
        onset = onset_frames[index] if onset_frames is not None else None
        if onset is not None and onset > 0:
            axes.axvline((onset - 1) / recordings.sample_rate_hz, color="black", linestyle="--", linewidth=1)
            title += f", onset at frame {onset} (dashed)"
        elif onset is not None:
            title += ", gate open at once" if onset == 0 else ", no onset found"
        axes.set_title(title)
        axes.set_ylabel("taxel")
    axes.set_xlabel("time (s)")
    of_all = f"{recordings.source}: {len(recordings)} recordings, {recordings.sample_rate_hz:g} Hz"
    figure.suptitle(of_all)
    return figure
