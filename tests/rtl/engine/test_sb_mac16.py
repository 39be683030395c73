"""The DSP lane's behaviour against the SB_MAC16 that it becomes, on the vendor's cell model."""

import random
from pathlib import Path

from eskin.rtl.engine.lanes import lane_signature
from eskin.rtl.engine.sb_mac16 import DspLane
from tests.support.table import each_row
from tests.support.vendor_cells import SETTLED, differences, with_parameter

OPERATIONS = 1500


def operations(accumulates: bool, acc_bits: int) -> list[tuple[int, ...]]:
    """Random (tick, a, b, swap, load, valid), often at the ends of the formats; the schedule's promise
    is kept."""
    rng = random.Random(acc_bits)

    def number(bits: int) -> int:
        low, high = -(1 << bits - 1), (1 << bits - 1) - 1
        return (
            rng.choice([low, high, 0, -1, 1, rng.randint(low, high), rng.randint(low, high)])
            & (1 << bits) - 1
        )

    found = []
    for k in range(OPERATIONS):
        early = k < SETTLED
        swap = int(rng.random() < 0.2 or (early and accumulates))
        valid = int(early or rng.random() < 0.7) & ~(swap & accumulates)
        found.append(
            (int(early or rng.random() < 0.7), number(16), number(16), swap, number(acc_bits), valid)
        )
    return found


def of_a_lane(tmp_path: Path, accumulates: bool, acc_bits: int, **change) -> tuple[int, int]:
    """As of `differences`."""
    signature = lane_signature(16, 16, acc_bits, load_with_operands=not accumulates, accumulates=accumulates)
    inputs = {"tick": 1, "a": 16, "b": 16, "swap": 1, "load": acc_bits, "valid": 1}
    made, played = lambda: DspLane(signature), operations(accumulates, acc_bits)
    return differences(tmp_path, made, inputs, ("acc", acc_bits), played, **change)


@each_row("accumulates, acc_bits", [(True, 32), (False, 27)])
def test_the_block_does_what_the_behaviour_says(tmp_path, accumulates, acc_bits):
    differ, moved = of_a_lane(tmp_path, accumulates, acc_bits)
    assert differ == 0 and moved > OPERATIONS // 3


@each_row(
    "accumulates, parameter, wrong",
    [(True, "A_SIGNED", 0), (True, "TOPADDSUB_CARRYSELECT", 0), (False, "BOTADDSUB_LOWERINPUT", 1)],
)
def test_a_wrong_parameter_is_seen(tmp_path, accumulates, parameter, wrong):
    change = with_parameter(parameter, wrong)
    assert of_a_lane(tmp_path, accumulates, 32, change=change)[0] > OPERATIONS // 100
