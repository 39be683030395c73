"""Decisions, answers and frames onto the serial line: docs/specification_interfaces.md section 9."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import Out

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import decision_layout, inputs, outputs
from eskin.rtl.host.frame_sender import word_layout
from eskin.rtl.host.packet_framing import ESCAPE, FCS_START, FCS_TAPS, FLAG, FLIPPED_BIT, is_special

CHECK, CLOSING = 5, 7


class PacketTransmitter(wiring.Component):
    """Sends packets of 5 bytes, or of a frame's words, and a check sequence, each bit straight from its source: no byte
    is stored.

    Parameters
    ----------
    divisor:
        Clocks a bit.
    sends_frames:
        There are frames.

    Members
    -------
    decision : In(stream of decision_layout)
        Has priority over an answer; taken when its packet is out. If it is withdrawn earlier, the packet
        breaks off after the byte under way and is too short to be accepted. (After its last byte it goes out
        whole but is not counted.)
    answer : In(1)
        Send ``r_data``; hold it until ``answered``.
    answered : Out(1)
        The answer is out.
    r_data : In(16), address : In(6), expected : In(8)
        The answer, which register it is, and the number of the next write or frame.
    words : In(stream of word_layout), only with ``sends_frames``
        A frame, when neither a decision nor an answer is there; each word stays until it is out.
    tx : Out(1)
        The line, from a register, idle high.

    A byte takes 10 * ``divisor`` cycles; a packet has 9 and one more for each escape, and begins at most
    ``divisor`` cycles after it can.
    """

    def __init__(self, config: AcceleratorConfig, divisor: int, sends_frames: bool = False):
        self._divisor, self._sends_frames = divisor, sends_frames
        super().__init__(
            inputs(
                "answer", decision=stream.Signature(decision_layout(config)), r_data=16, address=6, expected=8
            )
            | (inputs(words=stream.Signature(word_layout)) if sends_frames else {})
            | outputs("answered")
            | {"tx": Out(1, init=1)}
        )

    def elaborate(self, platform):
        m = Module()
        decisions = self.decisions = Signal(7)  # sent since reset
        is_decision = self.is_decision = Signal()
        is_answer = self.is_answer = Signal()
        # Place: 15 opening flag, 0 to 4 body (0 and 1 a word of a frame), 5 and 6 check sequence, 7 closing flag.
        byte = Signal(4, init=15)
        bit = Signal(4)
        data_bit = bit[:3]
        is_flag = byte[:3].all()
        in_check = byte[2] & (byte[0] ^ byte[1])
        answer = Cat(self.r_data, self.expected, self.address, Const(0, 2))
        payload = Mux(is_decision, Cat(self.decision.payload.as_value()[:31], 1), answer)
        number = Cat(decisions, is_decision & self.decision.p.unsure)
        quarters = [payload[8 * index : 8 * index + 8] for index in range(4)]
        body = Mux(
            byte[2],
            quarters[3],
            Mux(byte[1], Mux(byte[0], quarters[2], quarters[1]), Mux(byte[0], quarters[0], number)),
        )
        following, sends = byte + 1, is_decision | is_answer
        if self._sends_frames:
            is_frame = self.is_frame = Signal()
            body = Mux(is_frame, self.words.p.word.word_select(byte[0], 8), body)
            following = Mux(is_frame & (byte == 1), Mux(self.words.p.last, CHECK, 0), following)
            sends |= is_frame
        fcs = Signal(16)
        raw = Signal()
        m.d.comb += raw.eq(Mux(in_check, ~fcs[0], body.bit_select(data_bit, 1)))
        # The check sequence leaves its register bit by bit, so that its lower byte is always the byte to send
        # next.
        special = ~is_flag & Mux(in_check, is_special(~fcs[:8]), is_special(body))
        escape = Signal()  # this byte is the escape
        escaped = Signal()  # the byte before was
        shift = Signal()
        with m.If(shift):
            back = ~in_check & (raw ^ fcs[0])
            m.d.sync += fcs.eq(Cat(fcs[1:], back) ^ Mux(back, FCS_TAPS & 0x7FFF, 0))

        timer = Signal(range(self._divisor))
        tick = Signal()
        m.d.comb += tick.eq(timer == 0)
        m.d.sync += timer.eq(Mux(tick, self._divisor - 1, timer - 1))
        done = Signal()
        m.d.comb += [self.decision.ready.eq(done & is_decision), self.answered.eq(done & is_answer)]
        m.d.sync += is_decision.eq(is_decision & self.decision.valid)
        # one withdrawn in this very cycle went out whole and is not counted
        with m.If(self.decision.ready & self.decision.valid):
            m.d.sync += decisions.eq(decisions + 1)
        value = Mux(
            is_flag, Const(FLAG, 8).bit_select(data_bit, 1), raw ^ (escaped & (data_bit == FLIPPED_BIT))
        )
        value = Mux(escape, Const(ESCAPE, 8).bit_select(data_bit, 1), value)
        with m.FSM():
            with m.State("IDLE"):
                m.d.sync += [
                    byte.eq(15),
                    fcs.eq(FCS_START),
                    is_decision.eq(self.decision.valid),
                    is_answer.eq(~self.decision.valid & self.answer),
                ]
                begins = self.decision.valid | self.answer
                if self._sends_frames:
                    m.d.sync += is_frame.eq(self.words.valid & ~begins)
                    begins |= self.words.valid
                with m.If(begins):
                    m.next = "START"
            with m.State("START"), m.If(tick):
                m.d.sync += [self.tx.eq(0), escape.eq(special & ~escaped)]
                m.next = "SEND"
            with m.State("SEND"), m.If(tick):
                m.d.sync += [self.tx.eq(bit[3] | value), bit.eq(bit + 1)]
                m.d.comb += shift.eq(~(bit[3] | escape | is_flag))
                with m.If(bit[3]):
                    m.d.sync += [bit.eq(0), escaped.eq(escape)]
                    m.next = "START"
                    with m.If(~escape):
                        m.d.sync += byte.eq(following)
                        if self._sends_frames:
                            m.d.comb += self.words.ready.eq(is_frame & (byte == 1))
                        with m.If((byte == CLOSING) | ~sends):
                            m.next = "IDLE"
                        m.d.comb += done.eq(byte == CLOSING)
            # only an upset of the state's two bits leads here: without a way out the line would be dumb for
            # ever
            with m.State("UPSET"):
                m.next = "IDLE"
        return m
