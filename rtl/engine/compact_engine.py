"""The compact engine: one adder, one data memory and a looping program, for parts without multipliers and
with few logic cells.

Rows and cells: docs/specification.md, sections 4 and 5.
"""

from collections.abc import Mapping

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value, signed
from amaranth.lib import wiring
from amaranth.lib.memory import Memory

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common.collisions import NO_COLLISION
from eskin.rtl.common.load_port import load_lines
from eskin.rtl.common.memory_style import begins_as_told
from eskin.rtl.engine.compact_accumulator import CompactAccumulator
from eskin.rtl.engine.compact_result import CompactResult
from eskin.rtl.engine.compact_sequencer import CompactSequencer
from eskin.rtl.engine.engine import Engine, engine_signature
from eskin.rtl.engine.window_queue import WindowQueue
from eskin.rtl.program import memory_map
from eskin.rtl.program.cells import CellProgram
from eskin.rtl.program.compact_program import DATA_BITS, Kind
from eskin.rtl.program.schedule import schedule
from eskin.rtl.program.timing import is_compact, logit_to_decision


class CompactEngine(wiring.Component):
    """Computes one recurrent step and its logits for every window of centred sums:
    `eskin.rtl.program.compact_program` in hardware.

    It takes the place of `eskin.rtl.engine.engine.Engine` for the bit-serial lane, with the same ports and
    parameters. Weights are stored bit by bit in the order of their use. Everything else, including waiting
    windows and biases, lies in one memory of 16-bit words. A step takes `Schedule.step_cycles`.

    A MAC instruction addresses a word; in the next cycle the accumulator is shifted and the word added. The
    program leaves that cycle free between the last MAC and a STORE. A window's sum waits while a STORE
    writes.
    """

    def __init__(
        self,
        config: AcceleratorConfig,
        images: Mapping[int, list[int]] | None = None,
        program: CellProgram | None = None,
    ) -> None:
        self._config, self._images = config, images or {}
        self.plan = schedule(config, program)
        super().__init__(engine_signature(config))

    def elaborate(self, platform):
        m = Module()
        config, code = self._config, self.plan.compact
        m.submodules.sequencer = sequencer = CompactSequencer(config, code)
        m.submodules.queue = queue = WindowQueue(config, code.index_bits)
        m.submodules.accumulator = accumulator = CompactAccumulator(config, code)
        m.submodules.narrowing = narrowing = CompactResult(config, code)
        word = sequencer.fields

        # ---------------------------------------------------------------- windows waiting for their step
        wiring.connect(m, wiring.flipped(self.i), queue.i)
        # Registered, because it stalls everything in front. A cycle of notice is always there: a STORE comes
        # after an instruction that does nothing, or after the look-up of what it writes.
        stores_next = Signal()
        idles = sequencer.control & ~(word["clear"] | word["wait"] | word["release"])
        m.d.sync += stores_next.eq(idles | (sequencer.store & (word["kind"] == Kind.INDEX)))
        m.d.comb += [
            queue.hold.eq(stores_next),
            queue.released.eq(sequencer.control & word["release"]),
            queue.started.eq(self.started),
            queue.step_done.eq(self.step_done),
            sequencer.go.eq(queue.waiting & self.decider_idle),
            self.started.eq(sequencer.started),
            self.overrun.eq(queue.overrun),
            self.windows_open.eq(queue.open),
        ]

        # ---------------------------------------------------------------- from memories to the accumulator and back
        m.d.comb += [
            accumulator.mac.eq(sequencer.mac),
            accumulator.fresh.eq(sequencer.fresh),
            *(
                getattr(accumulator, name).eq(word[name])
                for name in ("shift", "inverted", "fetch", "use", "zero")
            ),
            accumulator.clear.eq(sequencer.control & word["clear"]),
            accumulator.weight.eq(self._weights(m, sequencer)),
            narrowing.acc.eq(accumulator.acc),
            narrowing.left.eq(accumulator.left),
            narrowing.store.eq(sequencer.store),
            *(getattr(narrowing, name).eq(word[name]) for name in ("kind", "table", "tanh")),
        ]
        result, stores = narrowing.result, sequencer.store & word["kind"][1]
        self._data(m, platform, sequencer, queue, accumulator, result, stores)
        m.d.comb += [
            self.logit.value.eq(result),
            self.logit.valid.eq(sequencer.store & (word["kind"] == Kind.LOGIT)),
        ]

        # ---------------------------------------------------------------- for control and benches
        m.d.comb += [
            self.step_done.eq(self.logit.valid & sequencer.last_class),
            self.slot_done.eq(self.started | queue.computing),
            self.working.eq(queue.any | ~sequencer.waits),
            self.busy.eq(self.working | queue.taxel.any()),
        ]
        cycles = Signal(range(code.last_logit + 1))
        with m.If(self.slot_done):
            m.d.sync += cycles.eq(Mux(self.started, 0, cycles + 1))
        region = word["region"]
        m.d.comb += [
            self.step.valid.eq(self.step_done),
            self.step.value.eq(cycles + 1 + logit_to_decision(config)),
            self.feature.valid.eq(stores & (word["kind"] == Kind.FEATURE) & (region == code.regions["S.x"])),
            self.feature.value.eq(result),
            self.state.value.eq(result),
        ]
        if code.program.hidden:
            hidden = code.regions[f"S.{code.program.hidden}"]
            m.d.comb += self.state.valid.eq(stores & (word["kind"] == Kind.STATE) & (region == hidden))
        return m

    def _weights(self, m: Module, sequencer: CompactSequencer):
        """The memory of the weights, and the bit of it under way: they lie in the order of their use."""
        config, code = self._config, self.plan.compact
        bits, depth = code.weight_word_bits, code.weight_words
        m.submodules.weights_0 = weights = Memory(
            shape=bits, depth=depth, init=self._images.get(0, []), attrs=NO_COLLISION
        )
        read = weights.read_port()
        address, bit = Signal(range(depth), name="weight_address"), Signal(range(bits), name="weight_bit")
        last_bit = sequencer.runs & (bit == bits - 1)
        m.d.comb += [read.addr.eq(address), read.en.eq(sequencer.runs)]
        m.d.sync += [bit.eq(Mux(last_bit, 0, bit + sequencer.runs)), address.eq(address + last_bit)]
        with m.If(self.started & (sequencer.first_step if config.sets > 1 else 1)):
            m.d.sync += [bit.eq(0), address.eq(0)]
        if config.hardware.loadable:
            write = weights.write_port()
            m.d.comb += [
                write.addr.eq(self.load.address),
                write.data.eq(self.load.data),
                write.en.eq(self.load.enable & self.load.select[load_lines(config)[0]]),
            ]
        return read.data.bit_select(bit, 1)

    def _data(
        self,
        m: Module,
        platform: str | None,
        sequencer: CompactSequencer,
        queue: WindowQueue,
        accumulator: CompactAccumulator,
        result: Signal,
        stores: Value,
    ) -> None:
        """The data memory: a MAC reads it; a STORE, a window's sum or the host writes it, one at a time."""
        config, code, word = self._config, self.plan.compact, sequencer.fields
        init = self._images.get(memory_map.Memory.CONSTANTS, [])
        # A ROM in front of the working values where these have no first word that one could be told with.
        apart = not config.hardware.loadable and not begins_as_told(platform)
        first = (
            min(number for name, number in code.regions.items() if name.startswith("S.")) << code.index_bits
            if apart
            else 0
        )
        m.submodules.data = memory = Memory(
            shape=signed(DATA_BITS),
            depth=code.data_words - first,
            init=[] if apart else init,
            attrs=NO_COLLISION,
        )
        read, write = memory.read_port(), memory.write_port()
        address, data = (
            Signal(range(code.data_words), name="read_address"),
            Signal(signed(DATA_BITS), name="read_data"),
        )
        region, window_region = word["region"], code.regions["X"]
        chosen = region | ((region[1:] == window_region >> 1) & queue.reading)
        index = sequencer.index
        if config.constants == 1:
            index = Mux(word["length"], queue.length, index)
        elif len(config.window_lengths) > 1:  # a region of scales for each length
            chosen = chosen | Mux(word["length"], queue.length, 0)
        m.d.comb += [
            address.eq(
                Cat(Mux(word["run"], sequencer.column, index)[: code.index_bits], chosen[: len(region)])
            ),
            read.addr.eq(address - first),
            read.en.eq(sequencer.mac),
            data.eq(read.data),
            accumulator.data.eq(data),
        ]
        if apart:
            m.submodules.constants = constants = Memory(shape=signed(DATA_BITS), depth=len(init), init=init)
            constant = constants.read_port()
            constant_read = Signal()
            is_constant = address < first
            m.d.comb += [
                constant.addr.eq(address),
                constant.en.eq(sequencer.mac & is_constant),
                read.en.eq(sequencer.mac & ~is_constant),
                data.eq(Mux(constant_read, constant.data, read.data)),
            ]
            with m.If(sequencer.mac):
                m.d.sync += constant_read.eq(is_constant)
        loads = (
            self.load.enable
            & int(config.hardware.loadable)
            & self.load.select[load_lines(config)[memory_map.Memory.CONSTANTS]]
        )
        incoming = Mux(loads, self.load.data, self.i.p.value)
        window = Cat(queue.taxel, queue.writing, Const(window_region >> 1, len(region) - 1))
        stored = Mux(sequencer.store, Cat(sequencer.index, region), window)
        m.d.comb += [
            write.addr.eq(Mux(loads, self.load.address, stored) - first),
            write.data.eq(Mux(sequencer.store & ~loads, result, incoming)),
            write.en.eq(stores | loads | queue.take),
        ]


def make_engine(
    config: AcceleratorConfig,
    images: Mapping[int, list[int]] | None = None,
    program: CellProgram | None = None,
) -> Engine | CompactEngine:
    """The engine for the configured lanes; parameters as of both."""
    return (CompactEngine if is_compact(config) else Engine)(config, images, program)
