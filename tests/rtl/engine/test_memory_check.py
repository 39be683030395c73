"""The checksum: every bit of every constant bears on it, it costs no slot, it flags wrong constants and nothing
else."""

import random

import pytest

from eskin.golden.core import PRESETS
from eskin.rtl.engine.memory_check import MemoryCheck
from eskin.rtl.program.memory_map import Fault, Memory, Register, load_writes, memory_images, words_per_entry
from eskin.rtl.program.microcode import Microcode
from eskin.rtl.program.schedule import schedule
from eskin.rtl.program.signature import START, WIDTH, advance, fold, parity, reads, retreat
from tests.rtl.top.test_accelerator import CONFIGS, play, recordings
from tests.support.random_models import random_integer_model
from tests.support.stream_bench import put, simulate
from tests.support.table import each_row
from tests.support.unseen import unseen


def checked(name: str, **changes):
    return CONFIGS[name].replace(checksum=True, watchdog=True, **changes)


def constant_counts(config, code) -> dict[str | int, int]:
    counts: dict[str | int, int] = {
        lane: len(code.plan.weight_words) for lane in range(config.hardware.lanes)
    }
    return counts | {"addend": len(code.plan.bias_rows), "gate": code.layout.constant_words}


@each_row("lane_type", ["plain", "dsp"])
@each_row("cell, reset", [("gru", "before"), ("gru", "after"), ("lstm", "before")])
def test_no_single_flip_leaves_the_signature_and_no_slot_or_word_is_added(cell, reset, lane_type):
    """Proven for every bit of weights, biases and constants, not sampled."""
    for preset, lanes in zip(("thesis", "pvdf"), (1, 4)[:: 1 if lane_type == "plain" else -1], strict=True):
        plain = PRESETS[preset].replace(cell=cell, reset=reset, lanes=lanes, lane_type=lane_type)
        config = plain.replace(checksum=True)
        code = Microcode(schedule(config))
        before = Microcode(schedule(plain))
        assert (len(code.words), len(code.slots)) == (len(before.words), len(before.slots)), (preset, lanes)
        assert unseen(code, constant_counts(config, code)) == [], (preset, lanes)
        if code.plan.shared:
            assert ("addend", code.plan.half_address) in {read for _, read in reads(code, 0)}


@each_row("cell, lanes", [("gru", 1), ("gru", 4), ("linear", 4)])
def test_every_kind_of_word_that_a_step_reads_bears_on_the_flag_and_no_other(cell, lanes):
    """A step's slots with the words that it reads and noise where it reads none; then with one change."""
    model = random_integer_model(
        PRESETS["thesis"].replace(hidden=4).replace(cell=cell, lanes=lanes, checksum=True), seed=3
    )
    code, images = Microcode(schedule(model.config)), memory_images(model.config, model.arrays)
    images |= {"addend": images[Memory.ADDENDS], "gate": images[Memory.CONSTANTS]}
    found = {  # words, by the slot in which they come
        (code.judged - 1 - age, memory): images[memory][address] for age, (memory, address) in reads(code, 0)
    }
    words, apart = [*code.unrolled()], code.plan.shared and code.plan.program.gate_regions
    gates = [  # slots in which a gate's word comes from a separate memory
        slot
        for slot in range(code.again + 1, code.judged + 1)
        if apart and words[slot - 1]["gate"] < code.layout.constants
    ]
    dut, rng, bits = MemoryCheck(code), random.Random(lanes), model.config.weight_bits

    async def body(ctx):
        async def flags(*wrong, operand=0, blank=-1) -> list[int]:
            """Slots with a flag. wrong: place of a word with a wrong bit; blank: slot in which a gate is added to."""
            seen = []
            for slot, word in enumerate(words):
                come = {
                    memory: found.get((slot, memory), rng.getrandbits(16))
                    for memory in (*range(lanes), "addend", "gate")
                }
                if slot == (wrong or [-1])[0]:
                    come[wrong[1]] ^= 1 << rng.randrange(bits)
                weights = [come.pop(lane) % (1 << bits) << lane * bits for lane in range(lanes)]
                zero = operand if slot == code.judged else rng.getrandbits(16)
                added = slot == blank if slot in gates else rng.getrandbits(16)
                controls = {name: word[name] for name, _ in dut.word.shape()}
                put(
                    ctx, dut, enable=0, word=controls, weights=sum(weights), operand=zero, blank=added, **come
                )
                await ctx.tick()
                seen += [slot] * ctx.get(dut.fault)
                ctx.set(dut.enable, 1)
                await ctx.delay(0)
                seen += [slot] * ctx.get(dut.fault)
                await ctx.tick()
            return seen

        assert await flags() == []
        places = {memory: slot for slot, memory in found if slot % 2}
        for memory, slot in places.items():
            assert await flags(slot, memory) == [code.judged], memory
        assert await flags(operand=1 << 15) == [code.judged]
        for slot in gates[:1] + gates[-1:]:
            assert await flags(blank=slot) == [slot]

    simulate(dut, body)


