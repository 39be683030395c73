"""Second operands of element-wise products: gates, which the step writes, and constants, which the host
loads.

Gates: docs/specification.md, section 5.
"""

from collections.abc import Sequence

from amaranth.hdl import Const, Module, Mux, Signal, signed
from amaranth.lib import wiring
from amaranth.lib.memory import Memory

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import NO_COLLISION, begins_as_told, drive, inputs, load_lines, load_signature, outputs
from eskin.rtl.program import memory_map
from eskin.rtl.program.cells import CellProgram
from eskin.rtl.program.microcode import Layout
from eskin.rtl.program.timing import ELEMENT_OPERAND_BITS


class CoefficientMemory(wiring.Component):
    """Gates and constants under one address (`eskin.rtl.program.microcode.Layout.gate`), as one memory or
    two.

    Off FPGAs, gates and constants have a memory each (a ROM for constants that are not loaded). The memory
    that is not addressed reads 0, and nothing relies on the initial contents of a memory. FPGAs define these
    contents (`begins_as_told`), which saves cells.

    On an FPGA with a shared lane, gates and constants have a memory each too. Either holds zeros where the
    other has its words; the lane selects between gates and weights anyway and takes their OR in the same
    cells. Other lanes have one block memory for both, and a program without gates has only the constants.

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

    def __init__(self, config: AcceleratorConfig, program: CellProgram, image: Sequence[int] = ()):
        self._config, self._layout, self._image = config, Layout(config, program), list(image)
        address = range(self._layout.gate_depth)
        super().__init__(
            inputs(
                "enable",
                "write",
                address=address,
                write_address=address,
                write_data=signed(config.gate_format.width),
                load=load_signature(config),
            )
            | outputs(gate=signed(ELEMENT_OPERAND_BITS), constant=signed(ELEMENT_OPERAND_BITS))
        )

    def elaborate(self, platform):
        m = Module()
        config, layout = self._config, self._layout
        if not begins_as_told(platform):
            self._apart(m)
            return m
        init = [0] * layout.constants + self._image
        loads = (
            self.load.enable
            & self.load.select[load_lines(config)[memory_map.Memory.CONSTANTS]]
            & int(config.hardware.loadable)
        )
        apart = layout.shared and bool(layout.program.gate_regions)
        to = Const(layout.constants) | self.load.address  # zeros where offsets have bits

        def memory(name: str, init: list[int]) -> tuple:
            m.submodules[name] = part = Memory(
                shape=signed(ELEMENT_OPERAND_BITS), depth=layout.gate_depth, init=init, attrs=NO_COLLISION
            )
            read = part.read_port()
            drive(m, read, addr=self.address, en=self.enable)
            return read.data, part.write_port()

        if apart:
            gate, write = memory("gates", [])
            constant, loaded = memory("constants", init)
            m.d.comb += self.constant.eq(constant)
            drive(m, loaded, addr=to, data=self.load.data, en=loads)
            drive(m, write, addr=self.write_address, data=self.write_data, en=self.write)
        else:
            gate, write = memory("both", init)
            drive(
                m,
                write,
                addr=Mux(loads, to, self.write_address),
                data=Mux(loads, self.load.data, self.write_data),
                en=loads | self.write,
            )
        m.d.comb += self.gate.eq(gate)
        return m

    def _apart(self, m: Module) -> None:
        config, layout = self._config, self._layout
        constant_read = Signal()  # a constant was addressed
        is_constant = self.address >= layout.constants if layout.constants else Const(1, 1)
        m.submodules.constants = constants = Memory(
            shape=signed(ELEMENT_OPERAND_BITS),
            depth=layout.constant_words,
            init=self._image,
            attrs=NO_COLLISION,
        )
        read = constants.read_port()
        drive(m, read, addr=self.address, en=self.enable & is_constant)
        m.d.comb += self.constant.eq(Mux(constant_read, read.data, 0))
        with m.If(self.enable):
            m.d.sync += constant_read.eq(is_constant)
        if config.hardware.loadable:
            loaded = constants.write_port()
            drive(
                m,
                loaded,
                addr=self.load.address,
                data=self.load.data,
                en=self.load.enable & self.load.select[load_lines(config)[memory_map.Memory.CONSTANTS]],
            )
        if not layout.program.gate_regions:
            return
        depth = len(layout.program.gate_regions) << layout.gate_bits
        m.submodules.gates = gates = Memory(
            shape=signed(config.gate_format.width), depth=depth, init=[], attrs=NO_COLLISION
        )
        gate, write = gates.read_port(), gates.write_port()
        drive(m, gate, addr=self.address, en=self.enable & ~is_constant)
        m.d.comb += self.gate.eq(Mux(constant_read, 0, gate.data))
        drive(m, write, addr=self.write_address, data=self.write_data, en=self.write)
