"""The image engine against the golden model, value by value, and against its cycle formula, on random
networks."""

import random

import pytest

from eskin.rtl.common import image_lines
from eskin.rtl.engine.lanes import LANE_TYPES
from eskin.rtl.image.image_engine import ImageEngine
from eskin.rtl.program.image_signature import BIAS_WORD_BITS
from eskin.rtl.program.memory_map import ImageMemory, image_memories
from eskin.rtl.program.signature import with_parity
from tests.support.image_case import ImageCase, make_case, random_case
from tests.support.stream_bench import put, simulate


def run(case: ImageCase, lane_type: str, images: int = 2, wrong: tuple[int, int, int] | None = None) -> int:
    """Load the network, compute images one after the other (the maps of an image are the next one's random
    contents), compare all. With ``wrong``, (memory, word, bit) that is loaded inverted, compare nothing.
    Returns how often a word was found wrong, and before the last logit."""
    plan, computed, found = case.plan, 0, 0
    dut, lines = ImageEngine(plan, lane_type), image_lines(plan)

    async def bench(ctx):
        nonlocal computed, found
        ctx.set(dut.load.enable, 1)
        for select, words in image_memories(plan, case.arrays).items():
            if wrong and wrong[0] == select:
                words[wrong[1]] ^= 1 << wrong[2]
            ctx.set(dut.load.select, 1 << lines[select])
            halves = 2 if select == ImageMemory.BIASES else 1
            for address, word in enumerate(
                word >> 16 * half & 0xFFFF for word in words for half in range(halves)
            ):
                put(ctx, dut.load, address=address, data=word)
                await ctx.tick()
        ctx.set(dut.load.enable, 0)
        for number in range(images):
            image = case.image(number)
            ctx.set(dut.fill.valid, 1)
            for address, value in enumerate(image.ravel()):
                put(ctx, dut.fill, address=address, value=int(value))
                await ctx.tick()
            ctx.set(dut.fill.valid, 0)
            ctx.set(dut.start, 1)
            maps, logits, cycles, last_logit = [], [], 0, 0
            while True:
                if ctx.get(dut.map.valid):
                    maps.append(ctx.get(dut.map.value))
                if ctx.get(dut.logit.valid):
                    logits.append(ctx.get(dut.logit.value))
                    last_logit = cycles
                if ctx.get(dut.check_failed):
                    found += len(logits) < plan.stages[-1].outputs
                if ctx.get(dut.done) or (wrong and cycles > 3 * plan.cycles):
                    break
                await ctx.tick()
                ctx.set(dut.start, 0)
                cycles += 1
                assert wrong or cycles <= plan.cycles, "longer than the formula says"
            if wrong:
                return
            assert (maps, logits) == case.expected(image)
            assert (cycles, last_logit) == (plan.cycles, plan.logit_cycles)
            await ctx.tick()
            assert not ctx.get(dut.busy)
            computed += 1

    simulate(dut, bench)
    assert computed == (0 if wrong else images) and (wrong or not found)
    return found


CORNERS = {
    "kernel larger than the map": (1, 1, ["conv 5 3", "dense 3"], 2, 8),
    "narrow map, odd pool, last group of one": (
        3,
        2,
        ["conv 5 9", "pool", "conv 3 5", "pool", "dense 5"],
        8,
        8,
    ),
    "one lane, conv on conv, two dense": (3, 5, ["conv 3 3", "conv 3 2", "pool", "dense 5", "dense 3"], 1, 8),
    "four bits on eight lanes": (5, 4, ["conv 3 6", "pool", "dense 9"], 8, 4),
    "four bits on one lane: eight taps a word": (2, 3, ["dense 3", "dense 2"], 1, 4),
    "pairs, odd rows and columns, then channels on all lanes": (
        5,
        7,
        ["conv 5 4", "pool", "conv 3 8", "pool", "dense 3"],
        8,
        8,
    ),
    "pairs behind pairs, a map of one column": (
        4,
        1,
        ["conv 3 2", "pool", "conv 1 2", "pool", "dense 2"],
        4,
        8,
    ),
    "pairs on sixteen lanes": (3, 4, ["conv 3 8", "pool", "dense 5"], 16, 4),
}


@pytest.mark.parametrize("name", CORNERS)
def test_corners(name):
    height, width, layers, lanes, weight_bits = CORNERS[name]
    run(make_case(height, width, layers, lanes=lanes, weight_bits=weight_bits), "plain")


def test_logits_beyond_their_format_are_saturated():
    """Sums up to the ends of the accumulator."""
    case = make_case(5, 5, ["dense 12"], lanes=4, logit_shift=0)
    case.arrays["b_0"][4:] = [-1 << 23, (1 << 23) - 1] * 4
    run(case, "plain")


@pytest.fixture(scope="module")
def checked() -> ImageCase:
    """Pairs, two groups, a dense layer of half of the lanes."""
    return make_case(3, 4, ["conv 3 4", "pool", "conv 1 16", "dense 5"], lanes=8, checksum=True)


@pytest.mark.parametrize("seed", range(4))
def test_a_wrong_bit_of_any_memory_is_seen_before_the_last_logit(checked, seed):
    rng, images = random.Random(seed), image_memories(checked.plan, checked.arrays)
    for select, words in list(images.items())[seed % len(images) :: 4]:
        bits = with_parity(-1, BIAS_WORD_BITS).bit_length() if select == ImageMemory.BIASES else 16
        wrong = (select, rng.randrange(len(words)), rng.randrange(bits))
        assert run(checked, "plain", 1, wrong), wrong


def test_the_checksum_changes_no_cycle_and_sees_no_fault_where_none_is(checked):
    run(checked, "dsp")
    assert (
        checked.plan.cycles
        == make_case(3, 4, ["conv 3 4", "pool", "conv 1 16", "dense 5"], lanes=8).plan.cycles
    )


@pytest.mark.parametrize("seed", range(3))
def test_random_networks_on_both_lanes(seed):
    for lane_type in LANE_TYPES:
        run(random_case(seed, most_cycles=700), lane_type)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 130))
def test_many_random_networks(seed):
    run(random_case(seed, most_cycles=4000), ("plain", "dsp")[seed % 2])
