"""Cycles of the published networks on so many lanes, by the formula that the other tests hold the hardware
to."""

from eskin.golden.core import QFormat
from eskin.golden.core.images import SIZES, layer_stages, network
from eskin.rtl.program.image_passes import ImagePlan
from tests.support.table import each_row


def plan_of(name: str, height: int, width: int, lanes: int) -> ImagePlan:
    stages = layer_stages(height, width, network(name, 22))
    shifts = (8,) * sum(1 for stage in stages if stage.weights)
    return ImagePlan(stages, weight_bits=8, shifts=shifts, logit_format=QFormat(16, 0), lanes=lanes)


@each_row("lanes, most", [(4, 1.05), (8, 1.05), (16, 1.15)])
def test_tactnet_at_each_of_its_sizes_takes_little_more_than_its_multiplies(lanes, most):
    for height, width in SIZES:
        plan = plan_of("tactnet", height, width, lanes)
        assert plan.cycles <= most * plan.multiplies / lanes, (height, width)


def test_a_convolution_works_in_pairs_where_half_of_the_lanes_would_rest():
    pairs = {lanes: [part.pairs for part in plan_of("tactnet", 28, 50, lanes).passes] for lanes in (8, 16)}
    assert pairs == {8: [False] * 4, 16: [True, False, False, False]}
