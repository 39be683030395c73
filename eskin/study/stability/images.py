"""Where a network for images fails, `eskin stability` on images: objects moved, turned, pressed otherwise;
rows and taxels lost; noise; an empty array; single bits of weights and maps. Experiments on a bench of
images, and their table.

An image is an array (height, width) of codes 0..255. A figure takes all images, a curve ``few``; bounds are
shares of the accuracy on the undisturbed images.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from eskin.golden.core import AcceleratorConfig, Pool, QFormat, narrow
from eskin.golden.core.images import BIAS_BITS
from eskin.golden.data import Recordings
from eskin.golden.model import ImageTrace, IntegerModel, images_of, layer_formats, run_images
from eskin.golden.model.image_network import accumulators, pooled
from eskin.study.stability.core import Case, Curve, Mode, Outcome
from eskin.study.stability.memory import Site, by_bit, upset
from eskin.training.made_up import image_recordings

FULL = 255
PLAYED = 3
"""Images of a case for the hardware."""
MAP_FLIPS = 400
"""Bits of maps that are inverted, one at a time."""
WEIGHT_FLIPS = 400
"""Bits of weights and biases that are inverted, one at a time."""
FLIPPED_ON = 40
"""Images on which a flipped bit is judged."""

Run = Callable[[IntegerModel, np.ndarray], ImageTrace]


def plain_run(model: IntegerModel, images: np.ndarray) -> ImageTrace:
    """The integer network, maps not kept."""
    return run_images(model, images, maps=False)


@dataclass(frozen=True)
class ImageBench:
    """A quantised network for images, and images to disturb.

    few: images (spread evenly over the classes) that the points of a curve take. flips: bits inverted at
    most, of weights and of maps. run: the part under test, which a broken variant replaces. origin: the bench
    that a broken one came from, whose accuracy bounds refer to.
    """

    model: IntegerModel
    recordings: Recordings
    few: int = 100
    flips: int = WEIGHT_FLIPS
    seed: int = 1
    run: Run = plain_run
    origin: ImageBench | None = field(default=None, compare=False, repr=False)

    @property
    def config(self) -> AcceleratorConfig:
        """The configuration under test."""
        return self.model.config

    @cached_property
    def images(self) -> np.ndarray:
        """All images (n, height, width)."""
        return images_of(self.recordings)

    @cached_property
    def sample(self) -> tuple[np.ndarray, np.ndarray]:
        """(images, labels) of ``few`` of them."""
        rows = self.recordings.evenly(self.few)
        return self.images[rows], self.recordings.labels[rows]

    @cached_property
    def clean_accuracy(self) -> float:
        """Accuracy on the undisturbed images."""
        return self.accuracy(self.images, self.recordings.labels)

    def accuracy(self, images: np.ndarray, labels: np.ndarray) -> float:
        """Share of images decided as labelled."""
        return self.run(self.model, images).accuracy(labels)

    def case(self, images: np.ndarray) -> Case:
        """A few images for the hardware."""
        return Case(image_recordings(self.config, images[:PLAYED]))

    def rng(self, *key: int) -> np.random.Generator:
        """Random numbers that depend on the bench's seed and ``key`` alone."""
        return np.random.default_rng([self.seed, *key])


# ---------------------------------------------------------------------- disturbances
Change = Callable[[ImageBench, np.ndarray, float], list[np.ndarray]]
"""(bench, images, level) -> the images disturbed, in one way or in several, of which the worst counts."""


def _codes(images: np.ndarray) -> np.ndarray:
    return np.clip(np.rint(images), 0, FULL).astype(np.uint8)


def shifted(bench: ImageBench, images: np.ndarray, level: float) -> list[np.ndarray]:
    """Moved by a share of each side (at least a pixel) up, down, left and right; zeros come in."""
    height, width = images.shape[1:]
    rows, columns = (max(round(level * side), 1) if level else 0 for side in (height, width))
    wide = np.pad(images, ((0, 0), (rows, rows), (columns, columns)))
    corners = ((0, columns), (2 * rows, columns), (rows, 0), (rows, 2 * columns))
    return [wide[:, y : y + height, x : x + width] for y, x in corners]


def turned(bench: ImageBench, images: np.ndarray, level: float) -> list[np.ndarray]:
    """Turned by so many degrees either way about the middle; zeros come in."""
    from scipy.ndimage import rotate

    if not level:
        return [images]
    real = images.astype(np.float64)
    return [_codes(rotate(real, way * level, axes=(1, 2), reshape=False, order=1)) for way in (1, -1)]


