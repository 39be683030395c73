"""SERV, memory, serial line and clock of microseconds around the accelerator behind Wishbone.

| bytes from | on SERV's data bus |
| --- | --- |
| 0x00000000 | memory: program and data |
| 0x40000000 | the accelerator (registers.h) |
| 0x80000000 | 0 UART: a write sends a byte; 4 TIME: microseconds since reset; 8 WAIT |
| 0xC0000000 | without a converter: the latest frame, 16 bits a taxel |

Reading WAIT is answered when the accelerator's interrupt is high (bit 0) or a frame is there (bit 1): until
then the CPU stands still. SERV has no instruction for that.
"""

from collections.abc import Sequence
from pathlib import Path

import pythondata_cpu_serv
from amaranth.hdl import Cat, ClockSignal, Instance, Module, Mux, Signal
from amaranth.lib import wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import OnePortMemory, forward
from eskin.rtl.host.flash_loader import FlashLoader, flash_pins
from eskin.rtl.host.uart import UartTransmitter, uart_divisor
from eskin.rtl.top.system import System

SERV = Path(pythondata_cpu_serv.data_location)
CORE = sorted(path for path in (SERV / "rtl").glob("serv_*.v") if path.name != "serv_synth_wrapper.v")
"""Verilog of the CPU; serv_synth_wrapper.v is a second top."""
LICENCE = SERV / "LICENSE"
"""Goes with whatever contains the CPU."""
BAUD = 1e6
LOADED_WORDS = 3072
"""32-bit words of the program in the flash."""


