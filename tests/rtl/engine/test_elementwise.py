"""Element-wise operations of states stay within the largest of tanh; their values are the engine's (test_engine.py)."""

from itertools import product

from eskin.golden.core import PRESETS, QFormat, narrow, tanh_table


def test_a_blend_of_states_stays_within_the_largest_of_tanh():
    """Every two states of narrow formats with every gate, by section 8's rounding: no state needs saturation."""
    config = PRESETS["thesis"].replace(
        state_format=QFormat(2, 4),
        gate_frac=4,
        table_entries=64,
        feature_format=QFormat(4, 4),
        weight_format=QFormat(3, 5),
        recurrent_format=QFormat(3, 5),
        bias_format=QFormat(3, 5),
        logit_format=QFormat(4, 4),
        dense_bias_format=QFormat(3, 5),
    )
    largest, one = int(tanh_table(config).max()), config.gate_one
    states = range(-largest, largest + 1)
    for s, n, z in product(states, states, range(one + 1)):
        assert abs(narrow((n << 4) + (s - n) * z, 4, config.formats.state_format)) <= largest
