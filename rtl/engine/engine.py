"""The scheduled engine: lanes, element-wise lane, memories, and the microcode that runs a cell's program on
them.

Rows and cells: docs/specification.md, sections 4 and 5.
"""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value, signed
from amaranth.lib import stream, wiring
from amaranth.lib.memory import Memory

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import (
    ENGINE,
    NO_COLLISION,
    addends_memory,
    begins_as_told,
    centred_layout,
    drive,
    forward,
    inputs,
    lanes_in_large_memories,
    load_lines,
    load_signature,
    outputs,
    probe,
    struct,
    working_memory,
    wrapping_increment,
)
from eskin.rtl.engine.activation_unit import ActivationUnit
from eskin.rtl.engine.coefficient_memory import CoefficientMemory
from eskin.rtl.engine.elementwise import ElementwiseUnit
from eskin.rtl.engine.lanes import LaneSignature, lane_signature, make_lane
from eskin.rtl.engine.memory_check import MemoryCheck
from eskin.rtl.engine.row_chain import RowChain
from eskin.rtl.engine.row_narrowing import RowNarrowing
from eskin.rtl.engine.sequencer import Sequencer
from eskin.rtl.engine.window_queue import WindowQueue
from eskin.rtl.program import memory_map
from eskin.rtl.program.cells import CellProgram
from eskin.rtl.program.microcode import Microcode
from eskin.rtl.program.schedule import schedule
from eskin.rtl.program.scheduler import Schedule
from eskin.rtl.program.timing import ELEMENT_OPERAND_BITS, logit_to_decision


def row_lane_signature(config: AcceleratorConfig, plan: Schedule) -> LaneSignature:
    """Lane for rows, for element-wise operations too where they share it."""
    if plan.shared:
        bits = max(config.accumulator_bits, config.elementwise_bits)
        return lane_signature(
            ELEMENT_OPERAND_BITS,
            ELEMENT_OPERAND_BITS,
            bits,
            load_with_operands=config.hardware.lane_type == "plain",
        )
    return lane_signature(
        config.operand_bits, config.weight_bits, config.accumulator_bits, load_with_operands=False
    )


def element_lane_signature(config: AcceleratorConfig, plan: Schedule) -> LaneSignature:
    """Lane for element-wise operations."""
    accumulates = any(len(op.terms) > 1 for op in plan.program.elements)
    bits = ELEMENT_OPERAND_BITS
    return lane_signature(
        bits, bits, config.elementwise_bits, load_with_operands=True, accumulates=accumulates
    )


def engine_ports(config: AcceleratorConfig) -> dict[str, wiring.Member]:
    """Members of `Engine`, and of what stands in its place for another kind of network."""
    return inputs(
        "decider_idle", "blank", i=stream.Signature(centred_layout(config)), load=load_signature(config)
    ) | outputs(
        "started",
        "busy",
        "check_failed",
        "partial",
        logit=struct("valid", value=signed(config.formats.logit_format.width)),
        status=ENGINE,
        feature=probe(),
        state=probe(),
        step=probe(),
    )


