"""Checks of the host's registers: their parity, and the end of each memory that is loaded
(docs/specification_interfaces.md section 11)."""

from amaranth.hdl import Cat, Module, Signal, Value

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common.compare import reaches
from eskin.rtl.common.load_port import load_lines
from eskin.rtl.program.memory_map import memory_words, words_per_entry


def parity_wrong(m: Module, register: Signal, write: Value, data: Value) -> Value:
    """High while the parity of ``register`` is wrong. ``data`` is its new value when ``write`` is high."""
    parity = Signal(init=register.init.bit_count() & 1, name=f"{register.name}_parity")
    with m.If(write):
        m.d.sync += parity.eq(data[: len(register)].xor())
    return register.xor() ^ parity


def at_end(config: AcceleratorConfig, select: Value, address: Value) -> Value:
    """High if ``address``, in 16-bit words from 0, is beyond the last one of the memory whose line of
    ``select`` is high."""
    count, lines = memory_words(config), load_lines(config)
    ends = [
        select[line] & reaches(address, count[number] * words_per_entry(config, number))
        for number, line in lines.items()
    ]
    return Cat(ends).any()
