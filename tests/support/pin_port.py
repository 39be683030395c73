"""The serial line of a simulated device at its pins, as a transport of eskin/live/link.py; and bytes as a line's
levels, 8N1."""

import numpy as np

from eskin.cosim.device import Device

FLAG = 0x7E


def levels(data: bytes, clocks: int, broken: frozenset[int] = frozenset()) -> np.ndarray:
    """Bytes as levels, one a clock; the stop bits of bytes at the places in ``broken`` are low."""
    bits = np.unpackbits(np.frombuffer(data, np.uint8)[:, None], axis=1, bitorder="little")
    stops = [[place not in broken] for place in range(len(data))]
    return np.repeat(
        np.hstack(
            [np.zeros((len(data), 1), np.uint8), bits, np.array(stops, np.uint8).reshape(-1, 1)]
        ).ravel(),
        clocks,
    )


def decoded(line: bytes, clocks: int) -> tuple[bytes, int]:
    """The bytes in a line's levels, and the place behind the last whole one."""
    data, at = bytearray(), 0
    while (start := line.find(0, at)) >= 0 and start + 10 * clocks <= len(line):
        middle = start + clocks // 2
        data.append(sum(line[middle + (k + 1) * clocks] << k for k in range(8)))
        at = middle + 9 * clocks
    return bytes(data), at if start >= 0 else len(line)


class PinPort:
    """Pins rx and tx of a device; ``timeout_s`` counts byte times."""

    def __init__(self, device: Device, clocks: int) -> None:
        self._device, self._clocks = device, clocks
        self._line, self._heard = b"", b""

    def close(self) -> None:
        pass

    def write(self, data: bytes, broken: frozenset[int] = frozenset()) -> None:
        """Send all of ``data``; the bytes at the places in ``broken`` have a low stop bit."""
        self._pass(levels(data, self._clocks, broken))

    def read(self, timeout_s: float) -> bytes:
        """Received bytes; waits for a flag, at most ``timeout_s``."""
        waited = 0
        while FLAG not in self._heard and waited < timeout_s:
            self._pass(np.ones(10 * self._clocks))
            waited += 1
        heard, self._heard = self._heard, b""
        return heard

    def _pass(self, driven: np.ndarray) -> None:
        driven, sent = driven.astype(np.uint8), np.zeros(len(driven), np.uint8)
        self._device._call("play_line", driven, len(driven), sent)
        self._line += sent.tobytes()
        data, through = decoded(self._line, self._clocks)
        self._line, self._heard = self._line[through:], self._heard + data
