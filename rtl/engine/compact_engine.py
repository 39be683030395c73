"""The compact engine: one adder, one data memory and a looping program, for parts without multipliers and with few logic cells.

Rows and cells: docs/specification.md, sections 4 and 5.
"""

from __future__ import annotations

from collections.abc import Mapping

from amaranth.hdl import Cat, Const, Module, Mux, Signal, signed
from amaranth.lib import wiring
from amaranth.lib.memory import Memory

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.formats import QFormat
from eskin.rtl.common.collisions import NO_COLLISION
from eskin.rtl.common.load_port import load_lines
from eskin.rtl.common.memory_style import begins_as_told
from eskin.rtl.engine.activation_unit import ActivationUnit
from eskin.rtl.engine.engine import Engine, engine_signature
from eskin.rtl.engine.window_queue import WindowQueue
from eskin.rtl.program import memory_map
from eskin.rtl.program.cells import CellProgram
from eskin.rtl.program.compact_program import DATA_BITS, CompactProgram, Instruction, Kind, Limit, Op, Use
from eskin.rtl.program.schedule import schedule
from eskin.rtl.program.timing import is_compact, logit_to_decision


class CompactEngine(wiring.Component):
    """Computes one recurrent step and its logits for every window of centred sums: `eskin.rtl.program.compact_program` in hardware.

    Ports and parameters are those of `eskin.rtl.engine.engine.Engine`, whose place it takes for the bit-serial lane. Weights come bit by
    bit, in the
    order of their use; everything else, waiting windows and biases included, lies in one memory of 16-bit words. A step takes
    `Schedule.step_cycles`.

    A MAC instruction addresses a word; in the next cycle the accumulator is shifted and the word added. Between the last MAC and a STORE
    the program leaves that cycle. A window's sum waits while a STORE writes.
    """

    def __init__(
        self, config: AcceleratorConfig, images: Mapping[int, list[int]] | None = None, program: CellProgram | None = None
    ) -> None:
        self._config, self._images = config, images or {}
        self.plan = schedule(config, program)
        super().__init__(engine_signature(config))

    def elaborate(self, platform):
        m = Module()
        config, images, code = self._config, self._images, self.plan.compact
        loads, lines = self.load.enable & int(config.hardware.loadable), load_lines(config)

        # ---------------------------------------------------------------- program
        packed = _Packing(code)
        m.submodules.program = program = Memory(shape=packed.bits, depth=len(packed.words), init=packed.words)
        fetch = program.read_port()
        word = packed.fields(fetch.data)
        primed = Signal()  # the first instruction after a reset takes one cycle to arrive
        op = {kind: Signal(name=f"is_{kind.name.lower()}") for kind in Op}
        m.d.comb += [signal.eq(primed & (word["op"] == kind)) for kind, signal in op.items()]
        address = Signal(range(len(packed.words)))
        index, column = (Signal(code.index_bits, name=name) for name in ("index", "column"))
        step = Signal(range(config.windows.steps))
        last_step = step == config.windows.steps - 1
        at_last = {limit: index == code.limit(limit) - 1 for limit in Limit if limit != Limit.STEPS} | {Limit.STEPS: last_step}
        ends_loop = Signal()
        with m.Switch(word["limit"]):
            for limit, last in at_last.items():
                with m.Case(limit):
                    m.d.comb += ends_loop.eq(last)
        runs, last_column = op[Op.MAC] & word["run"], Signal()
        columns = {limit: column == code.limit(limit) - 1 for limit in (Limit.HIDDEN, Limit.INPUTS)}
        m.d.comb += last_column.eq(Mux(word["limit"][0], columns[Limit.INPUTS], columns[Limit.HIDDEN]))
        waits, go = op[Op.CONTROL] & word["wait"], Signal()
        advance, fresh = Signal(), Signal()
        jumps = op[Op.JUMP] & ~ends_loop
        ended = op[Op.JUMP] & (word["limit"] == Limit.STEPS)
        m.d.comb += [
            advance.eq(~primed | ~Mux(waits, ~go, runs & ~last_column)),
            fetch.en.eq(advance),
            fetch.addr.eq(address),
            self.started.eq(waits & go),
        ]
        m.d.sync += [primed.eq(1), fresh.eq(advance), address.eq(Mux(jumps, word["target"], address + advance))]
        with m.If(ended):
            m.d.sync += step.eq(step + 1)
            with m.If(last_step):
                m.d.sync += [step.eq(0), address.eq(0)]
        with m.If(op[Op.JUMP] & (word["limit"] != Limit.STEPS)):
            m.d.sync += index.eq(Mux(ends_loop, 0, index + 1))
        with m.If(runs):
            m.d.sync += column.eq(Mux(last_column, 0, column + 1))

        # ---------------------------------------------------------------- windows waiting for their step
        m.submodules.queue = queue = WindowQueue(config, code.index_bits)
        wiring.connect(m, wiring.flipped(self.i), queue.i)
        # Registered, as it holds up everything in front: a STORE comes after an instruction that does nothing, or after the look-up of what
        # it writes.
        stores_next = Signal()
        idles = op[Op.CONTROL] & ~(word["clear"] | word["wait"] | word["release"])
        m.d.sync += stores_next.eq(idles | (op[Op.STORE] & (word["kind"] == Kind.INDEX)))
        m.d.comb += [
            queue.hold.eq(stores_next),
            queue.released.eq(op[Op.CONTROL] & word["release"]),
            queue.started.eq(self.started),
            queue.step_done.eq(self.step_done),
            go.eq(queue.waiting & self.decider_idle),
            self.overrun.eq(queue.overrun),
            self.windows_open.eq(queue.open),
        ]

        # ---------------------------------------------------------------- data memory
        init = images.get(memory_map.Memory.CONSTANTS, [])
        # A ROM in front of the working values where these have no first word that one could be told with.
        apart = not config.hardware.loadable and not begins_as_told(platform)
        first = min(number for name, number in code.regions.items() if name.startswith("S.")) << code.index_bits if apart else 0
        m.submodules.data = memory = Memory(
            shape=signed(DATA_BITS), depth=code.data_words - first, init=[] if apart else init, attrs=NO_COLLISION
        )
        read, write = memory.read_port(), memory.write_port()
        read_address, read_data = Signal(range(code.data_words)), Signal(signed(DATA_BITS))
        region, window_region = word["region"], code.regions["X"]
        of_window = region[1:] == window_region >> 1
        if config.constants > 1:  # a region of scales for each length
            index_now = Mux(word["run"], column, index)
            chosen = region | (of_window & queue.reading) | (Mux(word["length"], queue.length, 0) if len(config.window_lengths) > 1 else 0)
        else:
            index_now = Mux(word["run"], column, Mux(word["length"], queue.length, index))
            chosen = region | (of_window & queue.reading)
        m.d.comb += [
            read_address.eq(Cat(index_now[: code.index_bits], chosen[: len(region)])),
            read.addr.eq(read_address - first),
            read.en.eq(op[Op.MAC]),
            read_data.eq(read.data),
        ]
        if apart:
            m.submodules.constants = constants = Memory(shape=signed(DATA_BITS), depth=len(init), init=init)
            constant, constant_read = constants.read_port(), Signal()
            is_constant = read_address < first
            m.d.comb += [
                constant.addr.eq(read_address),
                constant.en.eq(op[Op.MAC] & is_constant),
                read.en.eq(op[Op.MAC] & ~is_constant),
                read_data.eq(Mux(constant_read, constant.data, read.data)),
            ]
            with m.If(op[Op.MAC]):
                m.d.sync += constant_read.eq(is_constant)

        # ---------------------------------------------------------------- weights, bit by bit
        bits, depth = code.weight_word_bits, code.weight_words
        m.submodules.weights_0 = weights = Memory(shape=bits, depth=depth, init=images.get(0, []), attrs=NO_COLLISION)
        weight_read = weights.read_port()
        weight_address, weight_bit = Signal(range(depth)), Signal(range(bits))
        last_bit = runs & (weight_bit == bits - 1)
        m.d.comb += [weight_read.addr.eq(weight_address), weight_read.en.eq(runs)]
        m.d.sync += [weight_bit.eq(Mux(last_bit, 0, weight_bit + runs)), weight_address.eq(weight_address + last_bit)]
        with m.If(self.started & ((step == 0) if config.sets > 1 else 1)):
            m.d.sync += [weight_bit.eq(0), weight_address.eq(0)]
        if config.hardware.loadable:
            weight_write = weights.write_port()
            m.d.comb += [
                weight_write.addr.eq(self.load.address),
                weight_write.data.eq(self.load.data),
                weight_write.en.eq(loads & self.load.select[lines[0]]),
            ]

        # ---------------------------------------------------------------- the accumulator
        # What an instruction says of it holds in the cycle after, when the word it has addressed is there.
        shifts, inverts, fetches, use = (Signal(name=name) for name in ("shifts", "inverts", "fetches", "use"))
        uses, fetched = Signal(2), Signal()
        plane = Signal(4)
        clears = op[Op.CONTROL] & word["clear"]
        m.d.sync += [
            shifts.eq(op[Op.MAC] & word["shift"] & fresh),
            inverts.eq(op[Op.MAC] & word["inverted"] & fresh),
            fetches.eq(op[Op.MAC] & word["fetch"]),
            uses.eq(word["use"] & op[Op.MAC].replicate(2)),
            plane.eq(plane + (op[Op.MAC] & word["shift"])),
        ]
        with m.If(fetches):
            m.d.sync += fetched.eq(read_data.as_unsigned().bit_select(plane, 1))
        with m.Switch(uses):
            with m.Case(Use.WEIGHT):
                m.d.comb += use.eq(weight_read.data.bit_select(weight_bit, 1))
            with m.Case(Use.BIT):
                m.d.comb += use.eq(fetched)
            with m.Case(Use.ALWAYS):
                m.d.comb += use.eq(1)
        acc = Signal(signed(code.accumulator_bits), reset_less=True)
        base = Mux(shifts, acc >> 1, acc) ^ inverts.replicate(len(acc)).as_signed()
        upper = base[code.guard :].as_signed()
        total = Signal(signed(len(upper)))
        m.d.comb += total.eq(Mux(use, upper + read_data, upper))
        m.d.sync += acc.eq(Cat(base[: code.guard], total).as_signed())
        with m.If(clears):
            zero = word["zero"] if code.carries else 0
            m.d.sync += [acc.eq(Mux(zero, 0, code.reset_value)), plane.eq(code.first_plane % 16)]
        if code.carries:
            left = Signal(config.kept_low_bits, reset_less=True)  # the last bits that were shifted out
            with m.If(shifts):
                m.d.sync += left.eq(Cat(left[1:], acc[0]))

        # ---------------------------------------------------------------- results
        kind, table_answers = word["kind"], op[Op.STORE] & word["table"]
        formats = {Kind.LOGIT: config.formats.logit_format, Kind.FEATURE: config.formats.feature_format} | (
            {Kind.STATE: QFormat(DATA_BITS, 0)}
            if code.carries
            else {Kind.INDEX: config.index_format, Kind.STATE: config.formats.state_format}
        )  # a carried sum's words fit: `AcceleratorConfig.kept_low_bits`
        sign, exceeds = acc[-1], Signal()
        with m.Switch(kind):
            for each, fmt in formats.items():
                above = acc[min(fmt.width, len(acc)) - 1 : -1]
                with m.Case(each):
                    m.d.comb += exceeds.eq((above != sign.replicate(len(above))) & ~table_answers)
        if code.carries:  # and has no tables
            answer = Cat(left, Const(0, 1))
        else:
            m.submodules.activation = table = ActivationUnit(config)
            answer = Mux(word["tanh"], ~table.not_state, table.gate)
        # One LUT a bit chooses between the accumulator, the table and, where the value exceeds its format, 0 and 1.
        result = Signal(signed(DATA_BITS))
        for bit in range(DATA_BITS):
            within = {each for each, fmt in formats.items() if bit < fmt.width - 1}
            if len(within) == len(formats):
                level = ~sign
            else:
                level = sign
                for each in within:
                    level = Mux(kind == each, ~sign, level)
            chosen = Signal(2, name=f"choice_{bit}")
            m.d.comb += chosen.eq(Cat(Mux(exceeds, level, table_answers), exceeds))
            own, other = acc[min(bit, len(acc) - 1)], answer[min(bit, len(answer) - 1)]
            m.d.comb += result[bit].eq(Mux(chosen[1], chosen[0], Mux(chosen[0], other, own)))
        if not code.carries:
            low = config.index_bits - 1
            m.d.comb += [table.enable.eq(op[Op.STORE]), table.tanh.eq(word["tanh"]), table.index.eq(Cat(result[:low], sign))]
        stores = op[Op.STORE] & kind[1]
        constant = loads & self.load.select[lines[memory_map.Memory.CONSTANTS]]
        given = Mux(constant, self.load.data, self.i.p.value)
        window = Cat(queue.taxel, queue.writing, Const(window_region >> 1, len(region) - 1))
        m.d.comb += [
            write.addr.eq(Mux(constant, self.load.address, Mux(op[Op.STORE], Cat(index, region), window)) - first),
            write.data.eq(Mux(op[Op.STORE] & ~constant, result, given)),
            write.en.eq(stores | constant | queue.take),
        ]
        m.d.comb += [self.logit.value.eq(result), self.logit.valid.eq(op[Op.STORE] & (kind == Kind.LOGIT))]

        # ---------------------------------------------------------------- for control and benches
        m.d.comb += [
            self.step_done.eq(self.logit.valid & at_last[Limit.CLASSES]),
            self.slot_done.eq(self.started | queue.computing),
            self.working.eq(queue.any | ~waits),
            self.busy.eq(self.working | queue.taxel.any()),
        ]
        cycles = Signal(range(code.last_logit + 1))
        with m.If(self.slot_done):
            m.d.sync += cycles.eq(Mux(self.started, 0, cycles + 1))
        m.d.comb += [self.step.valid.eq(self.step_done), self.step.value.eq(cycles + 1 + logit_to_decision(config))]
        features = code.regions["S.x"]
        m.d.comb += [
            self.feature.valid.eq(stores & (kind == Kind.FEATURE) & (region == features)),
            self.feature.value.eq(result),
            self.state.value.eq(result),
        ]
        if code.program.hidden:
            hidden = code.regions[f"S.{code.program.hidden}"]
            m.d.comb += self.state.valid.eq(stores & (kind == Kind.STATE) & (region == hidden))
        return m