def fainter(bench: ImageBench, images: np.ndarray, level: float) -> list[np.ndarray]:
    """Pressed less and more strongly: times 1 - level, and times 1 + level, held at the largest code."""
    return [_codes(images * (1 - level)), _codes(images * (1 + level))]


def noisy(bench: ImageBench, images: np.ndarray, level: float) -> list[np.ndarray]:
    """White noise of so many codes on every taxel; codes stay within their range."""
    return [_codes(images + bench.rng(1).normal(0, level, images.shape))]


def lost_taxels(bench: ImageBench, images: np.ndarray, level: float) -> list[np.ndarray]:
    """A share of the taxels, other ones in every image, reads 0."""
    return [np.where(bench.rng(2).random(images.shape) < level, 0, images).astype(np.uint8)]


def stuck_taxels(bench: ImageBench, images: np.ndarray, level: float) -> list[np.ndarray]:
    """So many taxels, other ones in every image, read the largest code."""
    places = bench.rng(3).random((len(images), images[0].size)).argsort(axis=1)[:, : int(level)]
    stuck = images.reshape(len(images), -1).copy()
    np.put_along_axis(stuck, places, FULL, axis=1)
    return [stuck.reshape(images.shape)]


def curve_of(
    change: Change, levels: Sequence[float], nominal: float, xlabel: str
) -> Callable[[ImageBench], Outcome]:
    """The experiment of a disturbance with a level: accuracy at ``nominal`` on all images, at ``levels`` on
    few; of several ways the worst."""

    def run(bench: ImageBench) -> Outcome:
        images, labels = bench.sample
        line = [min(bench.accuracy(way, labels) for way in change(bench, images, level)) for level in levels]
        ways = change(bench, bench.images, nominal)
        accuracies = [bench.accuracy(way, bench.recordings.labels) for way in ways]
        worst = int(np.argmin(accuracies))
        words = f"{xlabel}: {nominal:g}" + (f", way {worst + 1} of {len(ways)}" if len(ways) > 1 else "")
        return Outcome(
            accuracies[worst],
            words,
            Curve(xlabel, "accuracy", levels, {"accuracy": line}),
            bench.case(ways[worst]),
        )

    return run


def each_line(axis: int, word: str) -> Callable[[ImageBench], Outcome]:
    """The experiment in which each row (axis 1) or column (2) in turn reads 0: the mean over them; on few
    images."""

    def run(bench: ImageBench) -> Outcome:
        images, labels = bench.sample
        line, cases = [], []
        for number in range(images.shape[axis]):
            without = images.copy()
            without[(slice(None),) * axis + (number,)] = 0
            cases.append(without)
            line.append(bench.accuracy(without, labels))
        worst = int(np.argmin(line))
        curve = Curve(
            f"the {word} that is lost (0 = first)", "accuracy", range(len(line)), {"accuracy": line}
        )
        return Outcome(
            float(np.mean(line)),
            f"{word} {worst}: {100 * line[worst]:.1f} %",
            curve,
            bench.case(cases[worst]),
        )

    return run


# ---------------------------------------------------------------------- nothing on the array
NOTHING_NOISE = (0.0, 1.0, 2.0)
"""Standard deviations, codes, of an empty array's noise."""


def empty_images(bench: ImageBench, noise: float, count: int = 8) -> np.ndarray:
    """``count`` images of an empty array."""
    shape = bench.images.shape[1:]
    if not noise:
        return np.zeros((1, *shape), np.uint8)
    return _codes(bench.rng(4, round(8 * noise)).normal(0, noise, (count, *shape)))


def nothing(bench: ImageBench) -> Outcome:
    """Share of real images that a margin leaves confident when it is so high that an empty array, with some
    noise, is never confident."""
    trace, levels = bench.run(bench.model, bench.images), (*NOTHING_NOISE, 4.0, 8.0)
    empty = [int(bench.run(bench.model, empty_images(bench, noise)).margin.max()) for noise in levels]
    threshold = max(empty[: len(NOTHING_NOISE)]) + 1
    surviving = [float(np.mean(trace.margin > margin)) for margin in empty]
    sure = trace.margin >= threshold
    right, value = (trace.decision == bench.recordings.labels)[sure], float(np.mean(sure))
    share = 100 * float(np.mean(right)) if len(right) else 0.0
    words = f"margin_threshold {threshold}: {100 * value:.1f} % of the images stay confident, {share:.1f} % of these are right"
    curve = Curve(
        "noise of the empty array (codes)",
        "images still confident",
        levels,
        {"images still confident": surviving},
    )
    return Outcome(value, words, curve, bench.case(empty_images(bench, NOTHING_NOISE[-1])))


