"""rtl/program/signature.py: the proof that every flip is seen names every bit of words that no step reads;
check words make the sum zero."""

from eskin.golden.core import PRESETS
from eskin.rtl.program.memory_map import Memory, memory_images
from eskin.rtl.program.microcode import Microcode
from eskin.rtl.program.schedule import schedule
from eskin.rtl.program.signature import WIDTH, reads, residue
from tests.support.random_models import random_integer_model
from tests.support.unseen import unseen


def test_every_bit_of_a_word_that_is_never_read_is_unseen():
    code = Microcode(schedule(PRESETS["thesis"].replace(checksum=True)))
    config, biases, weights = code.plan.config, len(code.plan.bias_rows), len(code.plan.weight_words)
    assert unseen(code, {"addend": biases + 1}) == [
        (("addend", biases), bit) for bit in range(config.accumulator_bits)
    ]
    assert unseen(code, {0: weights + 1}) == [((0, weights), bit) for bit in range(config.weight_bits)]
    # its step has no check word to read, nor a reason to read the constant 0
    without = Microcode(schedule(PRESETS["thesis"]))
    place = without.layout
    zero = place.gate("zero", 0) - place.constants
    missed = unseen(without, {"gate": place.constant_words})
    assert [bit for (_, address), bit in missed if address == zero] == list(range(WIDTH))


def test_check_words_bring_the_signature_to_zero_wherever_they_are_read():
    """On two DSP lanes 12 slots before the signature is judged; elsewhere mostly in the last one."""
    model = random_integer_model(PRESETS["thesis"].with_lanes(2, "dsp").replace(checksum=True), seed=3)
    code, images = Microcode(schedule(model.config)), memory_images(model.config, model.arrays)
    lengths, check = range(len(model.config.window_lengths)), code.layout.check_base
    assert all(
        age > 1 for length in lengths for age, read in reads(code, length) if read == ("gate", check | length)
    )
    images |= {"addend": images[Memory.ADDENDS], "gate": images[Memory.CONSTANTS]}
    assert all(residue(code, images, length) == 0 for length in lengths)


def test_an_idle_port_does_not_count_into_the_check_words():
    """One lane, 256 taxels: the constants' address counts on in long words, past where the constants begin."""
    config = PRESETS["thesis"].replace(taxels=256, lanes=1, hidden=9, checksum=True, feature_shift=())
    model = random_integer_model(config, 1)
    assert memory_images(model.config, model.arrays)
