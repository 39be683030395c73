"""The accelerator's host side over a serial line: packets of docs/specification_interfaces.md section 9 in and out."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import decision_layout, drive, inputs, outputs, sample_layout, struct
from eskin.rtl.host.control import bus_signature
from eskin.rtl.host.frame_sender import word_layout
from eskin.rtl.host.packet_framing import FrameCheck, Unstuffer
from eskin.rtl.host.packet_transmitter import PacketTransmitter
from eskin.rtl.host.uart import UartReceiver
from eskin.rtl.program.memory_map import TeachRegister

WINDOW = 0x3C
"""Address of a packet from which four addresses stand for the registers of teaching, whose own addresses have
a bit more."""
HEADER_WORDS = 2
"""16-bit words of a packet besides its samples or its value: number and command before them, check sequence
after them."""


class UartLink(wiring.Component):
    """Frames, register writes and reads in; decisions and answers out. A packet acts only once its check
    sequence is proven.

    A frame or write acts when its number is the expected one, so each acts once and in order however often it
    is sent; a read acts always and its answer carries the number expected next. A packet that comes while one
    is still acting (the accelerator not ready, an answer not yet sent) is dropped like a damaged one.
    The next flag always resynchronises the receiver; no reset or timeout is needed.

    Parameters
    ----------
    config:
        ``taxels``, and the sample format.
    divisor:
        Clocks a bit (`eskin.rtl.host.uart.uart_divisor`).
    sends_frames:
        As of `PacketTransmitter`.

    Members
    -------
    rx : In(1), tx : Out(1)
        The lines.
    frame : Out(stream of sample_layout)
        One frame a packet, a beat a cycle.
    decision : In(stream of decision_layout)
        Taken when its packet is out. Where it is withdrawn before (a new recording was armed), its packet is
        broken off.
    words : In(stream of word_layout), only with ``sends_frames``
        As of `PacketTransmitter`.
    bus : Out
        Registers.
    expected : Out(8)
        The number of the next frame or write.

    A packet acts on ``frame`` or ``bus`` 4 cycles after the middle of its last flag's stop bit.
    """

    def __init__(self, config: AcceleratorConfig, divisor: int, sends_frames: bool = False):
        self._config = config
        self._divisor, self._sends_frames = divisor, sends_frames
        super().__init__(
            inputs(decision=stream.Signature(decision_layout(config)))
            | outputs(frame=stream.Signature(sample_layout(config)), bus=bus_signature(), expected=8)
            | (inputs(words=stream.Signature(word_layout)) if sends_frames else {})
            | {"rx": In(1, init=1), "tx": Out(1, init=1)}
        )

    def elaborate(self, platform):
        m = Module()
        taxels = self._config.sensor.taxels
        m.submodules.receiver = receiver = UartReceiver(self._divisor)
        m.submodules.unstuffer = unstuffer = Unstuffer()
        m.submodules.check = check = FrameCheck()
        m.submodules.transmitter = transmitter = self.transmitter = PacketTransmitter(
            self._config, self._divisor, self._sends_frames
        )
        wiring.connect(m, wiring.flipped(self.decision), transmitter.decision)
        if self._sends_frames:
            wiring.connect(m, wiring.flipped(self.words), transmitter.words)
        m.d.comb += receiver.rx.eq(self.rx)
        drive(m, unstuffer, data=receiver.data, valid=receiver.valid)
        drive(m, check, byte=unstuffer.byte, valid=unstuffer.byte_valid, start=unstuffer.end)
        m.d.comb += self.tx.eq(transmitter.tx)

        # ---------------------------------------------------------------- a packet comes in
        # word and high: words and odd byte so far; while a packet acts, the next word. No packet has a
        # length of all ones. The buffer is written only while nothing acts and read only while something
        # does.
        word = self.word = Signal((taxels + HEADER_WORDS + 1).bit_length())
        high = Signal()
        m.submodules.buffer = buffer = Memory(
            shape=data.ArrayLayout(unsigned(8), 2), depth=1 << len(word), init=[]
        )
        write, read = buffer.write_port(granularity=1), buffer.read_port()
        acting = self.acting = Signal()
        spoiled = Signal()
        in_order = Signal()
        command = Signal(struct(address=6, is_frame=1, is_read=1))
        accepted = unstuffer.byte_valid & ~acting
        length = Mux(command.is_frame, taxels + HEADER_WORDS, 1 + HEADER_WORDS)
        good = unstuffer.end & ~(acting | unstuffer.aborted | spoiled | high) & check.good & (word == length)
        m.d.comb += [
            write.addr.eq(word),
            write.data[0].eq(unstuffer.byte),
            write.data[1].eq(unstuffer.byte),
            write.en.eq(Mux(accepted, Cat(~high, high), 0)),
        ]
        with m.If(unstuffer.end):
            m.d.sync += spoiled.eq(0)
        with m.Elif(unstuffer.byte_valid & (acting | word.all())):
            m.d.sync += spoiled.eq(1)
        forward = Signal()
        restart = Signal()
        with m.If(accepted):
            m.d.sync += high.eq(~high)
            with m.If(word == 0):
                with m.If(high):
                    m.d.sync += command.eq(unstuffer.byte)
                with m.Else():
                    m.d.sync += in_order.eq(unstuffer.byte == self.expected)
        with m.If(restart | unstuffer.end & ~acting):
            m.d.sync += [word.eq(0), high.eq(0)]
        with m.Elif(accepted & high | forward):
            m.d.sync += word.eq(word + 1)

        # ---------------------------------------------------------------- and acts
        address: Value = command.address
        if self._config.readout_rule.taught:
            low = address[:2]
            address = Mux(address[2:] == WINDOW >> 2, Cat(low, Const(min(TeachRegister) >> 2, 6)), address)
        drive(m, read, addr=word, en=forward)
        drive(m, self.bus, addr=address, w_data=read.data)
        drive(m, self.frame.p, sample=Cat(read.data), first=word == 2, last=word == taxels + 1)
        drive(m, transmitter, r_data=self.bus.r_data, address=command.address, expected=self.expected)
        with m.FSM(name="act"):
            with m.State("RECEIVE"):
                with m.If(good & command.is_read):
                    m.d.comb += self.bus.r_stb.eq(1)
                    m.next = "ANSWER"
                with m.Elif(good & in_order):
                    m.d.sync += self.expected.eq(self.expected + 1)
                    m.next = "HEADER"
            with m.State("HEADER"):
                m.d.comb += [acting.eq(1), forward.eq(1)]
                with m.If(word == 1):
                    m.next = "ACT"
            with m.State("ACT"):
                m.d.comb += [
                    acting.eq(1),
                    self.frame.valid.eq(command.is_frame),
                    self.bus.w_stb.eq(~command.is_frame),
                    forward.eq(~command.is_frame | self.frame.ready),
                    restart.eq(forward & (~command.is_frame | self.frame.p.last)),
                ]
                with m.If(restart):
                    m.next = "RECEIVE"
            with m.State("ANSWER"):
                m.d.comb += [acting.eq(1), transmitter.answer.eq(1)]
                with m.If(transmitter.answered):
                    m.next = "RECEIVE"
        return m
