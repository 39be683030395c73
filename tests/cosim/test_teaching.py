"""A model taught by registers, in simulated hardware: after every touch, TEACH, FORGET and reload it decides as
the golden stream does."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eskin.cosim.netlist import Hardware, netlist_hardware
from eskin.data.archive import load_archive
from eskin.golden.core import PRESETS
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel
from eskin.golden.model.prototypes import forget, taught_in_use
from eskin.rtl.fpga.export import export
from eskin.rtl.fpga.synthesis import synthesise
from eskin.rtl.fpga.targets import target
from eskin.rtl.program.memory_map import Fault, Register, TeachRegister
from eskin.rtl.top.accelerator import Accelerator
from tests.golden.model.test_prototypes import taught_model
from tests.support.random_models import random_integer_model
from tests.support.taught_device import taught_at_random
from tests.support.touch_cuts import beginnings
from tests.support.touch_scenes import scene

BUILDS = Path("build/simulators")


def untaught() -> IntegerModel:
    """With checksum and watchdog."""
    plain = forget(taught_model("gru", taught_shift=1))
    return replace(plain, config=plain.config.replace(checksum=True, watchdog=True))


def test_what_is_taught_in_hardware_is_what_the_stream_is_taught():
    both = taught_at_random(untaught(), scene(30, seed=8), BUILDS, seed=3)
    assert both.decisions > 150 and both.refused > 5 and both.taught > 5


DATA = {"pvdf": 34, "fabric": 33}
"""Recordings of each data set."""


def data_case(name: str, folder: Path) -> tuple[IntegerModel, Recordings]:
    """Random weights and prototypes, nothing taught, and recordings around their touches."""
    recordings = load_archive(next(folder.glob(f"{name}_*")) / "recordings.npz")
    config = PRESETS[name].with_readout(
        readout="prototypes", prototypes=1, taught=2, state_code_bits=4, state_code_shift=9
    )
    model = forget(random_integer_model(config, 5))
    few = recordings.subset(recordings.evenly(DATA[name]))
    if name == "pvdf":
        few = beginnings(few, config, len(few), config.windows.steps, rest=400)
    return model, few


@pytest.mark.slow
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("name", DATA)
def test_teaching_on_recordings_as_rtl_netlist_and_in_icarus(name, shared_data, tmp_path):
    """All recordings in Verilator; a third of them again in Icarus, two as a netlist."""
    model, recordings = data_case(name, shared_data)
    both = taught_at_random(model, recordings, BUILDS, seed=3)
    print(name, len(recordings), both.decisions, "decisions", both.taught, "taught", both.refused, "refused")
    assert both.decisions > 20 * DATA[name] / 2 and both.taught > 5 and both.refused > 5
    (tmp_path / "accelerator.v").write_text(export(model.config, model.arrays))
    synthesise(Accelerator(model.config), target("icebreaker").family, tmp_path / "net")
    netlist = netlist_hardware(tmp_path / "net" / "accelerator.v", "ice40", "icebreaker", probes=False)
    for count, hardware in ((DATA[name] // 3, Hardware((tmp_path / "accelerator.v",))), (2, netlist)):
        few = taught_at_random(model, recordings.subset(range(count)), BUILDS, seed=3)
        print(hardware.level, count, few.device.replay(hardware, tmp_path / hardware.level, BUILDS))


def test_a_damaged_place_is_flagged():
    model = untaught()
    recordings = scene(12, seed=8)
    both = taught_at_random(model, recordings, BUILDS, seed=3)
    assert both.decisions > 50 and both.taught > 1
    both.stream.arm()
    both.reload()
    assert not both.device.read(Register.FAULTS) & Fault.CHECKSUM
    label = int(np.argmax(taught_in_use(both.stream.model)))
    rule, width = model.config.readout_rule, model.config.trajectory_width
    number = (1 + label * (rule.prototypes + rule.taught) + rule.prototypes) * width
    (word,) = both.words(number, 1)
    both.device.write(TeachRegister.PLACES, number)
    both.device.write(Register.MEMORY_DATA, (word ^ 1) & 0x1FF)
    assert both.words(number, 1) == [word ^ 1]
    both.device.frames(recordings.recording(2))
    both.device.settle()
    assert both.device.read(Register.FAULTS) & Fault.CHECKSUM
