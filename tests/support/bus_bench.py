"""A CPU's side of each bus, with random waits, in Amaranth's simulator; shell and front behind it."""

import random

from amaranth.hdl import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import Out

from eskin.rtl.host.bus_shell import BusShell
from eskin.rtl.top.bus_top import FRONTS

LIMIT = 400
"""Cycles within which an access must end."""


class ShellBehind(wiring.Component):
    """Front and shell without an accelerator: its side of the shell are ports."""

    def __init__(self, config, bus, **options):
        self.front, self.shell = FRONTS[bus](), BusShell(config, **options)
        self._sides = [
            (part, {name: member for name, member in part.signature.members.items() if name != "request"})
            for part in (self.front, self.shell)
        ]
        super().__init__(self._sides[0][1] | self._sides[1][1])

    def elaborate(self, platform):
        m = Module()
        m.submodules.front, m.submodules.shell = self.front, self.shell
        wiring.connect(m, self.front.request, self.shell.request)
        for part, members in self._sides:
            for name, member in members.items():
                mine, its = getattr(self, name), getattr(part, name)
                if member.is_signature:
                    wiring.connect(m, its, wiring.flipped(mine))
                else:
                    m.d.comb += mine.eq(its) if member.flow == Out else its.eq(mine)
        return m


class Cpu:
    """``read`` and ``write`` of word addresses over the ports of a front."""

    def __init__(self, ctx, dut, bus, seed=0, pause=0.3):
        self._ctx, self._dut, self._pause = ctx, dut, pause
        self._random, self._kind = random.Random(seed), bus

    async def read(self, address):
        return await getattr(self, f"_{self._kind}")(4 * int(address), None, 0xF)

    async def write(self, address, word, select=0xF):
        await getattr(self, f"_{self._kind}")(4 * int(address), word, select)

    async def _pauses(self):
        while self._random.random() < self._pause:
            await self._ctx.tick()

    def _put(self, prefix, **values):
        for name, value in values.items():
            self._ctx.set(getattr(self._dut, prefix + name), value)

    async def _until(self, prefix, *names):
        """Values of ``names`` at the first edge at which the first one is high."""
        ports = [getattr(self._dut, prefix + name) for name in names]
        for _ in range(LIMIT):
            _, _, first, *rest = await self._ctx.tick().sample(*ports)
            if first:
                return rest
        raise AssertionError(f"no {names[0]} in {LIMIT} cycles")

    async def _wishbone(self, address, word, select):
        await self._pauses()
        self._put("wb_", cyc=1, stb=1, we=word is not None, adr=address, dat_w=word or 0, sel=select)
        (value,) = await self._until("wb_", "ack", "dat_r")
        self._put("wb_", cyc=self._random.random() < 0.5, stb=0)
        return value

    async def _axi4lite(self, address, word, select):
        prefix = "s_axi_"
        if word is None:
            await self._pauses()
            self._put(prefix, arvalid=1, araddr=address)
            await self._until(prefix, "arready")
            self._put(prefix, arvalid=0, araddr=0)
            await self._pauses()
            self._put(prefix, rready=1)
            value, response = await self._until(prefix, "rvalid", "rdata", "rresp")
            self._put(prefix, rready=0)
            assert response == 0
            return value
        waits = {"aw": self._random.randrange(4), "w": self._random.randrange(4)}
        values = {"aw": {"awaddr": address}, "w": {"wdata": word, "wstrb": select}}
        cycle = 0
        while waits:
            for channel, wait in waits.items():
                if wait <= cycle:
                    self._put(prefix, **values[channel], **{f"{channel}valid": 1})
            dut = self._dut
            _, _, aw, w = await self._ctx.tick().sample(dut.s_axi_awready, dut.s_axi_wready)
            for channel, ready in (("aw", aw), ("w", w)):
                if channel in waits and waits[channel] <= cycle and ready:
                    self._put(prefix, **{f"{channel}valid": 0})
                    del waits[channel]
            cycle += 1
            assert cycle < LIMIT
        await self._pauses()
        self._put(prefix, bready=1)
        (response,) = await self._until(prefix, "bvalid", "bresp")
        self._put(prefix, bready=0)
        assert response == 0
        return None
