"""Random image networks, and what they compute by a reference of its own: sums written out, no shared
code."""

import random
from dataclasses import dataclass

import numpy as np

from eskin.golden.core import QFormat
from eskin.golden.core.images import layer_stages, parse_layer
from eskin.rtl.program.image_passes import ImagePlan

LOGIT = QFormat(16, 0)


@dataclass(frozen=True)
class ImageCase:
    """A network with its weights."""

    plan: ImagePlan
    arrays: dict[str, np.ndarray]
    height: int
    width: int

    def image(self, seed: int) -> np.ndarray:
        """Random pixels, a third of them 0."""
        rng = np.random.default_rng(seed)
        return rng.integers(0, 256, (self.height, self.width)) * (
            rng.random((self.height, self.width)) < 0.67
        )

    def expected(self, image: np.ndarray) -> tuple[list[int], list[int]]:
        """(values of all maps in their order, logits) of an image."""
        maps: list[int] = []
        value = image.astype(np.int64)[:, :, None]
        for one in self.plan.passes:
            weights = self.arrays[f"W_{one.number}"]
            if one.dense:
                value, weights = value.reshape(1, 1, -1), weights.reshape(one.outputs, 1, 1, -1)
            reach = one.kernel // 2
            padded = np.pad(value, ((reach, reach), (reach, reach), (0, 0)))
            sums = np.zeros((one.rows, one.columns, one.outputs), dtype=np.int64)
            for row, column in np.ndindex(one.rows, one.columns):
                window = padded[row : row + one.kernel, column : column + one.kernel]
                sums[row, column] = (weights * window).sum((1, 2, 3)) + self.arrays[f"b_{one.number}"]
            rounded = (sums + (1 << one.shift - 1 if one.shift else 0)) >> one.shift
            if one.last:
                return maps, [int(v) for v in rounded.ravel().clip(LOGIT.min_code, LOGIT.max_code)]
            value = rounded.clip(0, 255)
            if one.pool:
                even = np.pad(value, ((0, one.rows % 2), (0, one.columns % 2), (0, 0)))
                value = even.reshape(even.shape[0] // 2, 2, even.shape[1] // 2, 2, one.outputs).max((1, 3))
            maps += [int(v) for v in value.ravel()]
        raise AssertionError("a network ends with logits")


def make_case(
    height: int,
    width: int,
    layers: list[str],
    *,
    lanes: int,
    weight_bits: int = 8,
    seed: int = 1,
    logit_shift: int | None = None,
    **options,
) -> ImageCase:
    """Random weights of any size, shifts that leave most values inside the format and some outside; the last
    one as given."""
    rng = np.random.default_rng(seed)
    stages = layer_stages(height, width, [parse_layer(text) for text in layers])
    weighted = [stage for stage in stages if stage.weights]
    shifts = [
        max(0, int(np.log2(stage.products) / 2) + weight_bits - 1 + int(rng.integers(-1, 2)))
        for stage in weighted
    ]
    shifts[-1] = shifts[-1] if logit_shift is None else logit_shift
    top = 1 << weight_bits - 1
    arrays = {}
    for stage in weighted:
        arrays[f"W_{stage.number}"] = rng.integers(-top, top, stage.weight_shape)
        arrays[f"b_{stage.number}"] = rng.integers(-20 * top, 150 * top, stage.outputs)
    plan = ImagePlan(
        stages, weight_bits=weight_bits, shifts=shifts, logit_format=LOGIT, lanes=lanes, **options
    )
    return ImageCase(plan, arrays, height, width)


def random_case(seed: int, most_cycles: int) -> ImageCase:
    """A small random network: any kernels, pools, widths that no lane count divides, one or two dense
    layers."""
    rng = random.Random(seed)
    while True:
        height, width = rng.randint(1, 7), rng.randint(1, 7)
        layers: list[str] = []
        for _ in range(rng.randint(0, 3)):
            layers.append(f"conv {rng.choice((1, 3, 5))} {rng.randint(1, 10)}")
            layers += ["pool"] * rng.randint(0, 1)
        layers += [f"dense {rng.randint(1, 9)}"] * rng.randint(0, 1)
        layers.append(f"dense {rng.randint(2, 9)}")
        lanes, bits, checksum = rng.choice((1, 2, 4, 8, 16)), rng.choice((4, 8)), rng.random() < 0.5
        case = make_case(height, width, layers, lanes=lanes, weight_bits=bits, seed=seed, checksum=checksum)
        if case.plan.cycles <= most_cycles:
            return case
