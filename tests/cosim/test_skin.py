"""A board without a host: from the converter's pins to the bytes on the stimulator's line, as it goes onto
the part."""

import dataclasses
import shutil
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from eskin.cosim.netlist import Hardware, netlist_hardware
from eskin.data import turn_recordings
from eskin.data.archive import load_archive
from eskin.golden.core import PRESETS, AcceleratorConfig
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel, completing_frames, run, through_converter
from eskin.live.link import Answer, Decision, SensorFrame, Unpacker, ordered_packet, parse, read_packet
from eskin.rtl.fpga.export import verilog as text_of
from eskin.rtl.fpga.generate import boot_writes, register_map
from eskin.rtl.fpga.synthesis import PoweredOn, synthesise
from eskin.rtl.fpga.targets import target
from eskin.rtl.fpga.wiring import Wiring
from eskin.rtl.program.memory_map import Control, Register, memory_images
from eskin.rtl.top.system import System
from eskin.training.made_up import random_recordings
from eskin.verbs.build import BuildRequest, build
from eskin.verbs.cosim import BUILD
from tests.support.link_flow import pack_decisions
from tests.support.random_models import random_integer_model
from tests.support.skin import Played, expected_electrodes, play
from tests.support.small_designs import SMALL
from tests.support.stimulator import PLACES, table_frames
from tests.support.touch_cuts import beginnings

CONFIG = SMALL.replace(
    taxels=8,
    sample_bits=12,
    band_low=1900,
    band_high=2200,
    hop=25,
    window=51,
    touch_frames=220,
    lanes=1,
    lane_type="dsp",
    loadable=False,
    sample_rate_hz=1000.0,
    clock_hz=3e6,
    converter=dict(name="ads7953", hz=7.5e5),
    stimulator="decisions",
    hold_s=0.06,
    on_limit_s=5.0,
)
BURST_S, TAIL_S = 0.0135, 0.1


def board_of(
    model: IntegerModel, work: Path, level: str = "rtl", link_hz: float | None = None, **parts
) -> Hardware:
    """The icebreaker's design with a converter and ``parts`` of `Wiring`, as RTL or as its netlist."""
    config, family = model.config, target("icebreaker").family
    images = memory_images(config, model.arrays) if not config.hardware.loadable else None
    wiring = Wiring(config=config, target=target("icebreaker"), sensing=True, **parts)
    design = wiring.design(images, config.hardware.clock_hz, link_hz)
    if level == "netlist":
        synthesise(design, family, work / "net")
        return netlist_hardware(work / "net" / "accelerator.v", "ice40", "icebreaker", probes=False)
    (work / "accelerator.v").write_text(text_of(design, "accelerator"))
    return Hardware((work / "accelerator.v",))


def played(hardware: Hardware, config: AcceleratorConfig, codes: np.ndarray, work: Path, **options) -> Played:
    """One recording from power-on; the converter and the stimulator saw nothing that their data sheets forbid."""
    options = {"tail_s": TAIL_S, "builds": BUILD / "simulators"} | options
    found = play(hardware, config, codes, work=work, **options)
    assert found.violations == 0 and not found.model(config).wrong
    return found


