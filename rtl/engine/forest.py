"""The engine of decision trees: windows in, logits out, a comparison after the other and no multiplier
(docs/specification.md, section 5)."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value, signed, unsigned
from amaranth.lib import data, wiring
from amaranth.lib.memory import Memory, ReadPort
from amaranth.utils import ceil_log2

from eskin.golden.core import AcceleratorConfig
from eskin.golden.core.config import VOTE_BITS
from eskin.rtl.common import (
    NO_COLLISION,
    drive,
    forward,
    load_lines,
    prototypes_memory,
    saturate,
    shape_of,
    working_memory,
    wrapping_increment,
)
from eskin.rtl.engine.engine import engine_ports
from eskin.rtl.engine.window_queue import WindowQueue
from eskin.rtl.program import memory_map
from eskin.rtl.program.timing import SCALE_BITS, SCALING_CYCLES, logit_to_decision


class ForestEngine(wiring.Component):
    """Computes the trees' logits for every window of centred sums; ports as of `eskin.rtl.engine.engine.Engine`.

    A step clears the classes' sums (a cycle each), makes features of the window's sums (SCALING_CYCLES each, by shifts and
    additions), walks tree after tree (two cycles a comparison of a feature, or of the difference of two; ``depth``
    comparisons, though nothing moves behind a leaf), and gives the logits (a cycle each). It takes
    `eskin.rtl.program.timing.forest_cycles`, whatever the features are.

    Parameters
    ----------
    images:
        Memory contents (`memory_map.memory_images`) for a ROM design; None where the host loads them.
    """

    def __init__(self, config: AcceleratorConfig, images: memory_map.Images | None = None):
        self._config, self._images = config, images or {}
        super().__init__(engine_ports(config))

    def elaborate(self, platform):
        m, config = Module(), self._config
        forest, inputs, classes, steps = config.forest, config.inputs, config.classes, config.windows.steps

        # ---------------------------------------------------------------- phases of a step, and their counters
        go = Signal()
        names = "clearing scaling walking judging adding giving given".split()
        phases = self.phases = [Signal(name=name) for name in names]
        clearing, scaling, walking, judging, adding, giving, given = phases
        counts = dict(
            number=classes, column=inputs, turn=SCALING_CYCLES, tree=forest.trees, visit=forest.depth
        )
        counters = self.counters = {name: Signal(range(count), name=name) for name, count in counts.items()}
        number, column, turn, tree, visit = counters.values()
        step = Signal(range(steps))
        # a comparison: its node is read while this is low, its feature while it is high
        looks = self.looks = Signal()
        final = Signal()
        last_class = number == classes - 1
        scaled = scaling & (turn == SCALING_CYCLES - 1)
        released = scaled & (column == inputs - 1)
        tree_ends = looks & (visit == forest.depth - 1)
        walked = tree_ends & (tree == forest.trees - 1)
        m.submodules.queue = queue = self.queue = WindowQueue(config, ceil_log2(inputs))
        forward(m, self, queue, "i")
        drive(m, queue, released=released, started=go, step_done=self.status.step_done)
        in_step = Cat(phases).any()
        m.d.sync += [
            # a register, as in the engine of the other cells
            go.eq(~in_step & ~go & queue.waiting & self.decider_idle),
            clearing.eq(go | clearing & ~last_class),
            scaling.eq(clearing & last_class | scaling & ~released),
            walking.eq(released | walking & ~walked),
            looks.eq(walking & ~looks),
            judging.eq(looks),
            adding.eq(judging),
            giving.eq(adding & ~walking | giving & ~last_class),
            given.eq(giving),
            self.status.step_done.eq(giving & last_class),
        ]
        counted = clearing | giving, scaled, scaling, tree_ends, looks
        for name, counting in zip(counters, counted, strict=True):
            with m.If(counting):
                m.d.sync += counters[name].eq(wrapping_increment(counters[name], counts[name]))
        with m.If(released):
            m.d.sync += [final.eq(queue.final), self.partial.eq(queue.partial)]
        with m.If(self.status.step_done):
            m.d.sync += step.eq(Mux(final, 0, step + 1))
        drive(
            m,
            self.status,
            working=queue.any | go | in_step,
            overrun=queue.overrun,
            windows_open=queue.open,
            slot_done=in_step,
        )
        slots = Signal.like(self.step.value)
        m.d.sync += slots.eq(Mux(go, 0, slots + 1))
        m.d.comb += [self.started.eq(go), self.busy.eq(self.status.working | queue.taxel.any())]
        drive(m, self.step, valid=self.status.step_done, value=slots + logit_to_decision(config))

        # ---------------------------------------------------------------- features: sums by their scales
        arriving, waiting = working_memory(
            m, "windows", shape_of(config.centred_format), 1 << len(column) + 1
        )[::-1]
        begins = scaling & (turn == 0)
        drive(m, arriving, addr=Cat(queue.taxel, queue.writing), data=self.i.p.value, en=queue.take)
        drive(m, waiting, addr=Cat(column, queue.reading), en=begins)
        scale = self._scales(m, column, scaled, begins)
        # The scale's bits leave at the low end while the product grows at the high end. The rounding half
        # starts there: SCALE_BITS shifts later it is worth as much as in the product.
        product = Signal(signed(SCALE_BITS + 16))
        total = product[SCALE_BITS:].as_signed() + Mux(product[0], waiting.data, 0)
        m.d.sync += product.eq(Cat(product[1:SCALE_BITS], total))
        with m.If(turn == 1):
            m.d.sync += product.eq(Cat(scale[:SCALE_BITS], Const(config.gate_one >> 1)))
        feature = saturate(product >> config.formats.gate_frac, config.formats.feature_format)
        read, store = working_memory(
            m, "features", shape_of(config.formats.feature_format), steps << len(column)
        )
        less = m.submodules.features.read_port()
        drive(m, store, addr=Cat(column, step), data=feature, en=scaled)
        drive(m, self.feature, valid=scaled, value=feature)

        # ---------------------------------------------------------------- walks
        # A comparison is judged while the next node is read, the last one of a tree while the next root is.
        at_root = visit == 0
        ended = self.ended = Signal()  # the walk, by a vote
        address = Signal(range(forest.nodes))
        node_read = self._memory(
            m,
            memory_map.Memory.NODES,
            forest.nodes,
            address,
            **(
                prototypes_memory(config, platform, forest.nodes)
                if config.hardware.loadable
                else NO_COLLISION
            ),
        )
        fields = memory_map.node_fields(config)
        node = data.View(
            data.StructLayout(fields | {"threshold": shape_of(config.threshold_format)}),
            node_read.data[: sum(fields.values())],
        )
        single = Signal()  # a register: while the features are read
        m.d.sync += single.eq(node.subtrahend == node.input)
        value = read.data - Mux(single, 0, less.data)
        child = Mux(value > node.threshold, node.right, node.left)
        leaf = child[-1]
        votes = self.votes = judging & leaf & ~ended
        self.node_enable = walking & ~looks & (at_root | ~(ended | leaf))
        drive(m, node_read, en=self.node_enable)
        m.d.comb += address.eq(Mux(at_root, tree, child))
        window = Mux(node.window > step, step, node.window)[: len(step)]
        for port, column_read in ((read, node.input), (less, node.subtrahend)):
            drive(m, port, addr=Cat(column_read, window), en=looks & ~ended)
        with m.If(~looks):
            m.d.sync += ended.eq(~at_root & (ended | leaf))

        # ---------------------------------------------------------------- sums of the classes
        width = config.formats.logit_format.width
        summed, put = working_memory(m, "scores", signed(width), classes)
        voted, vote, adds = Signal.like(number), Signal(signed(VOTE_BITS)), Signal()
        m.d.sync += [voted.eq(child[VOTE_BITS:-1]), vote.eq(child), adds.eq(votes)]
        drive(m, summed, addr=Mux(giving, number, child[VOTE_BITS:-1]), en=giving | votes)
        drive(
            m,
            put,
            addr=Mux(clearing, number, voted),
            data=Mux(clearing, 0, summed.data + vote),
            en=clearing | adds,
        )
        drive(m, self.logit, valid=given, value=summed.data)
        if config.hardware.checksum:
            m.d.comb += self.check_failed.eq(
                (scaling & (turn == 1) & scale.xor()) | (looks & ~ended & node_read.data.xor())
            )
        return m

    def _scales(self, m: Module, column: Signal, scaled: Value, begins: Value) -> Value:
        """The scale, with its parity, of the window's input ``column``."""
        config = self._config
        constant: Value = column
        if config.constants < config.inputs:
            constant = Signal(range(config.constants))
            with m.If(scaled):
                m.d.sync += constant.eq(wrapping_increment(constant, config.constants))
        length_bits = ceil_log2(len(config.window_lengths))
        depth = memory_map.scale_places(config)[-1] + 1
        address = Cat(self.queue.length[:length_bits], constant)
        read = self._memory(m, memory_map.Memory.CONSTANTS, depth, address, **NO_COLLISION)
        drive(m, read, en=begins)
        return read.data

    def _memory(
        self, m: Module, which: memory_map.Memory, depth: int, address: Value, **style: int | str
    ) -> ReadPort:
        """Read port of a memory that the host loads, at ``address``; a word of it lies in the host's words from the lowest on.
        Its one port may be in a large memory."""
        config, load = self._config, self.load
        words = memory_map.node_words(config) if which == memory_map.Memory.NODES else 1
        each = (
            memory_map.words_per_entry(config, which).bit_length() - 1
        )  # bits of the address within an entry
        m.submodules[which.name.lower()] = memory = Memory(
            shape=unsigned(16 * words), depth=depth, init=self._images.get(which, []), attrs=style
        )
        read = memory.read_port()
        m.d.comb += read.addr.eq(address)
        if config.hardware.loadable:
            loads = load.enable & load.select[load_lines(config)[which]]
            write = memory.write_port(granularity=16)
            with m.If(loads):
                m.d.comb += read.addr.eq(load.address >> each)
            drive(
                m,
                write,
                addr=read.addr,
                data=load.data.replicate(words),
                en=Cat(loads & (load.address[:each] == part) for part in range(words)),
            )
        return read
