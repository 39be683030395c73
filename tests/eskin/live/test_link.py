"""The serial link's host (eskin/live/link.py): against devices in Python that are late, and at the pins of the simulated
board, with every kind of damage."""

from collections import Counter
from functools import partial

import numpy as np
import pytest

from eskin.golden.model import run, write_vectors
from eskin.golden.model.position import PositionStream
from eskin.live import link
from eskin.rtl.fpga.generate import register_map
from eskin.training.made_up import random_recordings
from tests.support.link_flow import play_link
from tests.support.noisy_port import NoisyPort
from tests.support.random_models import random_integer_model
from tests.support.small_designs import SMALL

CONFIG = SMALL.replace(
    hop=4,
    window=9,
    touch_frames=24,
    steps=5,
    pretrigger_frames=3,
    rearm_frames=12,
    fault_frames=8,
    fault_activity=60,
    margin_threshold=3,
)
LENGTHS = (90, 40, 60, 12, 5)
"""Several touches, a partial one, no touch."""


# ---------------------------------------------------------------- a device in Python
class Late:
    """A device that takes everything, but nothing while an answer is under way. ``out`` is what it has to say: an item
    a read."""

    registers = register_map(CONFIG)

    def __init__(self, own: tuple[int, ...] = ()) -> None:
        self.unpacker, self.expected, self.decisions = link.Unpacker(), 0, 0
        self.own, self.out = own, list[bytes]()

    def say(self, word: int, counts: int = 0) -> None:
        self.out.append(link.pack(bytes([self.decisions]) + word.to_bytes(4, "little")))
        self.decisions = (self.decisions + counts) % link.NUMBERS

    def write(self, data: bytes) -> None:
        bits, control = self.registers["bits"]["CONTROL"], self.registers["registers"]["CONTROL"]
        for number, command, word, *_ in self.unpacker.feed(data):
            if command & link.READ:
                named = {"ID": self.registers["id"], "VERSION": self.registers["version"]}
                values = {self.registers["registers"][name]: value for name, value in named.items()}
                address = command & 0x3F
                self.say(values.get(address, 0) | self.expected << 16 | address << 24)
            elif not self.out and number == self.expected:
                self.expected += 1
                if command == control and word & bits["ARM"] and self.own:
                    self.say(link.DECISION | 0x111, 1)  # two were under way: one was counted, one was not
                    self.say(link.DECISION | 0x222)
                for payload in self.own if command == control and word & bits["FINISH"] else ():
                    self.say(link.DECISION | payload, 1)

    def read(self, timeout_s: float) -> bytes:
        return self.out.pop(0) if timeout_s and self.out else b""


def test_a_late_answer_does_not_keep_every_packet_out():
    """Found by the 500th corruption of the line: each write met the answer under way to the question before."""
    device = Late()
    device.say(device.registers["registers"]["STATUS"] << 24)
    host = link.Link(device, device.registers, timeout_s=0.01)
    host.write([(device.registers["registers"]["CONTROL"], 2)])
    assert device.expected == host.repeated == 1


def test_packets_go_on_from_the_devices_count_and_a_reset_is_noticed():
    device, writes = Late(), [(Late.registers["registers"]["CONTROL"], 2)]
    device.expected = 200
    host = link.Link(device, device.registers, timeout_s=0.01)
    host.connect()
    host.write(writes)
    assert device.expected == 201
    device.expected = 0
    with pytest.raises(link.LinkError, match="it was reset"):
        host.write(writes)


def test_decisions_under_way_when_arm_comes_belong_to_the_recording_before():
    """docs/specification.md, section 7, and docs/specification_interfaces.md, section 9."""
    device = Late((5, 6, 7))
    host = link.Link(device, device.registers, timeout_s=0.01)
    for _ in range(3):
        played = host.play(np.zeros((3, CONFIG.sensor.taxels), dtype=np.int32))
        assert played.decisions == [5, 6, 7] and host.replayed == 0


# ---------------------------------------------------------------- the simulated board
@pytest.fixture(scope="session")
def board(tmp_path_factory):
    """``board(**options)``: the small board, as of `play_link`."""
    model, folder = random_integer_model(CONFIG, 5), tmp_path_factory.mktemp("board")
    recordings = random_recordings(model.config, LENGTHS, seed=5)
    trace = run(model, recordings)
    unsure = trace.global_margin < CONFIG.network.margin_threshold
    assert len(trace.streams["decision"][0]) > 10 and trace.partial.any() and (trace.first < 0).any()
    assert unsure.any() and not unsure.all() and trace.touches.faults.any()
    return partial(play_link, model, write_vectors(folder / "vectors.npz", trace, recordings))


def test_decisions_over_the_pins_are_golden(board):
    result = board()
    assert not result["wrong"] and result["decisions"] > 10
    assert result["repeated"] == result["replayed"] == result["unanswered"] == result["damaged"] == 0
    for played in result["played"]:
        last = played["decisions"][-1] if played["decisions"] else 0
        if last >> 29 & 1:
            assert played["pins"] == last & 31


@pytest.mark.slow
def test_positions_of_the_hosts_frames_are_read_over_the_link(tmp_path):
    """Golden ones behind every recording: how many since ARM, and the last."""
    one = dict(taxels=16, position=True, position_rest=28000, position_threshold=20, slide_least=2)
    model = random_integer_model(CONFIG.replace(**one), 5)
    recordings = random_recordings(model.config, LENGTHS, seed=5)
    vectors = write_vectors(tmp_path / "vectors.npz", run(model, recordings), recordings)
    result = play_link(model, vectors)
    assert not result["wrong"]
    told = 0
    for number, played in enumerate(result["played"]):
        golden = PositionStream(model.config).push(recordings.recording(number))
        told += len(golden)
        assert played["where"][2] == len(golden)
        for last in golden[-1:]:
            peak = last.peak | last.direction << 8 | last.ended << 11
            assert played["where"][:2] == [last.x | last.y << 8, peak]
    assert told > 50


@pytest.mark.parametrize(
    "count, seed", [(2 * len(NoisyPort.KINDS), 3), pytest.param(1000, 7, marks=pytest.mark.slow)]
)
def test_corruptions_are_noticed_and_every_decision_is_golden(board, count, seed):
    # A few are aimed at a packet that their recording does not come to.
    more = count + count // 100
    result = board(order=[*range(5), *(k % 5 for k in range(more))], corruptions=True, seed=seed)
    done = [played for played in result["played"] if played["done"]]
    kinds = Counter(tuple(played["done"][:2]) for played in done)
    assert len(done) >= count and len(kinds) == len(NoisyPort.KINDS) and not result["wrong"]
    noticed = sum(any(played["noticed"]) for played in done)
    assert noticed > 0.7 * len(done)
