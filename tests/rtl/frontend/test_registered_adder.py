"""The adder as described against the SB_MAC16 that it becomes, on the vendor's cell model."""

import random
from pathlib import Path

from amaranth.back import rtlil

from eskin.golden.core import PRESETS
from eskin.rtl.engine.sb_mac16 import ICE40
from eskin.rtl.frontend.front_end import FrontEnd
from eskin.rtl.frontend.registered_adder import BLOCK_BITS, RegisteredAdder
from tests.support.random_models import random_integer_model
from tests.support.table import each_row
from tests.support.vendor_cells import SETTLED, differences, with_parameter

OPERATIONS = 1000
CONFIG = PRESETS["thesis"].with_lanes(1, "dsp")


def of_the_adder(tmp_path: Path, carry: int = 1, **change) -> tuple[int, int]:
    """As of `differences`."""
    bits, rng = BLOCK_BITS, random.Random(3)
    ends = (0, 1, (1 << bits - 1) - 1, 1 << bits - 1, (1 << bits) - 1)

    def number() -> int:
        return rng.choice([*ends, *(rng.getrandbits(bits) for _ in ends)])

    played = [
        (int(k < SETTLED or rng.random() < 0.7), rng.randint(0, 1), number(), number())
        for k in range(OPERATIONS)
    ]

    def make() -> RegisteredAdder:
        return RegisteredAdder(CONFIG, bits, carry=carry)

    inputs = {"step": 1, "alone": 1, "word": bits, "addend": bits}
    return differences(tmp_path, make, inputs, ("total", bits), played, **change)


@each_row("carry", [0, 1])
def test_the_block_does_what_the_behaviour_says(tmp_path, carry):
    differ, moved = of_the_adder(tmp_path, carry)
    assert differ == 0 and moved > OPERATIONS // 3


@each_row("parameter, wrong", [("TOPADDSUB_CARRYSELECT", 0), ("BOTOUTPUT_SELECT", 0)])
def test_a_wrong_parameter_is_seen(tmp_path, parameter, wrong):
    assert of_the_adder(tmp_path, change=with_parameter(parameter, wrong))[0] > OPERATIONS // 100


@each_row(
    "lanes, lane_type, platform, blocks",
    [
        (1, "dsp", ICE40, 2),
        (5, "dsp", ICE40, 2),
        (6, "dsp", ICE40, 1),
        (7, "dsp", ICE40, 0),
        (1, "dsp", None, 0),
    ],
)
def test_only_where_a_block_is_idle(lanes, lane_type, platform, blocks):
    front_end = FrontEnd(random_integer_model(CONFIG.with_lanes(lanes, lane_type), 1).config)
    assert rtlil.convert(front_end, platform=platform).count("cell \\SB_MAC16") == blocks
