"""Image networks: layers, the maps between them, their sizes and integer formats (docs/specification.md,
section 15).

The golden model and the hardware share this file, not their algorithms. A network is a list of short texts,
as in a configuration's group ``image``:

| text | layer |
| --- | --- |
| ``conv K N`` | convolution K x K (1, 3 or 5), stride 1, zeros around the map ("same"), N channels; then ReLU |
| ``pool`` | after a convolution: largest of 2 x 2, stride 2; an odd last row or column is a separate window (ceil) |
| ``dense N`` | from every value of the map to N outputs; then ReLU, except in the last layer, whose outputs are the logits |

**Maps** are channels-last: value (row, column, channel) of a map of width W and C channels has the number
``(row W + column) C + channel``. Map 0 is the image, one channel, 8 bits unsigned. Every map between layers
has 8 bits unsigned.

**Numbers.** A layer with weights has signed weights of 8 or 4 bits and biases of BIAS_BITS bits, in units of
its accumulator: ``narrow(sum(weight * value) + bias, shift, F) = SAT_F(floor((sum + bias + 2^(shift-1)) /
2^shift))``, F = UQ 8 bits, where the saturation at 0 is the ReLU; in the last layer F is the signed
``logit_format``. ``shift`` is 0 or more, and with 0 nothing is rounded.

**Accumulator.** No sum overflows, whatever the weights and biases are: ``accumulator_bound`` depends on the
formats alone, so that other weights may be loaded.

**Folder of a model.** ``config.json`` has the group ``image`` (layers, formats) and ``weights.npz`` for each
layer that has weights, with n its number in the list of layers from 0 (pools count): ``W_n`` int64, of a
convolution (channels, K, K, channels before), of a dense layer (outputs, values of the map before, in the
order of their numbers); ``b_n`` int64 (channels or outputs). ``float.npz``: the same names, float64, batch
norm folded in.

**Input.** An image arrives as ``height`` frames of ``width`` samples: row by row from the top, each row from
the left. The gate is open at once and nothing is subtracted or normalised: a sample is a pixel. The last
pixel of row ``height`` ends the image; its decision is both local and global (one step).
"""

import itertools
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from eskin.golden.core.formats import QFormat, signed_bits

KERNELS = (1, 3, 5)
BIAS_BITS = 24
"""Bits of a bias, which takes two host words."""
PIXEL_FORMAT = QFormat(0, 8, signed=False)
"""Format in which a network reads a pixel: code / 256."""
LOGIT_BITS = 16
MOST_CHANNELS = 64
MOST_LAYERS = 16
MOST_MAP_VALUES = 32768
"""Highest number of values of a map that is kept (a convolution's only if no pool follows): one SPRAM of an
iCE40UP5K."""
MOST_DENSE_WEIGHTS = 65536
"""Highest number of weights of all dense layers together: two SPRAMs."""
MOST_CONV_WEIGHTS = 65536
MOST_SHIFT = 24

Shape = tuple[int, int, int]
"""Rows, columns, channels of a map."""


@dataclass(frozen=True)
class Conv:
    """``conv K N``: kernel K x K, N channels."""

    kernel: int
    channels: int

    def __str__(self) -> str:
        return f"conv {self.kernel} {self.channels}"


@dataclass(frozen=True)
class Pool:
    """``pool``: 2 x 2, stride 2, ceil."""

    def __str__(self) -> str:
        return "pool"


@dataclass(frozen=True)
class Dense:
    """``dense N``: N outputs."""

    outputs: int

    def __str__(self) -> str:
        return f"dense {self.outputs}"


Layer = Conv | Pool | Dense


def parse_layer(text: str) -> Layer:
    """The layer that prints as ``text``.

    Raises
    ------
    ValueError
        ``text`` is not a layer; the message shows the forms of one.
    """
    words = text.split()
    numbers = [int(word) for word in words[1:] if re.fullmatch(r"[0-9]{1,6}", word)]
    if words == ["pool"]:
        return Pool()
    if words[:1] == ["conv"] and len(words) == 3 and len(numbers) == 2:
        kernel, channels = numbers
        if kernel not in KERNELS:
            raise ValueError(f"'{text}' has a kernel of {kernel}; take 1, 3 or 5")
        if not 1 <= channels <= MOST_CHANNELS:
            raise ValueError(f"'{text}' has {channels} channels; take 1 to {MOST_CHANNELS}")
        return Conv(kernel, channels)
    if words[:1] == ["dense"] and len(words) == 2 and len(numbers) == 1:
        if not 1 <= numbers[0] <= 256:
            raise ValueError(f"'{text}' has {numbers[0]} outputs; take 1 to 256")
        return Dense(numbers[0])
    raise ValueError(f"'{text}' is not a layer; write 'conv K N', 'pool' or 'dense N', as in 'conv 3 16'")


