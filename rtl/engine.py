"""The scheduled engine: lanes, element-wise lane, memories, and the two sequencers that run a cell's program on them."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

from amaranth.hdl import Cat, Const, EnableInserter, Module, Mux, Signal, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from golden.config import AcceleratorConfig
from rtl import memory_map
from rtl.activation_unit import ActivationUnit
from rtl.elementwise import ElementwiseUnit, operation_fields, operation_word
from rtl.lanes import lane_signature, make_lane
from rtl.normaliser import centred_layout
from rtl.row_drain import RowDrain
from rtl.schedule import ELEMENT_OPERAND_BITS, CellProgram, Run, Schedule, element_slots, schedule, slot_cycles
from rtl.sequencer import Sequencer


def load_signature() -> wiring.Signature:
    """Port by which the host writes memories: ``select`` (memory_map.Memory), 16-bit ``data`` to word ``address`` where ``enable``."""
    return wiring.Signature({"select": Out(7), "address": Out(16), "data": Out(16), "enable": Out(1)})


def probe(bits: int = 32) -> wiring.Signature:
    """One value a cycle, for benches: ``value`` where ``valid``."""
    return wiring.Signature({"valid": Out(1), "value": Out(signed(bits))})


def row_lane_signature(config: AcceleratorConfig, plan: Schedule) -> wiring.Signature:
    """Lane for rows; with one multiplier in all, for element-wise operations too (accumulator 1)."""
    if plan.shared:
        return lane_signature(ELEMENT_OPERAND_BITS, ELEMENT_OPERAND_BITS, (config.accumulator_bits, config.elementwise_bits))
    return lane_signature(config.operand_bits, config.weight_bits, (config.accumulator_bits,))


def element_lane_signature(config: AcceleratorConfig) -> wiring.Signature:
    """Lane for element-wise operations."""
    return lane_signature(ELEMENT_OPERAND_BITS, ELEMENT_OPERAND_BITS, (config.elementwise_bits,))


def engine_members(config: AcceleratorConfig) -> dict:
    """Ports of `Engine`, which its core has too."""
    return {
        "i": In(stream.Signature(centred_layout(config))), "load": In(load_signature()),
        "logit": Out(data.StructLayout({"valid": 1, "value": signed(config.logit_format.width)})),
        "decider_idle": In(1), "started": Out(1), "busy": Out(1), "overrun": Out(1), "slot_filled": Out(1),
        "step_done": Out(1), "step_slots": Out(16), "feature": Out(probe()), "state": Out(probe()),
    }  # fmt: skip


class Engine(wiring.Component):
    """Computes one recurrent step and its logits for every window of centred sums.

    A window's sums are taken as they come into one of two buffers, so the next window fills while a step is computed. The program is
    `rtl.schedule.schedule(config)`; cycles of a step are `Schedule.step_cycles`, from the features' arrival to the last logit
    `Schedule.decision_cycles`. Here are the lanes, and the slot clock that holds everything else still while serial lanes work.

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
        Host writes; only while no touch is open.
    logit : Out(struct)
        ``value`` in logit_format where ``valid``, class by class; cannot be held up.
    decider_idle : In(1)
        A step starts only while this is high and the step before has given its logits.
    started : Out(1)
        Phase B of a step starts in this cycle.
    busy : Out(1)
        A window waits or a step is being computed.
    overrun : Out(1)
        A window arrives while both slots are full.
    slot_filled : Out(1)
        The last taxel's sum of a window is taken in this cycle.
    step_done, step_slots : Out
        At the step's last issue: the slots issued for it, phases A and B.
    feature, state : Out(probe)
        Feature codes and new hidden state codes as they are written.
    """

    def __init__(
        self, config: AcceleratorConfig, images: Mapping[int, list[int]] | None = None, program: CellProgram | None = None
    ) -> None:
        self._config, self._images = config, images
        self.plan: Schedule = schedule(config, program)
        super().__init__(engine_members(config))

    def elaborate(self, platform):
        m = Module()
        config = self._config
        core = EngineCore(config, self.plan, self._images)
        tick = Signal()
        length = slot_cycles(config)
        if length == 1:
            m.d.comb += tick.eq(1)
            m.submodules.core = core
        else:
            count = Signal(range(length))
            m.d.sync += count.eq(Mux(tick, 0, count + 1))
            m.d.comb += tick.eq(count == length - 1)
            # Host writes come at any cycle; the engine is held in reset meanwhile (rtl/accelerator.py), so nothing else moves then.
            m.submodules.core = EnableInserter(tick | self.load.enable)(core)
        for k in range(config.lanes):
            m.submodules[f"lane_{k}"] = lane = make_lane(config, *lane_sizes(core.lanes[k]))
            wiring.connect(m, core.lanes[k], lane)
        if not self.plan.shared:
            m.submodules.element_lane = lane = make_lane(config, *lane_sizes(core.element_lane))
            wiring.connect(m, core.element_lane, lane)
        wiring.connect(m, wiring.flipped(self.load), core.load)
        m.d.comb += [
            core.tick.eq(tick),
            core.i.payload.eq(self.i.payload), core.i.valid.eq(self.i.valid & tick), self.i.ready.eq(core.i.ready & tick),
            core.decider_idle.eq(self.decider_idle), self.busy.eq(core.busy), self.overrun.eq(core.overrun),
            self.started.eq(core.started & tick), self.slot_filled.eq(core.slot_filled & tick),
            self.step_done.eq(core.step_done & tick), self.step_slots.eq(core.step_slots),
            self.logit.value.eq(core.logit.value), self.logit.valid.eq(core.logit.valid & tick),
        ]  # fmt: skip
        for name in ("feature", "state"):
            inner, outer = getattr(core, name), getattr(self, name)
            m.d.comb += [outer.value.eq(inner.value), outer.valid.eq(inner.valid & tick)]
        return m


class EngineCore(wiring.Component):
    """The engine without its lanes: sequencers, memories, row drain, element-wise operands and results. One slot a cycle.

    Members, besides the engine's: ``lanes`` and ``element_lane`` towards the lanes, and the slot's ``tick``, which it hands on to them.
    """

    def __init__(self, config: AcceleratorConfig, plan: Schedule, images: Mapping[int, list[int]] | None) -> None:
        self._config, self.plan, self._images = config, plan, images
        members = {**engine_members(config), "tick": In(1), "lanes": Out(row_lane_signature(config, plan).flip()).array(config.lanes)}
        if not plan.shared:
            members["element_lane"] = Out(element_lane_signature(config).flip())
        super().__init__(members)

    # ------------------------------------------------------------------ program words
    def _mac_words(self) -> tuple[list[dict], int]:
        runs, again = self.plan.mac_runs
        regions = self.plan.program.state_regions

        def word(run: Run) -> dict:
            fields = {"active": int(run.op is not None), "region": regions.index(run.op) if run.op else 0}
            flags = {"starts": int(run.first), "finishes": int(run.last), "wait": int(run.wait), "end": int(run.end)}
            return {"length": run.length, "index": run.index, **fields, **flags}

        return [word(run) for run in runs], again

    def _element_words(self) -> tuple[list[dict], int]:
        runs, again = self.plan.element_runs
        program = self.plan.program
        place = {"length", "index", "wait", "end"}
        words = [
            {"length": run.length, "index": run.index, "wait": int(run.wait), "end": int(run.end), **operation_word(program, run.op)}
            for run in runs
        ]
        assert all(place <= set(word) for word in words)
        return words, again

    # ------------------------------------------------------------------ hardware
    def elaborate(self, platform):
        m = Module()
        config, plan = self._config, self.plan
        program, lanes = plan.program, config.lanes
        index_bits = (max(config.taxels, config.hidden) - 1).bit_length()
        hidden_bits = (config.hidden - 1).bit_length()
        constants = 2 + len(config.window_lengths)
        gate_bits = max(hidden_bits, (constants - 1).bit_length())

        mac_runs, mac_again = self._mac_words()
        m.submodules.mac = mac = Sequencer(
            {"active": 1, "region": range(len(program.state_regions)), "starts": 1, "finishes": 1}, mac_runs, mac_again
        )
        element_runs, element_again = self._element_words()
        fields = operation_fields(program)
        m.submodules.element = element = Sequencer(fields, element_runs, element_again)

        # ---------------------------------------------------------------- windows waiting for their step
        x_bits = (config.taxels - 1).bit_length()
        m.submodules.windows = windows = Memory(shape=signed(16), depth=2 << x_bits, init=[])
        slot_write, slot_read = windows.write_port(), windows.read_port()
        full, writing, reading = Signal(2), Signal(), Signal()
        length = data.ArrayLayout(centred_layout(config)["length"].shape, 2)
        slot_length = Signal(length)
        taxel = Signal(x_bits)
        take = self.i.valid & self.i.ready
        released = Signal()
        m.d.comb += [
            self.i.ready.eq(~full.bit_select(writing, 1)),
            self.overrun.eq(self.i.valid & self.i.p.first & full.all()),
            slot_write.addr.eq(Cat(taxel, writing)),
            slot_write.data.eq(self.i.p.value),
            slot_write.en.eq(take),
            self.slot_filled.eq(take & self.i.p.last),
        ]
        with m.If(take):
            m.d.sync += [taxel.eq(Mux(self.i.p.last, 0, taxel + 1)), slot_length[writing].eq(self.i.p.length)]
        with m.If(self.slot_filled):
            m.d.sync += [full.bit_select(writing, 1).eq(1), writing.eq(~writing)]
        with m.If(released):
            m.d.sync += [full.bit_select(reading, 1).eq(0), reading.eq(~reading)]

        # ---------------------------------------------------------------- steps
        due = Signal()  # a started step has not yet given its last logit
        step = Signal(range(config.steps))
        go = Signal()
        m.d.comb += [
            go.eq(mac.blocked & element.blocked & full.bit_select(reading, 1) & ~due & self.decider_idle),
            mac.go.eq(go), element.go.eq(go), self.started.eq(go),
            mac.restart.eq(step == config.steps - 1), element.restart.eq(step == config.steps - 1),
            self.busy.eq(full.any() | taxel.any() | due | ~mac.blocked | ~element.blocked),
        ]  # fmt: skip
        with m.If(mac.ended):
            m.d.sync += step.eq(Mux(mac.restart, 0, step + 1))
        # Slots issued for the step: everything but waiting and the state's clearing before a touch.
        in_prologue = Signal(init=1)
        slots = Signal(16)
        with m.If(mac.ended):
            m.d.sync += [in_prologue.eq(mac.restart), slots.eq(0)]
        with m.Elif(in_prologue), m.If(mac.valid & mac.advance & mac.last):
            m.d.sync += in_prologue.eq(0)
        with m.Elif(mac.valid & ~slots.all()):
            m.d.sync += slots.eq(slots + 1)
        m.d.comb += [self.step_done.eq(mac.ended), self.step_slots.eq(slots + 1)]

        # ---------------------------------------------------------------- issue
        # An element-wise term is issued in the first of the slots it takes; an operation has one or two.
        term_slots = element_slots(config)
        element_active, element_issue, second = Signal(), Signal(), Signal()
        phase = Signal(range(max(2, term_slots)))
        term_done = phase == term_slots - 1
        m.d.comb += [
            element_active.eq(element.valid & element.word.active),
            element_issue.eq(element_active & (phase == 0)),
            element.advance.eq(~element.word.active | (term_done & (~element.word.two | second))),
            mac.advance.eq(~element_active if plan.shared else 1),
        ]
        with m.If(element_active):
            m.d.sync += phase.eq(Mux(term_done, 0, phase + 1))
            with m.If(term_done):
                m.d.sync += second.eq(element.word.two & ~second)
        mac_active = Signal()
        m.d.comb += mac_active.eq(mac.valid & mac.advance & mac.word.active)
        term = Signal(fields["term0"])
        m.d.comb += term.eq(Mux(second, element.word.term1, element.word.term0))

        # ---------------------------------------------------------------- memories
        images = self._images or {}
        state_depth = 1 << index_bits + (len(program.state_regions) - 1).bit_length()
        m.submodules.state_memory = state_memory = Memory(shape=signed(config.operand_bits), depth=state_depth, init=[])
        mac_read, element_read, state_write = state_memory.read_port(), state_memory.read_port(), state_memory.write_port()
        t_depth = 1 << hidden_bits + (len(program.t_regions) - 1).bit_length()
        m.submodules.t_memory = t_memory = Memory(shape=signed(config.state_format.width), depth=t_depth, init=[])
        t_read, t_write = t_memory.read_port(), t_memory.write_port()
        gate_init = [0] * (len(program.gate_regions) << gate_bits) + images.get(memory_map.Memory.CONSTANTS, [])
        gate_depth = 1 << gate_bits + len(program.gate_regions).bit_length()
        m.submodules.gate_memory = gate_memory = Memory(shape=signed(16), depth=gate_depth, init=gate_init)
        gate_read, gate_write = gate_memory.read_port(), gate_memory.write_port()

        m.d.comb += [
            mac_read.addr.eq(_address(mac.index, index_bits, mac.word.region)),
            element_read.addr.eq(_address(element.index, index_bits, term.s_region)),
            t_read.addr.eq(_address(element.index, hidden_bits, term.t_region)),
            slot_read.addr.eq(_address(element.index, x_bits, reading)),
        ]
        # constants: one, zero, then a scale for each window length
        constant = Mux(term.constant == 3, slot_length[reading] + 2, term.constant == 2)
        gate_index = Signal(gate_bits)
        m.d.comb += [
            gate_index.eq(Mux(term.constant != 0, constant, element.index)),
            gate_read.addr.eq(Cat(gate_index, term.b_region)),
            released.eq(element_issue & element.word.feature & (element.index == config.taxels - 1)),
        ]

        # ---------------------------------------------------------------- lanes and their weights
        words = len(plan.weight_words)
        weight_address = Signal(range(words))
        with m.If(mac.ended):
            m.d.sync += weight_address.eq(0)
        with m.Elif(mac_active):
            m.d.sync += weight_address.eq(weight_address + 1)
        mac_1, first_1, last_1, last_2, last_3 = (Signal(name=name) for name in ("mac_1", "first_1", "last_1", "last_2", "last_3"))
        m.d.sync += [
            mac_1.eq(mac_active),
            first_1.eq(mac.first & mac.word.starts),
            last_1.eq(mac_active & mac.last & mac.word.finishes),
            last_2.eq(last_1),
            last_3.eq(last_2),
        ]
        # Stage k: k slots after issue; the lane's accumulator holds the result two slots after the last slot of a term.
        stage = data.StructLayout(_element_stage(fields, index_bits))
        stages = [Signal(stage, name=f"element_{k}") for k in range(1, 3 + term_slots)]
        element_1, finished = stages[0], stages[-1]
        term_1 = Signal.like(term)
        m.d.sync += [
            term_1.eq(term),
            element_1.valid.eq(element_issue),
            element_1.first.eq(~second),
            element_1.done.eq(element_issue & (~element.word.two | second)),
            element_1.add.eq(element.word.add & ~second),
            element_1.feature.eq(element.word.feature),
            element_1.hidden.eq(element.word.hidden),
            element_1.write_state.eq(element.word.write_state),
            element_1.state_region.eq(element.word.state_region),
            element_1.write_t.eq(element.word.write_t),
            element_1.activated_region.eq(element.word.activated_region),
            element_1.index.eq(element.index),
            *(later.eq(sooner) for sooner, later in pairwise(stages)),
        ]

        m.submodules.elementwise = unit = ElementwiseUnit(config, fields["term0"])
        m.d.comb += [unit.s.eq(element_read.data), unit.t.eq(t_read.data), unit.x.eq(slot_read.data), unit.term.eq(term_1)]
        m.d.comb += [unit.add.eq(element_1.add), unit.feature.eq(finished.feature)]

        m.submodules.drain = drain = RowDrain(config, plan)
        m.d.comb += drain.capture.eq(last_3)
        for k in range(lanes):
            image = images.get(k, [])
            weights = Memory(shape=signed(config.weight_bits), depth=words, init=image)
            m.submodules[f"weights_{k}"] = weights
            weight_read = weights.read_port()
            m.d.comb += weight_read.addr.eq(weight_address)
            if config.loadable:
                write = weights.write_port()
                m.d.comb += [
                    write.addr.eq(self.load.address),
                    write.data.eq(self.load.data),
                    write.en.eq(self.load.enable & (self.load.select == k)),
                ]
            lane = self.lanes[k]
            m.d.comb += [lane.tick.eq(self.tick), drain.acc[k].eq(lane.acc.acc0)]
            if plan.shared:
                # one multiplier: rows go to accumulator 0, element-wise operations to accumulator 1
                m.d.comb += [
                    lane.a.eq(Mux(element_1.valid, unit.a, mac_read.data)),
                    lane.b.eq(Mux(element_1.valid, gate_read.data, weight_read.data)),
                    lane.first.eq(Mux(element_1.valid, element_1.first, first_1)),
                    lane.load.eq(Mux(element_1.valid, unit.load, 0)),
                    lane.valid.eq(Cat(mac_1, element_1.valid)),
                    unit.acc.eq(lane.acc.acc1),
                ]
            else:
                m.d.comb += [
                    lane.a.eq(mac_read.data), lane.b.eq(weight_read.data), lane.first.eq(first_1), lane.valid.eq(mac_1),
                ]  # fmt: skip
        if not plan.shared:
            lane = self.element_lane
            m.d.comb += [
                lane.tick.eq(self.tick), lane.a.eq(unit.a), lane.b.eq(gate_read.data), lane.first.eq(element_1.first),
                lane.load.eq(unit.load), lane.valid.eq(element_1.valid), unit.acc.eq(lane.acc.acc0),
            ]  # fmt: skip

        # ---------------------------------------------------------------- addends
        m.submodules.addends = addends = _AddendMemory(config, plan, images.get(memory_map.Memory.ADDENDS, []))
        wiring.connect(m, wiring.flipped(self.load), addends.load)
        m.d.comb += [
            addends.read_address.eq(drain.addend_address), drain.addend.eq(addends.read_data),
            addends.write.eq(drain.partial), addends.write_address.eq(drain.partial_address), addends.write_data.eq(drain.total),
        ]  # fmt: skip

        # ---------------------------------------------------------------- results: rows through the table, and elements
        m.submodules.activation = table = ActivationUnit(config)
        element_4 = Signal.like(finished)
        activated_4 = Signal()
        m.d.sync += [element_4.eq(finished), activated_4.eq(finished.done & finished.write_t)]
        m.d.comb += [
            table.index.eq(Mux(activated_4, unit.index, drain.index)),
            table.tanh.eq(activated_4 | drain.tanh),
        ]
        row_7, value_7 = Signal.like(drain.result), Signal.like(drain.value)
        element_5_index, element_5_region, activated_5 = Signal(index_bits), Signal.like(element_4.activated_region), Signal()
        m.d.sync += [
            row_7.eq(drain.result), value_7.eq(drain.value),
            activated_5.eq(activated_4), element_5_index.eq(element_4.index), element_5_region.eq(element_4.activated_region),
        ]  # fmt: skip
        row_t_address = _address(row_7.index, hidden_bits, row_7.region)
        element_t_address = _address(element_5_index, hidden_bits, element_5_region)
        m.d.comb += [
            t_write.addr.eq(Mux(activated_5, element_t_address, row_t_address)),
            t_write.data.eq(Mux(row_7.t & ~row_7.tabled, value_7, table.value)),
            t_write.en.eq(row_7.t | activated_5),
            gate_write.addr.eq(_address(row_7.index, gate_bits, row_7.region)),
            gate_write.data.eq(table.value),
            gate_write.en.eq(row_7.gate),
            self.logit.valid.eq(drain.result.logit),
            self.logit.value.eq(drain.logit),
        ]
        if config.loadable:
            with m.If(self.load.enable & (self.load.select == memory_map.Memory.CONSTANTS)):
                base = len(program.gate_regions) << gate_bits
                m.d.comb += [gate_write.addr.eq(base + self.load.address), gate_write.data.eq(self.load.data), gate_write.en.eq(1)]
        last_logit = drain.result.logit & (drain.result.index == config.classes - 1)
        with m.If(go):
            m.d.sync += due.eq(1)
        with m.Elif(last_logit):
            m.d.sync += due.eq(0)

        m.d.comb += [
            state_write.addr.eq(Cat(finished.index, finished.state_region)),
            state_write.data.eq(unit.result),
            state_write.en.eq(finished.done & finished.write_state),
            self.feature.valid.eq(state_write.en & finished.feature),
            self.feature.value.eq(unit.code),
            self.state.valid.eq(state_write.en & finished.hidden),
            self.state.value.eq(unit.result),
        ]
        return m


def lane_sizes(lane) -> tuple[int, int, tuple[int, ...]]:
    """(a_bits, b_bits, acc_bits) of a lane's interface."""
    return len(lane.a), len(lane.b), tuple(field.width for _, field in lane.acc.shape())


