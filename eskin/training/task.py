"""The two tasks, touches in recordings and images, with one interface for evaluation: a float network and its
integers on the same data.

Steps and stages differ: a touch has several steps, and its stages are those of
`eskin.training.stage_error.STAGES`; an image is one step, and its stages are its layers with weights.
"""

from functools import cached_property
from pathlib import Path

import numpy as np

from eskin.data.fit import check_fit
from eskin.golden.core import Record
from eskin.golden.core.images import PIXEL_FORMAT
from eskin.golden.data import Recordings
from eskin.golden.model import (
    FloatModel,
    IntegerModel,
    find_touches,
    float_images,
    images_of,
    layer_formats,
    run,
    run_images,
)
from eskin.golden.model.image_network import layer_by_layer
from eskin.training.stage_error import figures_of, stage_errors

LOOKED_AT = 200
"""Images on which errors are taken layer by layer."""


class TouchTask:
    """A network for recordings.

    ideal, trace: results of the float and of the integer network on the recordings, with the same prototypes
    if prototypes decide.
    """

    def __init__(self, real: FloatModel, integer: IntegerModel, recordings: Recordings) -> None:
        self._real, self._integer = real, integer
        self._touches = find_touches(integer.config, recordings)
        self.ideal = run(real, recordings, touches=self._touches, readout=integer)
        self.trace = run(integer, recordings, touches=self._touches)

    @property
    def done(self) -> np.ndarray:
        """(touches, steps), bool: the steps that were completed."""
        return self.trace.local >= 0

    @property
    def local_agreement(self) -> float | None:
        """Share of completed steps with the same class; None without one."""
        same = (self.trace.local == self.ideal.local)[self.done]
        return float(np.mean(same)) if len(same) else None

    def stages(self) -> list[Record]:
        """The error of each stage."""
        return stage_errors(self._real, self._integer, self._touches)


class ImageTask:
    """A network for images, as `TouchTask`. Errors are measured on at most LOOKED_AT images, spread evenly
    over the classes."""

    local_agreement = None

    def __init__(self, real: FloatModel, integer: IntegerModel, recordings: Recordings) -> None:
        images = images_of(recordings)
        self._real, self._integer, self._some = real, integer, images[recordings.evenly(LOOKED_AT)]
        self.ideal = float_images(real, images, maps=False)
        self.trace = run_images(integer, images, maps=False)
        self.done = np.ones(len(images), dtype=bool)

    @cached_property
    def _maps(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """(real values, codes) of the outputs of each layer with weights."""
        ideal, trace = float_images(self._real, self._some), run_images(self._integer, self._some)
        stages = self._integer.config.weighted_stages
        return [(ideal.maps[s.number], trace.maps[s.number]) for s in stages[:-1]] + [
            (ideal.logits, trace.logits)
        ]

    def stages(self) -> list[Record]:
        """The error of each layer with weights."""
        errors = []
        for index, (stage, *_, fmt) in enumerate(layer_formats(self._integer.config)):
            real, codes = self._maps[index]
            error, alone = np.abs(fmt.to_real(codes) - real), np.abs(self._alone(index) - self._maps[-1][0])
            at_end = (codes >= fmt.max_code) | (fmt.signed & (codes <= fmt.min_code))
            largest = np.abs(codes.astype(np.int64)).max() / fmt.max_code
            errors.append(figures_of(f"{stage.number} {stage.layer}", error, at_end.mean(), largest, alone))
        return errors

    def _alone(self, index: int) -> np.ndarray:
        """Logits of the float network in which one layer has the weights, bias and output format of the
        integer network."""
        config, integer = self._integer.config, self._integer.arrays
        layers = layer_formats(config)
        stage, weight, before, after = layers[index]
        arrays = dict(self._real.arrays) | {
            f"W_{stage.number}": weight.to_real(integer[f"W_{stage.number}"]),
            f"b_{stage.number}": integer[f"b_{stage.number}"] / 2.0 ** (weight.frac_bits + before.frac_bits),
        }

        def behind(number: int, sums: np.ndarray) -> np.ndarray:
            if number == index:
                return after.to_real(after.quantise(sums, rounding="RND"))
            return sums if number == len(layers) - 1 else np.maximum(sums, 0.0)

        *_, logits = layer_by_layer(config, arrays, PIXEL_FORMAT.to_real(self._some)[..., None], behind)
        return logits.reshape(len(self._some), -1)


def load_task(model_dir: str | Path, recordings: Recordings) -> TouchTask | ImageTask:
    """Both networks of a model folder on recordings, or images.

    Raises
    ------
    InputError
        When the folder is not a quantised model folder, or the recordings are of another array or task.
    """
    integer, real = IntegerModel.load(model_dir, images=True), FloatModel.load(model_dir, images=True)
    check_fit(recordings, integer.config)
    return (ImageTask if integer.config.is_image else TouchTask)(real, integer, recordings)
