"""What an archive of images holds: figures, and a picture of each class's mean."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from eskin.golden.core.files import replacing
from eskin.golden.core.images import NETWORKS, network, stages_of
from eskin.golden.data.recordings import Recordings
from eskin.golden.model.image_network import images_of

SHOWN = 32
"""Classes that the picture has room for."""


def inspect_images(recordings: Recordings) -> dict[str, Any]:
    """Plain figures about an archive of images, ready for JSON.

    Returns
    -------
    dict with source, recordings, image_height, image_width, sample_min, sample_max, zeros (share of pixels that are 0), classes (name ->
    images), groups (name -> number of values), copies (images that are equal to an earlier one), silent_rows, silent_columns (those that
    are the same in every pixel of every image), networks (name -> multiplies an image), reasons (what the loader chose).
    """
    images = images_of(recordings)
    count, height, width = images.shape
    classes = {name: int(number) for name, number in zip(recordings.class_names, recordings.class_counts, strict=True)}
    multiplies = {}
    for name in NETWORKS:
        stages = stages_of(height, width, network(name, len(classes)))
        multiplies[name] = sum(stage.multiplies for stage in stages)
    return {
        "source": recordings.source,
        "recordings": count,
        "image_height": height,
        "image_width": width,
        "sample_min": int(images.min()),
        "sample_max": int(images.max()),
        "zeros": float(np.mean(images == 0)),
        "classes": classes,
        "groups": {name: len(np.unique(values)) for name, values in recordings.groups.items()},
        "copies": count - len(np.unique(images.reshape(count, -1), axis=0)),
        "silent_rows": np.flatnonzero(np.ptp(images, axis=(0, 2)) == 0).tolist(),
        "silent_columns": np.flatnonzero(np.ptp(images, axis=(0, 1)) == 0).tolist(),
        "networks": multiplies,
        "reasons": list(recordings.notes),
    }


def draw_images(recordings: Recordings, path: Path) -> None:
    """A picture of the mean image of each class, and of one image of each."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    images, shown = images_of(recordings), recordings.class_names[:SHOWN]
    across = min(len(shown), 4)
    rows = -(-len(shown) // across)
    figure, axes = pyplot.subplots(rows, 2 * across, figsize=(2.6 * 2 * across, 1.9 * rows), squeeze=False)
    for place in axes.flat:
        place.axis("off")
    for label, name in enumerate(shown):
        members = images[recordings.labels == label]
        left, right = axes[label // across][2 * (label % across) : 2 * (label % across) + 2]
        if not len(members):
            left.set_title(f"{name}: no image", fontsize=9)
            continue
        for place, picture, said in ((left, members.mean(axis=0), f"{name}: mean"), (right, members[0], "first image")):
            place.imshow(picture, cmap="viridis", vmin=0)
            place.set_title(said, fontsize=9)
    figure.tight_layout()
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=90, format="png")
    pyplot.close(figure)
