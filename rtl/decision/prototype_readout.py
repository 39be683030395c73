"""The nearest stored trajectory of a touch, and touches that are stored (docs/specification_interfaces.md, section 18)."""

from collections.abc import Callable
from types import SimpleNamespace

from amaranth.hdl import Array, Cat, Const, Module, Mux, Signal, Value, signed, unsigned
from amaranth.lib.memory import Memory

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import (
    NO_COLLISION,
    TEACHING,
    Block,
    drive,
    exceeds,
    greater,
    inputs,
    load_lines,
    load_signature,
    narrow,
    outputs,
    parity_wrong,
    prototypes_memory,
    reaches,
    shape_of,
    struct,
    working_memory,
    wrapping_increment,
)
from eskin.rtl.program.memory_map import Memory as Loaded
from eskin.rtl.program.memory_map import prototype_words


def _by_value(number: Value, of: Callable[[int], int]) -> Value:
    """``of(number)``, by gates."""
    outcomes = [of(value) for value in range(1 << len(number))]
    bits = (max(outcomes)).bit_length()
    return Cat(
        Const(
            sum((outcome >> k & 1) << value for value, outcome in enumerate(outcomes)), len(outcomes)
        ).bit_select(number, 1)
        for k in range(bits)
    )


def _odd_of_next(counter: Value) -> Value:
    """True if an odd number of bits changes when ``counter`` counts on."""
    odd: Value = Const(0, 1)
    for bit in reversed(counter):
        odd = ~(bit & odd)
    return odd


