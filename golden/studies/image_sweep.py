"""Networks for images side by side: input sizes, layers, bits of a weight; accuracy against latency, energy and memory.

A *point* is a network for images of one size with its bits and its lanes. One training of a fold serves all bits and lanes: weights of 8
bits are rounded after it, those of 4 bits are trained on (`eskin.golden.training.train_images.judge`). Images of other sizes are made of
the archive's by the means of areas. What was trained by `eskin train` on the same images, folds and recipe is not trained again.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.golden.core.formats import QFormat
from eskin.golden.core.images import BIAS_BITS, NETWORKS, SIZES, Conv, Dense, Pool, parse_layer
from eskin.golden.core.jobs import Jobs
from eskin.golden.core.memo import Memo
from eskin.golden.data.pictures import image_size, resized
from eskin.golden.data.recordings import Recordings
from eskin.golden.model.image_network import images_of
from eskin.golden.studies.sweep import NOT_BUILT, Bounds, expand, pareto, recommend, spread_of
from eskin.golden.training.evaluate_images import image_seconds
from eskin.golden.training.image_models import image_config, piece_keys
from eskin.golden.training.splits import split_folds
from eskin.golden.training.train_images import ImageRecipe, Piece, judge

FIELDS = ("size", "layers", "weight_bits", "lanes", "clock_hz")
"""What a grid may vary."""

CLOCK_HZ = 36e6
"""Clock without a wish: what `eskin build` reaches with TactNet4 on 8 lanes of an iCE40UP5K, and some reserve."""

LANES = 8

NARROW: dict[str, list[str]] = {
    "three 3x3, 4/8/16": ["conv 3 4", "pool", "conv 3 8", "pool", "conv 3 16", "pool"],
    "four, 4/4/8/16": ["conv 3 4", "pool", "conv 3 4", "pool", "conv 3 8", "pool", "conv 3 16", "pool"],
}
"""Networks of the default grid that have no name among `eskin.golden.core.images.NETWORKS`."""

FLOORS = (0.85, 0.90, 0.92, 0.94)
"""Shares of images for each of which the smallest network is named."""

COSTS = ("latency_s", "energy_j", "memory_bytes", "multiplies_decision")
"""What accuracy is set against."""


def default_grid(height: int, width: int) -> list[dict[str, Any]]:
    """14 networks with weights of 8 and of 4 bits: TactNet4 at the five sizes it was published for, as shares of ``height`` and ``width``;
    smaller networks at the whole size and at the smallest."""
    sizes = list(dict.fromkeys(f"{_share(height, h, 28)}x{_share(width, w, 50)}" for h, w in SIZES))
    bits = {"weight_bits": [8, 4]}
    return [
        {"size": sizes, "layers": ["tactnet"], **bits},
        {"size": [sizes[0], sizes[-1]], "layers": ["four", "four-lean", "tactnet-half"], **bits},
        {"size": [sizes[0]], "layers": list(NARROW.values()), **bits},
        {"size": [sizes[min(3, len(sizes) - 1)]], "layers": ["four"], **bits},
    ]


def _share(extent: int, part: int, whole: int) -> int:
    return max(round(extent * part / whole), 4)


# ---------------------------------------------------------------------- points
@dataclass(frozen=True)
class ImagePoint:
    """One network on one set of lanes.

    network: its layers in words. trained: the configuration as `eskin train` has it, whose cross-validation this is. config: on its lanes,
    with formats of the right widths, so that cycles can be counted.
    """

    network: str
    trained: AcceleratorConfig
    config: AcceleratorConfig

    @property
    def size(self) -> str:
        """``28x50``."""
        return f"{self.config.image.height}x{self.config.image.width}"

    @property
    def aware(self) -> bool:
        """Weights of 4 bits are trained on."""
        return self.config.weight_bits < 8

    @property
    def name(self) -> str:
        """The point in a few words."""
        lanes = self.config.hardware.lanes
        how = ", trained on" if self.aware else ""
        return f"{self.network} {self.size}, {self.config.weight_bits} bit{how}, {lanes} lane{'s' if lanes > 1 else ''}"

    def to_dict(self) -> dict[str, Any]:
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
        """Parameters, multiplies of an image, bits of all weights; memory_bytes: weights, biases, and the largest map before and behind a
        layer, which stand in memory together."""
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
    """Values of the two memories of maps: the image and every second map that is kept, and the others (the logits are in none)."""
    stages = config.stages
    kept = [stages[0].source] + [
        stage.result for stage, behind in itertools.pairwise(stages) if not isinstance(behind.layer, Pool)
    ]  # a convolution's map is not kept where a pool follows
    sizes = [int(np.prod(shape)) for shape in kept]
    return max(sizes[0::2]), max(sizes[1::2], default=0)


def network_name(layers: Sequence[str]) -> str:
    """A name for layers without the dense one at the end: that of NETWORKS or NARROW, else kernels and channels."""
    for name, known in (NETWORKS | {name: tuple(one) for name, one in NARROW.items()}).items():
        if tuple(layers) == tuple(known):
            return name
    parsed = [parse_layer(text) for text in layers]
    words = [f"{one.kernel}x{one.kernel} {one.channels}" for one in parsed if isinstance(one, Conv)]
    return ", ".join(words + [f"dense {one.outputs}" for one in parsed if isinstance(one, Dense)])


def make_image_points(recordings: Recordings, grids: Sequence[Mapping[str, Any]], source: str = "grid") -> list[ImagePoint]:
    """Every point of the grids, each once, in order.

    grids: field of FIELDS -> value or list of values, all combinations. ``size`` is as in ``28x50`` (default: the archive's); ``layers`` a
    name of NETWORKS or a list of layers without the dense one at the end (default: tactnet), and so a list of these to vary it.

    Raises
    ------
    InputError
        An unknown field, or a combination that no network has: before anything is trained.
    """
    assert recordings.image_shape is not None
    own = {"size": "{}x{}".format(*recordings.image_shape), "layers": "tactnet", "weight_bits": 8, "lanes": LANES, "clock_hz": CLOCK_HZ}
    whole = [own | dict(grid) for grid in grids]
    for grid in whole:
        layers = grid["layers"]
        if isinstance(layers, list) and layers and all(isinstance(one, str) and one not in NETWORKS for one in layers):
            grid["layers"] = [layers]  # one network, layer by layer
    return expand(whole, source, FIELDS, "a grid for images", lambda wanted: _point(recordings, wanted))


def _point(recordings: Recordings, wanted: Mapping[str, Any]) -> ImagePoint:
    size, layers, bits, lanes, clock = (wanted[name] for name in FIELDS)
    if not isinstance(size, str):
        raise InputError(f"field size: is {size!r}; give height x width as text, as in '26x47'")
    if bits not in (4, 8) or isinstance(bits, bool):
        raise InputError(f"field weight_bits: is {bits!r}; give 8 or 4")
    if not isinstance(lanes, int) or isinstance(lanes, bool):
        raise InputError(f"field lanes: is {lanes!r}; give a whole number")
    if not isinstance(clock, (int, float)) or isinstance(clock, bool) or not 0 < clock < 1e10:
        raise InputError(f"field clock_hz: is {clock!r}; give a clock in Hz, as in 36e6")
    if isinstance(layers, str) and layers not in NETWORKS:
        raise InputError(f"field layers: is {layers!r}; give {', '.join(NETWORKS)}, or a list of layers such as ['conv 3 8', 'pool']")
    if not isinstance(layers, str) and not (isinstance(layers, list) and all(isinstance(one, str) for one in layers)):
        raise InputError(f"field layers: is {layers!r}; give a list of layers such as ['conv 3 8', 'pool']")
    texts = list(NETWORKS[layers]) if isinstance(layers, str) else [str(parse_layer(text)) for text in layers]
    height, width = image_size(size)
    name = network_name(texts)
    if name in NETWORKS:
        trained = image_config(_of_size(recordings, height, width), name)
    else:
        whole = [*texts, f"dense {len(recordings.class_names)}"]
        fields = {"name": name, "sample_rate_hz": recordings.sample_rate_hz}
        trained = AcceleratorConfig.of_image(height, width, whole, recordings.class_names, **fields)
    weights = len(trained.weighted_stages)
    formats = {
        "weight_formats": (QFormat(1, bits - 1),) * weights,
        "map_formats": (QFormat(3, 5, signed=False),) * (weights - 1),
        "logit_format": QFormat(8, 8),
    }  # widths count cycles and memories; where the points stand is only known after training
    return ImagePoint(name, trained, trained.replace(**formats, clock_hz=float(clock)).with_lanes(lanes, "plain"))


def _of_size(recordings: Recordings, height: int, width: int) -> Recordings:
    return recordings if recordings.image_shape == (height, width) else resized(recordings, height, width)


# ---------------------------------------------------------------------- the sweep
@dataclass(frozen=True, kw_only=True)
class ImageSweepRequest:
    """What is swept, and how it is judged.

    points: `make_image_points`. group: of the one split; none: random folds, new ones for every seed. parts: how many of the folds are
    judged, from the first; None: all. bounds: of the recommendation.
    """

    points: Sequence[ImagePoint]
    group: Sequence[str] = ()
    folds: int = 5
    parts: int | None = None
    seeds: Sequence[int] = (0,)
    recipe: ImageRecipe = field(default_factory=ImageRecipe)
    bounds: Bounds = field(default_factory=Bounds)


Shared = tuple[dict[str, np.ndarray], np.ndarray]
"""Images by their size in words, and labels."""


def judge_sized(shared: Shared, piece: Piece) -> dict[str, Any]:
    """`judge` on the images of the size that the piece's network takes."""
    images, labels = shared
    return judge((images[f"{piece.config.image.height}x{piece.config.image.width}"], labels), piece)


def sweep_images(
    recordings: Recordings,
    request: ImageSweepRequest,
    *,
    cost_of: Callable[[AcceleratorConfig], Mapping[str, float]],
    jobs: Jobs,
    keep: Memo,
    judging: Callable[[Shared, Piece], dict[str, Any]] = judge_sized,
) -> dict[str, Any]:
    """Train and judge every point, mark the fronts, recommend one point, and name the smallest at each of FLOORS.

    cost_of: of a configuration cycles_step, cycles_decision (from the last pixel to the decision), energy_j (of an image's computation).

    Returns
    -------
    As in sweep.json: points, recommended, recommendation, smallest (floor -> index or None), baselines and refused (empty), judged_split,
    seeds, folds, parts, judged_images (of a seed).
    """
    parts = {seed: _parts(recordings, request, seed) for seed in request.seeds}
    tuned = {point.trained for point in request.points if point.aware}
    pieces: dict[AcceleratorConfig, list[list[Piece]]] = {}
    for point in request.points:
        bits = 4 if point.trained in tuned else 0
        pieces[point.trained] = [
            [Piece(point.trained, tuple(map(int, out)), seed, request.recipe, bits) for out in parts[seed]] for seed in request.seeds
        ]
    images = {point.size: images_of(_of_size(recordings, *image_size(point.size))) for point in request.points}
    keys = {size: piece_keys(each, recordings.labels) for size, each in images.items()}

    def key(piece: Piece) -> str:
        return keys[f"{piece.config.image.height}x{piece.config.image.width}"](piece)

    # a fold of every network before the next fold: what an interrupted sweep has kept says something of all of them
    every = [of_seed for of_network in pieces.values() for of_seed in of_network]
    ordered = [piece for turn in itertools.zip_longest(*every) for piece in turn if piece is not None]
    results = jobs.results(
        judging, {key(piece): piece for piece in ordered}, (images, recordings.labels), keep=keep, what="trained and judged"
    )
    records = []
    for point in request.points:
        found = [[results[key(piece)] for piece in of_seed] for of_seed in pieces[point.trained]]
        split = _split(recordings.labels, pieces[point.trained], found, "tuned" if point.aware else "w8", request, point)
        records.append(_record(point, split, cost_of(point.config)))
    front = {number for cost in COSTS for number in pareto(records, cost)}
    for number, record in enumerate(records):
        record["on_front"] = number in front
    choice = recommend(records, request.bounds)
    return {
        "points": records,
        "recommended": choice["point"],
        "recommendation": choice,
        "smallest": [{"floor": floor, "point": smallest_at(records, floor)} for floor in FLOORS],
        "baselines": [],
        "refused": [],
        "judged_split": list(request.group),
        "seeds": [int(seed) for seed in request.seeds],
        "folds": request.folds,
        "parts": request.parts or request.folds,
        "judged_images": sum(len(out) for out in parts[request.seeds[0]]),
    }


def smallest_at(records: Sequence[Mapping[str, Any]], floor: float) -> int | None:
    """The record with the fewest multiplies, then weight bits, then lanes, that is right on a share of ``floor``; None: none is."""
    enough = [number for number, record in enumerate(records) if record["accuracy"] >= floor]
    order = ("multiplies_decision", "weight_memory_bits")
    return min(enough, key=lambda number: (*(records[number][name] for name in order), records[number]["config"]["lanes"]), default=None)


def _parts(recordings: Recordings, request: ImageSweepRequest, seed: int) -> list[np.ndarray]:
    parts = split_folds(recordings, list(request.group), request.folds, None if request.group else seed)
    return list(parts)[: request.parts]


def _split(
    labels: np.ndarray,
    pieces: list[list[Piece]],
    found: list[list[dict[str, Any]]],
    kind: str,
    request: ImageSweepRequest,
    point: ImagePoint,
) -> dict[str, Any]:
    """The figures of one point, in the keys of `eskin.golden.studies.sweep.split_figures`."""
    outs = [np.concatenate([piece.left_out for piece in of_seed]) for of_seed in pieces]
    ideal, whole = ([np.concatenate([one[name] for one in of_seed]) for of_seed in found] for name in ("float", kind))
    right = [float(np.mean(given == labels[out])) for given, out in zip(whole, outs, strict=True)]
    real = [float(np.mean(given == labels[out])) for given, out in zip(ideal, outs, strict=True)]
    same = [float(np.mean(a == b)) for a, b in zip(whole, ideal, strict=True)]
    decided = image_seconds(point.config)
    accuracy = float(np.mean(right))
    return {
        "groups": list(request.group),
        "accuracy": accuracy,
        **spread_of(right, len(outs[0])),
        "float_accuracy": float(np.mean(real)),
        "float_by_seed": real,
        "agreement": float(np.mean(same)),
        "decision_time_s": decided,
        "per_step": [{"step": 1, "time_s": decided, "accuracy": accuracy}],
        "per_fold": [],
    }


def _record(point: ImagePoint, split: dict[str, Any], cost: Mapping[str, float]) -> dict[str, Any]:
    return {
        "name": point.name,
        "config": point.to_dict(),
        "widths": {"weight_bits": point.config.weight_bits},
        **{key: split[key] for key in ("accuracy", "spread", "standard_error", "float_accuracy", "agreement")},
        "cycles_step": cost["cycles_step"],
        "cycles_decision": cost["cycles_decision"],
        "clock_hz": point.config.hardware.clock_hz,
        "latency_s": cost["cycles_decision"] / point.config.hardware.clock_hz,
        **point.cost(),
        "energy_j": cost["energy_j"],
        "compute_j": cost["energy_j"],
        **dict.fromkeys(NOT_BUILT),
        "on_front": False,
        "splits": [split],
    }
