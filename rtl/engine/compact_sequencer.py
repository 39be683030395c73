"""The compact engine's program: which instruction is under way, and the loops' counters
(docs/specification.md, section 5)."""

from amaranth.hdl import Module, Mux, Signal
from amaranth.lib import wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.program.compact_program import CompactProgram, Instruction, Limit, Op

FIELDS = {
    Op.MAC: ("limit", "region", "use", "run", "length", "fetch", "shift", "inverted"),
    Op.STORE: ("region", "kind", "table", "tanh"),
    Op.JUMP: ("limit", "target"),
    Op.CONTROL: ("clear", "wait", "release", "zero"),
}
"""What of an instruction matters to which operation."""


class Packing:
    """Instructions as words: what no two operations use at once shares bits.

    Attributes
    ----------
    bits:
        Of a word.
    words:
        The program.
    """

    def __init__(self, code: CompactProgram) -> None:
        most = {
            "target": len(code.instructions) - 1,
            "region": code.regions["X"] + 1,
            "use": 3,
            "kind": 3,
            "limit": 3,
        }
        self.places = {"op": (0, 2), "limit": (2, 2)}
        for names in FIELDS.values():
            offset = 4
            for name in names:
                if name != "limit":
                    width = max(1, most.get(name, 1).bit_length())
                    self.places[name] = (offset, width)
                    offset += width
        self.bits = max(offset + width for offset, width in self.places.values())
        self.words = [self._pack(instruction) for instruction in code.instructions]

    def _pack(self, instruction: Instruction) -> int:
        names = ("op", *FIELDS[instruction.op])
        return sum(int(getattr(instruction, name)) << self.places[name][0] for name in names)

    def fields(self, word: Signal) -> dict[str, Signal]:
        """Each field of a word."""
        return {name: word[offset : offset + width] for name, (offset, width) in self.places.items()}


class CompactSequencer(wiring.Component):
    """Issues the instructions of `eskin.rtl.program.compact_program`, one a cycle.

    A MAC with ``run`` takes a cycle for each column of its loop; an instruction with ``wait`` lasts until
    ``go``. A jump takes effect after the instruction that follows it, which is already fetched.

    Attributes
    ----------
    fields : dict
        Fields of ``word`` by name; each says something only with the operation that has it (`FIELDS`).

    Members
    -------
    go : In(1)
        A step may start.
    word : Out
        The instruction under way, `Packing`; nothing before the first has come, a cycle after a reset, when
        no operation is named.
    mac, store, jump, control : Out(1)
        Its operation.
    index, column : Out(code.index_bits)
        Of the loop under way, and of a MAC with ``run``.
    runs : Out(1)
        A MAC goes on over columns.
    waits, started : Out(1)
        The program stands where it waits for a window; a step starts in this cycle.
    fresh : Out(1)
        The instruction's first cycle.
    first_step, last_class : Out(1)
        The step under way is its touch's first; the index is that of the last class.
    """

    def __init__(self, config: AcceleratorConfig, code: CompactProgram) -> None:
        self._config, self._code = config, code
        self.packing = Packing(code)
        flags = (
            "mac",
            "store",
            "jump",
            "control",
            "runs",
            "waits",
            "started",
            "fresh",
            "first_step",
            "last_class",
        )
        super().__init__(
            {
                "go": In(1),
                "word": Out(self.packing.bits),
                "index": Out(code.index_bits),
                "column": Out(code.index_bits),
            }
            | {name: Out(1) for name in flags}
        )
        self.fields = self.packing.fields(self.word)

    def elaborate(self, platform):
        m = Module()
        code, words, word = self._code, self.packing.words, self.fields
        m.submodules.program = program = Memory(shape=self.packing.bits, depth=len(words), init=words)
        fetch = program.read_port()
        primed = Signal()  # the first instruction after a reset takes one cycle to arrive
        operations = {Op.MAC: self.mac, Op.STORE: self.store, Op.JUMP: self.jump, Op.CONTROL: self.control}
        m.d.comb += self.word.eq(fetch.data)
        m.d.comb += [signal.eq(primed & (word["op"] == kind)) for kind, signal in operations.items()]

        address = Signal(range(len(words)))
        index = self.index
        column = self.column
        step = Signal(range(self._config.windows.steps))
        last_step = step == self._config.windows.steps - 1
        at_last = {limit: index == code.limit(limit) - 1 for limit in Limit if limit != Limit.STEPS} | {
            Limit.STEPS: last_step
        }
        ends_loop = Signal()
        with m.Switch(word["limit"]):
            for limit, last in at_last.items():
                with m.Case(limit):
                    m.d.comb += ends_loop.eq(last)
        last_column = Signal()
        advance = Signal()
        columns = {limit: column == code.limit(limit) - 1 for limit in (Limit.HIDDEN, Limit.INPUTS)}
        jumps = self.jump & ~ends_loop
        ended = self.jump & (word["limit"] == Limit.STEPS)
        m.d.comb += [
            self.runs.eq(self.mac & word["run"]),
            last_column.eq(Mux(word["limit"][0], columns[Limit.INPUTS], columns[Limit.HIDDEN])),
            self.waits.eq(self.control & word["wait"]),
            self.started.eq(self.waits & self.go),
            self.first_step.eq(step == 0),
            self.last_class.eq(at_last[Limit.CLASSES]),
            advance.eq(~primed | ~Mux(self.waits, ~self.go, self.runs & ~last_column)),
            fetch.en.eq(advance),
            fetch.addr.eq(address),
        ]
        m.d.sync += [
            primed.eq(1),
            self.fresh.eq(advance),
            address.eq(Mux(jumps, word["target"], address + advance)),
        ]
        with m.If(ended):
            m.d.sync += step.eq(step + 1)
            with m.If(last_step):
                m.d.sync += [step.eq(0), address.eq(0)]
        with m.If(self.jump & (word["limit"] != Limit.STEPS)):
            m.d.sync += index.eq(Mux(ends_loop, 0, index + 1))
        with m.If(self.runs):
            m.d.sync += column.eq(Mux(last_column, 0, column + 1))
        return m
