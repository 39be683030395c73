"""eskin/verbs/link_registers.py: the C driver plays recordings into the simulated board, over its serial line."""

from __future__ import annotations

from pathlib import Path

from eskin.cosim.device import Design, Device
from eskin.cosim.link import Link
from eskin.cosim.pin_port import PinPort
from eskin.golden.model.decision_word import decision_word
from eskin.golden.model.model import random_integer_model
from eskin.golden.model.pipeline import run
from eskin.golden.model.vectors import random_recordings
from eskin.rtl.fpga.export import export_board
from eskin.rtl.fpga.generate import generate, register_map
from eskin.verbs.link_registers import LinkRegisters
from tests.support.c_driver import Driver
from tests.support.link_flow import TIMEOUT_BYTES
from tests.support.result_case import CONFIG

CLOCKS_PER_BIT = 4


def test_the_driver_plays_recordings_over_the_link(tmp_path):
    model = random_integer_model(CONFIG, 3)
    config = model.config
    folder = generate(config, model.arrays, tmp_path / "design", bus="wishbone")
    baud = config.hardware.clock_hz / CLOCKS_PER_BIT
    board = export_board(config, clock_hz=config.hardware.clock_hz, baud=baud)
    device = Device(Design(board, Path("build") / "driver_builds", "this test", "board_top"))
    device.put("rx", 1)
    device.reset()
    link = Link(PinPort(device, CLOCKS_PER_BIT), register_map(config), timeout_s=TIMEOUT_BYTES)
    link.connect()
    registers = LinkRegisters(link, config)
    driver = Driver(folder, registers.read, registers.write)
    assert driver("present") and driver.load()
    length = config.rest_level.rest_frames + config.last_frame + 4 * config.windows.hop
    recordings = random_recordings(config, [length, length // 2, length], 5)
    rows, offsets = run(model, recordings).streams["decision"]
    for number in range(len(recordings)):
        samples = recordings.samples[slice(*recordings.offsets[number : number + 2])]
        expected = [decision_word(config, row) for row in rows[slice(*offsets[number : number + 2])]]
        assert driver.play(samples, pairs=number % 2 == 1) == expected
    assert len(rows) and not driver("faults") and not driver.refused
