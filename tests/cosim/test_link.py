"""cosim/link.py against a device in Python that is always a question behind."""

import numpy as np

from eskin.cosim import link
from eskin.rtl.fpga.generate import register_map
from tests.support.result_case import CONFIG


class Behind:
    """Takes no packet while an answer is under way but another question; the answer to one from before the
    program's is."""

    def __init__(self) -> None:
        self.unpacker, self.expected, self.writes = link.Unpacker(), 0, 0
        self.under_way = [self.answer(0)]

    def answer(self, address: int) -> bytes:
        return link.pack(bytes([0]) + (self.expected << 16 | address << 24).to_bytes(4, "little"))

    def write(self, data: bytes) -> None:
        for body in self.unpacker.feed(data):
            if body[1] & link.READ:
                self.under_way.append(self.answer(body[1] & 0x3F))
            elif not self.under_way and body[0] == self.expected:
                self.expected, self.writes = self.expected + 1, self.writes + 1

    def read(self, timeout_s: float) -> bytes:
        return self.under_way.pop(0) if timeout_s and self.under_way else b""


def test_a_late_answer_does_not_keep_every_packet_out():
    """Found by the 500th corruption of the line: each write met the answer under way to the question
    before."""
    registers = register_map(CONFIG)
    device = Behind()
    device.under_way = [device.answer(registers["registers"]["STATUS"])]
    host = link.Link(device, registers, timeout_s=0.01)
    host.write([(registers["registers"]["CONTROL"], 2)])
    assert device.writes == 1 and host.repeated == 1


class Late:
    """Takes everything; with each ``arm`` come two decisions that were under way: one was counted, one was
    not."""

    def __init__(self, own: list[int]) -> None:
        self.unpacker, self.expected, self.decisions, self.own, self.out = link.Unpacker(), 0, 0, own, b""
        self.registers = register_map(CONFIG)

    def decide(self, payload: int, *, counts: bool = True) -> None:
        self.out += link.pack(bytes([self.decisions]) + (payload | link.DECISION).to_bytes(4, "little"))
        self.decisions = (self.decisions + counts) % link.NUMBERS

    def write(self, data: bytes) -> None:
        for body in self.unpacker.feed(data):
            command, control = body[1], self.registers["bits"]["CONTROL"]
            if command & link.READ:
                address = command & 0x3F
                self.out += link.pack(
                    bytes([self.decisions]) + (self.expected << 16 | address << 24).to_bytes(4, "little")
                )
            elif body[0] == self.expected:
                self.expected = self.expected + 1 & 0xFF
                if command == self.registers["registers"]["CONTROL"] and body[2] & control["ARM"]:
                    self.decide(0x111)
                    self.decide(0x222, counts=False)
                elif command == self.registers["registers"]["CONTROL"] and body[2] & control["FINISH"]:
                    for payload in self.own:
                        self.decide(payload)

    def read(self, timeout_s: float) -> bytes:
        data, self.out = self.out, b""
        return data


def test_decisions_under_way_when_arm_comes_belong_to_the_recording_before():
    """docs/specification.md, sections 7 and 9."""
    device = Late([5, 6, 7])
    host = link.Link(device, device.registers, timeout_s=0.01)
    for _ in range(3):
        played = host.play(np.zeros((3, CONFIG.sensor.taxels), dtype=np.int32))
        assert played.decisions == [5, 6, 7] and host.replayed == 0
