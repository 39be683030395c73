"""Networks for images side by side: layers, bits of a weight; accuracy against latency, energy
and memory.

A *point* is a network with its bits and its lanes. One training of a fold serves all
bits and lanes: weights of 8 bits are rounded after it, those of 4 bits are trained on
(`eskin.training.train_images.judge`). Networks that `eskin train` trained on the same images, folds and recipe
are reused.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eskin.golden.core import NETWORKS, AcceleratorConfig, InputError, Pool, QFormat, Record
from eskin.golden.core.images import BIAS_BITS, parse_layer
from eskin.golden.data import Recordings
from eskin.golden.model import images_of
from eskin.jobs import Jobs
from eskin.memo import Memo
from eskin.study.sweep import expand, lanes_name, split_figures
from eskin.training.image_models import fold_jobs, image_config, judged_pieces, split_of
from eskin.training.train_images import ImageRecipe, judge, size_of

FIELDS = ("layers", "weight_bits", "lanes", "clock_hz")
"""Fields that a grid may vary."""

CLOCK_HZ = 36e6
"""Clock without a wish: what `eskin build` reaches with TactNet4 on 8 lanes of an iCE40UP5K, and some
reserve."""

LANES = 8
COSTS = ("latency_s", "energy_j", "memory_bytes", "multiplies_decision")
"""Keys of a record that accuracy is set against."""

NARROW = {
    "three 3x3, 4/8/16": ("conv 3 4", "pool", "conv 3 8", "pool", "conv 3 16", "pool"),
    "four, 4/4/8/16": ("conv 3 4", "pool", "conv 3 4", "pool", "conv 3 8", "pool", "conv 3 16", "pool"),
}
"""Networks of the default grid that have no name among `eskin.golden.core.images.NETWORKS`."""


DEFAULT_GRID: list[Record] = [
    {
        "layers": ["tactnet", "four", "four-lean", "tactnet-half", *map(list, NARROW.values())],
        "weight_bits": [8, 4],
    }
]


# ---------------------------------------------------------------------- points
@dataclass(frozen=True)
class ImagePoint:
    """One network on one set of lanes.

    network: its layers in words. trained: the configuration as `eskin train` has it, whose cross-validation
    this is. config: on its lanes, with formats of the right widths, so that cycles can be counted.
    """

    network: str
    trained: AcceleratorConfig
    config: AcceleratorConfig

    @property
    def size(self) -> str:
        """``28x50``."""
        return size_of(self.config)

    @property
    def recommended(self) -> AcceleratorConfig:
        """Options of `eskin train` that make it."""
        hardware = self.config.hardware
        return self.trained.replace(clock_hz=hardware.clock_hz).with_lanes(hardware.lanes, "plain")

    @property
    def widths(self) -> dict[str, int]:
        """Requested widths, as of an `eskin.study.sweep.Point`."""
        return {"weight_bits": self.config.weight_bits}

    @property
    def aware(self) -> bool:
        """Weights of 4 bits are trained on."""
        return self.config.weight_bits < 8

    @property
    def name(self) -> str:
        """The point in a few words."""
        end = ", trained on" if self.aware else ""
        return f"{self.network} {self.size}, {self.config.weight_bits} bit{end}, {lanes_name(self.to_dict())}"

    def to_dict(self) -> Record:
        """The point in the words of sweep.json."""
        hardware = self.config.hardware
        return {
            "network": self.network,
            "size": self.size,
            "layers": list(self.config.image.layers),
            "weight_bits": self.config.weight_bits,
            "quantisation_aware": self.aware,
            "lanes": hardware.lanes,
            "lane_type": hardware.lane_type,
            "clock_hz": hardware.clock_hz,
        }

    def cost(self) -> dict[str, int]:
        """Parameters, multiplies of an image, bits of all weights; memory_bytes: weights, biases, and the
        largest map before and behind a layer, which stand in memory together."""
        config = self.config
        weights = sum(stage.weights for stage in config.weighted_stages) * config.weight_bits
        biases = sum(stage.outputs for stage in config.weighted_stages) * BIAS_BITS
        return {
            "parameters": config.parameter_count,
            "multiplies_step": config.multiplies,
            "multiplies_decision": config.multiplies,
            "weight_memory_bits": weights,
            "memory_bytes": -(-(weights + biases) // 8) + sum(map_values(config)),
        }


def map_values(config: AcceleratorConfig) -> tuple[int, int]:
    """Values of the two memories of maps: the image and every second map that is kept, and the others (the
    logits are in none)."""
    stages = config.stages
    maps = [stages[0].source] + [
        stage.result for stage, behind in itertools.pairwise(stages) if not isinstance(behind.layer, Pool)
    ]  # a convolution's map is not kept where a pool follows
    sizes = [int(np.prod(shape)) for shape in maps]
    return max(sizes[0::2]), max(sizes[1::2], default=0)


def make_image_points(
    recordings: Recordings, grids: Sequence[Record], source: str = "grid"
) -> list[ImagePoint]:
    """Every point of the grids, each once, in order.

    grids: field of FIELDS -> value or list of values, all combinations. ``layers`` is a name of NETWORKS or a list
    of layers without the dense one at the end (default: tactnet), and so a list of these to vary it.

    Raises
    ------
    InputError
        An unknown field, or a combination that no network has: before anything is trained.
    """
    defaults = {"layers": "tactnet", "weight_bits": 8, "lanes": LANES, "clock_hz": CLOCK_HZ}
    whole = [defaults | dict(grid) for grid in grids]
    for grid in whole:
        layers = grid["layers"]
        if (
            isinstance(layers, list)
            and layers
            and all(isinstance(layer, str) and layer not in NETWORKS for layer in layers)
        ):
            grid["layers"] = [layers]  # one network, layer by layer
    return expand(whole, source, FIELDS, "a grid for images", lambda fields: _point(recordings, fields))


def _point(recordings: Recordings, values: Record) -> ImagePoint:
    layers, bits, lanes, clock = (values[name] for name in FIELDS)
    if bits not in (4, 8) or isinstance(bits, bool):
        raise InputError(f"field weight_bits: is {bits!r}; give 8 or 4")
    texts = NETWORKS.get(layers, ()) if isinstance(layers, str) else layers
    if not texts or not isinstance(texts, (list, tuple)) or not all(isinstance(text, str) for text in texts):
        raise InputError(
            f"field layers: is {layers!r}; give {', '.join(NETWORKS)}, or a list of layers such as ['conv 3 "
            "8', 'pool']"
        )
    texts = [str(parse_layer(text)) for text in texts]
    names = {stages: name for name, stages in (NETWORKS | NARROW).items()}
    name = names.get(tuple(texts), ", ".join(texts))
    if name in NETWORKS:
        trained = image_config(recordings, name)
    else:
        assert recordings.image_shape is not None
        whole = [*texts, f"dense {len(recordings.class_names)}"]
        # a name of a file, too
        fields: Record = {"name": name.replace("/", "-"), "sample_rate_hz": recordings.sample_rate_hz}
        trained = AcceleratorConfig.of_image(*recordings.image_shape, whole, recordings.class_names, **fields)
    weights = len(trained.weighted_stages)
    formats = {
        "weight_formats": (QFormat(1, bits - 1),) * weights,
        "map_formats": (QFormat(3, 5, signed=False),) * (weights - 1),
        "logit_format": QFormat(8, 8),
    }  # widths count cycles and memories; where the points stand is only known after training
    return ImagePoint(name, trained, trained.replace(**formats, clock_hz=clock).with_lanes(lanes, "plain"))


# ---------------------------------------------------------------------- judging
def judge_image_points(
    recordings: Recordings,
    points: Sequence[ImagePoint],
    group: list[str],
    *,
    seeds: list[int],
    folds: int,
    jobs: Jobs,
    keep: Memo,
) -> tuple[list[Record], Record]:
    """The outcome of each point, in the keys of `eskin.study.sweep.judge`, and what sweep.json
    holds of images alone: judged_images (of a seed), images, classes. ``group``: of the one split; none: random
    folds, new ones for every seed. Stored results are keyed by images and code."""
    tuned = {point.trained for point in points if point.aware}
    recipe = ImageRecipe()
    pieces = {
        config: fold_jobs(recordings, config, group, folds, seeds, recipe, 4 if config in tuned else 0)
        for config in dict.fromkeys(point.trained for point in points)
    }
    images = {points[0].size: images_of(recordings)}
    task = "trained and judged"
    results = judged_pieces(images, recordings.labels, list(pieces.values()), jobs, keep, task, judge)
    judged = dict(zip(pieces, results, strict=True))
    outcomes = []
    for point in points:
        of_point = pieces[point.trained], judged[point.trained], seeds, "tuned" if point.aware else "w8"
        split = split_figures(split_of(recordings, point.trained, group, *of_point))
        split["decision_time_s"] = split["per_step"][0]["time_s"]
        outcomes.append({"splits": [split]})
    judged_images = sum(len(piece.left_out) for piece in next(iter(pieces.values()))[0])
    return outcomes, {"judged_images": judged_images, "images": True, "classes": len(recordings.class_names)}
