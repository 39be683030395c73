"""A serial flash at its pins, by a data sheet's words (W25Q128: commands 0xAB, 0x03, 0x05, 0x06, 0x02 and an
erase), for Amaranth's simulator."""

import random

WAKE, READ, STATUS, ENABLE, PROGRAM = 0xAB, 0x03, 0x05, 0x06, 0x02
PAGE = 256


class SpiFlash:
    """Asleep until 0xAB: while it sleeps it hears nothing else and its output is high. Command, address and
    data highest bit first; it reads DI when CLK rises and changes DO when CLK falls.

    To program only clears bits, in one page; erase sets all of a sector. Either needs 0x06 before it, begins when
    CS rises and takes a cycle a byte, in which it hears 0x05 alone.

    contents: byte by address from ``offset`` on, 0xFF where it holds nothing. wake_cycles: from the end of 0xAB
    until it hears the next command. early: commands that came before that. erase: (command, bytes of a sector).
    changes: (byte, what it became), in their order. wrong: what no data sheet allows, or a byte programmed that is
    not erased.
    """

    def __init__(
        self, pins, offset: int, image: bytes, wake_cycles: int, *, erase: tuple[int, int] = (0, 0)
    ) -> None:
        self._pins, self._offset, self.image, self._wake = pins, offset, bytearray(image), wake_cycles
        self._erase, self._rng = erase, random.Random(1)
        self.commands: list[int] = []
        self.early = 0
        self.wrong: list[str] = []
        self.changes: list[tuple[int, int]] = []
        self._enabled, self._pending = False, []

    def _bit(self, number: int) -> int:
        byte = number // 8 - self._offset
        return (self.image[byte] if 0 <= byte < len(self.image) else 0xFF) >> 7 - number % 8 & 1

    def _ends(self, bits: list[int]) -> None:
        """CS has risen behind these bits."""
        number = int("".join(map(str, bits)) or "0", 2)
        command = number >> max(0, len(bits) - 8)
        if command == ENABLE and len(bits) == 8:
            self._enabled = True
        if command not in (PROGRAM, self._erase[0]) or len(bits) < 8:
            return
        if not self._enabled or (len(bits) != 32 if command == self._erase[0] else len(bits) % 8):
            self.wrong.append(f"command {command:#x} of {len(bits)} bits")
            return
        self._enabled = False
        address = int("".join(map(str, bits[8:32])), 2) - self._offset
        if command == PROGRAM:
            page = address // PAGE * PAGE
            data = bytes(int("".join(map(str, bits[at : at + 8])), 2) for at in range(32, len(bits), 8))
            self._pending = [(page + (address - page + k) % PAGE, byte) for k, byte in enumerate(data)]
            if any(self.image[at] != 0xFF for at, _ in self._pending):
                self.wrong.append(f"byte {address:#x} is not erased")
        else:
            first = address // self._erase[1] * self._erase[1]
            self._pending = [(first + k, None) for k in range(self._erase[1])]
            self._rng.shuffle(self._pending)

    def _change(self) -> None:
        at, byte = self._pending.pop(0)
        self.image[at] = 0xFF if byte is None else self.image[at] & byte
        self.changes.append((at, self.image[at]))

    async def play(self, ctx):
        cycle, fell, awake_at = 0, 0, None
        before = (1, 0)
        bits: list[int] = []
        ctx.set(self._pins.miso, 1)
        while True:
            cs_n, sclk, mosi = ctx.get(self._pins.cs_n), ctx.get(self._pins.sclk), ctx.get(self._pins.mosi)
            if cs_n and not before[0]:
                if int("".join(map(str, bits[:8])) or "0", 2) == WAKE and len(bits) == 8:
                    awake_at = cycle + self._wake
                self._ends(bits)
                bits = []
                ctx.set(self._pins.miso, 1)
            if self._pending:
                self._change()
            if not cs_n:
                fell = cycle if before[0] else fell
                if sclk and not before[1]:
                    bits.append(mosi)
                    if len(bits) == 8:
                        self.commands.append(int("".join(map(str, bits)), 2))
                        self.early += self.commands[-1] == READ and (awake_at is None or fell < awake_at)
                        if self._pending and self.commands[-1] != STATUS:
                            self.wrong.append(f"command {self.commands[-1]:#x} while it works")
                reads = self.commands and self.commands[-1] == READ and not self.early
                if before[1] and not sclk and len(bits) >= 32 and reads:
                    address = int("".join(map(str, bits[8:32])), 2)
                    ctx.set(self._pins.miso, self._bit(8 * address + len(bits) - 32))
                if before[1] and not sclk and len(bits) >= 8 and self.commands[-1] == STATUS:
                    ctx.set(self._pins.miso, int(bool(self._pending)) if len(bits) % 8 == 7 else 0)
            before = (cs_n, sclk)
            await ctx.tick()
            cycle += 1
