"""What the compact engine runs: a cell's program as loops of instructions, where the data lies, and the
cycles that this takes.

One multiplier-accumulator of one adder does everything, bit plane by bit plane. At time t the accumulator
holds what has been added so far divided by 2^t: passing from t to t + 1 halves it, and what leaves it at the
bottom is below the narrowing's result. Bit k of a weight is used at time k (at k + feature_align for
features, whose products have that many bits more to go), the sign's bit subtracts; a bias is added at time
bias_shift. At a narrowing's own shift the accumulator holds its floor, and the rounding half has been in it
from the start: it is what the accumulator is reset to. No shifter is needed, no product has more bits than
its operand, and narrowing takes no time of its own.

A carried sum goes on from step to step at full precision. What leaves the accumulator at the bottom is final,
bit by bit, and is caught: it is the low one of the two words in which the sum is kept, what is left in the
accumulator then the high one. The next step begins at 0 and adds the low word at time 0 and the high one
where it belongs; the rounding half came in with the bias.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property, lru_cache
from typing import Any

from eskin.golden.core import AcceleratorConfig, Arrays, signed_bits
from eskin.rtl.program.cells import CellProgram, ElementOp, RowBlock, in_one_phase, reads_new_state, row_count
from eskin.rtl.program.timing import logit_to_decision

DATA_BITS = 16
"""Of a word of the data memory, the host's."""
SCALE_PLANES = 15  # of the normaliser's positive constant


class Op(IntEnum):
    """What an instruction does."""

    MAC = 0  # addresses data, and a cycle later shifts the accumulator and adds
    STORE = 1  # narrows the accumulator: to the table, the data memory or the classifier
    JUMP = (
        2  # to ``target`` unless the index is the limit's last; the instruction after it is done in any case
    )
    CONTROL = 3


class Use(IntEnum):
    """When a MAC adds what it has addressed."""

    NEVER = 0
    WEIGHT = 1  # where the next bit of the weights is set
    BIT = 2  # where the bit fetched last is set
    ALWAYS = 3


class Kind(IntEnum):
    """Format a STORE narrows to, and where it puts it. The last two go to the data memory."""

    INDEX = 0  # the table looks it up
    LOGIT = 1  # the classifier takes it
    STATE = 2
    FEATURE = 3


class Limit(IntEnum):
    """Last index of a loop."""

    HIDDEN = 0
    INPUTS = 1
    CLASSES = 2
    STEPS = 3  # the loop over the steps of a touch; after the last one the program begins at its first instruction


@dataclass(frozen=True)
class Instruction:
    """One instruction; what an operation does not use is 0.

    Parameters
    ----------
    region:
        Of the data memory. MAC reads the word there at the loop's index; at the column where ``run``, one
        column after the other, as many as the limit has; at the window's length where ``length`` (in the
        region of that length where scales differ between inputs).
    shift, inverted:
        The accumulator is halved, and complemented, first: between two complements adding subtracts.
    fetch:
        The bit of this plane in the word that is read is kept for the next ones.
    table, tanh:
        STORE the table's answer, of that half, instead of the accumulator; in a program without tables what
        has left it at the bottom.
    clear, zero, wait, release:
        CONTROL: the accumulator is reset, to the rounding half or to 0; wait for a window; it has been read.
    """

    op: Op
    region: int = 0
    use: Use = Use.NEVER
    run: int = 0
    length: int = 0
    fetch: int = 0
    shift: int = 0
    inverted: int = 0
    kind: Kind = Kind.INDEX
    table: int = 0
    tanh: int = 0
    limit: Limit = Limit.HIDDEN
    target: int = 0
    clear: int = 0
    zero: int = 0
    wait: int = 0
    release: int = 0


@dataclass(frozen=True)
class Add:
    """One operand of a sum at one time. ``magnitude``: its largest absolute value."""

    region: str
    magnitude: int
    use: Use = Use.ALWAYS
    negative: bool = False
    gate: str = ""  # region of the word whose bit decides, for Use.BIT
    matrix: str = ""  # and the bit of it, for Use.WEIGHT
    plane: int = 0
    limit: Limit = Limit.HIDDEN  # columns, for Use.WEIGHT


