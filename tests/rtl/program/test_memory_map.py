"""Memory images: every weight in the place the schedule reads, addends with bias and rounding half, the
writes that load them."""

from eskin.golden.core import PRESETS
from eskin.rtl.program.memory_map import mask_words
from eskin.rtl.program.signature import with_parity


def test_a_checked_word_has_an_even_number_of_ones_and_its_own_bits():
    bits = 32
    for mean in (0, 1, -1, 3, -4, 123456, -123457):
        word = with_parity(mean, bits - 1)
        assert (word - mean) % (1 << bits - 1) == 0 and 0 <= word < 1 << bits and word.bit_count() % 2 == 0


def test_mask_words_have_a_bit_for_each_masked_taxel():
    config = PRESETS["thesis"].replace(taxels=33, feature_shift=(), masked_taxels=(32, 0, 17, 16, 15))
    assert mask_words(config) == [0x8001, 0x0003, 0x0001] and mask_words(
        config.replace(masked_taxels=())
    ) == [0, 0, 0]
