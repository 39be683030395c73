"""The check words of image networks: every weight counts, and the places of taps equal the places of a loop written
out."""

from eskin.golden.core import NETWORKS
from eskin.rtl.program.image_signature import tap_places
from tests.rtl.program.test_image_passes import plan_of
from tests.support.image_case import random_case
from tests.support.table import each_row
from tests.support.unseen import unseen_weights


@each_row("seed", range(20))
def test_taps_lie_in_the_map_and_come_in_the_order_of_the_sums(seed):
    for part in random_case(seed, most_cycles=3000).plan.passes:
        wanted, group = [], -1
        for row, column, dy, dx in part.sums():
            group = 0 if (dy, dx) == (0, 0) and group == part.groups - 1 else group + ((dy, dx) == (0, 0))
            for i in range(part.kernel):
                for j in range(part.span):
                    if (
                        0 <= row + i - part.radius < part.rows
                        and 0 <= column + j - part.radius < part.columns
                    ):
                        first = ((group * part.kernel + i) * part.span + j) * part.channels
                        wanted += range(first, first + part.channels)
        assert tap_places(part).tolist() == wanted


@each_row("name", NETWORKS)
def test_no_weight_escapes_the_signature(name):
    for lanes in (4, 8, 16):
        assert not unseen_weights(plan_of(name, 28, 50, lanes)), lanes
