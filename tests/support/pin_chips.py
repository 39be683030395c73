"""Chips for benches of the Amaranth simulator: a DDC232 and an MPR121 at their pins, as much of them as a
frame needs."""


class DdcSlave:
    """Answers with ``words`` (each ``bits`` wide, in the order of the wire) so many cycles after each edge of
    CONV. spoil(name, value) may change "readback" (the 88 bits) and "dvalid" (whether it comes).
    configurations: what was latched. clk_edges: cycles in which the system clock changed. resets: cycles of each.
    cfg_edges, din_edges: cycles in which configuration clock and data changed, counted from the end of the reset.
    to_readback: cycles from the last of them to the first edge of the data clock."""

    def __init__(self, pins, words, bits, delay=40, spoil=lambda name, value: value) -> None:
        self.pins, self.words, self.bits, self.delay, self.spoil = pins, words, bits, delay, spoil
        self.configurations: list[int] = []
        self.conv_edges: list[int] = []
        self.dclk_edges: list[int] = []
        self.clk_edges: list[int] = []
        self.cfg_edges: list[int] = []
        self.din_edges: list[int] = []
        self.resets = [0]
        self.to_readback = 0

    async def play(self, ctx) -> None:
        pins, cycle, due, out, left, latched, count = self.pins, 0, -1, 0, 0, 0, 0
        was, released = (0, 0, 0, 0, 0), 0
        lines = pins.reset_n, pins.conv, pins.clk_cfg, pins.din_cfg, pins.dclk, pins.clk
        ticks = aiter(ctx.tick().sample(*lines))
        while True:
            _, _, reset_n, conv, clk_cfg, din, dclk, clk = await anext(ticks)
            cycle += 1
            if reset_n and self.resets[-1]:
                self.resets.append(0)
            if clk_cfg != was[1]:
                self.cfg_edges.append(cycle - released)
            if din != was[4]:
                self.din_edges.append(cycle - released)
            if not reset_n:
                released = cycle
                self.resets[-1] += 1
                latched = count = 0
                due = -1
                ctx.set(pins.dvalid_n, 1)
            elif was[1] and not clk_cfg:
                latched, count = (latched << 1 | din) & 0xFFF, count + 1
                if count == 12:
                    self.configurations.append(latched)
                    answer = self.spoil("readback", latched << 76 | 9 << 72 | 0x30F066012480F69055)
                    out, left = int(f"{answer:088b}" * 8, 2) >> 64, 640
            if conv != was[0]:
                self.conv_edges.append(cycle)
                due = cycle + self.delay
                ctx.set(pins.dvalid_n, 1)
            if dclk != was[2]:
                self.dclk_edges.append(cycle)
                self.to_readback = self.to_readback or cycle - released - self.cfg_edges[-1]
            if clk != was[3]:
                self.clk_edges.append(cycle)
            if was[2] and not dclk and left:
                left -= 1
            if cycle == due and self.spoil("dvalid", True):
                out = 0
                for word in self.words():
                    out = out << self.bits | word
                left = self.bits * 32
                ctx.set(pins.dvalid_n, 0)
            was = (conv, clk_cfg, dclk, clk, din)
            ctx.set(pins.dout, out >> left - 1 & 1 if left else 0)


class MprSlave:
    """Chips on one bus, by address: ``electrodes(address)`` gives twelve codes. silent: addresses that do not
    acknowledge. ecr: register 0x5E, by address; where that is 0 electrodes read 0. written: (address,
    register, value) in their order. shortest: cycles that the clock was low or high at least. idle: clocks behind a
    stop. pauses: cycles from a stop to the next start, by what was written last."""

    def __init__(self, pins, electrodes, config2=0x24) -> None:
        self.pins, self.electrodes, self.config2 = pins, electrodes, config2
        self.silent: set[int] = set()
        self.upper, self.shortest, self.idle = 0, 1 << 20, 0
        self.ecr = {0x5A: 0, 0x5B: 0}
        self.written: list[tuple[int, int, int]] = []
        self.pauses: dict[tuple[int, int, int], set[int]] = {}

    def register(self, address: int, number: int) -> int:
        if number == 0x5D:
            return self.config2
        if number == 0x5E:
            return self.ecr[address]
        code = self.electrodes(address)[(number - 4) // 2 % 12] if self.ecr[address] else 0
        return code & 0xFF if number % 2 == 0 else code >> 8 | self.upper * (number == 5)

    async def play(self, ctx) -> None:
        pins, pulls, sda_was, scl_was = self.pins, False, 1, 1
        bits, word, address, pointer, mode, answer, since = 0, 0, 0, -1, "off", 0, 1 << 20
        ticks = aiter(ctx.tick().sample(pins.scl_low, pins.sda_low))
        while True:
            _, _, scl_low, sda_low = await anext(ticks)
            scl, sda = not scl_low, not (sda_low or pulls)
            since += 1
            if scl != scl_was:
                self.shortest, since = min(self.shortest, since), 0
            if scl and scl_was and sda != sda_was:
                if mode == "off" and not sda and self.written:
                    self.pauses.setdefault(self.written[-1], set()).add(since)
                mode, bits, word, pulls = ("address", 0, 0, False) if not sda else ("off", 0, 0, False)
            elif scl and not scl_was and mode == "off":
                self.idle += 1
            elif scl and not scl_was:
                bits += 1
                if bits < 9:
                    word = word << 1 | sda
                elif mode == "read" and sda:
                    mode = "off"
            elif not scl and scl_was and mode != "off":
                pulls = False
                if bits == 8 and mode != "read":
                    address = word >> 1 if mode == "address" else address
                    pulls = address in (0x5A, 0x5B) and address not in self.silent
                    mode = mode if pulls else "off"
                elif bits == 9:
                    if mode == "address":
                        mode, pointer = ("read", pointer) if word & 1 else ("write", -1)
                    elif mode == "write":
                        if pointer >= 0:
                            self.written.append((address, pointer, word))
                            self.ecr[address] = (
                                word if pointer == 0x5E else 0 if pointer == 0x80 else self.ecr[address]
                            )
                        pointer = word if pointer < 0 else pointer + 1
                    bits = word = 0
                if mode == "read" and bits < 8:
                    if bits == 0:
                        answer, pointer = self.register(address, pointer), pointer + 1
                    pulls = not answer >> 7 - bits & 1
            scl_was, sda_was = scl, not (sda_low or pulls)
            ctx.set(pins.sda, sda_was)