class Soc(wiring.Component):
    """The whole system.

    Parameters
    ----------
    config:
        Of the model. Without a converter the CPU feeds the accelerator.
    program:
        Words of 32 bits in the memory from the start. None: they come out of the board's flash, and the CPU
        stays in reset until their checksum has proved right.
    words:
        Of the memory, 32 bits each.

    Members
    -------
    tx : Out(1)
        Serial line, `BAUD`.
    led : Out(1)
        The CPU works; low while it waits in WAIT.
    pins : Out, with a converter
        The converter's.
    frame : In(16 bits a taxel), due : In(1), without one
        The latest frame, taxel 0 lowest, and a pulse with each new one.
    flash : Out(flash_pins), only without ``program``
    """

    def __init__(self, config: AcceleratorConfig, program: Sequence[int] | None, *, words: int) -> None:
        self._config, self._program, self._words = config, program, words
        self._accelerator = System(config, host="wishbone")
        fed = config.interface.converter.name == "none"
        members = {"frame": In(16 * config.sensor.taxels), "due": In(1)}
        pins = {} if fed else {"pins": self._accelerator.signature.members["pins"]}
        flash = {"flash": Out(flash_pins)} if program is None else {}
        super().__init__({"tx": Out(1, init=1), "led": Out(1), **(members if fed else pins), **flash})

    def elaborate(self, platform):
        m = Module()
        clock_hz = self._config.hardware.clock_hz
        m.submodules.accelerator = accelerator = self._accelerator
        m.submodules.uart = uart = UartTransmitter(uart_divisor(clock_hz, BAUD))

        # ------------------------------------------------------------ CPU
        starts, running = Signal(), Signal()
        m.d.comb += running.eq(starts)
        fetch, fetch_at, fetched, fetch_done = Signal(), Signal(32), Signal(32), Signal()
        asks, at, given, select, writes = Signal(), Signal(32), Signal(32), Signal(4), Signal()
        served, done = Signal(32), Signal()
        m.submodules.cpu = Instance(
            "serv_rf_top",
            p_WITH_CSR=0,
            i_clk=ClockSignal(),
            i_i_rst=~running,
            i_i_timer_irq=0,
            o_o_ibus_cyc=fetch,
            o_o_ibus_adr=fetch_at,
            i_i_ibus_rdt=fetched,
            i_i_ibus_ack=fetch_done,
            o_o_dbus_cyc=asks,
            o_o_dbus_adr=at,
            o_o_dbus_dat=given,
            o_o_dbus_sel=select,
            o_o_dbus_we=writes,
            i_i_dbus_rdt=served,
            i_i_dbus_ack=done,
            i_i_ext_rd=0,
            i_i_ext_ready=0,
        )

        # ------------------------------------------------------------ memory: SERV fetches or asks, never both
        address, stored, enables = Signal(range(self._words)), Signal(32), Signal(4)
        lines = Signal(4)  # one hot: which of the four is asked
        answered = Signal()
        m.d.comb += [
            lines.eq(Mux(asks, 1 << at[30:], 0)),
            address.eq(Mux(fetch, fetch_at[2:], at[2:])),
            enables.eq(Mux(lines[0] & writes & ~answered, select, 0)),
            fetched.eq(stored),
        ]
        if self._program is not None:
            m.submodules.memory = memory = Memory(shape=32, depth=self._words, init=self._program)
            read, write = memory.read_port(), memory.write_port(granularity=8)
            m.d.comb += [
                Cat(read.addr, write.addr).eq(Cat(address, address)),
                stored.eq(read.data),
                write.data.eq(given),
                write.en.eq(enables),
            ]
            m.d.sync += starts.eq(1)
        else:
            m.submodules.loader = loader = FlashLoader(2 * LOADED_WORDS, clock_hz)
            forward(m, self, loader, "flash")
            half = Signal(15)
            m.d.comb += starts.eq(loader.done)
            m.d.sync += half.eq(half + loader.valid)
            for k in range(2):
                m.submodules[f"memory_{k}"] = memory = OnePortMemory(self._words)
                m.d.comb += [
                    memory.address.eq(Mux(starts, address, half[1:])),
                    memory.enable.eq(1),
                    memory.data.eq(Mux(starts, given[16 * k :][:16], loader.word)),
                    memory.write.eq(
                        Mux(starts, enables[2 * k :][:2], (loader.valid & (half[0] == k)).replicate(2))
                    ),
                    stored[16 * k :][:16].eq(memory.word),
                ]

        # ------------------------------------------------------------ accelerator
        m.d.comb += [
            accelerator.wb_cyc.eq(lines[1]),
            accelerator.wb_stb.eq(lines[1]),
            accelerator.wb_we.eq(writes),
            accelerator.wb_adr.eq(at),
            accelerator.wb_sel.eq(select),
            accelerator.wb_dat_w.eq(given),
        ]

        # ------------------------------------------------------------ UART, TIME, WAIT
        answers, word, value = Signal(), Signal(32), Signal(32)
        part, time, new = Signal(range(round(clock_hz / 1e6))), Signal(32), Signal()
        over, waits = part == round(clock_hz / 1e6) - 1, Signal()
        m.d.sync += [part.eq(Mux(over, 0, part + 1)), time.eq(time + over)]
        m.d.comb += [uart.i.payload.eq(given), self.tx.eq(uart.tx), answers.eq(1)]
        with m.If(lines[2]), m.Switch(at[2:4]):
            with m.Case(0):
                m.d.comb += [uart.i.valid.eq(writes & ~answered), answers.eq(uart.i.ready)]
            with m.Case(1):
                m.d.comb += value.eq(time)
            with m.Case(2):
                m.d.comb += [
                    value.eq(Cat(accelerator.irq, new)),
                    answers.eq(value.any()),
                    waits.eq(~answered),
                ]
        m.d.comb += self.led.eq(running & ~(waits & ~answers))
        if hasattr(self, "frame"):
            m.d.sync += new.eq(self.due | new & ~(waits & answers))
            with m.If(lines[3]):
                m.d.comb += value.eq(self.frame.word_select(at[2:6], 32))
        else:
            wiring.connect(m, accelerator.pins, wiring.flipped(self.pins))

        # ------------------------------------------------------------ answers
        m.d.sync += [answered.eq((fetch | asks & ~lines[1] & answers) & ~answered), word.eq(value)]
        m.d.comb += [
            fetch_done.eq(fetch & answered),
            done.eq(Mux(lines[1], accelerator.wb_ack, asks & answered)),
            served.eq(Mux(lines[1], accelerator.wb_dat_r, Mux(lines[0], stored, word))),
        ]
        return m
