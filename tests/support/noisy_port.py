"""A serial port that damages bytes: what a bad line does, on purpose and by seed."""

import random

from eskin.live.link import read_packet


class NoisyPort:
    """Another port, with one thing done to its bytes when it is told to.

    Kinds, towards the device: ``flip`` a bit, ``drop`` a byte, ``double`` it, ``broken`` stop bit, ``break``:
    the line low for three bytes, ``cut`` a run of bytes, ``garbage`` bytes in between, ``swap`` two
    neighbours, ``overrun``: a read in between, during whose answer the device drops what comes. From it:
    ``flip``, ``drop``, ``double``, ``cut``, ``garbage``.
    """

    KINDS = (
        *(
            (kind, "to")
            for kind in ("flip", "drop", "double", "broken", "break", "cut", "garbage", "swap", "overrun")
        ),
        *((kind, "from") for kind in ("flip", "drop", "double", "cut", "garbage")),
    )

    def __init__(self, port, seed: int, address: int) -> None:
        self.port, self.rng, self.address = port, random.Random(seed), address
        self.plan: tuple[str, str, int] | None = None
        self.passed = {"to": 0, "from": 0}
        self.done: tuple[str, str, int] | None = None

    def arm(self, kind: tuple[str, str], place: int) -> None:
        """Do ``kind`` to the byte ``place`` of its direction, counted from now on."""
        self.plan, self.done, self.passed = (*kind, place), None, {"to": 0, "from": 0}

    def _place(self, direction: str, data: bytes) -> int | None:
        """Where in ``data`` the plan strikes."""
        begin = self.passed[direction]
        self.passed[direction] += len(data)
        if self.plan and self.plan[1] == direction and begin <= self.plan[2] < begin + len(data):
            self.done, place, self.plan = self.plan, self.plan[2] - begin, None
            return place
        return None

    def _damage(self, kind: str, data: bytes, at: int) -> bytes:
        rng = self.rng
        changed = {
            "flip": lambda: bytes([data[at] ^ 1 << rng.randrange(8)]),
            "drop": lambda: b"",
            "double": lambda: data[at : at + 1] * 2,
            "garbage": lambda: rng.randbytes(rng.randint(1, 20)) + data[at : at + 1],
            "overrun": lambda: read_packet(self.address) + data[at : at + 1],
        }
        if kind == "cut":
            return data[:at] + data[at + rng.randint(2, 60) :]
        if kind == "swap":
            return data[:at] + data[at : at + 2][::-1] + data[at + 2 :]
        return data[:at] + changed[kind]() + data[at + 1 :]

    def write(self, data: bytes) -> None:
        """As the port's."""
        place = self._place("to", data)
        if place is None:
            self.port.write(data)
        elif self.done[0] == "broken":
            self.port.write(data, frozenset([place]))
        elif self.done[0] == "break":
            self.port.write(data[:place] + bytes(3) + data[place:], frozenset(range(place, place + 3)))
        else:
            if self.done[0] == "overrun":
                # between packets: a read that is not itself damaged
                place = data.find(0x7E, place) + 1 or place
            self.port.write(
                self._damage(self.done[0], data, place)
                if place < len(data)
                else data + read_packet(self.address)
            )

    def read(self, timeout_s: float) -> bytes:
        """As the port's."""
        data = self.port.read(timeout_s)
        place = self._place("from", data)
        return data if place is None else self._damage(self.done[0], data, place)
