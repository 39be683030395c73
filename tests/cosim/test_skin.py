"""A board without a host: from the converter's pins to the bytes on the stimulator's line, as it goes onto the part."""

from __future__ import annotations

import random
from itertools import pairwise

import pytest

from eskin.cosim.netlist import Hardware, netlist_hardware
from eskin.cosim.skin import expected_electrodes, play
from eskin.cosim.stimulator import PLACES, table_frames
from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.golden.model.conversion import through_converter
from eskin.golden.model.model import random_integer_model
from eskin.golden.model.pipeline import run
from eskin.golden.model.vectors import completing_frames, random_recordings
from eskin.rtl.fpga.export import _verilog
from eskin.rtl.fpga.synthesis import synthesise
from eskin.rtl.fpga.targets import target
from eskin.rtl.program.flash_image import flash_image
from eskin.rtl.program.memory_map import memory_images
from eskin.rtl.top.skin_top import refuse_standalone
from eskin.scripts.jobs.build_job import skin_design, skin_pins, wiring_table
from eskin.scripts.jobs.flow import BUILD

CONFIG = AcceleratorConfig.of(
    taxels=8,
    hidden=4,
    sample_bits=12,
    band_low=1900,
    band_high=2200,
    hop=25,
    window=51,
    touch_frames=220,
    steps=8,
    pretrigger_frames=10,
    rearm_frames=20,
    decision="vote",
    lanes=1,
    lane_type="dsp",
    loadable=False,
    sample_rate_hz=1000.0,
    clock_hz=3e6,
    converter="ads7953",
    converter_hz=7.5e5,
    stimulator="decisions",
    hold_s=0.06,
    on_limit_s=5.0,
)
BURST_S, TAIL_S = 0.0135, 0.1


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("level", ["rtl", "netlist"])
def test_from_converter_pins_to_stimulator_bytes(level, tmp_path):
    board = target("icebreaker")
    model = random_integer_model(CONFIG, 1)
    config = model.config
    design = skin_design(config, memory_images(config, model.arrays), board, config.hardware.clock_hz)
    if level == "rtl":
        (tmp_path / "accelerator.v").write_text(_verilog(design, "accelerator"))
        hardware = Hardware((tmp_path / "accelerator.v",))
    else:
        synthesise(design, board.family, tmp_path / "net")
        hardware = netlist_hardware(tmp_path / "net" / "accelerator.v", "ice40", "icebreaker", probes=False)
    made = random_recordings(config, (520, 450, 400), seed=6)
    for end in made.offsets[1:]:  # nobody touches at the end: the last frame is held until the stimulator is silent
        made.samples[end - 150 : end] = made.samples[0]
    recordings, codes = through_converter(made, config)
    trace = run(model, recordings)
    rows, offsets = trace.streams["decision"]
    frames = completing_frames(trace)
    bursts = 0
    for number, (low, high) in enumerate(pairwise(offsets)):
        mine = codes[recordings.offsets[number] : recordings.offsets[number + 1]]
        played = play(hardware, config, mine, tail_s=TAIL_S, work=tmp_path / f"play{number}", builds=BUILD / "simulators")
        whole = rows[low:high, 4] == 0  # no host ends the recording, so nothing is decided early
        wanted = expected_electrodes(rows[low:high][whole], frames[low:high][whole], config, BURST_S)
        stimulator = played.model(config)
        assert not stimulator.wrong and played.violations == 0 and stimulator.frames[:16] == ["OFF"] * 16
        heard = bytes(byte for byte, _ in played.stim)
        ons = [burst for burst in heard.split(b">OFF<") if burst.endswith(b">ON<")]
        one = config.interface
        settings = (one.stim_amplitude, one.stim_delay, one.stim_frequency, one.stim_width)
        assert ons == [b"".join(table_frames(PLACES[e // 4][e % 4], *settings)) for e in wanted]
        bursts += len(ons)
        if whole.any() and rows[low:high][whole][-1, 0]:  # the last decision is a touch's final one
            assert stimulator.frames[-1] == "OFF" and played.pins[-1][1:3] == (int(rows[low:high][whole][-1, 2]), True)
        assert not any(led for *_, led in played.pins)
    assert bursts >= 3
    # the data line breaks while an electrode is on: the lamp, and OFF is the last word
    played = play(hardware, config, codes[:520], tail_s=TAIL_S, work=tmp_path / "broken", builds=BUILD / "simulators", fault_frame=200)
    stimulator = played.model(config)
    assert played.pins[-1][3] and stimulator.frames[-1] == "OFF" and not stimulator.is_on and not stimulator.wrong


def from_flash():
    """A board that reads its model from the flash, as RTL: (hardware, integer model)."""
    made = random_integer_model(CONFIG.replace(loadable=True), 1)
    return skin_design(made.config, None, target("icebreaker"), made.config.hardware.clock_hz, flash=True), made


@pytest.mark.slow
def test_the_model_out_of_the_flash_and_a_flipped_bit_refused(tmp_path):
    design, model = from_flash()
    config, image = model.config, flash_image(model.config, model.arrays)
    (tmp_path / "accelerator.v").write_text(_verilog(design, "accelerator"))
    hardware = Hardware((tmp_path / "accelerator.v",))
    made = random_recordings(config, (450,), seed=6)
    made.samples[300:] = made.samples[0]
    recordings, codes = through_converter(made, config)
    trace = run(model, recordings)
    rows, frames = trace.streams["decision"][0], completing_frames(trace)
    whole = rows[:, 4] == 0
    wanted = expected_electrodes(rows[whole], frames[whole], config, BURST_S)
    options = dict(tail_s=TAIL_S, builds=BUILD / "simulators")
    played = play(hardware, config, codes, work=tmp_path / "whole", flash=image, **options)
    heard = bytes(byte for byte, _ in played.stim)
    ons = [burst for burst in heard.split(b">OFF<") if burst.endswith(b">ON<")]
    one = config.interface
    settings = (one.stim_amplitude, one.stim_delay, one.stim_frequency, one.stim_width)
    assert wanted and ons == [b"".join(table_frames(PLACES[e // 4][e % 4], *settings)) for e in wanted]
    assert played.begun and not any(led for *_, led in played.pins)
    load_cycles = 4 * 8 * len(image) + 4 * 32 + 32 + 4000
    rng = random.Random(7)
    for bit in (3, *rng.sample(range(48, 8 * len(image)), 3)):
        damaged = bytearray(image)
        damaged[bit // 8] ^= 0x80 >> bit % 8
        work = tmp_path / f"bit{bit}"
        played = play(hardware, config, codes, work=work, flash=bytes(damaged), limit=load_cycles + 5000, **options)
        assert not played.begun and played.pins[-1][3], f"bit {bit}: the lamp is on and no scan begins"
        assert set(played.model(config).frames) == {"OFF"}
    print(f"{len(image)} bytes, {load_cycles} cycles at most")


def test_pins_and_wiring():
    board = target("icebreaker")
    pins = skin_pins(CONFIG, board)
    assert [pins[name] for name in ("pins__cs_n", "pins__mosi", "pins__miso", "pins__sclk")] == list(board.pins[:4])
    assert pins["stim_tx"] == board.pins[8] and len(set(pins.values())) == len(pins)
    assert {"port": "stim_tx", "site": board.pins[8], "to": "stimulator, RX (115200 baud)"} in wiring_table(CONFIG, board)
    with pytest.raises(InputError, match="has 16 free pins, and converter, stimulator and 3 classes need 24"):
        skin_pins(CONFIG.replace(converter="ad7476", taxels=16, converter_hz=0.0), board)


def test_what_needs_a_host_is_refused():
    with pytest.raises(InputError, match="nothing delivers frames; add --converter"):
        refuse_standalone(CONFIG.replace(converter="none"))
    immediate = dict(onset="immediate", window_mode="free", window=50, pretrigger_frames=0)
    with pytest.raises(InputError, match="needs 'band' or 'baseline'"):
        refuse_standalone(CONFIG.replace(**immediate))
