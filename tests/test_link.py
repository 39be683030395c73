"""cosim/link.py against a device in Python that is always a question behind."""

from __future__ import annotations

from cosim import link
from rtl.generate import register_map
from tests.result_case import CONFIG


class Behind:
    """Takes no packet while an answer is under way but another question; the answer to one from before the program's is."""

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
    """Found by the 500th corruption of the line: each write met the answer under way to the question before."""
    registers = register_map(CONFIG)
    device = Behind()
    device.under_way = [device.answer(registers["registers"]["STATUS"])]
    host = link.Link(device, registers, timeout_s=0.01)
    host.write([(registers["registers"]["CONTROL"], 2)])
    assert device.writes == 1 and host.repeated == 1
