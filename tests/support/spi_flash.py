"""A serial flash at its pins, by a data sheet's words (W25Q128: commands 0xAB and 0x03), for Amaranth's
simulator."""

WAKE, READ = 0xAB, 0x03


class SpiFlash:
    """Asleep until 0xAB: while it sleeps it hears nothing else and its output is high. Command, address and
    data highest bit first; it reads DI when CLK rises and changes DO when CLK falls.

    image: bytes from address ``offset`` on, 0xFF elsewhere. wake_cycles: from the end of 0xAB until it hears
    the next command. commands: what it heard. early: commands that came before it was awake.
    """

    def __init__(self, pins, offset: int, image: bytes, wake_cycles: int) -> None:
        self._pins, self._offset, self._image, self._wake = pins, offset, image, wake_cycles
        self.commands: list[int] = []
        self.early = 0

    def _bit(self, number: int) -> int:
        byte = number // 8 - self._offset
        return (self._image[byte] if 0 <= byte < len(self._image) else 0xFF) >> 7 - number % 8 & 1

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
                bits = []
                ctx.set(self._pins.miso, 1)
            if not cs_n:
                fell = cycle if before[0] else fell
                if sclk and not before[1]:
                    bits.append(mosi)
                    if len(bits) == 8:
                        self.commands.append(int("".join(map(str, bits)), 2))
                        self.early += self.commands[-1] == READ and (awake_at is None or fell < awake_at)
                reads = self.commands and self.commands[-1] == READ and not self.early
                if before[1] and not sclk and len(bits) >= 32 and reads:
                    address = int("".join(map(str, bits[8:32])), 2)
                    ctx.set(self._pins.miso, self._bit(8 * address + len(bits) - 32))
            before = (cs_n, sclk)
            await ctx.tick()
            cycle += 1
