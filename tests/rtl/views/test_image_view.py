"""The schedule of a network for images: rows add up to the formula, files are written, slots follow one
another."""

from itertools import pairwise

from eskin.golden.core import QFormat
from eskin.golden.core.images import layer_stages, network
from eskin.rtl.program.image_passes import ImagePlan
from eskin.rtl.views import image_view

STAGES = layer_stages(28, 50, network("tactnet", 22))
PLAN = ImagePlan(STAGES, weight_bits=8, shifts=(8,) * 4, logit_format=QFormat(6, 10), lanes=8)


def test_rows_add_up_to_the_formula():
    *passes, whole = image_view.rows(PLAN)
    assert [row["multiplies"] for row in passes] == [280000, 403200, 419328, 19712]
    assert whole["cycles"] == PLAN.cycles and whole["multiplies"] == PLAN.multiplies == 1122240
    assert whole["taps"] < whole["multiplies"] / 8 < whole["cycles"] * 1.1
    assert whole["ratio"] <= 0.95, "padding skipped"
    assert all(len(cells) == len(image_view.COLUMNS) for cells in image_view.cells(PLAN))


def test_slots_leave_room_for_what_goes_on_beside_them():
    for part in PLAN.passes:
        slots = list(part.slots(8))
        for slot, following in pairwise(slots):
            assert following.begin - slot.begin >= max(slot.taps + 1, 8 + 1)
        rows, columns, _ = part.result
        outputs = part.groups * part.rows * part.columns
        assert (
            len(slots) == outputs + 2 and rows * columns * (4 if part.pool else 1) >= part.rows * part.columns
        )
