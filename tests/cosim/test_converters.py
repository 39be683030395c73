"""Co-simulation from a converter's pins: every stage exact on what the converter gives, faults flagged, nothing decided from them."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from eskin.cosim import flow
from eskin.cosim.scoreboard import read_capture
from eskin.golden.core.config import PRESETS, AcceleratorConfig
from eskin.golden.core.converters import ConverterFault
from eskin.golden.core.errors import InputError
from eskin.golden.model.conversion import through_converter
from eskin.golden.model.model import random_integer_model
from eskin.golden.model.pipeline import run
from eskin.golden.model.vectors import random_recordings, write_vectors
from eskin.rtl.fpga.generate import generate, pack_decision
from eskin.scripts.jobs.flow import BUILD, cosimulate

CONFIG = AcceleratorConfig.of(
    taxels=8,
    hidden=4,
    sample_bits=14,
    band_low=7600,
    band_high=8800,
    hop=20,
    window=41,
    touch_frames=200,
    steps=8,
    pretrigger_frames=10,
    rearm_frames=20,
    decision="vote",
    lanes=2,
    sample_rate_hz=1000.0,
    clock_hz=2e6,
)
OTHERS = {
    "mcp3208x2": dict(converter="mcp3208x2"),
    "mcp3208 in series": dict(converter="mcp3208x2", data_lines=1, taxels=16, sample_rate_hz=500.0),
    "ad7476": dict(converter="ad7476"),
    "spi": dict(converter="spi", spi_channels=4, spi_frame_bits=20, spi_channel_bit=18, spi_code_bits=16),
    "spi, late codes with numbers": dict(
        converter="spi", spi_delay=1, spi_frame_bits=24, spi_channel_bit=3, spi_code_bit=4, spi_code_bits=14, spi_tag_bit=18, spi_tag_bits=3
    ),
    "ads7953, other clock and shift": dict(
        converter="ads7953", clock_hz=1.7e6, sample_rate_hz=700.0, converter_hz=4e5, code_shift=-1, code_offset=-3900
    ),
}


def check(config, tmp_path, lengths=(300, 250)):
    recordings = random_recordings(config, lengths, seed=4)
    result = cosimulate(random_integer_model(config, 5), recordings, work=tmp_path)
    assert result["mismatch_list"] == [] and result["bit_exact"] and result["passed"] and result["compared_values"] > 300
    assert result["conversion"]["faults"] == result["conversion"]["violations"] == result["overruns"] == 0
    return result


def test_ads7953_from_its_pins(tmp_path):
    result = check(CONFIG.replace(converter="ads7953"), tmp_path)
    assert result["pace"] == "declared" and result["conversion"]["jitter_cycles"] == 0
    assert result["conversion"]["scan_cycles"] < 0.9 * 2000 and max(result["conversion"]["feature_cycles"]) < 100


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHERS)
def test_the_others_from_their_pins(name, tmp_path):
    result = check(CONFIG.replace(**OTHERS[name]), tmp_path)
    assert result["conversion"]["jitter_cycles"] < 1


def play_with_a_fault(config, kind: int, tmp_path):
    """Broken frames 150 to 152 of 400: (fault bits, decisions before, after; golden ones of the good frames before, after)."""
    model = random_integer_model(config, 5)
    config = model.config
    recordings, codes = through_converter(random_recordings(config, (400,), seed=6), config)
    design = generate(config, model.arrays, tmp_path / "design")
    vectors = write_vectors(tmp_path / "vectors.npz", run(model, recordings), recordings, codes=codes)
    result = flow.cosim(design, vectors, fault=(150, 3, kind), waves=False, work=tmp_path / "run", builds=BUILD / "simulators")
    capture = read_capture(tmp_path / "run")
    stream, rearmed = capture.stages["decision"][0], int(capture.frame_cycles[152])
    halves: tuple[list, list] = [], []
    for word, cycle in zip(stream.words, stream.cycles, strict=True):
        halves[cycle > rearmed].append(int(word, 16))
    golden = []
    for low, high in ((0, 150), (153, 400)):
        part = dataclasses.replace(recordings, samples=recordings.samples[low:high], offsets=np.array([0, high - low]))
        rows, _ = run(model, part).streams["decision"]
        golden.append([pack_decision(row) for row in rows])
    # no end of a recording where the frames break: no partial decision
    golden[0] = [word for word in golden[0] if not word >> 30 & 1]
    assert not result["passed"]
    return result["conversion"]["faults"], halves, golden


@pytest.mark.parametrize(
    ("kind", "flagged"),
    [
        pytest.param(1, ConverterFault.STUCK, marks=pytest.mark.slow),
        pytest.param(2, ConverterFault.STUCK, marks=pytest.mark.slow),
        (3, ConverterFault.ORDER),
    ],
)
def test_a_fault_is_flagged_and_the_chain_begins_anew_when_it_is_over(kind, flagged, tmp_path):
    faults, halves, golden = play_with_a_fault(CONFIG.replace(converter="ads7953"), kind, tmp_path)
    assert faults & flagged and len(golden[1]) > 3
    assert halves[0] == golden[0] and halves[1] == golden[1]


@pytest.mark.slow
@pytest.mark.parametrize("converter", ["mcp3208x2", "ad7476"])
@pytest.mark.parametrize("kind", [1, 2, 3])
def test_the_faults_of_the_others(converter, kind, tmp_path):
    config = CONFIG.replace(taxels=16, clock_hz=4e6, converter=converter)
    faults, halves, golden = play_with_a_fault(config, kind, tmp_path)
    assert faults and len(golden[1]) > 3 and halves[0] == golden[0] and halves[1] == golden[1]


@pytest.mark.slow
@pytest.mark.parametrize("converter", ["ads7953", "mcp3208x2", "ad7476"])
def test_recordings_of_piezo_taxels_at_the_declared_pace(converter, shared_data, tmp_path):
    """5 recordings; the converter's 4096 codes lie around the taxels' rest level."""
    from eskin.golden.data.archive import load_archive

    config = PRESETS["pvdf"].replace(converter=converter, code_offset=-27352, code_shift=0, feature_shift=(4,))
    recordings = load_archive(shared_data / "pvdf_indent" / "recordings.npz")
    few = recordings.subset(recordings.evenly(5))
    model = random_integer_model(config, 3)
    result = cosimulate(model, few, work=tmp_path)
    assert result["passed"] and result["recordings"] == 5 and result["conversion"]["jitter_cycles"] == 0


def test_what_cannot_keep_up_is_refused_with_the_nearest_that_does():
    with pytest.raises(
        InputError, match=r"16 transfers of 2 chips in series at 1 MHz take 324 us.*data_lines 2.*takes 163 us.*at most 2777 Hz"
    ):
        PRESETS["thesis"].replace(converter="mcp3208x2", data_lines=1)
    PRESETS["thesis"].replace(converter="mcp3208x2", data_lines=1, sample_rate_hz=2777.0)
    with pytest.raises(InputError, match=r"18 transfers at 2 MHz take 156 us.*converter_hz 2e\+07 takes"):
        PRESETS["thesis"].replace(converter="ads7953", sample_rate_hz=6000.0)
    with pytest.raises(InputError, match="field spi_channel_bit: is 0 with the code's first bit at 11"):
        PRESETS["thesis"].replace(converter="spi", spi_channel_bit=0)
    with pytest.raises(InputError, match="two chips have 16 channels"):
        PRESETS["thesis"].replace(converter="mcp3208x2", taxels=40)


def test_without_a_converter_nothing_of_the_interface_is_built(monkeypatch):
    """The same Verilog as without the group: nothing of its folder is so much as made, and the fields change no text."""
    from amaranth.back import rtlil

    from eskin.rtl.interface import acquisition
    from eskin.rtl.top.board_top import BoardTop

    def refuse(*_, **__):
        raise AssertionError("an interface was built")

    monkeypatch.setattr(acquisition.Acquisition, "__init__", refuse)
    model = random_integer_model(CONFIG, 1)
    other = model.config.replace(spi_channels=4, converter_hz=1e6, code_shift=3)
    texts = [rtlil.convert(BoardTop(config, clock_hz=12e6), name="board_top", emit_src=False) for config in (model.config, other)]
    assert texts[0] == texts[1] and "converter" not in texts[0] and "cs_n" not in texts[0]


@pytest.mark.slow
def test_generated_files_of_a_configuration_with_a_converter(tmp_path):
    model = random_integer_model(CONFIG.replace(converter="ads7953"), 1)
    folder = generate(model.config, model.arrays, tmp_path / "design")
    assert "module sensing(" in (folder / "sensing.sv").read_text()
    assert not (generate(model.config.replace(converter="none"), model.arrays, tmp_path / "plain") / "sensing.sv").exists()
    assert Path(folder / "accelerator.sv").read_text() == (tmp_path / "plain" / "accelerator.sv").read_text()
