"""Configurations that the hardware cannot hold are refused."""

from __future__ import annotations

import pytest

from golden.config import PRESETS
from golden.errors import InputError
from golden.formats import QFormat

FINE = dict(weight_format=QFormat(1, 7), feature_format=QFormat(4, 8), recurrent_format=QFormat(4, 4))


def test_states_whose_differences_exceed_the_operand_are_refused():
    """formal/elementwise.py proves the operand exact for up to 14 fraction bits; with 15 it gave -5536 for 30000 - -30000."""
    PRESETS["thesis"].replace(state_format=QFormat(2, 14), **{**FINE, "feature_format": QFormat(4, 8)})
    with pytest.raises(InputError, match="field state_format: .* differences of states"):
        PRESETS["thesis"].replace(state_format=QFormat(1, 15), **FINE)
    assert PRESETS["thesis"].replace(cell="lstm", state_format=QFormat(1, 15), **FINE).operand_bits == 16


def test_a_weight_word_is_as_wide_as_the_widest_of_the_three_formats():
    for name in ("weight_format", "recurrent_format", "dense_format"):
        assert PRESETS["thesis"].replace(**{name: QFormat(4, 5)}).weight_bits == 9 > PRESETS["thesis"].weight_bits


def test_the_element_wise_accumulator_holds_its_operands_at_their_ends():
    """A window sum by a scale, and two gates by two states, each with the rounding half."""
    for state in (QFormat(2, 8), QFormat(2, 12), QFormat(4, 12)):
        config = PRESETS["thesis"].replace(state_format=state)
        top = (1 << config.elementwise_bits - 1) - 1
        half = config.gate_one >> 1
        assert config.centred_format.magnitude * config.scale_format.magnitude + half <= top
        assert 2 * state.magnitude * config.gate_one + half <= top