_FIELDS = {
    Op.MAC: ("limit", "region", "use", "run", "length", "fetch", "shift", "inverted"),
    Op.STORE: ("region", "kind", "table", "tanh"),
    Op.JUMP: ("limit", "target"),
    Op.CONTROL: ("clear", "wait", "release", "zero"),
}
"""What of an instruction matters to which operation."""


class _Packing:
    """Instructions as words: what no two operations use at once shares bits.

    Attributes
    ----------
    bits:
        Of a word.
    words:
        The program.
    """

    def __init__(self, code: CompactProgram) -> None:
        most = {"target": len(code.instructions) - 1, "region": code.regions["X"] + 1, "use": 3, "kind": 3, "limit": 3}
        self._places = {"op": (0, 2), "limit": (2, 2)}
        for names in _FIELDS.values():
            offset = 4
            for name in names:
                if name != "limit":
                    width = max(1, most.get(name, 1).bit_length())
                    self._places[name] = (offset, width)
                    offset += width
        self.bits = max(offset + width for offset, width in self._places.values())
        self.words = [self._pack(instruction) for instruction in code.instructions]

    def _pack(self, instruction: Instruction) -> int:
        names = ("op", *_FIELDS[instruction.op])
        return sum(int(getattr(instruction, name)) << self._places[name][0] for name in names)

    def fields(self, word: Signal) -> dict[str, Signal]:
        """Each field of a word."""
        return {name: word[offset : offset + width] for name, (offset, width) in self._places.items()}


def make_engine(
    config: AcceleratorConfig, images: Mapping[int, list[int]] | None = None, program: CellProgram | None = None
) -> Engine | CompactEngine:
    """The engine for the configured lanes; parameters as of both."""
    return (CompactEngine if is_compact(config) else Engine)(config, images, program)
