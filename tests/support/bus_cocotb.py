"""The other side of a bus under cocotb: masters of cocotbext, with pauses at random, on the generated Verilog."""

import os
import random

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import RisingEdge, Timer

from eskin.rtl.program.memory_map import ID_VALUE, NO_DECISION, VERSION_VALUE, Register, ShellRegister

NONE = NO_DECISION


def master(dut, bus, rng):
    """(read, write) of word addresses."""
    if bus == "axi4lite":
        from cocotbext.axi import AxiLiteBus, AxiLiteMaster

        axi = AxiLiteMaster(AxiLiteBus.from_prefix(dut, "s_axi"), dut.clk, dut.rst)
        for channel in (
            axi.write_if.aw_channel,
            axi.write_if.w_channel,
            axi.write_if.b_channel,
            axi.read_if.ar_channel,
            axi.read_if.r_channel,
        ):
            channel.set_pause_generator(iter(lambda: rng.random() < 0.4, None))

        async def read(address):
            return int.from_bytes((await axi.read(4 * address, 4)).data, "little")

        async def write(address, word):
            await axi.write(4 * address, word.to_bytes(4, "little"))

    else:
        from cocotbext.wishbone.driver import WBOp, WishboneMaster

        names = {name: name for name in ("cyc", "stb", "we", "adr", "sel", "ack")}
        wishbone = WishboneMaster(
            dut, "wb", dut.clk, timeout=100, signals_dict=names | {"datwr": "dat_w", "datrd": "dat_r"}
        )

        async def access(address, word):
            idle = rng.randrange(4)
            (result,) = await wishbone.send_cycle([WBOp(4 * address, word, idle=idle, acktimeout=100)])
            return result.datrd

        async def read(address):
            return int(await access(address, None))

        async def write(address, word):
            await access(address, word)

    return read, write


@cocotb.test()
async def registers_and_samples(dut):
    rng = random.Random(1)
    cocotb.start_soon(Clock(dut.clk, 10, "ns").start())
    dut.rst.value = 1
    # cocotbext-wishbone sets its lines at once. At time 0 Icarus 11 then never evaluates the gates behind them, and its
    # acknowledge stays unknown.
    await Timer(1, "ns")
    read, write = master(dut, os.environ["ESKIN_BUS"], rng)
    for _ in range(4):
        await RisingEdge(dut.clk)
    dut.rst.value = 0
    await RisingEdge(dut.clk)
    assert await read(Register.ID) == ID_VALUE
    assert await read(Register.VERSION) == VERSION_VALUE
    assert await read(ShellRegister.DECISION) == NONE
    taxels, place = int(os.environ["ESKIN_TAXELS"]), 0
    for _ in range(8):
        enable = rng.choice((0, 1, 2, 3, 8, 0x10F))
        await write(ShellRegister.ENABLE, enable)
        if rng.random() < 0.5:
            await write(ShellRegister.SAMPLE, rng.getrandbits(16))
            place = (place + 1) % taxels
        else:
            await write(ShellRegister.SAMPLE_PAIR, rng.getrandbits(32))
            place = 0 if place == taxels - 1 else (place + 2) % taxels
        assert await read(ShellRegister.ENABLE) == enable
        assert await read(ShellRegister.NEXT_TAXEL) == place
    assert await read(Register.FAULTS) == 0
