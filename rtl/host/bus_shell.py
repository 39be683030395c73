"""The accelerator as a CPU sees it: samples in, decisions out, events and an interrupt beside its registers
(docs/specification_interfaces.md, section 17)."""

from amaranth.hdl import Cat, Module, Mux, Signal, Value
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import Out

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import decision_layout, drive, inputs, outputs, sample_layout
from eskin.rtl.host.control import bus_signature
from eskin.rtl.host.decision_queue import DecisionQueue
from eskin.rtl.program.memory_map import Control, Event, Register, ShellRegister, TeachRegister

ADDRESS_BITS = 9
"""Bits of a byte address."""
FIRST = min(ShellRegister)
GLOBAL_ONLY, REFUSED = 8, 31
"""Their bits of ENABLE and NEXT_TAXEL."""


def request_signature() -> wiring.Signature:
    """One access, seen from the bus: the request holds from ``valid`` to ``done``; ``r_data`` is there
    with ``done``. ``whole``: a write has all four bytes. ``address`` is a word's."""
    fields = {"valid": 1, "write": 1, "whole": 1, "address": 7, "w_data": 32}
    return wiring.Signature({k: Out(v) for k, v in fields.items()} | inputs("done", r_data=32))


class BusShell(wiring.Component):
    """Registers of 32 bits for one access at a time.

    Parameters
    ----------
    samples:
        The CPU feeds; otherwise a converter or a stream does, and sample registers are not there.
    depth:
        As of `DecisionQueue`.

    Members
    -------
    request : In(request_signature)
        ``done`` comes in the cycle after the access has acted, so never in its first; a sample acts when it
        is taken or refused.
    bus : Out
        The accelerator's registers.
    frame : Out(stream of sample_layout), only with samples
    decision : In(stream of decision_layout)
    any_fault : In(1)
        A bit of FAULTS is set.
    irq : Out(1)
        Level, a cycle after the event.
    """

    def __init__(self, config: AcceleratorConfig, *, samples: bool = True, depth: int = 2):
        self._config, self._samples = config, samples
        self.queue = DecisionQueue(config, depth)
        super().__init__(
            inputs(
                "any_fault", request=request_signature(), decision=stream.Signature(decision_layout(config))
            )
            | outputs("irq", bus=bus_signature())
            | (outputs(frame=stream.Signature(sample_layout(config))) if samples else {})
        )

    def elaborate(self, platform):
        m = Module()
        request, bus = self.request, self.bus
        m.submodules.queue = queue = self.queue
        wiring.connect(m, wiring.flipped(self.decision), queue.i)
        acts = Signal()
        done = Signal()
        arming = Signal()
        inner, inner_bits = ~request.address[6], 6  # a register of the accelerator
        if self._config.readout_rule.taught:
            inner |= request.address[3:] == min(TeachRegister) >> 3
            inner_bits = 7
        own, place = request.address[3:] == FIRST >> 3, request.address[:3]
        writes, reads = request.write & request.whole, ~request.write
        ends: Value = ~done
        space: Value | int = 0
        local: dict[ShellRegister, Value] = {}
        m.d.comb += acts.eq(request.valid & ~done)
        drive(
            m,
            bus,
            addr=request.address[:inner_bits],
            w_data=request.w_data,
            w_stb=acts & inner & writes,
            r_stb=acts & inner & reads,
        )
        drive(
            m,
            queue,
            clear=arming,
            asked=acts & reads & own & (place == ShellRegister.DECISION - FIRST),
            take=request.valid,  # the outputs are valid with ``done``
        )
        # in the cycle after the write the accelerator restarts
        m.d.sync += arming.eq(bus.w_stb & (bus.addr == Register.CONTROL) & (bus.w_data & Control.ARM).any())

        if self._samples:
            frame, last = self.frame, self._config.sensor.taxels - 1
            taxel = self.taxel = Signal(range(last + 1))
            second = self.second = Signal()
            refusing = self.refusing = Signal()
            stuck = Signal()
            taken = Signal()
            pair = request.address[0]
            feeds = writes & own & (place[1:] == 0)
            more = pair & ~second & (taxel != last)
            m.d.comb += frame.valid.eq(acts & feeds & ~refusing)
            drive(
                m,
                frame.p,
                sample=Mux(second, request.w_data[16:], request.w_data[:16]),
                first=taxel == 0,
                last=taxel == last,
            )
            m.d.comb += [
                taken.eq(frame.valid & frame.ready),
                # only this CPU could end such a wait, and it cannot while it waits
                stuck.eq(frame.valid & ~frame.ready & queue.i.valid & ~queue.i.ready),
            ]
            with m.If(taken):
                m.d.sync += [taxel.eq(Mux(frame.p.last, 0, taxel + 1)), second.eq(more)]
            with m.If(stuck):
                m.d.sync += refusing.eq(1)
            with m.If(stuck | ~request.valid):  # or abandoned
                m.d.sync += second.eq(0)
            # not when a decision is read: an interrupt routine may do that, and the CPU then goes on within its frame
            looks = request.valid & done & reads & own & (place == ShellRegister.NEXT_TAXEL - FIRST)
            with m.If(looks | arming):
                m.d.sync += refusing.eq(0)
            with m.If(arming):
                m.d.sync += taxel.eq(0)
            ends = ~feeds | refusing | stuck | (taken & ~more)
            space = frame.ready & ~refusing
            local[ShellRegister.NEXT_TAXEL] = taxel | refusing << REFUSED

        enable = self.enable = Signal(len(Event))
        global_only = Signal()
        with m.If(acts & writes & own & (place == ShellRegister.ENABLE - FIRST)):
            m.d.sync += [enable.eq(request.w_data), global_only.eq(request.w_data[GLOBAL_ONLY])]
        events = Cat(queue.waits, queue.global_waits, space, self.any_fault)
        local[ShellRegister.EVENTS] = events
        local[ShellRegister.ENABLE] = enable | global_only << GLOBAL_ONLY
        m.d.comb += [queue.global_only.eq(global_only), request.done.eq(done)]
        m.d.sync += [done.eq(acts & ends), self.irq.eq((events & enable).any())]
        read = Signal(32)  # but for DECISION
        with m.If(inner):
            m.d.comb += read.eq(bus.r_data)
        with m.Elif(own), m.Switch(place):
            for register, value in local.items():
                with m.Case(register - FIRST):
                    m.d.comb += read.eq(value)
        m.d.comb += request.r_data.eq(read | queue.word)
        return m
