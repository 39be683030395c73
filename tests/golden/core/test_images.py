"""Layer lists: shapes, counts, formats, and lists that no hardware holds."""

import numpy as np

from eskin.golden.core import NETWORKS, AcceleratorConfig, Conv, QFormat
from eskin.golden.core.images import SIZES, Stage, network
from tests.support.table import each_row, refused

OBJECTS = tuple(f"object {number}" for number in range(22))
TINY = ("conv 3 4", "pool", "conv 1 3", "dense 2")
FORMATS = dict(weight_formats=("SQ(1,7)", "SQ(0,4)", "SQ(-1,9)"), map_formats=("UQ(1,7)", "UQ(2,6)"))


def tiny(**fields) -> AcceleratorConfig:
    return AcceleratorConfig.of_image(7, 9, TINY, ("a", "b"), name="tiny", **fields)


@each_row(
    "size, parameters, multiplies",
    zip(SIZES, (25862, 23046, 20230, 17414, 14598), (1122240, 1007792, 883200, 706560, 604416), strict=True),
)
def test_tactnet_has_the_published_parameters_at_each_of_its_sizes(size, parameters, multiplies):
    config = AcceleratorConfig.of_image(*size, network("tactnet", 22), OBJECTS)
    assert (config.parameter_count, config.multiplies) == (parameters, multiplies)


def test_the_small_networks_have_the_multiplies_of_the_study():
    of = {name: AcceleratorConfig.of_image(28, 50, network(name, 22), OBJECTS) for name in NETWORKS}
    assert {name: config.multiplies for name, config in of.items()} == {
        "tactnet": 1122240, "four": 541888, "four-lean": 390688, "tactnet-half": 355488
    }  # fmt: skip


def test_a_bound_is_reached_and_not_passed_by_the_worst_weights():
    stage = Stage(0, Conv(3, 2), (4, 4, 5), (4, 4, 2), False)
    worst = 9 * 5 * 255 * 128 + 2**23 + 2**6
    assert stage.accumulator_bound(8, 7) == worst
    config = tiny().replace(**FORMATS)
    bits = config.accumulator_bits
    for stage, shift in zip(config.weighted_stages, config.layer_shifts, strict=True):
        assert np.prod(stage.weight_shape[1:]) * 255 * 128 + 2**23 + (2**shift >> 1) < 1 << bits - 1
    assert any(
        of_layer.accumulator_bound(8, shift) >= 1 << bits - 2
        for of_layer, shift in zip(config.weighted_stages, config.layer_shifts, strict=True)
    )


@each_row(
    "fields, words",
    [
        ({"layers": ("conv 2 8", "dense 2")}, "field layers: .*has a kernel of 2; take 1, 3 or 5"),
        ({"layers": ("conv 3 0", "dense 2")}, "field layers: .*has 0 channels; take 1 to 64"),
        ({"layers": ("conv3 8", "dense 2")}, "'conv3 8' is not a layer; write 'conv K N'"),
        ({"layers": ("conv 3 -8", "dense 2")}, "is not a layer"),
        ({"layers": ("pool", "dense 2")}, "pool that follows no convolution"),
        ({"layers": ("conv 3 4", "pool")}, "must end with a dense layer"),
        ({"layers": ("dense 8", "conv 3 4", "dense 2")}, "behind a dense layer"),
        ({"layers": ("dense 3",)}, "end with 3 outputs and there are 2 classes"),
        (
            {"layers": ("conv 5 64", "conv 5 64", "pool", "dense 2")},
            "needs 104000 weights in its convolutions, and 65536 fit",
        ),
        ({"layers": ("conv 1 1",) * 16 + ("dense 2",)}, "has 17 layers; take at most 16"),
        ({"layers": ()}, "is given without layers"),
        ({"cell": "gru"}, "cell 'image' and layers go together"),
        ({"steps": 2, "touch_frames": 7}, "field steps"),
        ({"sample_bits": 16}, "field sample_bits: is 16 in a network for images, where it is always 8"),
        ({"taxels": 16}, "field taxels: is 16 .* always 9"),
        ({"rest": "initial", "rest_frames": 3}, "rest_level: is set, and images have none"),
        ({"logit_format": QFormat(4, 8)}, "field logit_format: is .*logits of images have 16 bits"),
        ({"weight_formats": ("SQ(1,7)",) * 3}, "field map_formats: has 0 formats and 2 layers"),
        ({**FORMATS, "weight_formats": ("SQ(1,5)",) * 3}, "use signed formats of 4 or 8 bits"),
        ({**FORMATS, "map_formats": ("SQ(1,7)",) * 2}, "use unsigned formats of 8 bits"),
        ({**FORMATS, "map_formats": ("UQ(-8,16)",) * 2}, "make a shift of -1 behind 'conv 3 4'"),
    ],
)
def test_what_cannot_be_a_network_is_refused_in_a_sentence(fields, words):
    with refused(words):
        tiny().replace(**fields)
