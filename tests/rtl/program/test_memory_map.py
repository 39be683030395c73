"""Memory images: every weight in the place the schedule reads, addends with bias and rounding half, the
writes that load them."""

from eskin.golden.core import PRESETS
from eskin.rtl.program.memory_map import mask_words


def test_mask_words_have_a_bit_for_each_masked_taxel():
    config = PRESETS["thesis"].replace(taxels=33, feature_shift=(), masked_taxels=(32, 0, 17, 16, 15))
    assert mask_words(config) == [0x8001, 0x0003, 0x0001] and mask_words(
        config.replace(masked_taxels=())
    ) == [0, 0, 0]