# ---------------------------------------------------------------------- upsets
def continued(model: IntegerModel, number: int, values: np.ndarray) -> np.ndarray:
    """Decisions from the map (n, rows, columns, channels) that layer ``number`` reads, on."""
    config = model.config
    formats = {stage.number: after for stage, *_, after in layer_formats(config)}
    shifts = dict(zip(formats, config.layer_shifts, strict=True))
    for stage in config.stages[number:]:
        if isinstance(stage.layer, Pool):
            values = pooled(values)
        else:
            sums = accumulators(
                stage, values, model.arrays[f"W_{stage.number}"], model.arrays[f"b_{stage.number}"]
            )
            values = narrow(sums.astype(np.int64), shifts[stage.number], formats[stage.number])
    return np.argmax(values.reshape(len(values), -1), axis=1)


def kept_maps(bench: ImageBench, images: np.ndarray) -> dict[int, np.ndarray]:
    """Number of the layer that reads it -> the map that stands in memory, of each image: the image itself,
    then what each layer gave."""
    maps = run_images(bench.model, images).maps
    kept = {0: images[..., None].astype(np.int64)}
    for stage in bench.config.stages[1:]:
        if not isinstance(stage.layer, Pool):
            kept[stage.number] = maps[stage.number - 1].astype(np.int64)
    return kept


def _flips(
    bench: ImageBench,
    key: int,
    count: int,
    sizes: Mapping[Any, int],
    bits: Mapping[Any, int],
    decide: Callable[[Any, int, int], np.ndarray],
    images: np.ndarray,
) -> tuple[list[Site], list[float], str]:
    """``count`` bits hit at random, the share of decisions on ``images`` that each changes, and how many
    change nothing, in words.

    sizes, bits: values of what can be hit, and bits of each. decide: the decisions with one bit inverted.
    """
    rng, names, clean = bench.rng(key), list(sizes), bench.run(bench.model, images).decision
    weights = np.array([sizes[name] * bits[name] for name in sizes])
    sites: list[Site] = []
    for _ in range(count):
        name = names[int(rng.choice(len(names), p=weights / weights.sum()))]
        sites.append((name, int(rng.integers(0, sizes[name])), int(rng.integers(0, bits[name]))))
    changed = [float(np.mean(decide(*site) != clean)) for site in sites]
    return sites, changed, f"{np.mean([not share for share in changed]):.1%} of {count} flips change nothing"


def map_flips(bench: ImageBench) -> Outcome:
    """Single bits of stored maps, the image among them, inverted while an image is under way, at random
    places: mean share of decisions changed."""
    images = bench.images[bench.recordings.evenly(FLIPPED_ON)]
    maps = kept_maps(bench, images)

    def decide(number: int, place: int, bit: int) -> np.ndarray:
        values = maps[number].copy()
        values.reshape(len(values), -1)[:, place] ^= 1 << bit
        return continued(bench.model, number, values)

    sizes = {number: values[0].size for number, values in maps.items()}
    count = min(bench.flips, MAP_FLIPS)
    sites, changed, harmless = _flips(bench, 5, count, sizes, dict.fromkeys(maps, 8), decide, images)
    shares: dict[int, list[float]] = {}
    for (number, *_), share in sorted(zip(sites, changed, strict=True), key=lambda flip: flip[0][0]):
        shares.setdefault(number, []).append(share)
    worst = max(shares, key=lambda number: np.mean(shares[number]))
    source = f"the map before '{bench.config.stages[worst].layer}'" if worst else "the image"
    words = f"{source}: {np.mean(shares[worst]):.4f} on average; {harmless}"
    return Outcome(
        float(np.mean(changed)), words, by_bit(sites, changed, "bit of a map's value (0 = lowest)")
    )


