"""A scheduled step as microcode: for every slot, the action of each unit of the engine.

The words are time-stationary: an operation that takes several slots sets bits in several words, so nothing
travels beside the data and the hardware needs no pipeline of control. Consecutive words that differ in a
counting operand address alone are one word with a repeat count. Reads have latency 1: an address in slot t is
data in slot t + 1.
"""

from collections.abc import Iterator
from functools import cached_property
from itertools import accumulate, pairwise

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.program.cells import CellProgram, ElementOp
from eskin.rtl.program.scheduler import RowGroup, Schedule
from eskin.rtl.program.timing import shares_lane

ADDRESSES = tuple("vector element t gate window addend partial_to result state_to".split())
"""Fields that are addresses: where a slot does not use one it may have any value."""

CONTROLS = tuple(
    (
        "mac valid swap shift partial tanh activated gate_write t_write value logit ends_step "
        "element_operand element_valid element_first add t_operand minus scale state_write feature hidden released in_step"
    ).split()
)
"""Bits; 0 where a slot does not set them.

- mac: the addressed weight is used; go on to the next. valid: the rows' product is added.
- swap: the row lanes' accumulators start from the waiting addends, and their sums go into the chain.
- shift: the chain moves on. partial: the finished row goes back to the addend memory.
- tanh, activated: the table's half; its index comes from the element-wise lane.
- gate_write, t_write: the table's answer of this slot is written.
- value: the finished row goes to the T memory as it is.
- logit, ends_step: it goes to the classifier; it is the step's last.
- element_*: the same for the element-wise lane. The sum starts at the rounding constant, plus T with ``add``.
- t_operand, minus: operand a is T, less T; a window sum, where one is addressed, comes on top.
- scale: the gate memory's address points at the scale of the window's length.
- state_write, feature, hidden: the element-wise result is written, is a feature, is the new hidden state.
- released: the window has been read.
- in_step: phases A and B up to the last logit, without the prologue and what the chain takes in afterwards.
"""


