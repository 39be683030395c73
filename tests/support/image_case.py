"""Random image networks, also smaller than a configuration may be, and what the golden model computes."""

import random
from dataclasses import dataclass

import numpy as np

from eskin.golden.core import Pool, QFormat, narrow
from eskin.golden.core.images import PIXEL_FORMAT, layer_stages, parse_layer
from eskin.golden.model.image_network import accumulators, pooled
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
        maps: list[np.ndarray] = []
        value = image.astype(np.int64)[None, :, :, None]
        shifts = iter(part.shift for part in self.plan.passes)
        for stage in self.plan.stages:
            if isinstance(stage.layer, Pool):
                maps[-1] = value = pooled(value)
                continue
            weights, bias = (self.arrays[f"{letter}_{stage.number}"] for letter in "Wb")
            sums = accumulators(stage, value, weights, bias).astype(np.int64)
            value = narrow(sums, next(shifts), LOGIT if stage.last else PIXEL_FORMAT)
            maps.append(value)
        return [code for values in maps[:-1] for code in values.ravel().tolist()], value.ravel().tolist()


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
