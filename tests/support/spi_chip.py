"""A chip on an SPI port for benches of the Amaranth simulator: what it hears and says, bit by bit, out of a
function of the command."""

from collections import deque
from collections.abc import Callable


class SpiSlave:
    """One chip for each data line. ``answers(line)`` is asked when select falls and gives the word that the
    line says, highest bit first; heard: of every transfer the select lines that fell, the bits and the word that came in; edges: cycles of
    every change of select and clock. late: cycles that its answer takes."""

    def __init__(self, pins, bits: int, answers: Callable[[int, int], int], late: int = 1) -> None:
        self.pins, self.bits, self.answers, self.late = pins, bits, answers, late
        self.heard: list[tuple[int, int, int]] = []
        self.edges: list[tuple[int, str, int]] = []

    async def play(self, ctx) -> None:
        pins, lines, cycle = self.pins, len(self.pins.miso), 0
        idle = (1 << len(pins.cs_n)) - 1
        words, sent, heard, select, clock = [0] * lines, 0, 0, idle, 0
        levels = deque([(1 << lines) - 1] * self.late)
        ctx.set(pins.miso, (1 << lines) - 1)
        while True:
            await ctx.tick()
            now, level, bit = ctx.get(pins.cs_n), ctx.get(pins.sclk), ctx.get(pins.mosi)
            if now != select:
                self.edges.append((cycle, "select", now))
                if now == idle:
                    self.heard.append((idle & ~select, sent, heard))
                else:
                    words, sent, heard = [self.answers(line, select & ~now) for line in range(lines)], 0, 0
            elif now != idle and level and not clock:
                heard = heard << 1 | bit
            elif now != idle and clock and not level:
                sent += 1
            if level != clock:
                self.edges.append((cycle, "clock", level))
            select, clock = now, level
            place = self.bits - 1 - sent
            levels.append(
                (1 << lines) - 1
                if now == idle or place < 0
                else sum((words[k] >> place & 1) << k for k in range(lines))
            )
            ctx.set(pins.miso, levels.popleft())
            cycle += 1
