"""What element-wise operands are multiplied by: gates, which the step writes, and constants, which the host loads.

Gates are those of docs/specification.md, section 5.
"""

from __future__ import annotations

from collections.abc import Sequence

from amaranth.hdl import Cat, Const, Module, Mux, signed
from amaranth.lib import wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from eskin.golden.core.config import AcceleratorConfig
from eskin.rtl.common.collisions import NO_COLLISION
from eskin.rtl.common.load_port import load_lines, load_signature
from eskin.rtl.program import memory_map
from eskin.rtl.program.cells import CellProgram
from eskin.rtl.program.microcode import Layout


class CoefficientMemory(wiring.Component):
    """Gates and constants under one address (`eskin.rtl.program.microcode.Layout.gate`), as one memory or two.

    A shared lane chooses between them and the weights anyway: there each has a memory of its own that holds zeros where the other has its
    words, and the lane's choice takes their OR in the same cells; nothing chooses what is written. Elsewhere one block memory serves both,
    and a program without gates has only the constants.

    Parameters
    ----------
    image:
        The constants of a ROM design; empty where the host loads them.

    Members
    -------
    address : In, enable : In(1)
        Read.
    gate, constant : Out(signed(16))
        Latency 1. The word is their OR; of one memory ``constant`` is 0.
    write : In(1), write_address : In, write_data : In(signed)
        A gate code.
    load : In
        The host's writes.
    """

    def __init__(self, config: AcceleratorConfig, program: CellProgram, image: Sequence[int] = ()) -> None:
        self._config, self._layout, self._image = config, Layout(config, program), list(image)
        address = range(self._layout.gate_depth)
        super().__init__(
            {
                "address": In(address),
                "enable": In(1),
                "gate": Out(signed(16)),
                "constant": Out(signed(16)),
                "write": In(1),
                "write_address": In(address),
                "write_data": In(signed(config.gate_format.width)),
                "load": In(load_signature(config)),
            }
        )

    def elaborate(self, platform):
        m = Module()
        config, layout = self._config, self._layout
        init = [0] * layout.constants + self._image
        loads = self.load.enable & self.load.select[load_lines(config)[memory_map.Memory.CONSTANTS]] & int(config.hardware.loadable)
        offset = self.load.address[: (layout.gate_depth - layout.constants - 1).bit_length()]
        apart = layout.shared and bool(layout.program.gate_regions)
        to = Cat(offset, Const(0, layout.constants.bit_length() - 1 - len(offset)), 1) if apart else Const(layout.constants) | offset

        def memory(name: str, init: list[int]) -> tuple:
            m.submodules[name] = part = Memory(shape=signed(16), depth=layout.gate_depth, init=init, attrs=NO_COLLISION)
            read = part.read_port()
            m.d.comb += [read.addr.eq(self.address), read.en.eq(self.enable)]
            return read.data, part.write_port()

        if apart:
            gate, write = memory("gates", [])
            constant, loaded = memory("constants", init)
            m.d.comb += [
                self.constant.eq(constant),
                loaded.addr.eq(to),
                loaded.data.eq(self.load.data),
                loaded.en.eq(loads),
                write.addr.eq(self.write_address),
                write.data.eq(self.write_data),
                write.en.eq(self.write),
            ]
        else:
            gate, write = memory("both", init)
            m.d.comb += [
                write.addr.eq(Mux(loads, to, self.write_address)),
                write.data.eq(Mux(loads, self.load.data, self.write_data)),
                write.en.eq(loads | self.write),
            ]
        m.d.comb += self.gate.eq(gate)
        return m
