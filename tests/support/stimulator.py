"""A model of the electro-tactile stimulator: it decodes the bytes on its line and refuses what its protocol
forbids.

Written from the protocol's table alone: frames begin with '>' and end with '<'; ON, OFF and T have no body;
SD has four bytes, SF and SW two, C1 and C2 sixteen amplitudes, SA sixty-four channel bytes, of which byte n -
1 is n - 1 for channel n or 0xFF for off.
"""

from dataclasses import dataclass, field

LENGTHS = {
    b">ON": 4,
    b">OFF": 5,
    b">T": 3,
    b">SD;": 9,
    b">SF;": 7,
    b">SW;": 7,
    b">C1;": 21,
    b">C2;": 21,
    b">SA;": 69,
}
PLACES = ((11, 6, 27, 22), (10, 7, 1, 23), (9, 8, 2, 24), (12, 5, 28, 21), (13, 4, 29, 20), (14, 3, 30, 19))
"""Channel under each electrode, by row and column."""


def table_frames(channel: int, amplitude: int, delay: int, frequency: int, width: int) -> list[bytes]:
    """The frames of one stimulation of ``channel`` as the protocol's table has them, in the order SD, SF, SW,
    SA, C1, C2, ON."""
    select = bytearray(b"\xff" * 64)
    select[channel - 1] = channel - 1
    banks = [bytearray(16), bytearray(16)]
    banks[(channel - 1) // 16][(channel - 1) % 16] = amplitude
    return [
        b">SD;" + delay.to_bytes(4, "big") + b"<",
        b">SF;" + frequency.to_bytes(2, "big") + b"<",
        b">SW;" + width.to_bytes(2, "big") + b"<",
        b">SA;" + bytes(select) + b"<",
        b">C1;" + bytes(banks[0]) + b"<",
        b">C2;" + bytes(banks[1]) + b"<",
        b">ON<",
    ]


@dataclass
class StimulatorModel:
    """Bytes in, frames out.

    limits: (amplitude, delay, frequency, width) that no frame may exceed. frames: names of the frames taken.
    wrong: what was against the protocol, in words; a frame that is wrong is not taken. is_on: current flows.
    """

    limits: tuple[int, int, int, int]
    frames: list[str] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)
    is_on: bool = False
    selected: list[int] = field(default_factory=list)
    amplitudes: list[int] = field(default_factory=lambda: [0] * 32)
    set_since_off: set[str] = field(default_factory=set)
    pending: bytearray = field(default_factory=bytearray)

    def feed(self, data: bytes) -> None:
        """Bytes off the line."""
        for byte in data:
            self._take(byte)

    def _take(self, byte: int) -> None:
        if not self.pending and byte != ord(">"):
            self.wrong.append(f"byte {byte:#04x} outside of a frame")
            return
        self.pending.append(byte)
        head = next((head for head in LENGTHS if self.pending.startswith(head)), None)
        if head is None:
            if not any(known.startswith(bytes(self.pending)) for known in LENGTHS):
                self.wrong.append(f"no frame begins with {bytes(self.pending)!r}")
                self.pending.clear()
            return
        if len(self.pending) < LENGTHS[head]:
            return
        frame = bytes(self.pending)
        self.pending.clear()
        if frame[-1] != ord("<"):
            self.wrong.append(f"{head!r} does not end with '<'")
            return
        name = head.decode().strip(">;")
        self._act(name, frame[4:-1])
        self.frames.append(name)

    def _act(self, name: str, body: bytes) -> None:
        if name == "OFF":
            self.is_on = False
            self.set_since_off.clear()
            return
        if name == "ON":
            missing = {"SD", "SF", "SW", "SA", "C1", "C2"} - self.set_since_off
            if missing:
                self.wrong.append(f"ON without {', '.join(sorted(missing))}")
            if len(self.selected) != 1:
                self.wrong.append(f"ON with {len(self.selected)} channels")
            for place, amplitude in enumerate(self.amplitudes):
                if amplitude and place + 1 not in self.selected:
                    self.wrong.append(f"channel {place + 1} has an amplitude and is off")
            self.is_on = True
            return
        if self.is_on:
            self.wrong.append(f"{name} while current flows")
        self.set_since_off.add(name)
        if name == "SA":
            self.selected = [place + 1 for place, byte in enumerate(body) if byte != 0xFF]
            self.wrong += [
                f"SA byte {place} is {byte}" for place, byte in enumerate(body) if byte not in (0xFF, place)
            ]
        elif name in ("C1", "C2"):
            low = 0 if name == "C1" else 16
            self.amplitudes[low : low + 16] = body
            self.wrong += [f"amplitude {value} is over the limit" for value in body if value > self.limits[0]]
        elif name in ("SD", "SF", "SW"):
            limit = self.limits[("SD", "SF", "SW").index(name) + 1]
            if int.from_bytes(body, "big") > limit:
                self.wrong.append(f"{name} {int.from_bytes(body, 'big')} is over the limit")
