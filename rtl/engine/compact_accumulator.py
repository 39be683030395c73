"""The compact engine's accumulator: one adder, and one bit of the other operand a cycle
(docs/specification.md, section 4)."""

from amaranth.hdl import Cat, Module, Mux, Signal, signed
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.program.compact_program import DATA_BITS, CompactProgram, Use


class CompactAccumulator(wiring.Component):
    """Shifts the sum, then may add a word of the data memory.

    An instruction takes effect one cycle later, when the word it addressed has been read. ``acc`` shows the
    result two cycles after the instruction.

    Members
    -------
    mac : In(1)
        The instruction is a MAC; without one nothing is added.
    shift, inverted : In(1)
        Of its first cycle (``fresh``): the sum halves, its bits turn over.
    fetch : In(1)
        The bit of ``data`` that stands for the plane under way is kept, for ``Use.BIT``.
    use : In(2)
        What says whether ``data`` is added (`eskin.rtl.program.compact_program.Use`).
    fresh : In(1)
        The instruction's first cycle.
    clear, zero : In(1)
        The sum begins, with the rounding half or, where a sum is carried over steps, with 0.
    weight : In(1)
        The weights' bit under way; with the word, a cycle after the instruction.
    data : In(signed(16))
        The word that was addressed.
    acc : Out(signed(accumulator_bits))
        The sum, ``code.guard`` fraction bits below the words'.
    left : Out(kept_low_bits)
        The last bits that were shifted out, where a sum is carried.
    """

    def __init__(self, config: AcceleratorConfig, code: CompactProgram) -> None:
        self._config, self._code = config, code
        flags = ("mac", "shift", "inverted", "fetch", "fresh", "clear", "zero", "weight")
        super().__init__(
            {name: In(1) for name in flags}
            | {
                "use": In(2),
                "data": In(signed(DATA_BITS)),
                "acc": Out(signed(code.accumulator_bits)),
                "left": Out(config.kept_low_bits),
            }
        )

    def elaborate(self, platform):
        m = Module()
        code = self._code
        shifts, inverts, fetches, use = (
            Signal(name=name) for name in ("shifts", "inverts", "fetches", "use_now")
        )
        uses = Signal(2)
        fetched = Signal()
        plane = Signal(4)
        m.d.sync += [
            shifts.eq(self.mac & self.shift & self.fresh),
            inverts.eq(self.mac & self.inverted & self.fresh),
            fetches.eq(self.mac & self.fetch),
            uses.eq(self.use & self.mac.replicate(2)),
            plane.eq(plane + (self.mac & self.shift)),
        ]
        with m.If(fetches):
            m.d.sync += fetched.eq(self.data.as_unsigned().bit_select(plane, 1))
        with m.Switch(uses):
            with m.Case(Use.WEIGHT):
                m.d.comb += use.eq(self.weight)
            with m.Case(Use.BIT):
                m.d.comb += use.eq(fetched)
            with m.Case(Use.ALWAYS):
                m.d.comb += use.eq(1)
        acc = Signal(signed(code.accumulator_bits), reset_less=True)
        base = Mux(shifts, acc >> 1, acc) ^ inverts.replicate(len(acc)).as_signed()
        upper = base[code.guard :].as_signed()
        total = Signal(signed(len(upper)))
        m.d.comb += [total.eq(Mux(use, upper + self.data, upper)), self.acc.eq(acc)]
        m.d.sync += acc.eq(Cat(base[: code.guard], total).as_signed())
        with m.If(self.clear):
            m.d.sync += [
                acc.eq(Mux(self.zero if code.carries else 0, 0, code.reset_value)),
                plane.eq(code.first_plane % 16),
            ]
        if code.carries:
            left = Signal(len(self.left), reset_less=True)
            m.d.comb += self.left.eq(left)
            with m.If(shifts):
                m.d.sync += left.eq(Cat(left[1:], acc[0]))
        return m
