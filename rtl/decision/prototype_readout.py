"""The nearest stored trajectory of a touch, and touches that are stored (docs/specification.md, section 18)."""

from __future__ import annotations

from amaranth.hdl import Array, Cat, Const, Module, Mux, Signal, Value, signed, unsigned
from amaranth.lib import data, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from eskin.golden.core.config import AcceleratorConfig
from eskin.rtl.common.collisions import NO_COLLISION
from eskin.rtl.common.fixed import narrow, shape_of, wrapping_increment
from eskin.rtl.common.load_port import load_lines, load_signature
from eskin.rtl.common.memory_style import prototypes_memory
from eskin.rtl.program.memory_map import Memory as Loaded
from eskin.rtl.program.memory_map import prototype_words


class PrototypeReadout(wiring.Component):
    """Distances of the touch under way from all prototypes, a code a cycle and no multiplier; writes what it
    sees into the place of a taught touch.

    The codes are in one memory, step by step, place by place, value by value, so that a step begins where the
    one before ended and a single counter addresses all of a touch. With places for taught touches the first
    place of each step is the touch's own: it is written there as it comes. Teaching goes through the memory
    once and copies it, while no touch is open.

    Members
    -------
    vector : In(struct)
        Value by value where ``valid``: new hidden states; of a linear cell logits. Never held up.
    logit_valid : In(1)
        A logit of the step is given.
    step_done : In(1)
        The step's last logit is given in this cycle: distances are computed from now on.
    ended : In(1)
        A touch's last decision is taken (as of the classifier).
    score : Out(struct)
        Complement of the distance of each class, class by class: with n values a step and S places in all,
        n + 1 (only with taught places) + S n + 3 cycles after ``step_done`` for the last
        (`eskin.rtl.program.timing.readout_cycles`).
    wrong : Out(1), only with ``checksum``
        The code that is compared, of a place in use, has another parity than it was stored with. Until the touch
        ends its place does not count, unless it is its class's first.
    far : Out(1), only with ``unknown_above``
        The step's smallest distance is above it; from the last score on.
    idle : Out(1)
        Nothing is under way: the next step may begin.
    clear : In(1)
        A new recording: the touch under way is dropped; a touch that is being written is finished.
    load : In
        The host's writes, never while not idle.
    teach, forget : In(1), only with taught places
        Pulses. ``label`` is the class; ``option``: of the next touch, of all classes; ``loaded``: of the touch whose
        codes the host has written into the touch's own place.
    locked : In(1)
        A touch is open.
    look : In(1)
        Reads word ``load.address``, only while idle; ``place`` : Out(9) is it from the next cycle on, while the
        address stays and nothing else happens.
    refused : Out(1)
        Pulse: that was not, or will not be, done.
    teaching_done : Out(1)
        Pulse: a touch is taught.
    in_use : Out(8)
        Places that hold a taught touch.
    """

    def __init__(self, config: AcceleratorConfig) -> None:
        self._config = config
        self._teaches = config.readout_rule.taught > 0
        score = shape_of(config.score_format)
        commands = {
            "teach": In(1),
            "forget": In(1),
            "label": In(7),
            "option": In(1),
            "loaded": In(1),
            "locked": In(1),
        }
        looking = {"look": In(1), "place": Out(9)}
        super().__init__(
            {
                "vector": In(data.StructLayout({"valid": 1, "value": shape_of(config.trajectory_format)})),
                "logit_valid": In(1),
                "step_done": In(1),
                "ended": In(1),
                "clear": In(1),
                "score": Out(data.StructLayout({"valid": 1, "value": score})),
                "idle": Out(1),
                "load": In(load_signature(config)),
            }
            | ({"wrong": Out(1)} if config.hardware.checksum else {})
            | ({"far": Out(1)} if config.readout_rule.unknown_above else {})
            | (
                commands | looking | {"refused": Out(1), "teaching_done": Out(1), "in_use": Out(8)}
                if self._teaches
                else {}
            )
        )

    def elaborate(self, platform):
        m = Module()
        config, rule, teaches = self._config, self._config.readout_rule, self._teaches
        width, bits, checks = config.trajectory_width, rule.state_code_bits, int(config.hardware.checksum)
        stored = bits + checks  # a code and its parity
        places, words = rule.prototypes + rule.taught, prototype_words(config)
        vector = self.vector

        # ---------------------------------------------------------------- where it is
        busy, head, gap, body, teaching = Signal(), Signal(), Signal(), Signal(), Signal()
        address = Signal(range(words + 1))
        unit, slot, label = Signal(range(width)), Signal(range(places)), Signal(range(config.classes))
        last_unit, last_slot, last_label = (
            Signal(name=name) for name in ("last_unit", "last_slot", "last_label")
        )
        row_ends = body & last_unit & last_slot & last_label
        begins = Signal()  # a step's distances, or a pass that teaches
        m.d.comb += [
            last_unit.eq(unit == width - 1),
            last_slot.eq(slot == places - 1),
            last_label.eq(label == config.classes - 1),
        ]
        with m.If(head | body):
            m.d.sync += [address.eq(address + 1), unit.eq(wrapping_increment(unit, width))]
            with m.If(body & last_unit):
                m.d.sync += slot.eq(wrapping_increment(slot, places))
                with m.If(last_slot):
                    m.d.sync += label.eq(wrapping_increment(label, config.classes))
        first = Signal(init=1)  # step of the touch
        row_begins = begins
        m.d.sync += [gap.eq(head & last_unit), body.eq((body & ~row_ends) | (gap if teaches else row_begins))]
        if teaches:
            pass_ends, row_again = Signal(), Signal()
            m.d.comb += [
                pass_ends.eq(teaching & row_ends & (address == words - 1)),
                row_again.eq(teaching & row_ends & ~pass_ends),
            ]
            m.d.sync += head.eq((head & ~last_unit) | row_begins | row_again)

        # ---------------------------------------------------------------- codes of the step, and of the places
        codes = Signal(width * stored)  # the next one lowest
        reading, comparing, from_memory = Signal(), Signal(), Signal()
        m.submodules.places = memory = Memory(
            shape=unsigned(stored), depth=words, init=[], attrs=prototypes_memory(config, platform, words)
        )
        read, write = memory.read_port(), memory.write_port()
        loads = self.load.enable & self.load.select[load_lines(config)[Loaded.PROTOTYPES]]
        asked = loads  # the address is the host's
        reads: Value = reading
        if teaches:
            asked, reads = loads | (self.look & self.idle), reading | (self.look & self.idle)
        written, at = Signal(), Signal(range(words))
        target = Signal()  # of a pass that teaches, the place under way
        m.d.comb += [
            written.eq((head & ~teaching) | (body & target)),
            at.eq(Mux(asked, self.load.address, address)),
            read.addr.eq(at),
            read.en.eq(reads),
            reading.eq(Mux(teaching, head, body)),
            write.addr.eq(at),
            write.data.eq(Mux(loads, self.load.data, codes)),
            write.en.eq(written | (loads & (self.load.address < words))),
        ]
        m.d.sync += [comparing.eq(body & ~teaching), from_memory.eq(head & teaching)]
        comes = Mux(from_memory, read.data, codes[:stored])
        code: Value = narrow(vector.value, rule.state_code_shift, config.state_code_format).as_unsigned()
        if checks:
            code = Cat(code, code.xor())
        with m.If(vector.valid | comparing | from_memory | written):
            m.d.sync += codes.eq(Cat(codes[stored:], Mux(vector.valid, code, comes)))

        # ---------------------------------------------------------------- sums
        sum_bits = len(self.score.value) - 1
        total, nearest = Signal(sum_bits), Signal(sum_bits)
        begin_of, end_of, first_of, last_of, used_of = (
            Signal(name=name) for name in ("begin_of", "end_of", "first_of", "last_of", "used_of")
        )
        m.d.sync += [
            begin_of.eq(unit == 0),
            end_of.eq(last_unit),
            first_of.eq(slot == 0),
            last_of.eq(last_slot),
        ]
        apart = Signal(signed(bits + 1))
        m.d.comb += apart.eq(codes[:bits].as_signed() - read.data[:bits].as_signed())
        minus = apart[-1]
        before: Value = Const(0, sum_bits)
        damaged, was_damaged = Signal(), Signal()  # the place: in this step, in one before
        whole_place, first_done, last_done, used_done = (
            Signal(name=name) for name in ("whole_place", "first_done", "last_done", "used_done")
        )
        m.d.sync += [
            whole_place.eq(comparing & end_of),
            first_done.eq(first_of),
            last_done.eq(last_of),
            used_done.eq(used_of),
        ]
        if config.network.decision != "vote":
            every = config.classes * places
            m.submodules.sums = sums = Memory(
                shape=unsigned(sum_bits + checks),
                depth=every,
                init=[],
                attrs=NO_COLLISION | {"ram_style": "block"},
            )
            sum_read, sum_write = sums.read_port(), sums.write_port()
            asked, kept = Signal(range(every)), Signal(range(every))
            with m.If(body & last_unit):
                m.d.sync += asked.eq(wrapping_increment(asked, every))
            with m.If(whole_place):
                m.d.sync += kept.eq(wrapping_increment(kept, every))
            m.d.comb += [
                sum_read.addr.eq(asked),
                sum_write.addr.eq(kept),
                sum_write.data.eq(Cat(total, damaged) if checks else total),
                sum_write.en.eq(whole_place),
            ]
            before = Mux(first, 0, sum_read.data[:sum_bits])
            if checks:
                m.d.comb += was_damaged.eq(~first & sum_read.data[sum_bits])
        # |apart| is added with the same carries that make it positive
        carried = Cat(minus, Mux(begin_of, before, total)) + Cat(minus, apart[:-1] ^ minus.replicate(bits))
        with m.If(comparing):
            m.d.sync += total.eq(carried >> 1)
        counts_too = used_done & ~damaged if checks else used_done
        if checks:
            m.d.comb += self.wrong.eq(comparing & used_of & read.data.xor())
            with m.If(comparing):
                m.d.sync += damaged.eq(Mux(begin_of, was_damaged, damaged) | read.data.xor())
        compared: Value = total
        if rule.taught_shift:
            taught_of, taught_done = Signal(name="taught_of"), Signal(name="taught_done")
            m.d.sync += [taught_of.eq(slot >= rule.prototypes), taught_done.eq(taught_of)]
            compared = Mux(taught_done, total >> rule.taught_shift, total)
        nearer = whole_place & (first_done | (counts_too & (compared < nearest)))
        with m.If(nearer):
            m.d.sync += nearest.eq(compared)
        if rule.spare_classes:  # a class may have no place in use
            with m.If(nearer & first_done & ~used_done):
                m.d.sync += nearest.eq(-1)
        told, scores = Signal(), Signal(range(config.classes))
        m.d.sync += told.eq(whole_place & last_done)
        done = told & (scores == config.classes - 1)
        with m.If(told):
            m.d.sync += scores.eq(wrapping_increment(scores, config.classes))
        m.d.comb += [
            self.score.valid.eq(told),
            self.score.value.eq(~Cat(nearest, Const(0, 1))),
            self.idle.eq(~(busy | teaching)),
        ]
        m.d.sync += busy.eq((busy | self.logit_valid) & ~done)
        with m.If(done):
            m.d.sync += first.eq(0)
        if rule.unknown_above:
            limit, near = Signal(range(rule.unknown_above * config.windows.steps + 1)), Signal()
            with m.If(self.step_done):
                m.d.sync += [limit.eq(Mux(first, 0, limit) + rule.unknown_above), near.eq(0)]
            with m.If(told):
                m.d.sync += near.eq(near | (nearest <= limit))
            m.d.comb += self.far.eq(~near)

        # ---------------------------------------------------------------- a recording, and what is taught
        pass_begins: Value = Const(0, 1)
        if teaches:
            pass_begins = self._teaching(m, target, teaching, pass_ends, address, slot, label, used_of, loads)
            m.d.comb += begins.eq(self.step_done | pass_begins)
            with m.If(self.load.address < words):
                m.d.comb += self.place.eq(read.data)
        else:
            m.d.comb += begins.eq(self.step_done)
            m.d.sync += used_of.eq(1)
        dropped = self.clear & ~teaching & ~pass_begins
        with m.If(dropped | self.ended | (pass_ends if teaches else 0)):
            m.d.sync += [address.eq(0), first.eq(1)]
        with m.If(dropped):
            m.d.sync += [
                signal.eq(0)
                for signal in (
                    *(busy, head, gap, body, comparing, whole_place, told),
                    unit,
                    slot,
                    label,
                    scores,
                )
            ]
            if config.network.decision != "vote":
                m.d.sync += [asked.eq(0), kept.eq(0)]
        return m

    def _teaching(
        self,
        m: Module,
        target: Signal,
        teaching: Signal,
        pass_ends: Signal,
        address: Signal,
        slot: Signal,
        label: Signal,
        used_of: Signal,
        loads: Value,
    ) -> Value:
        """Commands, and the numbers of touches taught; high where a pass begins."""
        config, rule = self._config, self._config.readout_rule
        words, taught = prototype_words(config), rule.taught
        counts = Array(Signal(range(2 * taught), name=f"count_{k}") for k in range(config.classes))
        chosen, whole, following = Signal(range(config.classes)), Signal(), Signal()
        in_use = Signal(range(config.classes * taught + 1))
        complete = address == words
        known = self.label < config.classes
        free = ~self.locked & self.idle
        teaches = self.teach & free & known & (self.option | self.loaded | whole)
        forgets = self.forget & free & (self.option | known)
        pass_begins, taught_before = Signal(), Signal(range(2 * taught))
        m.d.comb += [
            pass_begins.eq((teaches & ~self.option) | (self.ended & following & complete)),
            taught_before.eq(counts[chosen]),
            target.eq(
                teaching
                & (label == chosen)
                & (
                    slot
                    == Mux(taught_before < taught, taught_before, taught_before - taught) + rule.prototypes
                )
            ),
            self.refused.eq(
                (self.teach & ~teaches) | (self.forget & ~forgets) | (self.ended & following & ~complete)
            ),
            self.in_use.eq(in_use),
            self.teaching_done.eq(pass_ends),
        ]
        in_place: Value = counts[label] + rule.prototypes > slot
        if rule.spare_classes:
            spare = label >= config.classes - rule.spare_classes
            in_place &= ~spare | (slot >= rule.prototypes)
        m.d.sync += used_of.eq(in_place)
        with m.If(teaches):
            m.d.sync += [chosen.eq(self.label), following.eq(self.option)]
        with m.If(self.ended):
            m.d.sync += [whole.eq(complete), following.eq(0)]
        with m.If(self.vector.valid | (self.clear & self.locked) | loads):
            m.d.sync += whole.eq(0)
        m.d.sync += teaching.eq((teaching | pass_begins) & ~pass_ends)
        with m.If(pass_ends):
            m.d.sync += [
                counts[chosen].eq(Mux(taught_before == 2 * taught - 1, taught, taught_before + 1)),
                in_use.eq(in_use + (taught_before < taught)),
            ]
        used = lambda number: Mux(number < taught, number, taught)
        with m.If(forgets):
            with m.If(self.option):
                m.d.sync += [in_use.eq(0), *(number.eq(0) for number in counts)]
            with m.Else():
                of_class = counts[self.label]
                m.d.sync += [in_use.eq(in_use - used(of_class)), of_class.eq(0)]
        number = (self.load.address - words)[: max(1, len(label))]
        with m.If(loads & (self.load.address >= words)):
            m.d.sync += [
                counts[number].eq(self.load.data),
                in_use.eq(Mux(number == 0, 0, in_use) + used(self.load.data[: len(taught_before)])),
            ]
        with m.If(self.load.address >= words):
            m.d.comb += self.place.eq(counts[number])
        return pass_begins
