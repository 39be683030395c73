"""The serial link: frames and register writes out of packets, decisions and answers into packets."""

from unittest import mock

from amaranth.hdl import Module, Mux, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

import eskin.rtl.host.uart_link
from eskin.golden.core import PRESETS
from eskin.rtl.host.packet_transmitter import PacketTransmitter
from eskin.rtl.host.uart_link import UartLink
from formal import proof as words
from formal.proof import Bug, any_number, assume, before, free, keeps_its_beat, placed_free, proof, prove

TRANSMITTER = "rtl/host/packet_transmitter.py"
CONFIG = PRESETS["thesis"].replace(taxels=4, feature_shift=())


class AnyBytes(wiring.Component):
    """A stand-in for the receiver: any bytes at any time."""

    def __init__(self, divisor: int) -> None:
        super().__init__({"rx": In(1), "data": Out(8), "valid": Out(1)})

    def elaborate(self, platform):
        m = Module()
        free(self.data, self.valid, m=m)
        return m


@proof(
    "whatever bytes come: offered samples stay until taken, every frame that begins has all its taxels in "
    "order, one write is one cycle, "
    "and each acts once for each step of the count",
    depth=3,
    reduced="4 taxels, any bytes in place of the receiver",
    bugs=(
        Bug(
            "the next sample does not wait",
            "forward.eq(~command.is_frame | self.frame.ready)",
            "forward.eq(1)",
        ),
        Bug("a frame a taxel too long", "last=word == taxels + 1", "last=word == taxels + 2"),
    ),
)
def frames_and_writes(m: Module) -> None:
    with mock.patch.object(eskin.rtl.host.uart_link, "UartReceiver", AnyBytes):
        dut = placed_free(UartLink(CONFIG, 4))
    taxels, word = CONFIG.sensor.taxels, dut.word
    keeps_its_beat(dut.frame, "frame")
    beats = Signal(range(taxels + 1))
    accepted = dut.frame.valid & dut.frame.ready
    with m.If(accepted):
        m.d.sync += beats.eq(Mux(dut.frame.p.last, 0, beats + 1))
    prove(
        ~dut.frame.valid | (dut.frame.p.first == (beats == 0)) & (dut.frame.p.last == (beats == taxels - 1)),
        "first and last",
    )
    prove(
        ~(before(accepted & ~dut.frame.p.last, "goes_on")) | dut.frame.valid,
        "no frame stops before its last taxel",
    )
    prove(
        ~(dut.frame.valid & (dut.bus.w_stb | dut.bus.r_stb)) & ~(dut.bus.w_stb & dut.bus.r_stb),
        "one thing at a time",
    )
    prove(~before(dut.bus.w_stb, "wrote") | ~dut.bus.w_stb, "one write is one cycle")
    ended = dut.bus.w_stb | (accepted & dut.frame.p.last)
    counted, was = Signal(name="counted"), before(dut.expected, "expected_before")
    moves = dut.expected != was
    m.d.sync += counted.eq((counted | moves) & ~ended)
    prove(~(counted & moves), "the count does not go on before the packet has acted")
    prove(~ended | counted | moves, "nothing acts that was not counted")
    prove(~moves | (dut.expected == (was + 1)[:8]), "one by one")
    # ---- for the induction
    answers = dut.transmitter.answer
    header = dut.acting & ~dut.frame.valid & ~dut.bus.w_stb & ~answers
    prove(~header | (word <= 1) & (counted | moves), "header")
    prove(~moves | header & (word == 0), "the count goes on when a packet begins to act")
    prove(~dut.bus.w_stb | (word == 2) & counted, "write")
    prove(~dut.frame.valid | (word == beats + 2) & (beats < taxels) & counted, "frame")
    prove(dut.frame.valid | (beats == 0), "between frames")
    prove(~counted | header | dut.frame.valid | dut.bus.w_stb, "counted while it acts")


@proof(
    "decisions are counted as they are taken, also where one is withdrawn while its packet is under way",
    depth=2,
    reduced="1 clock a bit",
    quick=True,
    bugs=(
        Bug(
            "one withdrawn with its last bit is counted",
            "with m.If(self.decision.ready & self.decision.valid):",
            "with m.If(self.decision.ready):",
            file=TRANSMITTER,
            eager=True,
        ),
    ),
)
def decisions_counted(m: Module) -> None:
    dut = placed_free(PacketTransmitter(CONFIG, 1))
    if words.EAGER:  # one decision of zeros, withdrawn once: no escapes, no answers
        fall, cycle = any_number(7, "fall"), Signal(7, name="cycle")
        m.d.sync += cycle.eq(cycle + 1)
        assume(
            (dut.decision.payload.as_value() == 0)
            & ~dut.answer
            & (dut.decision.valid == (cycle < fall))
            & (fall > 85)
        )
    count = Signal(7, name="taken")
    m.d.sync += count.eq(count + (dut.decision.valid & dut.decision.ready))
    prove(dut.decisions == count, "decisions sent")
    prove(~(dut.is_decision & dut.is_answer), "either")
    prove(~(dut.decision.ready & dut.answered), "one at a time")