def _element_stage(fields: dict, index_bits: int) -> dict:
    """What travels beside an element-wise operation through the lane."""
    kept = {name: fields[name] for name in ("write_state", "state_region", "write_t", "activated_region", "hidden", "feature", "add")}
    return {"valid": 1, "first": 1, "done": 1, "index": index_bits, **kept}


def _address(index, bits: int, region):
    """Memory address: ``index`` brought to ``bits`` bits, ``region`` above it."""
    return Cat(index[:bits], Const(0, max(0, bits - len(index))), region)


class _AddendMemory(wiring.Component):
    """Addends and partial sums: one word a row, accumulator_bits wide, in two halves so that a 16-bit bus can load it.

    Read latency 1. A word written in a cycle can be addressed in the next.
    """

    def __init__(self, config: AcceleratorConfig, plan: Schedule, image: list[int]) -> None:
        self._config, self._image = config, image
        self._words = len(plan.bias_rows) + plan.partial_rows
        address, word = range(self._words), signed(config.accumulator_bits)
        super().__init__(
            {
                "load": In(load_signature()), "read_address": In(address), "read_data": Out(word),
                "write": In(1), "write_address": In(address), "write_data": In(word),
            }
        )  # fmt: skip

    def elaborate(self, platform):
        m = Module()
        data_out = []
        loads = self.load.enable & (self.load.select == memory_map.Memory.ADDENDS) & int(self._config.loadable)
        for half in range(2):
            bits = slice(16 * half, min(16 * half + 16, self._config.accumulator_bits))
            width = bits.stop - bits.start
            init = [word >> bits.start & (1 << width) - 1 for word in self._image]
            m.submodules[("low", "high")[half]] = memory = Memory(shape=width, depth=self._words, init=init)
            read, write = memory.read_port(), memory.write_port()
            load = loads & (self.load.address[0] == half)
            m.d.comb += [
                read.addr.eq(self.read_address),
                write.addr.eq(Mux(load, self.load.address[1:], self.write_address)),
                write.data.eq(Mux(load, self.load.data, self.write_data[bits])),
                write.en.eq(load | self.write),
            ]
            data_out.append(read.data)
        m.d.comb += self.read_data.eq(Cat(*data_out))
        return m