@dataclass(frozen=True)
class Stage:
    """A layer at its place in the network.

    number: in the list of layers, from 0. source, result: shapes of its input and output map. last: its
    outputs are the logits.
    """

    number: int
    layer: Layer
    source: Shape
    result: Shape
    last: bool

    @property
    def weight_shape(self) -> tuple[int, ...]:
        """Shape of ``W_n``; () for a pool."""
        if isinstance(self.layer, Conv):
            return (self.layer.channels, self.layer.kernel, self.layer.kernel, self.source[2])
        return (self.layer.outputs, math.prod(self.source)) if isinstance(self.layer, Dense) else ()

    @property
    def outputs(self) -> int:
        """Number of biases: channels of a convolution, outputs of a dense layer, 0 for a pool."""
        return self.weight_shape[0] if self.weight_shape else 0

    @property
    def weights(self) -> int:
        """Number of weights; 0 for a pool."""
        return math.prod(self.weight_shape) if self.weight_shape else 0

    @property
    def products(self) -> int:
        """Number of products of one sum."""
        return self.weights // self.outputs if self.outputs else 0

    @property
    def multiplies(self) -> int:
        """Multiplies per image, including those with the zero padding."""
        return self.result[0] * self.result[1] * self.weights

    @property
    def parameters(self) -> int:
        """Number of trained parameters: weights and biases, and for a convolution two more per channel, of
        the batch norm that is folded in later."""
        return self.weights + self.outputs * (3 if isinstance(self.layer, Conv) else 1)

    def accumulator_bound(self, weight_bits: int, shift: int) -> int:
        """Largest absolute value of a sum with bias and rounding half:
        products x 255 x 2^(weight_bits-1) + 2^(BIAS_BITS-1) + 2^(shift-1)."""
        products = self.products * PIXEL_FORMAT.max_code << weight_bits - 1
        return products + (1 << BIAS_BITS - 1) + (1 << shift - 1 if shift else 0)


def layer_stages(height: int, width: int, layers: Sequence[Layer]) -> tuple[Stage, ...]:
    """Every layer with the shapes of its maps, for images of ``height`` x ``width`` pixels.

    Raises
    ------
    ValueError
        The list makes no network, or none that fits the memories; the message says why and what to change.
    """
    if not layers or not isinstance(layers[-1], Dense):
        raise ValueError("must end with a dense layer, whose outputs are the classes")
    if len(layers) > MOST_LAYERS:
        raise ValueError(f"has {len(layers)} layers; take at most {MOST_LAYERS}")
    shape: Shape = (height, width, 1)
    stages: list[Stage] = []
    for number, layer in enumerate(layers):
        if isinstance(layer, Dense):
            result: Shape = (1, 1, layer.outputs)
        elif number and isinstance(layers[number - 1], Dense):
            raise ValueError(
                f"has '{layer}' behind a dense layer, which leaves no image; put dense layers last"
            )
        elif isinstance(layer, Conv):
            result = (shape[0], shape[1], layer.channels)
        elif not number or isinstance(layers[number - 1], Pool):
            raise ValueError("has a pool that follows no convolution; put one between, or leave the pool out")
        else:
            result = (-(-shape[0] // 2), -(-shape[1] // 2), shape[2])
        stages.append(Stage(number, layer, shape, result, number == len(layers) - 1))
        shape = result
    _check_room(stages)
    return tuple(stages)


def _check_room(stages: Sequence[Stage]) -> None:
    for stage, following in itertools.pairwise(stages):
        if math.prod(stage.result) > MOST_MAP_VALUES and not isinstance(following.layer, Pool):
            raise ValueError(
                f"has a map of {math.prod(stage.result)} values behind '{stage.layer}', and "
                f"{MOST_MAP_VALUES} fit the memory; use fewer channels, or a pool behind it"
            )
    for kind, most, words in (
        (Conv, MOST_CONV_WEIGHTS, "convolutions"),
        (Dense, MOST_DENSE_WEIGHTS, "dense layers"),
    ):
        weights = sum(stage.weights for stage in stages if isinstance(stage.layer, kind))
        if weights > most:
            raise ValueError(
                f"needs {weights} weights in its {words}, and {most} fit the memory; use fewer channels, or "
                "more pools"
            )


SIZES = ((28, 50), (26, 47), (28, 40), (28, 32), (24, 32))
"""Heights and widths of images for which TactNet4 was published (Gandarias et al., IEEE Sensors Journal
19(16), 2019)."""

NETWORKS: dict[str, tuple[str, ...]] = {
    "tactnet": ("conv 5 8", "pool", "conv 3 16", "pool", "conv 3 32", "pool"),
    "four": ("conv 3 8", "pool", "conv 3 8", "pool", "conv 3 16", "pool", "conv 3 32", "pool"),
    "four-lean": ("conv 3 4", "pool", "conv 3 8", "pool", "conv 3 16", "pool", "conv 3 32", "pool"),
    "tactnet-half": ("conv 5 4", "pool", "conv 3 8", "pool", "conv 3 16", "pool"),
}
"""Networks by name, without the dense layer at the end, which has an output for each class: TactNet4, and
smaller ones."""


def network(name: str, classes: int) -> tuple[Layer, ...]:
    """Layers of the network called ``name`` in NETWORKS, for a number of classes."""
    return (*map(parse_layer, NETWORKS[name]), Dense(classes))


def accumulator_bits(stages: Sequence[Stage], weight_bits: int, shifts: Sequence[int]) -> int:
    """Bits of one accumulator for all layers; ``shifts``: of the layers that have weights, in order."""
    weighted = [stage for stage in stages if stage.weights]
    return max(
        signed_bits(stage.accumulator_bound(weight_bits, shift))
        for stage, shift in zip(weighted, shifts, strict=True)
    )