class PrototypeReadout(Block):
    """Distances of the current touch from all prototypes, one code per cycle and without a multiplier; writes
    the touch into the slot of a taught one.

    The codes are in one memory, step by step, place by place, value by value, so that a step begins where the
    step before ended and a single counter addresses all of a touch. With places for taught touches the first
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
    commands : In(TEACHING), only with taught places
        Of `eskin.rtl.common.status`.
    """

    def ports(self, config: AcceleratorConfig):
        score = shape_of(config.score_format)
        return (
            inputs(
                "logit_valid",
                "step_done",
                "ended",
                "clear",
                vector=struct("valid", value=shape_of(config.trajectory_format)),
                load=load_signature(config),
            )
            | outputs("idle", score=struct("valid", value=score))
            | (outputs("wrong") if config.hardware.checksum else {})
            | (outputs("far") if config.readout_rule.unknown_above else {})
            | (inputs(commands=TEACHING) if config.readout_rule.taught else {})
        )

    def elaborate(self, platform):
        m = Module()
        config, rule, teaches = self.spec, self.spec.readout_rule, self.spec.readout_rule.taught > 0
        width, bits, checks = config.trajectory_width, rule.state_code_bits, int(config.hardware.checksum)
        stored = bits + checks  # a code and its parity
        places, words = rule.prototypes + rule.taught, prototype_words(config)
        vector = self.vector
        upset_seen = Signal()  # a register below is not what was written
        guards = []

        # ---------------------------------------------------------------- where it is
        busy, head, gap, body, teaching, first = (
            Signal(name=name, init=name == "first")  # first: step of the touch, row of a pass
            for name in ("busy", "head", "gap", "body", "teaching", "first")
        )
        address = Signal(range(words + 1))
        unit = Signal(range(width))
        label = Signal(range(config.classes))
        slot, after_slot, last_slot, taught_slot = self._slots()
        last_unit, last_label = Signal(name="last_unit"), Signal(name="last_label")
        row_ends = body & last_unit & last_slot & last_label
        begins = Signal()  # a step's distances, or a pass that teaches
        pass_begins = Signal()
        pass_ends = Signal()
        row_again = Signal()
        dropped = Signal()
        back = Signal()
        closes = Signal()
        m.d.comb += [
            last_unit.eq(unit == width - 1),
            last_label.eq(label == config.classes - 1),
            begins.eq(self.step_done | pass_begins),
            dropped.eq(self.clear & ~teaching & ~pass_begins),
            back.eq(dropped | self.ended | pass_ends),
        ]
        place_ends, moves = body & last_unit, head | body
        registers = [
            (address, moves | back, Mux(back, 0, (address + 1)[: len(address)])),
            (unit, begins | moves, Mux(begins, 0, wrapping_increment(unit, width))),
            (slot, begins | place_ends, Mux(begins, 0, after_slot)),
            (
                label,
                begins | (place_ends & last_slot),
                Mux(begins, 0, wrapping_increment(label, config.classes)),
            ),
        ]
        flags = [
            (busy, (busy | self.logit_valid) & ~closes & ~dropped),
            (body, ((body & ~row_ends) | (gap if teaches else begins)) & ~dropped),
            (first, back | (first & ~closes & ~(teaching & row_ends))),
        ]
        if teaches:
            m.d.comb += [
                # (also where an upset has ended or begun one: nothing moves)
                pass_ends.eq(teaching & ((row_ends & reaches(address, words - 1)) | ~(head | gap | body))),
                row_again.eq(teaching & row_ends & ~pass_ends),
            ]
            flags += [
                (head, ((head & ~last_unit) | begins | row_again) & ~dropped),
                (gap, head & last_unit & ~dropped),
                (teaching, (teaching | pass_begins) & ~pass_ends),
            ]

        # ---------------------------------------------------------------- codes of the step, and of the places
        codes = Signal(width * stored)  # the next one lowest
        reading = Signal()
        comparing = Signal()
        from_memory = Signal()
        read, write = working_memory(
            m, "places", unsigned(stored), words, attrs=prototypes_memory(config, platform, words)
        )
        loads = self.load.enable & self.load.select[load_lines(config)[Loaded.PROTOTYPES]]
        wanted: Value = loads  # the address is the host's
        reads: Value = reading
        if teaches:
            looks = self.commands.look & self.idle
            wanted, reads = loads | looks, reading | looks
        beyond = Signal()  # the host's address is a class's number
        written = self.written = Signal()
        at = Signal(range(words))
        target = Signal()  # of a pass that teaches, the place under way
        sound: Value = Const(1, 1)
        if checks and teaches:
            spoiled = Signal()  # since the touch or pass began
            m.d.sync += spoiled.eq((spoiled | upset_seen) & ~back)
            sound = ~(spoiled | upset_seen)
        m.d.comb += [
            beyond.eq(exceeds(self.load.address, words - 1)),
            written.eq(((head & ~teaching) | (body & target)) & sound),
            at.eq(Mux(wanted, self.load.address, address)),
        ]
        drive(m, read, addr=at, en=reads)
        m.d.comb += reading.eq(Mux(teaching, head, body))
        drive(m, write, addr=at, data=Mux(loads, self.load.data, codes), en=written | (loads & ~beyond))
        m.d.sync += [comparing.eq(body & ~teaching & ~dropped), from_memory.eq(head & teaching)]
        comes = Mux(from_memory, read.data, codes[:stored])
        code: Value = narrow(vector.value, rule.state_code_shift, config.state_code_format).as_unsigned()
        if checks:
            code = Cat(code, code.xor())
        with m.If(vector.valid | comparing | from_memory | written):
            m.d.sync += codes.eq(Cat(codes[stored:], Mux(vector.valid, code, comes)))

        # ---------------------------------------------------------------- a place: in use, and what was last of it
        used = Signal(init=1)  # of the place whose code is compared
        used_done = Signal(init=1)  # of the place that is whole
        place_used: Value = Const(1, 1)
        if teaches:
            scan = SimpleNamespace(
                teaching=teaching,
                first=first,
                body=body,
                last_unit=last_unit,
                label=label,
                slot=slot,
                begins=pass_begins,
                ends=pass_ends,
                target=target,
            )
            whole = reaches(address, words) & sound
            place_used, number, guard = self._teaching(m, scan, loads, beyond, whole, registers, flags)
            guards.append(guard)
            m.d.comb += self.commands.place.eq(Mux(beyond, number, read.data))
        begin_of, end_of, first_done, last_done, taught_done, label_done, whole_place, told = (
            Signal(name=name)
            for name in "begin_of end_of first_done last_done taught_done label_done whole_place told".split()
        )
        m.d.sync += [
            begin_of.eq(unit == 0),
            end_of.eq(last_unit),
            used.eq(place_used),
            whole_place.eq(comparing & end_of & ~dropped),
        ]
        with m.If(
            place_ends
        ):  # a place has two values at least, so its sum is whole before the next one ends
            m.d.sync += [
                first_done.eq(slot == 0),
                last_done.eq(last_slot),
                taught_done.eq(taught_slot),
                label_done.eq(last_label),
                used_done.eq(place_used),
            ]

        # ---------------------------------------------------------------- sums
        sum_bits = len(self.score.value) - 1
        total, nearness, nearest = (Signal(sum_bits, name=name) for name in ("total", "nearness", "nearest"))
        apart = Signal(signed(bits + 1))
        m.d.comb += [apart.eq(codes[:bits].as_signed() - read.data[:bits].as_signed()), nearest.eq(~nearness)]
        minus = apart[-1]
        before: Value = Const(0, sum_bits)
        damaged = Signal()  # the place, in this step
        was_damaged = Signal()  # the place, in a step before
        if config.network.decision != "vote":
            every = config.classes * places
            m.submodules.sums = sums = Memory(
                shape=unsigned(sum_bits + checks),
                depth=every,
                init=[],
                attrs=NO_COLLISION | {"ram_style": "block"},
            )
            sum_read, sum_write = sums.read_port(), sums.write_port()
            place = Signal(range(every))
            kept = Signal(range(every))
            registers.append((place, begins | place_ends, Mux(begins, 0, wrapping_increment(place, every))))
            with m.If(place_ends):
                m.d.sync += kept.eq(place)
            m.d.comb += sum_read.addr.eq(place)
            drive(
                m, sum_write, addr=kept, data=Cat(total, damaged) if checks else total, en=whole_place & busy
            )
            before = Mux(first, 0, sum_read.data[:sum_bits])
            if checks:
                m.d.comb += was_damaged.eq(~first & sum_read.data[sum_bits])
        # |apart| is added with the same carries that make it positive
        carried = Cat(minus, Mux(begin_of, before, total)) + Cat(minus, apart[:-1] ^ minus.replicate(bits))
        with m.If(comparing):
            m.d.sync += total.eq(carried >> 1)
        counts_too = used_done & ~damaged if checks else used_done
        compared = Mux(taught_done, total >> rule.taught_shift, total) if rule.taught_shift else total
        nearer = whole_place & (first_done | (counts_too & (compared < nearest)))
        with m.If(nearer):
            m.d.sync += nearness.eq(~compared)
        if rule.spare_classes:  # a class may have no place in use
            with m.If(nearer & first_done & ~used_done):
                m.d.sync += nearness.eq(0)
        told_all = Signal()
        m.d.sync += [
            told.eq(whole_place & last_done & ~dropped),
            told_all.eq(whole_place & last_done & label_done & ~dropped),
        ]
        m.d.comb += closes.eq(told & told_all)
        drive(m, self.score, valid=told & busy, value=Cat(nearness, Const(1, 1)))
        m.d.comb += self.idle.eq(~(busy | teaching))
        if rule.unknown_above:
            limit = Signal(range(rule.unknown_above * config.windows.steps + 1))
            near = Signal()
            with m.If(self.step_done):
                m.d.sync += [limit.eq(Mux(first, 0, limit) + rule.unknown_above), near.eq(0)]
            with m.If(told):
                m.d.sync += near.eq(near | (nearest <= limit))
            m.d.comb += self.far.eq(~near)

        # ---------------------------------------------------------------- what outlasts a cycle, with its parity
        names, values = zip(*flags, strict=True)
        state = Signal(len(names), init=sum(flag.init << k for k, flag in enumerate(names)))
        m.d.comb += Cat(*names).eq(state)
        registers.append((state, Const(1, 1), Cat(*values)))
        for register, changes, value in registers:
            with m.If(changes):
                m.d.sync += register.eq(value)
        if checks:
            odd = comparing & (read.data.xor() ^ codes[:stored].xor())
            counted = (
                address.xor() ^ _odd_of_next(address)
            ) & ~back  # a separate sum would take a second adder
            guards += [
                parity_wrong(m, register, changes, counted if register is address else value)
                for register, changes, value in registers
            ]
            m.d.comb += [upset_seen.eq(Cat(guards).any()), self.wrong.eq((odd & used) | upset_seen)]
            with m.If(comparing):
                m.d.sync += damaged.eq(Mux(begin_of, was_damaged, damaged) | odd)
        return m

    def _slots(self) -> tuple[Signal, Value, Value, Value]:
        """Place of a class: its number among prototypes, or with the highest bit among taught ones. (That,
        the next one, whether it is the last, whether it is a taught one.)"""
        rule = self.spec.readout_rule
        bits = max(1, (max(rule.prototypes, rule.taught) - 1).bit_length())
        slot = Signal(bits + (rule.taught > 0))
        number = slot[:bits]
        ends, more = number == rule.prototypes - 1, wrapping_increment(number, 1 << bits)
        if not rule.taught:
            return slot, Mux(ends, 0, more), ends, Const(0, 1)
        ends = Mux(slot[-1], number == rule.taught - 1, ends)
        return slot, Mux(ends, Cat(Const(0, bits), ~slot[-1]), Cat(more, slot[-1])), ends & slot[-1], slot[-1]

    def _teaching(
        self,
        m: Module,
        scan: SimpleNamespace,
        loads: Value,
        beyond: Value,
        complete: Value,
        registers: list,
        flags: list,
    ) -> tuple[Value, Value, Value]:
        """Commands, and the numbers of touches taught: whether the current slot is in use, the number of the
        requested class, whether one has another parity than was written."""
        config, rule = self.spec, self.spec.readout_rule
        words, places, classes = prototype_words(config), rule.taught, config.classes
        checks = config.hardware.checksum
        numbers = [Signal(range(2 * places), name=f"count_{k}") for k in range(classes)]
        parities = [Signal(name=f"count_{k}_parity") for k in range(classes)] if checks else []
        chosen = Signal(range(classes))
        whole = Signal()
        following = Signal()
        known = ~exceeds(self.commands.label, classes - 1)
        free = ~self.commands.locked & self.idle
        teaches = self.commands.teach & free & known & (self.commands.option | self.commands.loaded | whole)
        forgets = self.commands.forget & free & (self.commands.option | known)
        asked = (self.load.address - words)[: len(chosen)]  # a class, of a host that loads or looks
        at_class = Signal(range(classes))
        count = Signal(range(2 * places))
        m.d.comb += [
            at_class.eq(Mux(self.idle, Mux(self.commands.forget, self.commands.label, asked), scan.label)),
            count.eq(Array(numbers)[at_class]),
        ]
        # a touch is counted as its pass comes to its class for the first time; its place is the newest from then on
        counted = (
            scan.teaching
            & scan.first
            & scan.body
            & (scan.slot == 0)
            & scan.last_unit
            & (scan.label == chosen)
        )
        newest = _by_value(count, lambda n: (n - 1) % places)
        used = lambda number: _by_value(number, lambda n: min(n, places))
        renewed = Signal.like(count)
        in_use = Signal(range(classes * places + 1))
        loaded = loads & beyond
        drive(
            m,
            scan,
            begins=(teaches & ~self.commands.option) | (self.ended & following & complete),
            target=scan.teaching & (scan.label == chosen) & scan.slot[-1] & (scan.slot[:-1] == newest),
        )
        m.d.comb += renewed.eq(
            Mux(
                loaded,
                self.load.data,
                Mux(counted, _by_value(count, lambda n: n + 1 if n + 1 < 2 * places else places), 0),
            )
        )
        drive(
            m,
            self.commands,
            refused=(self.commands.teach & ~teaches)
            | (self.commands.forget & ~forgets)
            | (self.ended & following & ~complete),
            in_use=in_use,
            done=scan.ends,
        )
        with m.If(loaded | counted | forgets):
            m.d.sync += [
                Array(numbers)[at_class].eq(renewed),
                in_use.eq(in_use - used(count) + used(renewed)),
            ]
            if checks:
                m.d.sync += Array(parities)[at_class].eq(renewed.xor())
        with m.If(forgets & self.commands.option):
            m.d.sync += [in_use.eq(0), *(number.eq(0) for number in (*numbers, *parities))]
        registers.append((chosen, teaches, self.commands.label[: len(chosen)]))
        touch_stays = ~(self.vector.valid | (self.clear & self.commands.locked) | loads)
        flags += [
            (whole, Mux(self.ended, complete, whole) & touch_stays),
            (following, Mux(teaches, self.commands.option, following) & ~self.ended),
        ]
        turned = exceeds(count, places - 1)
        place_used = ~scan.slot[-1] | turned | greater(count, scan.slot[:-1])
        if rule.spare_classes:
            place_used &= scan.slot[-1] | ~exceeds(scan.label, classes - rule.spare_classes - 1)
        return place_used, count, Cat(*numbers, *parities).xor() if checks else Const(0, 1)
