"""Images row by row: the integer network's decision with the last row, as the hardware gives it
(docs/specification.md, section 15)."""

from typing import Any

import numpy as np

from eskin.golden.core import AcceleratorConfig, InputError
from eskin.golden.model.image_network import run_images
from eskin.golden.model.model import IntegerModel
from eskin.golden.model.stream import Decision


class ImageStream:
    """`eskin.golden.model.stream.Stream` of a network for images: the first ``height`` frames after ``arm``
    are an image, a row each; later frames have no effect.

    The local decision's stages are ``map`` (the values of all maps that are kept, one map after the other)
    and ``logit`` (C).
    """

    def __init__(self, model: IntegerModel) -> None:
        self.model = model
        self.arm()

    @property
    def config(self) -> AcceleratorConfig:
        """The model's configuration."""
        return self.model.config

    def arm(self) -> None:
        """Begin a new image."""
        self._image = np.zeros((self.config.image.height, self.config.image.width), dtype=np.uint8)
        self.frame = 0
        """Rows taken since ``arm``."""
        self.decision = -1
        """Class of the image, -1 while it is not whole."""

    @property
    def touches(self) -> int:
        """1 from the first row on."""
        return int(self.frame > 0)

    @property
    def onset_frame(self) -> int | None:
        """0 while rows arrive, as an image starts at once; None before and after."""
        return 0 if 0 < self.frame < self.config.image.height else None

    @property
    def start_frame(self) -> int | None:
        """1 while rows come."""
        return None if self.onset_frame is None else 1

    def push(self, frames: Any) -> list[Decision]:
        """Take rows (n, width) of pixels 0..255; the decisions, the local one and then the global one, with
        the image's last row.

        Raises
        ------
        InputError
            Rows of another width, or no whole numbers from 0 to 255.
        """
        rows, height, width = np.atleast_2d(frames), *self._image.shape
        if rows.ndim != 2 or rows.shape[1] != width:
            raise InputError(
                f"frames: have shape {np.shape(frames)}; the model takes ({width},) for one row, (rows, "
                f"{width}) for many"
            )
        if rows.dtype.kind not in "iu" or (len(rows) and (rows.min() < 0 or rows.max() > 255)):
            raise InputError("frames: hold values that are no pixels; give whole numbers from 0 to 255")
        missing = height - self.frame
        part = rows[: max(0, missing)]
        self._image[self.frame : self.frame + len(part)] = part
        self.frame += len(rows)
        return self._decided() if 0 < missing <= len(rows) else []

    def finish(self) -> list[Decision]:
        """The end: an image that is not whole has no decision."""
        return []

    def _decided(self) -> list[Decision]:
        trace = run_images(self.model, self._image[None])
        streams = trace.streams
        maps = [values for name, (values, _) in streams.items() if name.startswith("map_")]
        stages = {"map": np.concatenate([np.zeros(0, dtype=np.int64), *maps]), "logit": streams["logit"][0]}
        self.decision = int(trace.decision[0])
        local, whole = streams["decision"][0].tolist()
        return [
            Decision(
                self.config.image.height,
                0,
                step,
                bool(is_global),
                label,
                margin,
                bool(partial),
                bool(unsure),
                stages={} if is_global else stages,
            )
            for is_global, step, label, margin, partial, unsure in (local, whole)
        ]