class Engine(wiring.Component):
    """Computes one recurrent step and its logits for every window of centred sums.

    Sums are taken as they come into
    one of two buffers, so the next window fills while a step is computed. The program is
    `eskin.rtl.program.schedule.schedule(config)`, encoded by `eskin.rtl.program.microcode.Microcode`.

    A step takes `Schedule.step_cycles`. Phase B starts 2 cycles after the window's last taxel if the program
    already waits for it; from there to the decision it is `Schedule.decision_cycles`. While the program waits
    for a window, the engine is idle.

    Parameters
    ----------
    images:
        Memory contents (`memory_map.memory_images`) for a ROM design; None where the host loads them.
    program:
        Another cell's program; the configured cell's by default.

    Members
    -------
    i : In(stream)
        Centred sums, taxel by taxel; ready while a slot is free.
    load : In
        Host writes; only while no touch is open, and with the engine in reset.
    logit : Out(struct)
        ``value`` in logit_format where ``valid``, class by class; cannot be held up.
    decider_idle : In(1)
        Phase B of a step starts only in a cycle after one in which this was high, and the window was there.
    blank : In(1)
        Pulse after reset, before any window, while ``i`` is 0: the engine stores that word as "no window".
    started : Out(1)
        Phase B of a step starts in this cycle.
    busy : Out(1)
        A window waits or a step is being computed.
    partial : Out(1)
        ``window_mode`` whole: the step is of a touch that was the longest.
    status : Out(ENGINE)
        Of `eskin.rtl.common.status`.
    check_failed : Out(1)
        With ``checksum``: a constant, a table entry or a word of the program that was just used is wrong.
    feature, state, step : Out(probe)
        Feature codes and new hidden state codes as they are written; cycles of a step as it is done, phases A
        and B and the way to its decision.
    """

    def __init__(
        self,
        config: AcceleratorConfig,
        images: memory_map.Images | None = None,
        program: CellProgram | None = None,
    ):
        self._config, self._images = config, images or {}
        self.plan: Schedule = schedule(config, program)
        super().__init__(engine_ports(config))

    def elaborate(self, platform):
        m = Module()
        config, plan, images = self._config, self.plan, self._images
        code = Microcode(plan)
        layout = self.layout = code.layout
        m.submodules.sequencer = sequencer = self.sequencer = Sequencer(code)
        word, enable = sequencer.word, sequencer.enable
        self.released = enable & word.released
        window_sum = self._windows(m)
        self._steps(m)

        # ---------------------------------------------------------------- memories
        def memory(name: str, shape, depth: int, init=(), **style) -> Memory:
            m.submodules[name] = part = Memory(
                shape=shape, depth=depth, init=init, attrs=NO_COLLISION | style
            )
            return part

        def read(part: Memory, address):
            port = part.read_port()
            drive(m, port, addr=address, en=enable)
            return port.data

        states = memory("state_memory", signed(config.operand_bits), layout.state_depth)
        operand = read(states, word.vector)
        lengths = self._lengths(m)
        m.submodules.coefficients = coefficients = CoefficientMemory(
            config, plan.program, images.get(memory_map.Memory.CONSTANTS, [])
        )
        drive(m, coefficients, address=word.gate | Mux(word.scale, lengths, 0), enable=enable)
        forward(m, self, coefficients, "load")
        gate = coefficients.gate | coefficients.constant
        # T holds complements: values that are mostly subtracted need no inverters then. Its last word stands for 0.
        not_t: Value = Const(-1)
        if plan.program.t_regions:
            values = memory("t_memory", signed(config.formats.state_format.width), layout.t_depth)
            not_t = read(values, word.t)
        addends = _AddendMemory(config, plan, images.get(memory_map.Memory.ADDENDS, []))
        m.submodules.addends = addends
        weights = self._weights(m, platform, memory)

        # ---------------------------------------------------------------- lanes
        m.submodules.elementwise = unit = ElementwiseUnit(config, plan)
        reads_states = any("S." in a for op in plan.program.elements for a, _ in op.terms)
        drive(
            m,
            unit,
            s=operand if plan.shared else read(states, word.element) if reads_states else 0,
            not_t=not_t,
            x=window_sum,
            use_t=word.t_operand,
            minus=word.minus,
            add=word.add & (word.in_step if plan.shared else 1),  # before, T's word for 0 may be any
            feature=word.feature,
        )
        row_sums = self._lanes(m, unit, operand, weights, gate, addends.read_data)

        # ---------------------------------------------------------------- sums of rows, one by one
        total = self._total(m, row_sums, addends.read_data)
        m.submodules.narrowing = row = RowNarrowing(config)
        drive(m, row, total=total, tanh=word.tanh)
        drive(
            m,
            addends,
            read_address=word.addend,
            read_enable=enable,
            write=enable & word.partial,
            write_address=word.partial_to,
            write_data=total,
        )
        forward(m, self, addends, "load")

        # ---------------------------------------------------------------- results
        table_wrong = 0
        if plan.program.t_regions:  # no cell has gates alone
            m.submodules.activation = table = ActivationUnit(config)
            t_write = values.write_port()
            drive(m, table, enable=enable, index=Mux(word.activated, unit.index, row.index), tanh=word.tanh)
            drive(
                m,
                t_write,
                addr=word.result,
                data=Mux(word.value, ~row.value, table.not_state),
                en=enable & word.t_write,
            )
            drive(
                m,
                coefficients,
                write_address=word.result,
                write_data=table.gate,
                write=enable & word.gate_write,
            )
            if config.hardware.checksum:
                m.d.comb += table.walk.eq(sequencer.waiting & ~enable)
                # outside a step the index may come of sums that nothing was loaded into
                judged = Signal()
                m.d.sync += judged.eq(table.walk | enable & word.in_step)
                table_wrong = table.wrong & judged
        m.d.comb += unit.tick.eq(enable)
        state_write = states.write_port()
        drive(m, state_write, addr=word.state_to, data=unit.result, en=enable & word.state_write)
        drive(m, self.logit, value=row.logit, valid=enable & word.logit)
        if config.hardware.checksum:
            m.submodules.check = check = MemoryCheck(code)
            drive(
                m,
                check,
                word=word,
                enable=enable,
                weights=Cat(weights),
                addend=addends.read_data,
                gate=gate,
                operand=unit.a,
                blank=coefficients.constant,
            )
            m.d.comb += self.check_failed.eq(check.fault | table_wrong | sequencer.wrong)
        drive(m, self.feature, valid=state_write.en & word.feature, value=unit.code)
        drive(m, self.state, valid=state_write.en & word.hidden, value=unit.result)
        return m

    def _windows(self, m):
        """Windows that wait for their step, and their queue. Gives the sum that the program reads."""
        config, layout, word, enable = self._config, self.layout, self.sequencer.word, self.sequencer.enable
        window_words = layout.window_none + 1  # two buffers; above them a zero
        m.submodules.windows = windows = Memory(
            shape=signed(ELEMENT_OPERAND_BITS), depth=window_words, init=[], attrs=NO_COLLISION
        )
        slot_write, slot_read = windows.write_port(), windows.read_port()
        m.submodules.queue = queue = self.queue = WindowQueue(config, layout.window_bits)
        forward(m, self, queue, "i")
        drive(m, queue, released=self.released, started=self.started, step_done=self.status.step_done)
        drive(m, self.status, overrun=queue.overrun, windows_open=queue.open)
        drive(
            m,
            slot_write,
            addr=Cat(queue.taxel, queue.writing, self.blank),
            data=self.i.p.value,
            en=queue.take | self.blank,
        )
        drive(
            m,
            slot_read,
            addr=word.window | Cat(Const(0, layout.window_bits), queue.reading & ~word.window[-1]),
            en=enable,
        )
        return slot_read.data

    def _steps(self, m):
        """Start and end of a step, with the ports that report them."""
        sequencer, queue = self.sequencer, self.queue
        word, enable = sequencer.word, sequencer.enable
        final = self.final = Signal()  # the step under way is its touch's last
        with m.If(self.released):
            m.d.sync += [final.eq(queue.final), self.partial.eq(queue.partial)]
        m.d.comb += [
            sequencer.restart.eq(final),
            self.started.eq(sequencer.waiting & enable),
            self.status.working.eq(queue.any | ~sequencer.waiting),
            self.busy.eq(self.status.working | queue.taxel.any()),
        ]
        drive(m, self.status, slot_done=enable & word.in_step, step_done=enable & word.ends_step)
        # A register, because everything depends on it: a step starts a cycle later.
        m.d.sync += sequencer.go.eq(sequencer.waiting & queue.waiting & self.decider_idle)
        slots = Signal.like(self.step.value)
        with m.If(self.status.slot_done):
            m.d.sync += slots.eq(slots + 1)
        with m.If(sequencer.ended):
            m.d.sync += slots.eq(0)
        drive(m, self.step, valid=self.status.step_done, value=slots + logit_to_decision(self._config))

    def _lengths(self, m):
        """Offset to a scale's address: the index of the window's length, or the place of its check word."""
        # scales of length 0 stand at multiples of a power of two
        config, lengths = self._config, self.queue.length
        if not config.hardware.checksum:
            return lengths
        # a check word for each step of a touch
        check: Value = Signal(range(config.sets), name="step")
        with m.If(self.sequencer.ended):
            m.d.sync += check.eq(Mux(self.final, 0, check + 1))
        # a check word for each length; it is read when the window has left its buffer
        if config.sets == 1 or config.follows_touch:
            released = Signal.like(lengths, name="released_length")
            with m.If(self.released):
                m.d.sync += released.eq(lengths)
            check = Cat(released, check)
        return Mux(self.sequencer.word.gate[self.layout.check_base.bit_length() - 1], check, lengths)

    def _weights(self, m, platform, memory):
        """A memory of weights a lane, all read at one address; the host writes each."""
        config, plan, enable = self._config, self.plan, self.sequencer.enable
        loads, lines = self.load.enable & int(config.hardware.loadable), load_lines(config)
        weight_address = Signal(range(plan.weight_depth))
        with m.If(enable):
            m.d.sync += weight_address.eq(weight_address + self.sequencer.word.mac)
        with m.If(self.sequencer.ended & (self.final if config.sets > 1 else 1)):
            m.d.sync += weight_address.eq(0)
        # A large memory has one port, which the host's write takes: it restarts the engine, so the read
        # that it displaces is not used.
        large = lanes_in_large_memories(config, platform, plan.weight_depth)
        port_address = Signal.like(weight_address)
        if large:
            m.d.comb += port_address.eq(Mux(loads, self.load.address, weight_address))
        weights = []
        for k in range(config.hardware.lanes):
            style = {"ram_style": "huge"} if k < large else {}
            part = memory(
                f"weights_{k}",
                signed(config.weight_bits),
                plan.weight_depth,
                self._images.get(k, []),
                **style,
            )
            port = part.read_port()
            drive(
                m,
                port,
                addr=port_address if k < large else weight_address,
                en=enable & ~loads if k < large else enable,
            )
            weights.append(port.data)
            if config.hardware.loadable:
                write = part.write_port()
                drive(
                    m,
                    write,
                    addr=port_address if k < large else self.load.address,
                    data=self.load.data,
                    en=loads & self.load.select[lines[k]],
                )
        return weights

    def _lanes(self, m, unit, operand, weights, gate, addend):
        """The lanes of rows and the lane of element-wise products, or one lane for both. Gives the sum of
        each row lane."""
        config, plan, word, enable = self._config, self.plan, self.sequencer.word, self.sequencer.enable
        row_sums = []
        for k in range(config.hardware.lanes):
            m.submodules[f"lane_{k}"] = lane = make_lane(config, row_lane_signature(config, plan))
            drive(m, lane, tick=enable, swap=word.swap, valid=word.valid, a=operand, b=weights[k])
            row_sums.append(lane.acc)
        if plan.shared:
            drive(
                m,
                lane,
                a=unit.a,
                b=Mux(word.element_operand, gate, weights[0]),
                swap=word.swap | word.element_first,
                valid=word.valid | word.element_valid,
                load=addend | unit.load,
            )
            m.d.comb += unit.acc.eq(lane.acc)
        else:
            m.submodules.element_lane = element = make_lane(config, element_lane_signature(config, plan))
            drive(
                m,
                element,
                tick=enable,
                a=unit.a,
                b=gate,
                swap=word.element_first,
                load=unit.load,
                valid=word.element_valid,
            )
            m.d.comb += unit.acc.eq(element.acc)
        return row_sums

    def _total(self, m, row_sums, addend):
        """Sums of rows, one by one."""
        config, word, enable = self._config, self.sequencer.word, self.sequencer.enable
        total = Signal(signed(config.accumulator_bits))
        if config.hardware.lanes > 1:
            m.submodules.chain = chain = RowChain(config.accumulator_bits, config.hardware.lanes)
            drive(m, chain, tick=enable, swap=word.swap, shift=word.shift, addend=addend)
            m.d.comb += [
                *(lane.eq(acc) for lane, acc in zip(chain.acc, row_sums, strict=True)),
                total.eq(chain.total),
            ]
            for k in range(config.hardware.lanes):
                m.d.comb += m.submodules[f"lane_{k}"].load.eq(chain.load[k])
        else:
            m.d.comb += total.eq(row_sums[0])
        return total