def weight_flips(bench: ImageBench) -> Outcome:
    """Single bits of weights and biases inverted, at random: mean share of decisions changed."""
    images, arrays = bench.images[bench.recordings.evenly(FLIPPED_ON)], bench.model.arrays
    formats = {f"b_{stage.number}": QFormat(BIAS_BITS, 0) for stage in bench.config.weighted_stages}
    formats |= {f"W_{stage.number}": weight for stage, weight, *_ in layer_formats(bench.config)}

    def hit(name: str, place: int, bit: int) -> IntegerModel:
        upset_arrays = {**arrays, name: upset(arrays[name], place, bit, formats[name])}
        return IntegerModel(bench.config, upset_arrays, bench.model.source)

    sizes = {name: arrays[name].size for name in formats}
    bits = {name: fmt.width for name, fmt in formats.items()}
    sites, changed, harmless = _flips(
        bench, 6, bench.flips, sizes, bits, lambda *site: bench.run(hit(*site), images).decision, images
    )
    worst = sites[int(np.argmax(changed))]
    shown = [k for k, (name, *_) in enumerate(sites) if name.startswith("W")]
    curve = by_bit([sites[k] for k in shown], [changed[k] for k in shown], "bit of a weight (0 = lowest)")
    case = Case(image_recordings(bench.config, images[:PLAYED]), hit(*worst))
    words = f"{worst[0]}, value {worst[1]}, bit {worst[2]}: {max(changed):.3f}; {harmless}"
    return Outcome(float(np.mean(changed)), words, curve, case)


# ---------------------------------------------------------------------- the table
# fmt: off
IMAGE_MODES: dict[str, Mode] = {mode.name: mode for mode in (
    Mode("stream", "object moved",
        curve_of(shifted, (0.0, 0.04, 0.08, 0.12, 0.16, 0.2), 0.05, "moved by (share of the "
                                                                    "side)"), "accuracy",
        "nobody puts an object down twice at the same place",
        "Accuracy with every image moved by a twentieth of each side, the worst of four directions.",
        at_least=0.95),
    Mode("stream", "object turned",
        curve_of(turned, (0, 5, 10, 20, 30, 45, 60, 90), 15, "turned by (degrees)"), "accuracy",
        "training turns images by up to 30 degrees",
        "Accuracy with every image turned by 15 degrees, the worse of both ways.", at_least=0.95),
    Mode("stream", "pressed less, pressed more",
        curve_of(fainter, (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6), 0.2, "pressed less or more by "
                                                                    "(share)"), "accuracy",
        "a hand does not press with the same force each time",
        "Accuracy with every pixel times 0.8, and times 1.2 and held at 255; the worse of both.",
        at_least=0.95),
    Mode("stream", "empty array", nothing, "share of images",
        "a class 'nothing' by margin is worth having if most objects are still named",
        "Share of real images that stay confident with a margin at which an empty array (noise of up to 2 "
        "codes) never is.",
        at_least=0.75),
    Mode("sensor", "noise on every taxel",
        curve_of(noisy, (0, 1, 2, 4, 8, 16, 32), 2, "noise (codes, standard deviation)"), "accuracy",
        "a converter's lowest bits are noise",
        "Accuracy with white noise of 2 codes on every taxel.", at_least=0.97),
    Mode("sensor", "taxels lost",
        curve_of(lost_taxels, (0, 0.01, 0.02, 0.05, 0.1, 0.2), 0.01, "taxels lost (share)"), "accuracy",
        "one in a hundred taxels may be gone in a used array",
        "Accuracy with a hundredth of the taxels, other ones in each image, at 0.", at_least=0.95),
    Mode("sensor", "a taxel stuck",
        curve_of(stuck_taxels, (0, 1, 2, 4, 8, 16), 1, "taxels stuck at the largest code"), "accuracy",
        "one short must not take the array out of use",
        "Accuracy with one taxel, another one in each image, at the largest code.", at_least=0.9),
    Mode("sensor", "a row lost", each_line(1, "row"), "accuracy",
        "a broken row wire must not take the array out of use",
        "Mean accuracy over all rows, each in turn at 0; on few images.", at_least=0.9),
    Mode("sensor", "a column lost", each_line(2, "column"), "accuracy",
        "a broken column wire must not take the array out of use",
        "Mean accuracy over all columns, each in turn at 0; on few images.", at_least=0.9),
    Mode("memory", "a bit of a weight", weight_flips, "share of decisions",
        "what a fault is worth until weights are loaded again",
        f"Mean share of decisions changed by one inverted bit of a weight or bias, on {FLIPPED_ON} images.",
        at_most=0.01),
    Mode("memory", "a bit of a map", map_flips, "share of decisions",
        "it lasts for one image",
        f"Mean share of decisions changed by one inverted bit of a stored map, on {FLIPPED_ON} images.",
        at_most=0.005),
)}
# fmt: on
"""The failure modes of networks for images, by name."""