def stimulated(found: Played, electrodes: list[int], config: AcceleratorConfig) -> bool:
    """The bursts on the stimulator's line that switch on are what the protocol's table says for these electrodes."""
    interface = config.interface
    settings = (
        interface.stim_amplitude,
        interface.stim_delay,
        interface.stim_frequency,
        interface.stim_width,
    )
    bursts = bytes(byte for byte, _ in found.stim).split(b">OFF<")
    wanted = [b"".join(table_frames(PLACES[e // 4][e % 4], *settings)) for e in electrodes]
    return [burst for burst in bursts if burst.endswith(b">ON<")] == wanted


def plays_as_golden(
    hardware: Hardware, model: IntegerModel, made: Recordings, work: Path, **options
) -> tuple[int, bytes, list[int]]:
    """Each recording from power-on: every burst on the line and the class on the pins are the golden
    decisions'. Returns the bursts, and of the last recording what the host heard and the decisions."""
    config = model.config
    recordings, codes = through_converter(made, config)
    trace = run(model, recordings)
    rows, offsets = trace.streams["decision"]
    frames, bursts = completing_frames(trace), 0
    for number, (low, high) in enumerate(pairwise(offsets)):
        mine = codes[recordings.offsets[number] : recordings.offsets[number + 1]]
        found = played(hardware, config, mine, work / f"play{number}", **options)
        whole = rows[low:high, 4] == 0  # no host ends the recording, so nothing is decided early
        decided = rows[low:high][whole]
        wanted = expected_electrodes(decided, frames[low:high][whole], config, BURST_S)
        stimulator = found.model(config)
        assert stimulator.frames[:16] == ["OFF"] * 16 and stimulated(found, wanted, config)
        bursts += len(wanted)
        if len(decided) and decided[-1, 0]:  # the last decision is a touch's final one
            assert stimulator.frames[-1] == "OFF" and found.pins[-1][1:3] == (int(decided[-1, 2]), True)
        assert not any(led for *_, led in found.pins)
    return bursts, found.host, pack_decisions(config, decided)


@pytest.mark.slow
@pytest.mark.parametrize("scan_every", [1, 4])
def test_from_converter_pins_to_stimulator_bytes(scan_every, tmp_path):
    """Of a source of 4 kHz one frame in four is scanned: at 1 kHz, as the other boards."""
    sensor = {"scan_every": scan_every, "sample_rate_hz": scan_every * CONFIG.sensor.sample_rate_hz}
    model = random_integer_model(CONFIG.replace(**sensor), 1)
    config, hardware = model.config, board_of(model, tmp_path)
    made = random_recordings(config, (520, 450, 400), seed=6).scanned(scan_every)
    # nobody touches at the end: the last frame is held until the stimulator is silent
    for end in made.offsets[1:]:
        made.samples[end - 150 : end] = made.samples[0]
    assert plays_as_golden(hardware, model, made, tmp_path)[0] >= 3
    # the data line breaks while an electrode is on: the lamp, and OFF is the last word
    codes = through_converter(made, config)[1][:520]
    found = played(hardware, config, codes, tmp_path / "broken", fault_frame=200)
    stimulator = found.model(config)
    assert "ON" in stimulator.frames, "no electrode is on when the line breaks"
    assert found.pins[-1][3] and stimulator.frames[-1] == "OFF" and not stimulator.is_on


TWO_CHIPS = CONFIG.replace(
    taxels=42,
    rows=6,
    columns=7,
    converter=dict(name="mpr121", chips=2, hz=0.0),
    sample_rate_hz=100.0,
    stimulator="positions",
    position=True,
    position_rest=1292,
    position_threshold=200,
    hop=6,
    window=13,
    touch_frames=60,
    pretrigger_frames=2,
    rearm_frames=12,
)


def test_an_electrode_chip_that_reads_0_is_a_fault(tmp_path):
    """It loses its supply while nobody touches. Its zeros look like the hardest touch; then somebody does
    touch, row 2, column 5."""
    model = random_integer_model(TWO_CHIPS, 1)
    config = model.config
    board = PoweredOn(System(config, memory_images(config, model.arrays), host=None), 16)
    (tmp_path / "accelerator.v").write_text(text_of(board, "accelerator"))
    codes = np.full((14, 13), 700)
    codes[10:13, [5, 7 + 2]] = 300
    options = dict(tail_s=0.05, fault_frame=5, fault_kind=4)
    found = played(Hardware((tmp_path / "accelerator.v",)), config, codes, tmp_path / "play", **options)
    assert stimulated(found, [4 * 2 + 4 * (2 * 5 + 1) // (2 * 7)], config)
    assert found.pins[-1][3] and not found.model(config).is_on


SKIN = dict(converter="ads7953", stimulator="decisions", lanes=1, lane_type="dsp", clock_hz=12e6, hold_s=0.13)
BOARDS = {
    "thesis": dict(decision="vote", steps=3, touch_frames=1229, **SKIN),
    "pvdf": dict(
        steps=4,
        feature_shift=(4,),
        **SKIN | dict(converter=dict(name="ads7953", code_offset=-27352, code_shift=0)),
    ),
}
"""Designs at the board's own 12 MHz; fewer steps than the presets' 20, so that a whole touch with its final
decision is simulated."""
DRAWN = {"thesis": 48, "pvdf": 45}
"""Seeds of random weights that decide for more than one class in three recordings."""


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("name", BOARDS)
def test_the_placed_netlist_of_a_board_at_its_own_clock(name, shared_data, tmp_path):
    """What `eskin build --standalone` places on the icebreaker: 16 taxels at 3 kHz (the scene) or 8 at 2 kHz
    (real recordings)."""
    board = target("icebreaker")
    model = random_integer_model(PRESETS[name].replace(**BOARDS[name]), DRAWN[name])
    result, bitstream, verilog, _ = build(
        BuildRequest(config=model.config, arrays=model.arrays, target=board, standalone=True)
    )
    assert result.clock_met and bitstream.exists()
    config = model.config.replace(loadable=False)
    model = dataclasses.replace(model, config=config)
    hardware = netlist_hardware(Path(shutil.copy(verilog, tmp_path)), "ice40", "icebreaker", probes=False)
    made = (
        turn_recordings(persons=1, trials=2, rows=4, columns=4, sample_rate_hz=3000)
        if name == "thesis"
        else load_archive(shared_data / "pvdf_indent" / "recordings.npz")
    )
    before = config.windows.pretrigger_frames + 2 * config.rest_level.rest_frames + 20
    cut = beginnings(made, config, count=3, steps=config.windows.steps, before=before, rest=60)
    assert plays_as_golden(hardware, model, cut, tmp_path, tail_s=0.16, limit_s=3600)[0] >= 3


@pytest.mark.slow
def test_with_a_host_that_loads_listens_and_asks(tmp_path):
    """The link and the converter together: a host writes the model and an amplitude above its limit, arms,
    hears each decision and each frame from the converter's pins, and reads registers at the end; the stimulator
    gets the limit."""
    clocks, loudest = 4, CONFIG.interface.amplitude_limit
    model = random_integer_model(CONFIG.replace(loadable=True, stim_amplitude=loudest, send_frames=True), 1)
    config = model.config
    hardware = board_of(model, tmp_path, link_hz=config.hardware.clock_hz / clocks, link=True)
    names = register_map(config)["registers"]
    writes = [*boot_writes(config, model.arrays), (names["STIM_AMPLITUDE"], 255), (names["FRAMES"], 1)]
    writes += [(int(Register.CONTROL), int(Control.ARM))]
    sent = b"".join(ordered_packet(number, address, [word]) for number, (address, word) in enumerate(writes))
    addresses = [names[name] for name in ("CONVERTER_FAULTS", "FAULTS", "STIM_AMPLITUDE")]
    last = b"".join(read_packet(address) + b"\x7e" * 40 for address in addresses)  # time for each answer
    made = random_recordings(config, (650,), seed=6)
    made.samples[370:] = made.samples[0]
    options = dict(host=(sent, last), host_clocks=clocks, limit=3_000_000)
    bursts, heard, decided = plays_as_golden(hardware, model, made, tmp_path, **options)
    packets = [parse(body) for body in Unpacker().feed(heard)]
    assert (
        [packet.payload for packet in packets if isinstance(packet, Decision)] == decided
        and bursts
        and len(decided) > 3
    )
    frames = [packet for packet in packets if isinstance(packet, SensorFrame)]
    samples = through_converter(made, config)[0].samples
    assert [frame.number for frame in frames] == [*range(len(frames))] and len(frames) > len(samples)
    assert (np.array([frame.words for frame in frames[: len(samples)]]) == samples).all()
    answers = {packet.address: packet.value for packet in packets if isinstance(packet, Answer)}
    assert [answers[address] for address in addresses] == [0, 0, 255]
