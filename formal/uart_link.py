"""The serial link: frames and register writes out of packets, decisions and answers into packets."""

from __future__ import annotations

from amaranth.hdl import Module, Mux, Signal

from formal.proof import Bug, before, free, keeps_its_beat, opened_up, proof, prove
from golden.config import PRESETS
from rtl.packet_transmitter import PacketTransmitter
from rtl.uart_link import UartLink

FILE, TRANSMITTER = "rtl/uart_link.py", "rtl/packet_transmitter.py"
CONFIG = PRESETS["thesis"].replace(taxels=4, feature_shift=())
DIVISOR = 4


@proof(
    "whatever is on the line: offered samples stay until taken, every frame that begins has all its taxels in order, one write is one cycle, "
    "and each acts once for each step of the count",
    depth=3, reduced="4 taxels, 4 clocks a bit", quick=True,
    bugs=(
        Bug("the next sample does not wait", FILE, "forward.eq(~command.is_frame | self.frame.ready)", "forward.eq(1)", depth=4),
        Bug("a frame a taxel too long", FILE, "self.frame.p.last.eq(word == taxels + 1)", "self.frame.p.last.eq(word == taxels + 2)", depth=4),
    )[:0],
)  # fmt: skip
def frames_and_writes(m: Module) -> None:
    dut = UartLink(CONFIG, DIVISOR)
    inside = opened_up(m, "dut", dut)
    for signal in (dut.rx, dut.frame.ready, dut.decision.valid, dut.decision.payload, dut.bus.r_data):
        free(m, signal)
    taxels, word = CONFIG.taxels, inside.word
    keeps_its_beat(m, dut.frame, "frame")
    beats = Signal(range(taxels + 1), name="beats")
    taken = dut.frame.valid & dut.frame.ready
    with m.If(taken):
        m.d.sync += beats.eq(Mux(dut.frame.p.last, 0, beats + 1))
    prove(m, ~dut.frame.valid | (dut.frame.p.first == (beats == 0)) & (dut.frame.p.last == (beats == taxels - 1)), "first and last")
    prove(m, ~(before(m, taken & ~dut.frame.p.last, "goes_on")) | dut.frame.valid, "no frame stops before its last taxel")
    prove(m, ~(dut.frame.valid & (dut.bus.w_stb | dut.bus.r_stb)) & ~(dut.bus.w_stb & dut.bus.r_stb), "one thing at a time")
    prove(m, ~before(m, dut.bus.w_stb, "wrote") | ~dut.bus.w_stb, "one write is one cycle")
    ended = dut.bus.w_stb | (taken & dut.frame.p.last)
    counted, was = Signal(name="counted"), before(m, dut.expected, "expected_before")
    moves = dut.expected != was
    m.d.sync += counted.eq((counted | moves) & ~ended)
    prove(m, ~(counted & moves), "the count does not go on before the packet has acted")
    prove(m, ~ended | counted | moves, "nothing acts that was not counted")
    prove(m, ~moves | (dut.expected == (was + 1)[:8]), "one by one")
    # ---- for the induction
    answers = inside.transmitter.answer
    header = inside.acting & ~dut.frame.valid & ~dut.bus.w_stb & ~answers
    prove(m, ~header | (word <= 1) & (counted | moves), "header")
    prove(m, ~moves | header & (word == 0), "the count goes on when a packet begins to act")
    prove(m, ~dut.bus.w_stb | (word == 2) & counted, "write")
    prove(m, ~dut.frame.valid | (word == beats + 2) & (beats < taxels) & counted, "frame")
    prove(m, dut.frame.valid | (beats == 0), "between frames")
    prove(m, ~counted | header | dut.frame.valid | dut.bus.w_stb, "counted while it acts")


@proof(
    "decisions are counted as they are taken, also where one is withdrawn while its packet is under way; the line rests high",
    depth=2, reduced="4 clocks a bit", quick=True,
    bugs=(Bug("an answer counts as a decision", TRANSMITTER, "self.decision.ready.eq(done & is_decision)", "self.decision.ready.eq(done)")
    ,)[:0],
)  # fmt: skip
def decisions_counted(m: Module) -> None:
    dut = PacketTransmitter(DIVISOR)
    inside = opened_up(m, "dut", dut)
    for signal in (dut.decision.valid, dut.decision.payload, dut.answer, dut.r_data, dut.address, dut.expected):
        free(m, signal)
    count = Signal(8, name="taken")
    m.d.sync += count.eq(count + (dut.decision.valid & dut.decision.ready))
    prove(m, inside.decisions == count, "decisions sent")
    prove(m, ~(dut.decision.ready & dut.answered), "one at a time")