class Layout:
    """Bits of indices and the places of regions in the memories.

    Attributes
    ----------
    state_bases:
        First address of each region of the state memory. Regions are adjacent, so that a row may continue from one into
        the next.
    hidden_bits, gate_bits, window_bits:
        Bits of an index in the T memory; in the gate memory, whose last region holds the constants: the scales, one and
        zero, and check words; of an input in a window buffer.
    scale_words, scale_bits:
        Words of the scales' region: one a window length, or for each of ``constants`` one a length, from a power of two
        (these bits) on.
    checks:
        For each check word (index of the window length, set of weights) of the steps it is for: one a length, or one a
        set.
    check_base:
        Index of the first check word, a multiple of a power of two as for the scales; its highest bit none of them has.
    state_zero, t_zero, window_none:
        Addresses of words that hold 0: of the state memory and the T memory (which a program without T regions has not),
        written by the prologue; of the window memory, above the buffers, written after each reset of the chain.
    shared:
        One multiplier serves rows and element-wise operations.
    holds_dense:
        The constants hold the dense layer's weights: see `eskin.rtl.program.scheduler.Schedule.beside`.
    constants, constant_words:
        Address of the constants after the gates, on a shared lane a power of two no smaller, so that one bit marks them;
        words that the host loads: scales, one, zero, check words; on a shared lane the dense layer's weights, each row
        from a power of two on.
    used_constants:
        Places among the words that the host loads that are ever read; the others keep rows and check words where powers
        of two begin.
    state_depth, t_depth, gate_depth:
        Words of the memories.
    """

    def __init__(self, config: AcceleratorConfig, program: CellProgram):
        self.config, self.program = config, program
        hidden, lengths = config.network.hidden, len(config.window_lengths)
        self.state_bases: dict[str, int] = {}
        end = 0
        for region in program.state_regions:
            self.state_bases[region] = end
            end += config.inputs if region == "x" else hidden
        self.state_zero, self.state_depth = end, end + 1
        self.hidden_bits, self.window_bits = (hidden - 1).bit_length(), (config.inputs - 1).bit_length()
        self.t_zero = len(program.t_regions) << self.hidden_bits
        self.t_depth, self.window_none = self.t_zero + 1, 2 << self.window_bits
        self.scale_bits = (lengths - 1).bit_length()
        self.scale_words = config.constants << self.scale_bits if config.constants > 1 else lengths
        self.checks = tuple((length, 0) for length in range(lengths))
        if config.sets > 1:
            self.checks = tuple((length, step) for step, length in enumerate(config.length_index))
            if config.follows_touch:  # each step with each length, in powers of two
                every = [min(length, lengths - 1) for length in range(1 << self.scale_bits)]
                self.checks = tuple((length, step) for step in range(config.sets) for length in every)
        align = 1 << (len(self.checks) - 1).bit_length()
        if config.constants > 1:
            self.check_base = max(align, 1 << (self.scale_words + 1).bit_length())
        else:
            self.check_base = -(-(2 + lengths) // align) * align
        checks = range(self.check_base, self.check_base + len(self.checks) * config.hardware.checksum)
        self._few = checks.stop if checks else 2 + self.scale_words
        self.gate_bits = max(self.hidden_bits, (self._few - 1).bit_length())
        self.shared = shares_lane(config)
        self.holds_dense = self.shared and not any(block.carried for block in program.after)
        rows = range(config.classes) if self.holds_dense else ()
        dense = [self.dense_offset(row) + column for row in rows for column in range(hidden)]
        self.constant_words = dense[-1] + 1 if dense else self._few
        scales = [
            self.scale_place(constant) + q for constant in range(config.constants) for q in range(lengths)
        ]
        self.used_constants = [*scales, self.scale_words, self.scale_words + 1, *checks, *dense]
        self.constants = len(program.gate_regions) << self.gate_bits
        if self.shared and program.gate_regions:
            self.constants = 1 << (max(self.constants, self.constant_words) - 1).bit_length()
        self.gate_depth = self.constants + self.constant_words

    def scale_place(self, constant: int) -> int:
        """Place of the scale of length 0, of this kind or input where there is one for each."""
        return constant << self.scale_bits

    def state(self, region: str, index: int) -> int:
        """Address in the state memory."""
        return self.state_bases[region] + index

    def t(self, region: str, index: int) -> int:
        """Address in the T memory."""
        return self.program.t_regions.index(region) << self.hidden_bits | index

    def gate(self, region: str, index: int) -> int:
        """Address in the gate memory; ``one``, ``zero``, ``scale`` (of an input, of length 0) and ``check``
        (of length 0) are constants."""
        if region in self.program.gate_regions:
            return self.program.gate_regions.index(region) << self.gate_bits | index
        if region == "scale":
            return self.constants + self.scale_place(self.config.input_constants[index])
        return (
            self.constants
            + {"one": self.scale_words, "zero": self.scale_words + 1, "check": self.check_base}[region]
        )

    def dense_offset(self, row: int) -> int:
        """Place of a row of the dense layer among the constants of a shared lane."""
        return (-(-self._few >> self.hidden_bits) + row) << self.hidden_bits


class Microcode:
    """The words that `eskin.rtl.engine.sequencer.Sequencer` runs.

    Attributes
    ----------
    slots:
        Fields of every slot: the prologue (writes the words that stand for 0, clears the state, fills the
        chain), phase A, phase B.
    again:
        Slot at which a further step of the touch begins.
    wait:
        Slot that is held until the window is complete.
    """

    def __init__(self, plan: Schedule):
        self.plan, self.layout = plan, Layout(plan.config, plan.program)
        self._operand = "vector" if plan.shared else "element"
        self._slots: dict[int, dict[str, int]] = {}  # fields set so far, by slot
        self.again = self._prologue()
        self.wait = self.again + plan.slots_before
        self._rows()
        for issue in plan.elements:
            self._element(issue.op, issue.term, issue.index, self.wait + issue.cycle)
        length = self.wait + plan.slots_after
        if max(self._slots) >= length:
            raise RuntimeError(
                f"slot {max(self._slots)} is used and the step has {length}: the schedule ends too soon"
            )
        for slot in range(self.again, self.judged + 1):
            self._set(slot, in_step=1)
        if plan.config.hardware.checksum:
            # the words that stand for 0 are the element-wise operand of that slot
            zeros = {self._operand: self.layout.state_zero, "t": self.layout.t_zero}
            self._set(self.judged - 1, **zeros)
            self._set(self.judged, minus=int(bool(plan.program.t_regions)))
            waiting = self._slots.get(self.wait, {})
            if waiting.get("gate_write") or (waiting.get("t_write") and not waiting.get("value")):
                raise RuntimeError("the table's answer is waited for where the checksum looks up its entries")
        self.slots = [self._slots.get(slot, {}) for slot in range(length)]
        for fields in self.slots:
            fields.setdefault("window", self.layout.window_none)
        self._always_minus_t()

    def _set(self, slot: int, **fields: int) -> None:
        word = self._slots.setdefault(slot, {})
        for name, value in fields.items():
            if word.setdefault(name, value) != value:
                raise RuntimeError(
                    f"slot {slot}: {name} is needed as {word[name]} and as {value}: the schedule has a hazard"
                )

    def _always_minus_t(self) -> None:
        """If every T that is read is both subtracted and added, every slot does so; the other slots read a
        zero."""
        asks = [slot for slot in self.slots if slot.get("element_operand")]
        apart = any(slot.get("t_operand") or slot.get("minus") != slot.get("add", 0) for slot in asks)
        if self.plan.program.t_regions and not apart:
            for fields in self.slots:
                fields.setdefault("t", self.layout.t_zero)
                fields |= {"minus": 1, "add": 1}

    @property
    def judged(self) -> int:
        """Slot of the step's last logit, in which the checksum is judged."""
        return self.wait + self.plan.decision_slots

    # ------------------------------------------------------------------ what the units do
    def _prologue(self) -> int:
        plan, lanes = self.plan, self.plan.config.hardware.lanes
        begin = slot = self._zero_t() if plan.program.t_regions else 0
        zeroed = [
            self.layout.state(region, index)
            for region in plan.program.cleared
            for index in range(plan.config.network.hidden)
        ]
        for address in [self.layout.state_zero, *zeroed]:
            self._clear(address, slot)
            slot += 1 + (0 if plan.shared else plan.element_gap)
        end, first = slot + plan.timing.acc, begin
        if any(group.block.carried for group in plan.groups):
            first = self._carry_biases(slot)
            end = max(end, first)
        # addends of the first group into the chain and on into the accumulators, then the second's
        if plan.timing.chain:
            self._fill(plan.groups[0], first)
            self._shift(range(first + 1, first + lanes + 1))
            self._set(first + lanes + 1, swap=1)
            end = max(end, first + lanes + 2)
            if len(plan.groups) > 1 and plan.groups[1].block.bias:
                self._fill(plan.groups[1], first + lanes + 1)
                self._shift(range(first + lanes + 2, first + 2 * lanes + 2))
                end = max(end, first + 2 * lanes + 2)
        return end

    def _zero_t(self) -> int:
        """Write the T memory's word for 0: the table's answer to the addend 0. The slot in which it can be
        addressed."""
        plan, lanes = self.plan, self.plan.config.hardware.lanes
        self._set(0, addend=plan.zero_address)
        if plan.timing.chain:
            self._shift(range(1, lanes + 1))
            loaded = lanes + 1
        else:  # the lane takes the addend alone: only in a step does T come with it
            loaded = plan.timing.added - plan.timing.gap + 1
            self._set(loaded - 1, element_first=1)
        self._set(loaded, tanh=1)
        self._set(loaded + 1, t_write=1, value=0, result=self.layout.t_zero)
        return loaded + 2

    def _clear(self, address: int, slot: int) -> None:
        """Write 0 to a word of the state memory: the rounding half alone is 0 when narrowed, whatever the
        memories hold.

        A DSP block that adds one product to what it loads cannot leave it out: there it is multiplied by 0.
        """
        plan, timing = self.plan, self.plan.timing
        first = slot + timing.added - (timing.gap if plan.shared else plan.element_gap)
        if plan.shared:
            self._set(slot, addend=plan.half_address)
        elif timing.gap and not plan.element_gap:
            self._set(slot, gate=self.layout.gate("zero", 0))
            self._set(slot + 1, element_operand=1, minus=0)
            self._set(slot + timing.valid, element_valid=1)
        self._set(first, element_first=1)
        finished = first + 1 if plan.shared else slot + timing.acc
        self._set(finished, state_write=1, state_to=address, feature=0, hidden=0)

    def _carry_biases(self, slot: int) -> int:
        """From ``slot`` on, copy the biases to the start of carried sums, through the chain or the lane.
        Returns the slot after that."""
        plan, lanes = self.plan, self.plan.config.hardware.lanes
        sources = [address for address, (block, _) in enumerate(plan.bias_rows) if block.carried]
        targets = [
            group.addend + row for group in plan.groups if group.block.carried for row in range(group.rows)
        ]
        way = lanes + 1 if plan.timing.chain else plan.timing.added - plan.timing.gap + 1
        for k, (source, target) in enumerate(zip(sources, targets, strict=True)):
            self._set(slot + k, addend=source)
            if not plan.timing.chain:
                self._set(slot + k + way - 1, swap=1)
            self._set(slot + k + way, partial=1, partial_to=target)
        if plan.timing.chain:
            self._shift(range(slot + 1, slot + len(sources) + lanes))
        return slot + len(sources) + way

    def _fill(self, group: RowGroup, slot: int) -> None:
        for row in range(group.rows):
            self._set(slot + row, addend=group.addend + row)

    def _shift(self, slots) -> None:
        for slot in slots:
            self._set(slot, shift=1)

    def _rows(self) -> None:
        plan, timing, layout = self.plan, self.plan.timing, self.layout
        begin = self.again
        for ops, base in ((plan.mac_before, begin), (plan.mac_after, self.wait)):
            for op in ops:
                group, slot = plan.groups[op.group], base + op.cycle
                self._set(slot, vector=layout.state(op.region, op.index))
                if plan.beside(op):
                    row = layout.constants + layout.dense_offset(group.first_row)
                    self._set(slot, gate=row + op.index)
                    self._set(slot + 1, element_operand=1, minus=0)
                else:
                    self._set(slot, mac=1)
                self._set(slot + timing.valid, valid=1)
                if op.first and not timing.chain:
                    self._set(slot, addend=group.addend)
                    self._set(slot + timing.added - timing.gap, swap=1)
                for row in range(group.rows if op.last else 0):
                    self._result(group, row, slot + timing.row + row)
        for swap in plan.swaps:
            self._set(begin + swap, swap=1)
        for number, slot in plan.fills:
            self._fill(plan.groups[number], begin + slot)
        self._shift(begin + slot for slot in plan.shifts)

    def _result(self, group: RowGroup, row: int, slot: int) -> None:
        block, index = group.block, group.dest + row
        if block.dest == "partial":
            self._set(slot, partial=1, partial_to=index)
        elif block.dest == "logit":
            self._set(slot, logit=1, **({"ends_step": 1} if index == self.plan.config.classes - 1 else {}))
            if block.carried:
                self._set(slot, partial=1, partial_to=group.addend + row)
        elif block.dest == "value":
            self._set(slot, value=1, t_write=1, result=self.layout.t(block.region, index))
        elif block.dest == "tanh":
            self._set(slot, tanh=1)
            self._set(slot + 1, t_write=1, value=0, result=self.layout.t(block.region, index))
        else:
            self._set(slot, tanh=0)
            self._set(
                slot + 1, gate_write=1, result=self.layout.gate(block.region, index)
            )  # the table takes a slot

    def _element(self, op: ElementOp, term: int, index: int, slot: int) -> None:
        plan, timing, layout = self.plan, self.plan.timing, self.layout
        a, b = op.terms[term]
        for part in a.split("-"):
            memory, _, region = part.partition(".")
            if memory == "S":
                self._set(slot, **{self._operand: layout.state(region, index)})
            elif memory == "T":
                self._set(slot, t=layout.t(region, index))
            else:
                self._set(slot, window=index, **{self._operand: layout.state_zero})
        self._set(slot, gate=layout.gate(b, index), scale=int(b == "scale"))
        self._set(slot + 1, element_operand=1, t_operand=int(a.startswith("T.")), minus=int("-" in a))
        self._set(slot + timing.valid, element_valid=1)
        if term == 0:
            self._set(slot + timing.added - plan.element_gap, element_first=1)
            if op.add:
                self._set(slot, t=layout.t(op.add, index))
                self._set(slot + 1, add=1)
            if plan.shared:
                self._set(slot, addend=plan.half_address)
        if a == "X" and index == plan.config.inputs - 1:
            self._set(slot, released=1)
        if term < len(op.terms) - 1:
            return
        finished = slot + timing.acc
        if op.state:
            self._set(
                finished, state_write=1, state_to=layout.state(op.state, index), feature=int(op.state == "x")
            )
            self._set(
                finished, hidden=int(op.state == plan.program.hidden and not op.name.startswith("clear"))
            )
        if op.activated:
            self._set(finished + 1, activated=1, tanh=1)
            self._set(finished + 2, t_write=1, value=0, result=layout.t(op.activated, index))

    # ------------------------------------------------------------------ words
    @property
    def counted(self) -> tuple[str, ...]:
        """Addresses that count up in a repeated word."""
        return ("vector", "gate") if self.layout.holds_dense else ("vector",)

    @cached_property
    def words(self) -> list[dict[str, int]]:
        """Words in order: every address and control, ``repeat`` (slots less one), ``wait`` (held at its
        slot), ``end`` (the last).

        In slot k of a repeated word the fields in `counted` are k more than the word has them.
        """
        words: list[dict[str, int]] = []
        accesses: list[dict[str, int]] = []  # of each word the addresses that something is read or written at
        free: dict[str, int] = {}
        for slot, fields in enumerate(self.slots):
            controls = {name: fields.get(name, 0) for name in CONTROLS}
            addresses = {name: fields[name] for name in ADDRESSES if name in fields}
            last = words[-1] if words else None
            # a step begins with a separate word, and so do the wait, what follows it, and the last slot
            joins = slot not in (self.again, self.wait, self.wait + 1) and slot != len(self.slots) - 1
            if last is not None and joins and all(last[name] == value for name, value in controls.items()):
                count = last["repeat"] + 1
                relative = {
                    name: value - (count if name in self.counted else 0) for name, value in addresses.items()
                }
                counts = all(relative.get(name, 0) >= 0 for name in self.counted)
                # A row's constants end with their word: counting on would reach addresses that hold nothing.
                counts &= not (
                    self.layout.holds_dense
                    and free.get("gate", 0) + count * self.plan.config.hardware.checksum
                    >= self.layout.constants
                    and "gate" not in addresses
                )
                if counts and all(free.get(name, value) == value for name, value in relative.items()):
                    free |= relative  # in place: the last entry of `accesses` is this very dict
                    last.update(relative, repeat=count)
                    continue
            free = addresses
            accesses.append(free)
            words.append({name: addresses.get(name, 0) for name in ADDRESSES} | controls)
            words[-1] |= {
                "repeat": 0,
                "wait": int(slot == self.wait),
                "end": int(slot == len(self.slots) - 1),
            }
        if self.plan.config.hardware.clock_gate:
            self._hold(words, accesses)
        if self.plan.config.hardware.checksum:
            self._read_constants(words)
        return words

    def _hold(self, words: list[dict[str, int]], accesses: list[dict[str, int]]) -> None:
        """Let a word keep the previous word's address where it uses none: a needless change costs energy."""
        for (before, word), access in zip(pairwise(words), accesses[1:], strict=True):
            for name in ADDRESSES:
                counts = name in self.counted
                if name not in access and not (counts and word["repeat"]):
                    word[name] = before[name] + (before["repeat"] if counts else 0)

    def _read_constants(self, words: list[dict[str, int]]) -> None:
        """Let words with an idle port read every addend and constant, which takes no slot and no word."""
        free: dict[str, list[dict[str, int]]] = {"addend": [], "gate": []}
        slot = 0
        for word in words:
            inside = range(slot, slot + word["repeat"] + 1)
            slot = inside.stop
            if self.again <= inside.start and inside.stop <= self.judged - 1:
                for name, places in free.items():
                    if not any(name in self.slots[t] for t in inside):
                        places.append(word)
        used = {fields["addend"] for fields in self.slots[self.again : self.judged - 1] if "addend" in fields}
        # The check word must count once, so its word is not repeated. It is chosen by the window's length and
        # therefore read after the window was released, when that length is in a register.
        released = next(number for number, word in enumerate(words) if word["released"])
        late = [id(word) for word in words[released + 1 :] if not word["repeat"]]
        single = next((word for word in reversed(free["gate"]) if id(word) in late), None)
        places = [
            word
            for word in free["gate"]
            if word is not single and not (word["repeat"] and "gate" in self.counted)
        ]
        missing = [address for address in self.plan.constant_addends if address not in used]
        if single is None or len(places) < 2 or len(free["addend"]) < len(missing):
            raise RuntimeError("the step has too few free reads for the checksum's constants")
        for word, address in zip(free["addend"], missing, strict=False):
            word["addend"] = address
        for word, region in zip(places, ("one", "zero"), strict=False):
            word["gate"] = self.layout.gate(region, 0)
        single |= {"gate": self.layout.gate("check", 0), "scale": 1}

    @property
    def idle_words(self) -> int:
        """Words of a slot each that do nothing, in front of the prologue: they fill the program's memory up
        to a power of two."""
        return (1 << (len(self.words) - 1).bit_length()) - len(self.words)

    @cached_property
    def again_word(self) -> int:
        """Word at which a further step begins."""
        return [0, *accumulate(word["repeat"] + 1 for word in self.words)].index(self.again)

    def unrolled(self) -> Iterator[dict[str, int]]:
        """The words slot by slot, as the hardware runs them."""
        for word in self.words:
            for count in range(word["repeat"] + 1):
                yield {**word, **{name: word[name] + count for name in self.counted}}
