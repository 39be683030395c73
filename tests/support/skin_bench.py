"""The cocotb test of skin_board.sv: frames at the converter's taxels, a host on the serial line, and what the pins say."""

import json
from contextlib import suppress
from pathlib import Path

import cocotb
import numpy as np
from cocotb.triggers import FallingEdge, RisingEdge, SimTimeoutError, Timer, with_timeout
from cocotb.utils import get_sim_time

CYCLE_NS = 10


async def cycles(count: float) -> None:
    """Wait so many."""
    await Timer(round(count * CYCLE_NS), "ns")


def now() -> int:
    """The cycle."""
    return round(get_sim_time("ns") / CYCLE_NS)


async def hear(line, clocks: int, heard: list) -> None:
    """Bytes on a serial line and the cycle of their stop bit; 256 more where that is low."""
    while True:
        await FallingEdge(line)
        await cycles(1.5 * clocks)
        byte = 0
        for bit in range(8):
            byte |= int(line.value) << bit
            await cycles(clocks)
        heard.append((byte + 256 * (not line.value), now()))


async def say(line, clocks: int, data: bytes) -> None:
    """Bytes onto a serial line."""
    for byte in data:
        for bit in f"{byte | 1 << 8:b}0"[::-1]:
            line.value = int(bit)
            await cycles(clocks)


class Board:
    """``dut`` under the settings of `tests.support.skin.play`; said: what becomes its `Played`."""

    def __init__(self, dut, settings: dict) -> None:
        self.dut, self.settings = dut, settings
        self.events: dict = {"stim": [], "pins": [], "host": [], "begun": False}

    async def follow(self) -> None:
        """Decision, its valid, and the lamp, whenever one changes."""
        while True:
            await self.dut.shown.value_change
            *one_hot, valid, led = str(self.dut.shown.value)
            self.events["pins"].append(
                (now(), int("".join(one_hot), 2).bit_length() - 1, valid == "1", led == "1")
            )

    async def play(self, codes: np.ndarray) -> None:
        """The taxels take the next frame a tenth of a frame before it is due, from the first scan on."""
        dut, settings, period = self.dut, self.settings, self.settings["period"]
        await cycles(3)
        if not dut.moving.value:
            await RisingEdge(dut.moving)
        self.events["begun"] = True
        await cycles(period - period // 10)
        for number, frame in enumerate(codes[1:], start=1):
            self.take(frame, number)
            await cycles(period)
        self.take(codes[-1], len(codes))
        await cycles(settings["tail"] / 2)
        await say(dut.rx, settings["host_clocks"], bytes.fromhex(settings["last"]))
        await cycles(settings["tail"] / 2)

    def take(self, frame: np.ndarray, number: int) -> None:
        """The taxels are ``frame``; from one number on the converter misbehaves."""
        self.dut.analog.value = int.from_bytes(frame.astype("<u4").tobytes(), "little")
        self.dut.misbehaves.value = self.settings["fault_kind"] * (number >= self.settings["fault_frame"])

    async def host(self) -> None:
        """What the host sends once the part is out of its reset."""
        await cycles(20000)
        await say(self.dut.rx, self.settings["host_clocks"], bytes.fromhex(self.settings["host"]))


@cocotb.test()
async def play(dut) -> None:
    """One recording from power-on."""
    settings, codes = json.loads(Path("skin.json").read_text()), np.load("codes.npy")
    board = Board(dut, settings)
    board.take(codes[0], 0)
    for task in (
        hear(dut.stim_tx, settings["stim_clocks"], board.events["stim"]),
        hear(dut.tx, settings["host_clocks"], board.events["host"]),
        board.follow(),
        board.host(),
    ):
        cocotb.start_soon(task)
    with suppress(SimTimeoutError):
        await with_timeout(board.play(codes), settings["limit"] * CYCLE_NS, "ns")
    board.events["violations"] = dut.violations.value.to_unsigned()
    Path("result.json").write_text(json.dumps(board.events))
