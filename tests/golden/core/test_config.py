"""Configurations that the hardware cannot hold are refused."""

import json

from eskin.golden.core import PRESETS, AcceleratorConfig, QFormat, signed_bits
from eskin.training.formats import with_network
from tests.support.table import each_row, refused

FINE = dict(weight_format=QFormat(1, 7), feature_format=QFormat(4, 8), recurrent_format=QFormat(4, 4))


def test_states_whose_differences_exceed_the_operand_are_refused():
    """tests/rtl/engine/test_elementwise.py tries the ends of up to 14 fraction bits; with 15 the operand was
    -5536 for 30000 - -30000."""
    PRESETS["thesis"].replace(state_format=QFormat(2, 14), **{**FINE, "feature_format": QFormat(4, 8)})
    with refused("field state_format: .* differences of states"):
        PRESETS["thesis"].replace(state_format=QFormat(1, 15), **FINE)
    assert PRESETS["thesis"].replace(cell="lstm", state_format=QFormat(1, 15), **FINE).operand_bits == 16


def test_the_element_wise_accumulator_holds_its_operands_at_their_ends():
    """A window sum by a scale, and two gates by two states, each with the rounding half."""
    for state in (QFormat(2, 8), QFormat(2, 12), QFormat(4, 12)):
        config = PRESETS["thesis"].replace(state_format=state)
        top = (1 << config.elementwise_bits - 1) - 1
        half = config.gate_one >> 1
        assert config.centred_format.magnitude * config.scale_format.magnitude + half <= top
        assert 2 * state.magnitude * config.gate_one + half <= top


@each_row("cell", ["gru", "lstm", "linear"])
@each_row("bits", [6, 8, 12])
def test_the_row_accumulator_holds_the_worst_vector_and_a_bit_less_does_not(cell, bits):
    """Every operand at the end of its format that is largest, all signs agreeing, added up one by one."""
    words = dict.fromkeys(("weight_format", "recurrent_format", "dense_format"), QFormat(bits - 4, 4))
    config = with_network(PRESETS["pvdf"], cell=cell).replace(**words, lane_type="plain")
    c, feature = config.formats, config.formats.feature_format.min_code << config.feature_align
    state, operands = c.state_format.min_code, [c.state_format.min_code] * config.network.hidden
    gate: list[int] = []
    if cell == "linear":
        operands = [c.feature_format.min_code] * config.inputs * config.windows.steps
    else:
        gate = [c.weight_format.min_code * feature] * config.inputs
        gate += [c.recurrent_format.min_code * state] * config.network.hidden
        gate += [-c.bias_format.min_code << config.bias_shift]
        gate += [1 << max(config.sigmoid_shift, config.tanh_shift, config.value_shift) - 1]
    dense = [c.dense_format.min_code * operand for operand in operands]
    dense += [-c.dense_bias_format.min_code << config.dense_bias_shift, 1 << config.logit_shift - 1]
    assert config.accumulator_bits == max(18, signed_bits(max(sum(gate), sum(dense))))


@each_row(
    "changes, words",
    [
        (dict(lanes=1, lane_type="serial"), "lane_type: is 'serial'; give one of plain, dsp"),
        # as a sum of powers of two, twice taxel 1 was taxel 2
        (dict(masked_taxels=(1, 1)), "masked_taxels: names a taxel twice"),
    ],
)
def test_what_cannot_be_built_is_refused(changes, words):
    with refused(f"field {words}"):
        PRESETS["thesis"].replace(**changes)


