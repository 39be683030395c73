"""Memory images: every weight in the place the schedule reads, addends with bias and rounding half, the
writes that load them."""

from eskin.golden.core import PRESETS
from eskin.rtl.program.memory_map import (
    Memory,
    Register,
    load_words,
    load_writes,
    mask_words,
    mean_word,
    memory_images,
)
from tests.support.random_models import random_integer_model
from tests.support.table import each_row


def test_a_checked_mean_has_an_even_number_of_ones_and_its_own_bits():
    config = PRESETS["thesis"].replace(checksum=True)
    bits = 16 * config.mean_words
    for mean in (0, 1, -1, 3, -4, 123456, -123457):
        word = mean_word(config, mean)
        assert (word - mean) % (1 << bits - 1) == 0 and 0 <= word < 1 << bits and word.bit_count() % 2 == 0


def test_mask_words_have_a_bit_for_each_masked_taxel():
    config = PRESETS["thesis"].replace(taxels=33, feature_shift=(), masked_taxels=(32, 0, 17, 16, 15))
    assert mask_words(config) == [0x8001, 0x0003, 0x0001] and mask_words(
        config.replace(masked_taxels=())
    ) == [0, 0, 0]


@each_row(("bits", "words"), [(16, 2), (4, 1)])
def test_load_writes_carry_the_images_word_by_word(bits, words):
    band = {"band_low": 2, "band_high": 12} if bits == 4 else {}
    config = PRESETS["thesis"].replace(masked_taxels=(0, 15), sample_bits=bits, **band)
    assert config.mean_words == words
    model = random_integer_model(config, seed=1)
    memories: dict[int, dict[int, int]] = {}
    select = address = None
    masks = []
    for register, word in load_writes(model.config, model.arrays):
        assert 0 <= word < 1 << 16
        if register == Register.MEMORY_SELECT:
            select, address = word, 0
        elif register == Register.MEMORY_DATA:
            memories.setdefault(select, {})[address] = word
            address += 1
        else:
            masks.append((register, word))
    assert masks == [(Register.MASK, 1 << 15 | 1)]
    for select, image in memory_images(model.config, model.arrays).items():
        halves = {Memory.ADDENDS: 2, Memory.MEANS: config.mean_words}.get(select, 1)
        assert len(memories[select]) == halves * len(image) <= load_words(model.config)
        for k, word in enumerate(image):
            loaded = sum(memories[select][halves * k + half] << 16 * half for half in range(halves))
            assert loaded == word % (1 << 16 * halves)
