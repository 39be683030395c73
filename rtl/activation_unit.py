"""Sigmoid and tanh by table."""

from __future__ import annotations

from amaranth.hdl import Cat, Module, signed
from amaranth.lib import wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from golden.activation import sigmoid_table, tanh_table
from golden.config import AcceleratorConfig


class ActivationUnit(wiring.Component):
    """ROM with both tables of golden/activation.py: the sigmoid's in the lower half, tanh's in the upper.

    Members
    -------
    index : In(signed(index_bits))
        Rounded and saturated pre-activation; SQ(index_bits, 0).
    tanh : In(1)
        Which table.
    enable : In(1)
        Look up in this cycle; otherwise ``value`` stays.
    value : Out(signed)
        Gate code (sigmoid) or state code (tanh) of the index one cycle before.

    Latency 1 cycle, one look-up a cycle.
    """

    def __init__(self, config: AcceleratorConfig) -> None:
        self._config = config
        bits = max(config.gate_format.width, config.state_format.width)
        super().__init__({"index": In(signed(config.index_bits)), "tanh": In(1), "enable": In(1), "value": Out(signed(bits))})

    def elaborate(self, platform):
        m = Module()
        table = [int(code) for code in (*sigmoid_table(self._config), *tanh_table(self._config))]
        m.submodules.table = memory = Memory(shape=self.value.shape(), depth=len(table), init=table)
        read = memory.read_port()
        m.d.comb += read.en.eq(self.enable)
        # entry i of a table stands at i + T/2: the index with its sign bit turned over
        m.d.comb += [read.addr.eq(Cat(self.index[:-1], ~self.index[-1], self.tanh)), self.value.eq(read.data)]
        return m