@dataclass(frozen=True)
class Sum:
    """A sum and its narrowing: what is added at which time, and the time (``shift``) at which it is the
    result.

    carried: it begins at 0, not at the rounding half, and every bit that leaves the accumulator is one of the
    sum.
    """

    adds: Mapping[int, tuple[Add, ...]]
    shift: int
    carried: bool = False


@dataclass(frozen=True)
class Unit:
    """Rows, or an element-wise operation, of which every index is done alike: instructions between its first
    and its jump back."""

    name: str
    work: RowBlock | ElementOp
    first: int
    end: int


@dataclass(frozen=True)
class Executed:
    """One instruction as it is done: at ``cycle`` from the start of a step, for ``cycles``, with this loop
    index."""

    instruction: Instruction
    address: int
    index: int
    cycle: int
    cycles: int


@dataclass(frozen=True)
class CompactProgram:
    """A cell's program as instructions.

    Parameters
    ----------
    program:
        Without partial sums, see `eskin.rtl.program.cells.in_one_phase`.
    """

    config: AcceleratorConfig
    program: CellProgram

    # ------------------------------------------------------------------ data memory
    @cached_property
    def regions(self) -> dict[str, int]:
        """Number of each region of the data memory: what the host loads first, windows in an even and an odd
        one. Scales are one region with a word a window length; where they differ from input to input one a
        length, from a power of two on, with a word an input."""
        names = [f"bias.{block.name}" for block in self.program.after if block.bias and not block.carried]
        carried = [
            f"{half}.{block.name}"
            for block in self.program.after
            if block.carried
            for half in ("low", "high")
        ]
        names += [f"first.{name}" for name in carried]
        if self.config.constants > 1:
            lengths = len(self.config.window_lengths)
            align = 1 << (lengths - 1).bit_length()
            names += [f"unused.{k}" for k in range(-len(names) % align)]
            names += ["scale", *(f"scale.{q}" for q in range(1, lengths))]
        else:
            names.append("scale")
        names += [
            *(f"S.{name}" for name in self.program.state_regions),
            *(f"B.{name}" for name in self.program.gate_regions),
        ]
        names += [f"T.{name}" for name in self.program.t_regions] + carried
        places = {name: number for number, name in enumerate(names)}
        return places | {"X": len(names) + len(names) % 2}

    @cached_property
    def index_bits(self) -> int:
        """Bits of an index in a region."""
        c = self.config
        return max(
            1,
            (
                max(c.network.hidden if c.recurrent else 1, c.inputs, c.classes, len(c.window_lengths)) - 1
            ).bit_length(),
        )

    @property
    def data_words(self) -> int:
        """Words of the data memory."""
        return self.regions["X"] + 2 << self.index_bits

    def limit(self, limit: Limit) -> int:
        """How many indices a loop has."""
        return (
            self.config.network.hidden,
            self.config.inputs,
            self.config.classes,
            self.config.windows.steps,
        )[limit]

    # ------------------------------------------------------------------ sums
    def row_sum(self, block: RowBlock) -> Sum:
        """The sum of any row of ``block``."""
        c, logit = self.config, block.narrowing == "logit"
        shift = {
            "sigmoid": c.sigmoid_shift,
            "tanh": c.tanh_shift,
            "value": c.value_shift,
            "logit": c.logit_shift,
        }[block.narrowing]
        adds: dict[int, list[Add]] = {}
        for matrix, region in block.terms:
            features = region == "x"
            weights = (
                c.formats.dense_format
                if logit
                else c.formats.weight_format
                if features
                else c.formats.recurrent_format
            )
            magnitude = (c.formats.feature_format if features else c.formats.state_format).magnitude
            limit = Limit.INPUTS if features else Limit.HIDDEN
            for plane in range(weights.width):
                negative = plane == weights.width - 1
                add = Add(
                    f"S.{region}", magnitude, Use.WEIGHT, negative, matrix=matrix, plane=plane, limit=limit
                )
                adds.setdefault(plane + (c.feature_align if features else 0), []).append(add)
        if block.carried:
            adds.setdefault(0, []).append(Add(f"low.{block.name}", (1 << c.kept_low_bits) - 1))
            adds.setdefault(c.kept_low_bits, []).append(Add(f"high.{block.name}", 1 << DATA_BITS - 1))
        elif block.bias:
            bias = c.formats.dense_bias_format if logit else c.formats.bias_format
            time = c.dense_bias_shift if logit else c.bias_shift
            adds.setdefault(time, []).append(Add(f"bias.{block.name}", bias.magnitude))
        return Sum(_ordered(adds), shift, block.carried)

    def element_sum(self, op: ElementOp) -> Sum:
        """The sum of any index of ``op``."""
        c = self.config
        adds: dict[Any, Any] = {}

        def magnitude(part: str) -> int:
            return (
                c.centred_format.magnitude
                if part == "X"
                else (c.formats.feature_format if part == "S.x" else c.formats.state_format).magnitude
            )

        for a, b in op.terms:
            parts = [(part, k > 0) for k, part in enumerate(a.split("-"))]
            if b == "one":
                constant = adds.setdefault(c.formats.gate_frac, [])
                constant += [Add(part, magnitude(part), negative=negative) for part, negative in parts]
                continue
            gate = "scale" if b == "scale" else f"B.{b}"
            for plane in range(SCALE_PLANES if b == "scale" else c.formats.gate_frac + 1):
                gated = [
                    Add(part, magnitude(part), Use.BIT, negative, gate, plane=plane)
                    for part, negative in parts
                ]
                adds.setdefault(plane, []).extend(gated)
        if op.add:
            adds.setdefault(c.formats.gate_frac, []).append(
                Add(f"T.{op.add}", c.formats.state_format.magnitude)
            )
        return Sum({time: tuple(additions) for time, additions in adds.items()}, c.formats.gate_frac)

    def index_sum(self, op: ElementOp) -> Sum:
        """The narrowing of a result of ``op`` to the index whose tanh is wanted."""
        stored = Add(self._stored(op), self.config.formats.state_format.magnitude)
        return Sum({0: (stored,)}, self.config.state_index_shift)

    def _stored(self, op: ElementOp) -> str:
        return f"S.{op.state}" if op.state else f"T.{op.activated}"

    @cached_property
    def sums(self) -> tuple[Sum, ...]:
        """Every sum of a step, one an index."""
        rows = [self.row_sum(block) for block in self.program.after]
        elements = [self.element_sum(op) for op in self.program.elements]
        return (*rows, *elements, *(self.index_sum(op) for op in self.program.elements if op.activated))

    @cached_property
    def guard(self) -> int:
        """Bits of the accumulator below what is added: so many that nothing is added later than its sum's
        result."""
        return max(0, *(max(total.adds) - total.shift for total in self.sums))

    @cached_property
    def longest_shift(self) -> int:
        """The largest of all narrowings."""
        return max(total.shift for total in self.sums)

    @property
    def reset_value(self) -> int:
        """What the accumulator is reset to: the rounding half, before the first shift of the sum that has the
        largest."""
        return 1 << self.longest_shift + self.guard

    @property
    def first_plane(self) -> int:
        """Plane of the accumulator's reset in an element-wise sum: one before the first, and less where rows
        are narrowed further."""
        return self.config.formats.gate_frac - self.longest_shift - 1

    @cached_property
    def accumulator_bits(self) -> int:
        """Bits of the accumulator, guard included: proven, by the largest value it can have after every
        addition of every sum."""
        largest = self.reset_value
        for total in self.sums:
            value = 0 if total.carried else self.reset_value >> self.longest_shift - total.shift
            for time in range(total.shift + self.guard + 1):
                value = (value >> 1) + 1
                for add in total.adds.get(time, ()):
                    columns = self.limit(add.limit) if add.use == Use.WEIGHT else 1
                    value += (
                        columns * add.magnitude << self.guard
                    ) + 1  # a complement is one more than the negative
                    largest = max(largest, value)
        return signed_bits(largest)

    @property
    def carries(self) -> bool:
        """A sum is kept from step to step."""
        return any(block.carried for block in self.program.after)

    # ------------------------------------------------------------------ order
    @cached_property
    def order(self) -> tuple[RowBlock | ElementOp, ...]:
        """Blocks of rows in the program's order, with the element-wise operations between them.

        Each of these comes as soon as its operands are there and nothing needs the value that it replaces.
        """
        blocks, pending = list(self.program.after), list(self.program.elements)
        produced: set[str] = set()
        issued: list[RowBlock | ElementOp] = []
        makes = {
            f"B.{block.region}" if block.dest == "sigmoid" else f"T.{block.region}"
            for block in blocks
            if block.dest != "logit"
        }
        makes |= {f"T.{op.activated}" for op in pending if op.activated}

        def operands(op: ElementOp) -> set[str]:
            reads = {part for a, _ in op.terms for part in a.split("-")} | {f"B.{b}" for _, b in op.terms}
            return reads | ({f"T.{op.add}"} if op.add else set())

        def old_is_read(op: ElementOp) -> bool:
            # by other operations; rows that read the old state stand before a block that the new one is made
            # from
            return any(f"S.{op.state}" in operands(reader) for reader in pending if reader is not op)

        while blocks or pending:
            for op in pending:
                if operands(op) & makes <= produced and not (op.state and old_is_read(op)):
                    pending.remove(op)
                    produced |= {f"T.{op.activated}", f"S.{op.state}"}
                    issued.append(op)
                    break
            else:
                block = blocks[0] if blocks else None
                if block is None or any(
                    f"S.{r}" not in produced and reads_new_state(self.program, block, r)
                    for _, r in block.terms
                ):
                    raise RuntimeError(
                        "the program cannot be scheduled: an operation waits for a result that nothing writes"
                    )
                blocks.pop(0)
                produced.add(f"B.{block.region}" if block.dest == "sigmoid" else f"T.{block.region}")
                issued.append(block)
        return tuple(issued)

    # ------------------------------------------------------------------ instructions
    @cached_property
    def _assembled(self) -> tuple[tuple[Instruction, ...], int, tuple[Unit, ...]]:
        code: list[Instruction] = []
        if self.program.cleared:
            code += [_CLEAR] + [Instruction(Op.MAC, shift=1)] * self.reset_value.bit_length()  # until it is 0
            first = len(code)
            # in a feature's format: only steps store states as such
            for region in self.program.cleared:
                code += [_NOTHING, Instruction(Op.STORE, self.regions[f"S.{region}"], kind=Kind.FEATURE)]
            code += [Instruction(Op.JUMP, limit=Limit.HIDDEN, target=first), _NOTHING]
        for block in self.program.after:
            code += self._carry_bias(len(code), block) if block.carried else []
        wait, units = len(code), []
        code.append(Instruction(Op.CONTROL, wait=1, clear=1))
        last_window = max(
            k
            for k, work in enumerate(self.order)
            if isinstance(work, ElementOp) and any(a == "X" for a, _ in work.terms)
        )
        for k, work in enumerate(self.order):
            first = len(code)
            if isinstance(work, RowBlock):
                code += self._row(work)
                limit, carried = Limit.CLASSES if work.dest == "logit" else Limit.HIDDEN, work.carried
            else:
                code += self._element(work)
                limit, carried = Limit.INPUTS if work.state == "x" else Limit.HIDDEN, False
            units.append(Unit(work.name, work, first, len(code)))
            code += [Instruction(Op.JUMP, limit=limit, target=first), _ZERO if carried else _CLEAR]
            # a carried row comes right after it: nothing else is between features and logits
            if k == last_window:
                behind = self.order[k + 1 : k + 2]
                zero = int(any(isinstance(follower, RowBlock) and follower.carried for follower in behind))
                code.append(Instruction(Op.CONTROL, release=1, clear=1, zero=zero))
        code += [Instruction(Op.JUMP, limit=Limit.STEPS, target=wait), _NOTHING]
        return tuple(code), wait, tuple(units)

    @property
    def instructions(self) -> tuple[Instruction, ...]:
        """All of them: what clears the state before a touch, or begins carried sums with the biases, then a
        step."""
        return self._assembled[0]

    @property
    def wait(self) -> int:
        """Address of the instruction that waits for a window."""
        return self._assembled[1]

    @property
    def units(self) -> tuple[Unit, ...]:
        """Where in the program each block and operation lies, in their order."""
        return self._assembled[2]

    def _macs(self, total: Sum) -> list[Instruction]:
        """A sum from the accumulator's reset to its result."""
        code = [] if total.carried else [Instruction(Op.MAC, shift=1)] * (self.longest_shift - total.shift)
        complement = False
        for time in range(total.shift + self.guard + 1):
            shift, fetched = 1, ""
            for add in total.adds.get(time, ()):
                if add.use == Use.BIT and add.gate != fetched:
                    code.append(
                        Instruction(
                            Op.MAC,
                            self.regions[add.gate],
                            fetch=1,
                            length=int(add.gate == "scale"),
                            shift=shift,
                            inverted=int(complement),
                        )
                    )
                    shift, complement, fetched = 0, False, add.gate
                code.append(
                    Instruction(
                        Op.MAC,
                        self.regions[add.region],
                        add.use,
                        run=int(add.use == Use.WEIGHT),
                        limit=add.limit,
                        shift=shift,
                        inverted=int(complement != add.negative),
                    )
                )
                shift, complement = 0, add.negative
            if total.carried and complement:  # a bit that leaves is the sum's, not its complement's
                code.append(Instruction(Op.MAC, inverted=1))
                complement = False
            if shift:
                code.append(Instruction(Op.MAC, shift=1, inverted=int(complement)))
                complement = False
        if complement:
            code.append(Instruction(Op.MAC, inverted=1))
        return [*code, _NOTHING]  # the last addition is done a cycle later

    def _row(self, block: RowBlock) -> list[Instruction]:
        code = self._macs(self.row_sum(block))
        if block.dest == "logit":
            return [
                *code,
                Instruction(Op.STORE, kind=Kind.LOGIT),
                *(self._keep(block) if block.carried else []),
            ]
        if block.dest == "value":
            return [*code, Instruction(Op.STORE, self.regions[f"T.{block.region}"], kind=Kind.STATE)]
        return code + self._look_up(
            f"{'B' if block.dest == 'sigmoid' else 'T'}.{block.region}", tanh=int(block.dest == "tanh")
        )

    def _keep(self, block: RowBlock) -> list[Instruction]:
        """Write a carried sum back: the accumulator holds it without the bits below a logit."""
        further = self.config.kept_low_bits - self.config.logit_shift
        return [
            *[Instruction(Op.MAC, shift=1)] * further,
            _NOTHING,
            Instruction(Op.STORE, self.regions[f"low.{block.name}"], kind=Kind.STATE, table=1),
            _NOTHING,
            Instruction(Op.STORE, self.regions[f"high.{block.name}"], kind=Kind.STATE),
        ]

    def _carry_bias(self, address: int, block: RowBlock) -> list[Instruction]:
        """Copy what the host loaded to where a carried sum goes on from."""
        code: list[Instruction] = [_ZERO]
        for half in ("low", "high"):
            first = address + len(code)
            code += [Instruction(Op.MAC, self.regions[f"first.{half}.{block.name}"], Use.ALWAYS)]
            code += [Instruction(Op.MAC, shift=1)] * self.guard + [_NOTHING]
            code += [Instruction(Op.STORE, self.regions[f"{half}.{block.name}"], kind=Kind.STATE)]
            code += [Instruction(Op.JUMP, limit=Limit.CLASSES, target=first), _ZERO]
        return code

    def _look_up(self, region: str, tanh: int) -> list[Instruction]:
        return [
            Instruction(Op.STORE, kind=Kind.INDEX, tanh=tanh),
            Instruction(Op.STORE, self.regions[region], kind=Kind.STATE, table=1, tanh=tanh),
        ]

    def _element(self, op: ElementOp) -> list[Instruction]:
        kind = Kind.FEATURE if op.state == "x" else Kind.STATE
        code = [
            *self._macs(self.element_sum(op)),
            Instruction(Op.STORE, self.regions[self._stored(op)], kind=kind),
        ]
        if op.activated:
            code += [_CLEAR, *self._macs(self.index_sum(op)), *self._look_up(f"T.{op.activated}", tanh=1)]
        return code

    # ------------------------------------------------------------------ cycles
    def _execute(self, address: int) -> tuple[Executed, ...]:
        """From ``address`` to the jump back to the wait, or to the wait."""
        trace: list[Executed] = []
        cycle, index, jump = 0, 0, None
        while not trace or not self.instructions[address].wait:
            instruction = self.instructions[address]
            cycles = self.limit(instruction.limit) if instruction.run else 1
            trace.append(Executed(instruction, address, index, cycle, cycles))
            cycle += cycles
            address, jump = address + 1 if jump is None else jump, None
            if instruction.op == Op.JUMP and instruction.limit == Limit.STEPS:
                break
            if instruction.op == Op.JUMP:
                ends = index == self.limit(instruction.limit) - 1
                index, jump = (0, None) if ends else (index + 1, instruction.target)
        return tuple(trace)

    @cached_property
    def step(self) -> tuple[Executed, ...]:
        """Everything one step does, from the cycle in which the wait ends (0) to the jump back to it."""
        return self._execute(self.wait)

    @cached_property
    def prologue(self) -> tuple[Executed, ...]:
        """Everything that is done before a touch."""
        return self._execute(0)

    @cached_property
    def last_logit(self) -> int:
        """Cycles from the start of a step to the one in which its last logit is given."""
        return max(
            entry.cycle
            for entry in self.step
            if entry.instruction.op == Op.STORE and entry.instruction.kind == Kind.LOGIT
        )

    # ------------------------------------------------------------------ memory contents
    @cached_property
    def weight_order(self) -> tuple[tuple[str, int, int, int], ...]:
        """(matrix, row, column, plane) of every bit of the weights that a step uses, in the order of their
        use."""
        bits = []
        for work in self.order:
            if isinstance(work, RowBlock):
                total = self.row_sum(work)
                for row in range(row_count(self.config, work)):
                    for time in sorted(total.adds):
                        for add in total.adds[time]:
                            if add.use == Use.WEIGHT:
                                bits += [
                                    (add.matrix, row, column, add.plane)
                                    for column in range(self.limit(add.limit))
                                ]
        return tuple(bits)

    @property
    def weight_word_bits(self) -> int:
        """Bits of a word of the weights' memory: as few as fill memories of 2048 words of 2 bits, 16 at
        most."""
        return min(DATA_BITS, 2 * -(-self.config.sets * len(self.weight_order) // 4096))

    @property
    def weight_words(self) -> int:
        """Words of the weights' memory."""
        return -(-self.config.sets * len(self.weight_order) // self.weight_word_bits)

    @property
    def constant_words(self) -> int:
        """Words that the host writes of the data memory, from its first on."""
        lengths = len(self.config.window_lengths)
        if self.config.constants > 1:
            return (self.regions["scale"] + lengths - 1 << self.index_bits) + self.config.inputs
        return (self.regions["scale"] << self.index_bits) + lengths

    def weight_image(self, arrays: Arrays) -> list[int]:
        """The weights' bits in the order of their use; sets of weights follow one another.

        In a word of n bits, the bit that is used k-th stands at (k + 1) modulo n: the hardware's counter of
        bits is one ahead by then.
        """
        bits, words = self.weight_word_bits, [0] * self.weight_words
        matrices = {
            name: arrays[name].reshape(-1, *arrays[name].shape[-2:])
            for name in {matrix for matrix, *_ in self.weight_order}
        }
        used = ((step, *bit) for step in range(self.config.sets) for bit in self.weight_order)
        for number, (step, matrix, row, column, plane) in enumerate(used):
            words[number // bits] |= (int(matrices[matrix][step, row, column]) >> plane & 1) << (
                number + 1
            ) % bits
        return words

    def constant_image(self, arrays: Arrays) -> list[int]:
        """Bias codes (of carried sums at product scale with the rounding half, in two words) and the
        normaliser's scales, each where the program looks for it."""
        words = [0] * self.constant_words
        for block in self.program.after:
            if block.carried:
                c, low, high = (
                    self.config,
                    self.regions[f"first.low.{block.name}"],
                    self.regions[f"first.high.{block.name}"],
                )
                for row in range(row_count(c, block)):
                    total = (int(arrays[block.bias][row]) << c.dense_bias_shift) + (1 << c.logit_shift - 1)
                    words[(low << self.index_bits) + row] = total & (1 << c.kept_low_bits) - 1
                    words[(high << self.index_bits) + row] = total >> c.kept_low_bits
            elif block.bias:
                base = self.regions[f"bias.{block.name}"] << self.index_bits
                for row in range(row_count(self.config, block)):
                    words[base + row] = int(arrays[block.bias][row])
        base = self.regions["scale"] << self.index_bits
        if self.config.constants == 1:
            words[base:] = [int(scale) for scale in arrays["scale"]]
            return words
        for q, scales in enumerate(arrays["scale"]):
            for index, constant in enumerate(self.config.input_constants):
                words[base + (q << self.index_bits) + index] = int(scales[constant])
        return words


_NOTHING, _CLEAR, _ZERO = (
    Instruction(Op.CONTROL),
    Instruction(Op.CONTROL, clear=1),
    Instruction(Op.CONTROL, clear=1, zero=1),
)


def _ordered(adds: Mapping[int, list[Add]]) -> dict[int, tuple[Add, ...]]:
    """What subtracts after what adds: fewer complements."""
    return {time: tuple(sorted(additions, key=lambda add: add.negative)) for time, additions in adds.items()}


@dataclass(frozen=True)
class CompactSchedule:
    """What `eskin.rtl.program.scheduler.Schedule` tells of a step, for the compact engine; slots are cycles,
    and there is no phase A."""

    compact: CompactProgram

    @property
    def config(self) -> AcceleratorConfig:
        """Of the accelerator."""
        return self.compact.config

    @property
    def program(self) -> CellProgram:
        """The cell's, without partial sums."""
        return self.compact.program

    shared = True
    slots_before = 0

    @property
    def decision_cycles(self) -> int:
        """Cycles from the start of a step to the cycle in which its decision is offered."""
        return self.compact.last_logit + logit_to_decision(self.config)

    @property
    def step_cycles(self) -> int:
        """Cycles of one step: nothing of it comes before the features."""
        return self.decision_cycles

    @property
    def busy_share(self) -> float:
        """Share of the cycles of a step in which rows are multiplied."""
        return len(self.compact.weight_order) / self.step_cycles

    @cached_property
    def element_cycles(self) -> int:
        """Cycles of a step in which element-wise operations are done, their narrowing and table included."""
        ranges = [
            range(unit.first, unit.end) for unit in self.compact.units if isinstance(unit.work, ElementOp)
        ]
        return sum(
            entry.cycles
            for entry in self.compact.step
            if any(entry.address in addresses for addresses in ranges)
        )

    @property
    def prologue_cycles(self) -> int:
        """Cycles that clear the state before a touch, or begin carried sums with the biases."""
        return sum(entry.cycles for entry in self.compact.prologue)

    @property
    def weights(self) -> int:
        """Weights that a step uses; the network has ``config.sets`` times as many."""
        return sum(1 for *_, plane in self.compact.weight_order if plane == 0)


@lru_cache(maxsize=64)
def compact_schedule(config: AcceleratorConfig, program: CellProgram) -> CompactSchedule:
    """``program`` on the compact engine."""
    return CompactSchedule(CompactProgram(config, in_one_phase(program)))
