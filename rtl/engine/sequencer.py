"""Runs the engine's microcode: the order of docs/specification.md, section 5, slot by slot."""

from functools import cached_property
from typing import Any

from amaranth.hdl import Const, Module, Signal, Value
from amaranth.lib import data
from amaranth.lib.memory import Memory

from eskin.rtl.common import Block, drive, inputs, outputs, program_memory
from eskin.rtl.program.microcode import ADDRESSES, CONTROLS, Microcode


def control_layout(code: Microcode) -> data.StructLayout:
    """Layout of a program word, as wide as this program needs it."""
    addresses = {name: range(1 + max(word[name] for word in code.unrolled())) for name in ADDRESSES}
    return data.StructLayout(addresses | dict.fromkeys(CONTROLS, 1))


class _WordLayout(data.StructLayout):
    """Layout of the program's words. Amaranth's own adds up the fields anew for each of hundreds of words, which takes
    half of the time in which a design is elaborated."""

    @cached_property
    def size(self) -> int:
        return super().size

    def const(self, init: dict[str, int] | None) -> Const:
        return Const(sum(value << self[name].offset for name, value in (init or {}).items()), self.size)


class Sequencer(Block):
    """Puts out one slot's controls in every cycle with ``enable``, repeats and all; waits at the ``wait``
    word until ``go``.

    Fields that never change in a program are constants and take no room in its memory.

    Members
    -------
    go : In(1)
        The window is there: the waiting slot may end.
    restart : In(1)
        After the step's last slot begin with the prologue, otherwise with phase A. Sampled at the end of the
        third-last word.
    word : Out(control_layout)
        The slot's controls: valid in the cycle with ``enable``, and before it as long as the slot lasts.
    enable : Out(1)
        The slot ends with this cycle: all its actions happen at this clock edge.
    waiting : Out(1)
        Held at the ``wait`` word.
    ended : Out(1)
        The step's last slot ends with this cycle.
    wrong : Out(1)
        With ``checksum``: the word does not have its parity.
    """

    def ports(self, code: Microcode):
        return inputs("go", "restart") | outputs(
            "enable", "waiting", "ended", "wrong", word=control_layout(code)
        )

    def elaborate(self, platform):
        m = Module()
        # The memory is filled to its end: words that do nothing, the prologue, the step. After the step the
        # program counter wraps to the prologue by itself, or turns back to the step. So the address needs no
        # multiplexer, and the counter starts from 0, the power-on value of an FPGA's flip-flops.
        words, again = self.spec.words, self.spec.again_word
        varying = [name for name in words[0] if len({word[name] for word in words}) > 1]
        fields: dict[str, Any] = {name: range(1 + max(word[name] for word in words)) for name in varying}
        fields |= {"turns": 1, "once": 1}
        idle = dict.fromkeys(varying, 0) | {"turns": 0, "once": 1}
        before = self.spec.idle_words
        # A repeat count is stored less one. It marks the last slot but one, so the word's end is a register.
        init = [idle] * before + [
            {name: word[name] for name in varying}
            | {"turns": int(k == len(words) - 3), "once": int(not word["repeat"])}
            | ({"repeat": max(0, word["repeat"] - 1)} if "repeat" in varying else {})
            for k, word in enumerate(words)
        ]
        if self.spec.plan.config.hardware.checksum:
            fields["parity"] = 1
            init = [word | {"parity": sum(value.bit_count() for value in word.values()) & 1} for word in init]
        m.submodules.program = program = Memory(
            shape=_WordLayout(fields), depth=len(init), init=init, attrs=program_memory(platform)
        )
        fetch = self.fetch = program.read_port()

        def field(name: str):
            return fetch.data[name] if name in varying else Const(words[0][name])

        if self.spec.plan.config.hardware.checksum:
            m.d.comb += self.wrong.eq(Value.cast(fetch.data).xor())

        turn = self.turn = Signal()
        pc = self.pc = Signal(range(len(init)))  # the word to fetch next
        count = self.count = Signal(range(1 + max(word["repeat"] for word in words)))
        primed = self.primed = Signal()  # the first word after a reset takes one cycle to arrive
        ends = self.ends = Signal()
        last = Signal()
        fetching = Signal()
        m.d.sync += primed.eq(1)
        drive(m, self, waiting=primed & field("wait"), enable=primed & (~field("wait") | self.go))
        m.d.comb += [
            last.eq(fetch.data.once | ends),
            self.ended.eq(self.enable & field("end")),
            fetching.eq(~primed | (self.enable & last)),
        ]
        drive(m, fetch, en=fetching, addr=pc)
        # A condition becomes the flip-flops' clock enable, a separate condition their reset; as an addend it
        # would run through the carries. ``primed``: until the first word arrives, the memory's output is
        # still the word from before the reset.
        with m.If(fetching):
            m.d.sync += [pc.eq(pc + 1), turn.eq(primed & fetch.data.turns & ~self.restart)]
            with m.If(turn):  # the step's last word is fetched, and another step follows
                m.d.sync += pc.eq(before + again)
        with m.If(self.enable):
            m.d.sync += [count.eq(count + 1), ends.eq(~last & (count == field("repeat")))]
        with m.If(self.enable & last):
            m.d.sync += count.eq(0)
        m.d.comb += [getattr(self.word, name).eq(field(name)) for name in CONTROLS]
        for name in ADDRESSES:
            m.d.comb += getattr(self.word, name).eq(field(name) + (count if name in self.spec.counted else 0))
        return m