def touch_data(config, frames: int = 110):
    data = recordings(config, 3, [frames])
    data.samples[20:, 2] = 3000  # a touch from frame 21 on
    return data


@pytest.mark.parametrize("select, word, bit", [(1, 3, 7), (Memory.MEANS, 0, 1)])
def test_a_word_that_is_not_the_image_s_is_flagged_before_the_global_decision(select, word, bit):
    config = checked("thesis", rearm_frames=60)
    model = random_integer_model(config, seed=3)
    failed: list[list[int]] = []
    wrong: list[tuple[int, int]] = []
    current, place = 0, 0
    for register, value in load_writes(model.config, model.arrays):
        if register == Register.MEMORY_SELECT:
            current, place = value, 0
        elif register == Register.MEMORY_DATA:
            value ^= (1 << bit) if (current, place) == (select, word * words_per_entry(config, select)) else 0
            place += 1
        wrong.append((register, value))
    assert wrong != load_writes(model.config, model.arrays)
    streams, statuses = play(
        model,
        touch_data(config),
        writes=wrong,
        prepare=lambda bench: failed.append(bench.watch(bench.dut.control.check_failed)),
    )
    ends = [beat.cycle for beat in streams["beats"] if beat.value["is_global"]]
    assert statuses[0][1] & Fault.CHECKSUM and failed[0][0] < ends[0]


def faults(model, writes) -> int:
    """FAULTS behind a touch, on memories filled by ``writes``."""
    return play(model, touch_data(model.config), writes=writes)[1][0][1]


def test_a_reload_word_by_word_raises_no_flag_and_a_half_one_does():
    """Between the write of a word and of its check word no touch passes: nothing is judged. When one begins
    before, it is."""
    config = checked("thesis", rearm_frames=60)
    model, other = random_integer_model(config, seed=3), random_integer_model(config, seed=4)
    first, second = load_writes(model.config, model.arrays), load_writes(other.config, other.arrays)
    chosen = [write for write in second if write[0] == Register.MEMORY_SELECT]  # and no word
    assert first != second and not faults(other, [*first, *second, *chosen]) & Fault.CHECKSUM
    half = second[: len(second) // 2]
    assert faults(other, [*first, *half]) & Fault.CHECKSUM
    assert faults(other, []) & Fault.CHECKSUM  # nothing was ever loaded


def test_the_register_runs_through_every_value_and_back():
    value, seen = START, 0
    while True:
        assert retreat(advance(value)) == value
        value, seen = advance(value), seen + 1
        if value == START:
            break
    assert seen == (1 << WIDTH) - 1
    assert (
        fold(-1, 20) == 0xFFFF ^ 0xF
        and fold(0x1234_5678, 32) == 0x1234 ^ 0x5678
        and parity(-1, 3) == 1
        and parity(0b1010, 4) == 0
    )