class _AddendMemory(wiring.Component):
    """Addends and partial sums: one word a row, accumulator_bits wide, in ``addend_parts`` memories so that a
    16-bit bus can load it.

    Read latency 1. A word written in a slot can be addressed in the next. Where a memory does not begin as
    told (`begins_as_told`), constants that are not loaded are a ROM.
    """

    def __init__(self, config: AcceleratorConfig, plan: Schedule, image: list[int]):
        self._config, self._plan, self._image = config, plan, image
        address, word = range(plan.addend_words), signed(config.accumulator_bits)
        super().__init__(
            inputs(
                "read_enable",
                "write",
                load=load_signature(config),
                read_address=address,
                write_address=address,
                write_data=word,
            )
            | outputs(read_data=word)
        )

    def elaborate(self, platform):
        m = Module()
        if not self._config.hardware.loadable and not begins_as_told(platform):
            self._constants_apart(m)
            return m
        data_out = []
        # a constant 0 in a ROM design, so that only partial sums are written
        loads = (
            self.load.enable
            & self.load.select[load_lines(self._config)[memory_map.Memory.ADDENDS]]
            & int(self._config.hardware.loadable)
        )
        names = ("low", "high") if self._config.addend_parts == 2 else ("low", "middle", "high")
        part, entry = self._loaded_entry(m, loads)
        style = addends_memory(self._config, platform)
        for number, name in enumerate(names):
            bits = slice(16 * number, 16 * number + 16)
            width = len(self.write_data[bits])  # the last part is shorter
            init = [word >> bits.start & (1 << width) - 1 for word in self._image]
            memory = Memory(shape=width, depth=self._plan.addend_words, init=init, attrs=style)
            m.submodules[name] = memory
            read, write = memory.read_port(), memory.write_port()
            load = loads & (part == number)
            drive(m, read, addr=self.read_address, en=self.read_enable)
            data_out.append(read.data)
            if self._plan.partial_rows:
                drive(
                    m,
                    write,
                    addr=Mux(load, entry, self.write_address),
                    data=Mux(load, self.load.data, self.write_data[bits]),
                    en=load | self.write,
                )
            else:
                drive(m, write, addr=entry, data=self.load.data, en=load)
        m.d.comb += self.read_data.eq(Cat(*data_out))
        return m

    def _constants_apart(self, m: Module) -> None:
        """Constants as a ROM; partial sums in a memory of which no word is read before it was written."""
        plan, first = self._plan, len(self._plan.bias_rows)
        shape = signed(self._config.accumulator_bits)
        m.submodules.constants = constants = Memory(shape=shape, depth=plan.addend_words, init=self._image)
        constant = constants.read_port()
        drive(m, constant, addr=self.read_address, en=self.read_enable)
        m.d.comb += self.read_data.eq(constant.data)
        if not plan.partial_rows:
            return
        read, write = working_memory(m, "sums", shape, plan.partial_rows)
        is_sum = Signal()
        sum_read = Signal()
        with m.If(self.read_enable):
            m.d.sync += sum_read.eq(is_sum)
        m.d.comb += [
            is_sum.eq((self.read_address >= first) & (self.read_address < first + plan.partial_rows)),
            constant.en.eq(self.read_enable & ~is_sum),
        ]
        drive(m, read, addr=self.read_address - first, en=self.read_enable & is_sum)
        drive(m, write, addr=self.write_address - first, data=self.write_data, en=self.write)
        m.d.comb += self.read_data.eq(Mux(sum_read, read.data, constant.data))

    def _loaded_entry(self, m: Module, loads: Value) -> tuple[Value, Value]:
        """(part, word) that the host's next write goes to.

        The bus counts 16-bit words. Where a word has three of them, two counters replace a division by 3.
        They restart with the memory's first word and have no reset, because each write resets the engine.
        """
        address = self.load.address
        if self._config.addend_parts == 2:
            return address[0], address[1:]
        parts = self._config.addend_parts
        part_now = Signal(range(parts))
        entry_now = Signal(range(self._plan.addend_words))
        part_next = Signal.like(part_now, reset_less=True)
        entry_next = Signal.like(entry_now, reset_less=True)
        with m.If(address != 0):
            m.d.comb += [part_now.eq(part_next), entry_now.eq(entry_next)]
        with m.If(loads):
            m.d.sync += [
                part_next.eq(wrapping_increment(part_now, parts)),
                entry_next.eq(entry_now + (part_now == parts - 1)),
            ]
        return part_now, entry_now