@each_row(
    "values, words",
    [
        ({"network": {"class_names": "abc"}}, "field class_names: .*is 'abc'; give a list"),
        ({"network": {"class_names": ["a", 2]}}, "field class_names: .*give text"),
        (
            {"network": {"class_names": [str(k) for k in range(129)]}},
            "field class_names: .*has 129 names; a classifier has 2 to 128",
        ),
        ({"sensor": {"masked_taxels": [1.5]}}, r"field masked_taxels: .*is \[1.5\]; give whole numbers"),
        ({"sensor": {"sample_rate_hz": True}}, "field sample_rate_hz: .*is True; give a finite number"),
        ({"sensor": {"sample_rate_hz": float("nan")}}, "field sample_rate_hz: .*give a finite number"),
        ({"sensor": {"volt_per_code": -1}}, "field volt_per_code: .*is -1; it must be at least 0"),
        ({"sensor": {"taxels": 0}}, "field taxels: .*it must lie in 1..256"),
        ({"hardware": {"clock_hz": 0}}, "field clock_hz: .*it must be above 0"),
        ({"hardware": {"loadable": 1}}, "field loadable: .*give true or false"),
        ({"network": {"cell": "rnn"}}, "field cell: .*give one of gru, lstm"),
        ({"formats": {"table_entries": 100}}, "field table_entries: .*give one of 64, 128, 256, 512, 1024"),
        ({"formats": {"weight_format": "Q3.5"}}, "field weight_format: .*SQ"),
        (
            {"formats": {"weight_format": "SQ(10,10)"}},
            "field weight_format: .*use a signed format of 2 to 16 bits",
        ),
        ({"name": "old", "taxels": 8}, "unknown group taxels; known groups are sensor"),
        ({"sensors": {}}, "unknown group sensors; known groups are sensor, rest_level"),
        ({"sensor": {"hidden": 8}}, "group sensor: unknown field hidden; known fields are taxels"),
        ({"sensor": [8]}, "group sensor: must be a JSON object"),
        ([], "holds no configuration"),
        ({"name": 3}, "field name: is 3; give up to 100 printable letters"),
        *(
            ({"name": name}, "field name: is .*without / and")
            for name in ("../x", "a\\b", "a\nb", "a\0", "\u202egnp", "\ud800", "x" * 101)
        ),
    ],
)
def test_a_file_of_another_form_or_with_a_wrong_value_is_refused_in_a_sentence(tmp_path, values, words):
    file = tmp_path / "mine.json"
    file.write_text(json.dumps(values))
    with refused(f"mine.json.*{words}"):
        AcceleratorConfig.load(file)


def test_a_configuration_survives_its_file_and_its_flat_fields():
    image = AcceleratorConfig.of_image(7, 9, ("conv 3 4", "pool", "dense 2"), ("a", "b"))
    quantised = image.replace(weight_formats=("SQ(1,7)",) * 2, map_formats=("UQ(2,6)",))
    for preset in (*PRESETS.values(), quantised):
        assert AcceleratorConfig.from_dict(json.loads(preset.to_json())) == preset
        flat = {name: preset.value(name) for name in preset.fields()}
        assert AcceleratorConfig.of(**flat) == preset
    peaks = AcceleratorConfig.from_dict({"features": {"feature_kinds": ["mean", "peak"]}})
    assert peaks.features.feature_kinds == ("mean", "highest", "lowest")


@each_row(
    "field, word, foreign, value",
    [
        ("rest", "none", "rest_frames", 3),
        ("onset", "immediate", "band_low", 5),
        ("window_mode", "free", "pretrigger_frames", 7),
        ("window_mode", "touch", "store_per_window", 4),
        ("cell", "gru", "weight_sets", "one"),
        ("cell", "lstm", "reset", "after"),
        ("cell", "linear", "hidden", 16),
        ("decision", "vote", "early_steps", 2),
        ("readout", "dense", "taught", 2),
        ("position", False, "slide_least", 3),
    ],
)
def test_a_variant_has_no_value_of_another(field, word, foreign, value):
    variant = {"window": 614, "pretrigger_frames": 0, field: word}
    config = AcceleratorConfig.of(**variant)
    with refused(f"field {foreign}: is {value!r}; it belongs to .*: leave it out"):
        config.replace(**{foreign: value})
    # as in a file that names every field
    assert AcceleratorConfig.of(**variant | {foreign: value}) == config


def test_a_field_of_the_other_variant_leaves_with_it():
    config = AcceleratorConfig.of(hidden=16).replace(cell="linear", window_mode="free", window=614)
    assert (config.network.hidden, config.windows.pretrigger_frames) == (12, 0)
    assert config.replace(window_mode="touch").windows.pretrigger_frames == 50


def test_a_weight_word_is_as_wide_as_the_widest_of_the_three_formats():
    for name in ("weight_format", "recurrent_format", "dense_format"):
        assert (
            PRESETS["thesis"].replace(**{name: QFormat(4, 5)}).weight_bits
            == 9
            > PRESETS["thesis"].weight_bits
        )
