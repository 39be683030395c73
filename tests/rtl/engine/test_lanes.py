"""Every lane type against plain arithmetic: which slot takes operands, addend and controls, and when the sum
is there."""

import random

import pytest
from amaranth.hdl import Fragment

from eskin.golden.core import PRESETS
from eskin.rtl.engine.lanes import LANE_TYPES, lane_signature, make_lane
from eskin.rtl.engine.sb_mac16 import DspLane
from eskin.rtl.program.timing import Timing
from tests.support.stream_bench import simulate
from tests.support.table import each_row

A_BITS, B_BITS, ACC_BITS = 16, 8, 30
KINDS = [
    ("plain", False, True),
    ("plain", True, True),
    ("plain", True, False),
    ("dsp", False, True),
    ("dsp", True, False),
]
"""(lane type, load_with_operands, accumulates), as the engine uses them."""


def config_of(lane_type: str):
    return PRESETS["thesis"].replace(lane_type=lane_type)


def ends(rng: random.Random, bits: int) -> int:
    low, high = -(1 << bits - 1), (1 << bits - 1) - 1
    return rng.choice([low, high, 0, -1, 1, rng.randint(low, high), rng.randint(low, high)])


def dot_products(seed: int, count: int, most: int) -> list[tuple[int, list[tuple[int, int] | None]]]:
    """(addend, operands) of sums that stay within ACC_BITS; None: a slot without a product. A sum of one
    product for ``most`` 1."""
    rng = random.Random(seed)
    found = []
    for _ in range(count):
        terms = [(ends(rng, A_BITS), ends(rng, B_BITS)) for _ in range(rng.randint(1, most))]
        if most > 1:
            terms = [part for term in terms for part in ([None] * (rng.random() < 0.3) + [term])]
        found.append((ends(rng, ACC_BITS - 3), terms))
    return found


def play(lane_type: str, with_operands: bool, accumulates: bool, sums, gap_of_ticks=lambda: 0):
    """The sums as the lane gives them, each in the slot that the timing names and in no earlier one."""
    when = Timing(config_of(lane_type))
    dut = make_lane(
        config_of(lane_type),
        lane_signature(A_BITS, B_BITS, ACC_BITS, load_with_operands=with_operands, accumulates=accumulates),
    )
    assert type(dut) is LANE_TYPES[lane_type]
    gap = when.gap if accumulates else 0
    slots: dict[int, dict[str, int]] = {}
    checks: dict[int, int] = {}
    issue = 0
    for addend, terms in sums:
        issue += gap
        swap = issue + when.added - gap
        slots.setdefault(swap, {}).update(swap=1)
        slots.setdefault(issue + 1 if with_operands else swap, {}).update(load=addend)
        total = addend
        for term in terms:
            if term is not None:
                slots.setdefault(issue + 1, {}).update(a=term[0], b=term[1])
                slots.setdefault(issue + when.valid, {}).update(valid=1)
                total += term[0] * term[1]
                checks[issue + when.acc] = total
            issue += 1
    seen = {}
    rng = random.Random(9)

    async def bench(ctx):
        for number in range(max(checks) + 1):
            fields = slots.get(number, {})
            # what no slot asks for is rubbish, not zero
            rubbish = {"a": rng.randint(-999, 999), "b": rng.randint(-99, 99), "load": rng.randint(-999, 999)}
            fields = rubbish | {"swap": 0, "valid": 0} | fields
            for name, value in fields.items():
                ctx.set(getattr(dut, name), value)
            length = 1 + gap_of_ticks()
            for cycle in range(length):
                ctx.set(dut.tick, cycle == length - 1)
                if cycle == length - 1:
                    seen[number] = ctx.get(dut.acc)
                await ctx.tick()

    simulate(dut, bench)
    assert {number: seen[number] for number in checks} == checks
    return seen, checks


@each_row("gaps", [(0,), (0, 0, 1, 5)])
@each_row(("lane_type", "with_operands", "accumulates"), KINDS)
def test_sums_are_exact_and_there_in_their_slot(lane_type, with_operands, accumulates, gaps):
    """Slots of one cycle and of any number; sums that begin at either end of the accumulator first."""
    ends = [(end, [(0, 0)]) for end in (-(1 << ACC_BITS - 1), (1 << ACC_BITS - 1) - 1)]
    sums, rng = ends + dot_products(3, 60, 6 if accumulates else 1), random.Random(4)
    seen, checks = play(lane_type, with_operands, accumulates, sums, lambda: rng.choice(gaps))
    early = [number for number, total in checks.items() if seen[number - 1] != total]
    assert len(early) > 0.5 * len(checks), "the sum is there a slot sooner than the timing says"


def test_a_dsp_lane_is_no_wider_than_its_block():
    wide = lane_signature(16, 16, 33, load_with_operands=False)
    with pytest.raises(ValueError, match="16-bit operands and 32 bits of sum, not 16 x 16 and 33"):
        Fragment.get(DspLane(wide), None)
