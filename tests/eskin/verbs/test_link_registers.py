"""eskin/verbs/link_registers.py: the C driver plays recordings over a serial line, into a board in Python and into
the simulated one."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from eskin.cosim import device as simulated
from eskin.cosim.link import Link
from eskin.cosim.pin_port import PinPort
from eskin.cosim.serial_port import SerialPort
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel, random_integer_model, random_recordings, run
from eskin.golden.model.decision_word import decision_word
from eskin.rtl.fpga.export import export_board
from eskin.rtl.fpga.generate import generate, register_map
from eskin.verbs.link_registers import LinkRegisters
from tests.support.c_driver import Driver
from tests.support.link_device import Device, golden_decisions
from tests.support.link_flow import TIMEOUT_BYTES
from tests.support.result_case import CONFIG

CLOCKS_PER_BIT = 4


@contextmanager
def in_python(model: IntegerModel, recordings: Recordings) -> Iterator[Link]:
    with Device(model.config, golden_decisions(model, recordings)) as device:
        port = SerialPort(device.port, 2_000_000)
        yield Link(port, register_map(model.config), timeout_s=0.5)
        port.close()


@contextmanager
def in_simulation(model: IntegerModel, recordings: Recordings) -> Iterator[Link]:
    clock_hz = model.config.hardware.clock_hz
    board = export_board(model.config, clock_hz=clock_hz, baud=clock_hz / CLOCKS_PER_BIT)
    design = simulated.Design(board, Path("build") / "driver_builds", "this test", "board_top")
    device = simulated.Device(design)
    device.put("rx", 1)
    device.reset()
    yield Link(PinPort(device, CLOCKS_PER_BIT), register_map(model.config), timeout_s=TIMEOUT_BYTES)


@pytest.mark.parametrize("board", [in_python, pytest.param(in_simulation, marks=pytest.mark.slow)])
def test_the_driver_plays_recordings_over_the_link(board, tmp_path):
    model = random_integer_model(CONFIG, 3)
    config = model.config
    folder = generate(config, model.arrays, tmp_path / "design", bus="wishbone")
    length = config.rest_level.rest_frames + config.last_frame + 4 * config.windows.hop
    recordings = random_recordings(config, [length, length // 2, length], 5)
    rows, offsets = run(model, recordings).streams["decision"]
    with board(model, recordings) as link:
        link.connect()
        registers = LinkRegisters(link, config)
        driver = Driver(folder, registers.read, registers.write)
        assert driver("present") and driver.load()
        for number in range(len(recordings)):
            samples = recordings.recording(number)
            expected = [decision_word(config, row) for row in rows[slice(*offsets[number : number + 2])]]
            assert driver.play(samples, pairs=number % 2 == 1) == expected
        assert len(rows) and not driver("faults") and not driver.refused
