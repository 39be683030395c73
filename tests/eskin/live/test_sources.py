"""eskin/live/sources.py: hardware beside the model, value by value; every kind of difference is seen; a board
that is only heard."""

import dataclasses

import numpy as np
import pytest

from eskin.cosim.device import Accelerator, Design
from eskin.cosim.scoreboard import INPUT_STALLED
from eskin.golden.model import Stream, run
from eskin.live.serial_port import SerialPort
from eskin.live.sources import ModelSource, SimulationSource
from eskin.rtl.fpga.export import export
from eskin.rtl.fpga.generate import boot_writes, register_map
from eskin.training.made_up import random_recordings
from eskin.verbs.watch import BUILDS, board_source
from tests.eskin.live.test_link import CONFIG, LENGTHS
from tests.support.link_device import Device, golden_decisions
from tests.support.link_flow import pack_decisions
from tests.support.live_case import Stage
from tests.support.random_models import random_integer_model
from tests.support.table import each_row


@pytest.fixture(scope="module")
def model():
    return random_integer_model(CONFIG.replace(lanes=1), 5)


@pytest.fixture(scope="module")
def recordings(model):
    return random_recordings(model.config, LENGTHS, seed=4)


class Twin:
    """In place of the simulated device: the model's own values, some of them spoiled by ``spoil(frame, stage,
    values)``."""

    def __init__(self, model, spoil=lambda frame, stage, values: values) -> None:
        self.stream, self.spoil, self.registers = Stream(model), spoil, dict[str, int]()
        self.map = register_map(model.config)

    def command(self, *names: str) -> None:
        self.ended = "FINISH" in names
        if not self.ended:
            self.stream.arm()
            self.steps = 0

    def register(self, register: str, word: int = 0) -> int:
        usual = dict(STATUS=self.stream.status, TOUCHES=self.stream.touches, VERSION=self.map["version"])
        usual["FAULTS"] = 0x40 * bool(self.stream.flagged.any())
        usual["TAXEL_FAULTS"] = sum(1 << taxel for taxel in np.flatnonzero(self.stream.flagged).tolist())
        usual["LONGEST"] = self.map["longest_step"] * bool(self.steps)
        return (usual | self.registers)[register]

    def close(self) -> None:
        pass

    def brought(self, frames: np.ndarray | None = None) -> dict[str, list[int]]:
        brought: dict[str, list[int]] = {}
        decisions = [] if frames is None else self.stream.push(frames)
        for made in self.stream.finish() if self.ended else decisions:
            self.steps += not made.is_global
            for stage, values in made.stages.items():
                brought.setdefault(stage, []).extend(np.asarray(values).astype(int).tolist())
            word = pack_decisions(self.stream.config, np.array([made.row()]))
            brought.setdefault("decision", []).extend(word)
        spoiled = {stage: self.spoil(self.stream.frame, stage, values) for stage, values in brought.items()}
        return {stage: values for stage, values in spoiled.items() if values}


def test_windows_that_follow_the_touch_come_when_it_ends(recordings):
    """The onset is shown at once, no step before the touch's last frame, and then all of them."""
    config = CONFIG.replace(window_mode="whole", window=8, touch_frames=200)
    source, samples = ModelSource(random_integer_model(config, 5)), recordings.recording(0)
    source.arm()
    frames = [source.take(samples[at : at + 1]) for at in range(len(samples))] + [source.finish()]
    kinds = [[type(event).__name__ for event in events] for events in frames]
    touches = [events for events in kinds if events]
    assert touches == [["Onset"], ["Step"] * config.windows.steps + ["Decided"]] * (len(touches) // 2) != []
    for at, events in enumerate(frames[:-1], 1):
        assert all(event.frame == at for event in events)


def expected_values(streams) -> int:
    """Numbers of all stages, and six fields of each decision."""
    return sum(len(values) * (6 if name == "decision" else 1) for name, (values, _) in streams.items())


SPOILT = {
    "one value": ("feature", lambda values: [values[0] + 1, *values[1:]], "1 values differ (feature)"),
    "one missing": ("state", lambda values: values[:-1], "1 values differ (state)"),
    "all missing": ("logit", lambda values: [], "values differ (logit)"),
    "one too many": (
        "sum",
        lambda values: [*values, 7],
        "gave 1 values of stage sum that the model does not have",
    ),
    "another class": ("decision", lambda values: [values[0] ^ 1, *values[1:]], "1 values differ (decision)"),
    "no decision": ("decision", lambda values: [], "6 values differ (decision)"),
}


@each_row("case", SPOILT)
def test_one_difference_in_one_recording_is_seen(model, recordings, case):
    (wanted, change, sentence), done = SPOILT[case], []

    def spoil(frame, stage, values):
        if stage == wanted and not done:
            done.append(frame)
            return change(values)
        return values

    stage = Stage(SimulationSource(model, Twin(model, spoil)), recordings).go()
    tally = stage.player.tally
    assert tally.mismatches > 0 and any(sentence in said for said in tally.sentences)
    assert [message["wrong"] for message in stage.seen("result")] == [tally.mismatches, 0, 0, 0, 0]


@each_row("register, value", [("TAXEL_FAULTS", 15), ("FAULTS", INPUT_STALLED)])
def test_a_false_register_is_seen(model, recordings, register, value):
    """In lock step no frame waits."""
    twin = Twin(model)
    twin.registers[register] = value
    tally = Stage(SimulationSource(model, twin), recordings).go().player.tally
    assert f"register {register} reads {value} and the model expects 0" in tally.sentences


@pytest.mark.slow
@pytest.mark.parametrize("scan_every", [1, 4])
def test_the_simulated_rtl_is_equal_in_lock_step(model, scan_every):
    """Several touches, a partial one, none; a fault detector that masks; decisions by vote; frames that the chain does
    not take."""
    config = model.config.replace(scan_every=scan_every)
    model = dataclasses.replace(model, config=config)
    recordings = random_recordings(config, LENGTHS, seed=4)
    design, registers = Design(export(config, model.arrays), BUILDS), register_map(config)
    simulated = Accelerator(design, config, registers, boot_writes(config, model.arrays))
    stage = Stage(SimulationSource(model, simulated), recordings).go()
    tally = stage.player.tally
    assert (tally.mismatches, tally.sentences) == (0, []) and tally.compared == expected_values(
        run(model, recordings).streams
    )


def board(model, device) -> object:
    return board_source(model, SerialPort(device.port, 2_000_000), device.port, 2_000_000, True)


def test_a_board_is_equal_and_a_wrong_decision_is_seen(model, recordings):
    with Device(model.config, golden_decisions(model, recordings)) as device:
        source = board(model, device)
        tally = Stage(source, recordings).go().player.tally
        source._link._transport.close()
    assert (tally.mismatches, tally.sentences) == (0, []) and tally.compared > 60
    golden = golden_decisions(model, recordings)

    def decide(samples):
        rows, touches = golden(samples)
        rows = rows.copy()
        if len(samples) == 60:
            rows[1, 2] ^= 1
        return (rows[:-1], touches) if len(samples) == 40 else (rows, touches)

    with Device(model.config, decide) as device:
        source = board(model, device)
        stage = Stage(source, recordings).go()
        source._link._transport.close()
    assert [message["wrong"] for message in stage.seen("result")] == [0, 6, 1, 0, 0]
