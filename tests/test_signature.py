"""The proof that every single flip is seen, on words that no step reads: it names every bit of them."""

from __future__ import annotations

from golden.config import PRESETS
from rtl.microcode import Microcode
from rtl.schedule import schedule
from rtl.signature import WIDTH, unseen


def test_every_bit_of_a_word_that_is_never_read_is_unseen():
    code = Microcode(schedule(PRESETS["thesis"].replace(checksum=True)))
    config, biases, weights = code.plan.config, len(code.plan.bias_rows), len(code.plan.weight_words)
    assert unseen(code, {"addend": biases + 1}) == [(("addend", biases), bit) for bit in range(config.accumulator_bits)]
    assert unseen(code, {0: weights + 1}) == [((0, weights), bit) for bit in range(config.weight_bits)]
    without = Microcode(schedule(PRESETS["thesis"]))  # its step has no check word to read, nor a reason to read the constant 0
    place = without.layout
    zero = place.gate("zero", 0) - place.constants
    missed = unseen(without, {"gate": place.constant_words})
    assert [bit for (_, address), bit in missed if address == zero] == list(range(WIDTH))
