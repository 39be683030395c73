"""The image engine's program: the words of its passes, one after the other
(eskin/rtl/program/image_passes.py)."""

from amaranth.hdl import Module, Signal
from amaranth.lib.wiring import Out

from eskin.rtl.common import Block, drive, inputs, outputs, working_memory
from eskin.rtl.image.layouts import pass_layout
from eskin.rtl.program.image_passes import PASS_WORDS, ImagePlan, Word

CHECKED = {"arrives": Out(1), "arrived": Out(16), "checks": Out(1)}


class PassFetch(Block):
    """Reads the words of the next pass into registers.

    Members
    -------
    rewind : In(1)
        With ``fetch``: the first pass is the next.
    fetch : In(1)
        Pulse: read the next pass; its first word is there two cycles later.
    fetched : Out(1)
        Pulse, PASS_WORDS + 1 cycles after ``fetch``: ``now`` is whole from the next cycle on.
    now : Out(pass_layout)
        The pass.
    arrives : Out(1), arrived : Out(16), checks : Out(1)
        With ``checksum``: a word ``arrived`` is there; it is the pass's check word. The check word follows
        the others, and the last pass has a second one; both arrive before the pass's first tap.
    write : In(1), address : In(16), word : In(16)
        The host's writes.
    """

    def ports(self, plan: ImagePlan):
        return (
            inputs("rewind", "fetch", "write", address=16, word=16)
            | outputs("fetched", now=pass_layout(plan))
            | CHECKED
        )

    def elaborate(self, platform):
        m, words = Module(), self.spec.program_words
        read, write = working_memory(m, "program", 16, words)
        drive(m, write, addr=self.address, data=self.word, en=self.write)
        address = Signal(range(words + 1))
        reading = Signal()
        number = Signal(range(PASS_WORDS + 2))
        arrived = Signal(range(PASS_WORDS + 2))
        arriving = Signal()
        last = PASS_WORDS - 1 if not self.spec.checksum else PASS_WORDS + self.now.last
        drive(m, read, addr=address, en=reading)
        m.d.comb += self.fetched.eq(arriving & (arrived == PASS_WORDS - 1))
        m.d.sync += [arriving.eq(reading), arrived.eq(number)]
        with m.If(self.fetch):
            m.d.sync += [reading.eq(1), number.eq(0)]
            with m.If(self.rewind):
                m.d.sync += address.eq(0)
        with m.Elif(reading):
            m.d.sync += [address.eq(address + 1), number.eq(number + 1), reading.eq(number != last)]
        now, data = self.now, read.data
        drive(m, self, arrives=arriving, arrived=data, checks=arriving & (arrived == PASS_WORDS))
        parts = {
            Word.FLAGS: (
                (now.radius, 0),
                (now.pool, 2),
                (now.dense, 3),
                (now.last, 4),
                (now.pairs, 5),
                (now.shift, 8),
            ),
            Word.EXTENT: ((now.columns, 0), (now.rows, 8)),
            Word.GROUPS: ((now.groups, 0), (now.last_group, 8)),
        }
        parts |= {word: ((now[word.name.lower()], 0),) for word in Word if word not in parts}
        with m.If(arriving), m.Switch(arrived):
            for word_number, fields in parts.items():
                with m.Case(int(word_number)):
                    m.d.sync += [field.eq(data[low:]) for field, low in fields]
        return m
