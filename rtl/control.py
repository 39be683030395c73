"""The host's side: registers, commands, memory loading, faults and cycle counters."""

from __future__ import annotations

from amaranth.hdl import Array, Cat, Module, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from golden.config import AcceleratorConfig
from rtl.engine import load_signature
from rtl.memory_map import ID_VALUE, VERSION_VALUE, Register
from rtl.memory_map import Control as Command
from rtl.schedule import slot_cycles

COUNTER_BITS = 16


def bus_signature() -> wiring.Signature:
    """The host bus, seen from the host: write ``w_data`` to ``addr`` with ``w_stb``, read it with ``r_stb``; ``r_data`` one cycle later."""
    return wiring.Signature({"addr": Out(8), "w_data": Out(16), "w_stb": Out(1), "r_stb": Out(1), "r_data": In(16)})


class HostControl(wiring.Component):
    """Registers of rtl/memory_map.py, and the life of a recording: arm, frames, finish.

    Members
    -------
    bus : In
        One access a cycle.
    clear : Out(1)
        Synchronous reset of the datapath for one cycle, at ``arm``.
    finish : Out(1)
        Pulse once everything in flight has been decided after the command.
    load : Out
        Memory writes; refused (and flagged) while a touch is open.
    mask : Out(taxels)
        Bit set: taxel out of use.
    frame_beat, beat_offered, frame_first, frame_last : In(1)
        Input beat taken; offered; its first and last flags.
    detector_armed, touch_started, framing_fault : In(1)
    moving : In(1)
        Anything between input and engine offers a beat.
    engine_busy, engine_overrun, slot_filled, step_done : In(1)
    step_slots : In(16)
    decision_offered, global_taken, decider_idle : In(1)
        A local decision is offered; a touch's global decision is taken; the classifier is idle.
    busy : Out(1)
        A frame, sum, step, decision or command is in flight.
    step_counted, step_total : Out
        A step's decision is offered in this cycle; the cycles it took, issue and drain.

    Counters saturate at 65535.
    """

    def __init__(self, config: AcceleratorConfig) -> None:
        self._config = config
        inputs = (
            "frame_beat", "beat_offered", "frame_first", "frame_last", "detector_armed", "touch_started", "framing_fault", "moving",
            "engine_busy", "engine_overrun", "slot_filled", "step_done", "decision_offered", "global_taken", "decider_idle",
        )  # fmt: skip
        super().__init__(
            {
                "bus": In(bus_signature()), "clear": Out(1), "finish": Out(1), "load": Out(load_signature()),
                "mask": Out(config.taxels), "step_slots": In(16), "busy": Out(1),
                "step_counted": Out(1), "step_total": Out(COUNTER_BITS), **{name: In(1) for name in inputs},
            }
        )  # fmt: skip

    def elaborate(self, platform):
        m = Module()
        bus = self.bus

        # ---------------------------------------------------------------- life of a recording
        touch, finishing, finished = Signal(), Signal(), Signal()
        touches = Signal(COUNTER_BITS)
        # A beat spends at most a few cycles between the offers that `moving` sees: quiet for 31 cycles means nothing is under way.
        quiet = Signal(5, init=31)
        with m.If(self.moving):
            m.d.sync += quiet.eq(0)
        with m.Elif(~quiet.all()):
            m.d.sync += quiet.eq(quiet + 1)
        idle = Signal()
        m.d.comb += [
            idle.eq(quiet.all() & ~self.moving & ~self.engine_busy & self.decider_idle),
            self.finish.eq(finishing & ~finished & idle),
            self.busy.eq(~idle | finishing | self.clear),
        ]
        with m.If(self.touch_started):
            m.d.sync += [touch.eq(1), touches.eq(touches + 1)]
        with m.Elif(self.global_taken):
            m.d.sync += touch.eq(0)
        with m.If(self.finish):
            m.d.sync += finished.eq(1)
        with m.Elif(finished & idle):  # the partial decision, if there was one, is out
            m.d.sync += [finishing.eq(0), finished.eq(0), touch.eq(0)]

        # ---------------------------------------------------------------- memory loading
        select, address = Signal(7), Signal(16)
        write_data = Signal()
        m.d.comb += [
            write_data.eq(bus.w_stb & (bus.addr == Register.MEMORY_DATA)),
            self.load.enable.eq(write_data & ~touch & int(self._config.loadable)),
            self.load.select.eq(select),
            self.load.address.eq(address),
            self.load.data.eq(bus.w_data),
        ]
        with m.If(write_data):
            m.d.sync += address.eq(address + 1)

        # ---------------------------------------------------------------- counters
        timer, frame_end = Signal(COUNTER_BITS), Signal(COUNTER_BITS)
        m.d.sync += timer.eq(timer + 1)
        in_frame, frame_cycles = Signal(), Signal(COUNTER_BITS)
        frame_max, step_max, latency_max = Signal(COUNTER_BITS), Signal(COUNTER_BITS), Signal(COUNTER_BITS)
        with m.If(self.frame_beat & self.frame_last):
            m.d.sync += [in_frame.eq(0), frame_cycles.eq(0), frame_end.eq(timer)]
            with m.If(frame_cycles >= frame_max):
                m.d.sync += frame_max.eq(frame_cycles + 1)
        with m.Elif((in_frame | (self.beat_offered & self.frame_first)) & (frame_cycles < (1 << COUNTER_BITS) - 2)):
            m.d.sync += [in_frame.eq(1), frame_cycles.eq(frame_cycles + 1)]
        # Windows are decided in order; at most two wait and one is computed, so four stamps are enough.
        stamps = Array(Signal(COUNTER_BITS, name=f"stamp_{k}") for k in range(4))
        newest, oldest = Signal(2), Signal(2)
        with m.If(self.slot_filled):
            m.d.sync += [stamps[newest].eq(frame_end), newest.eq(newest + 1)]
        offered_before, decided = Signal(), Signal()
        m.d.sync += offered_before.eq(self.decision_offered)
        m.d.comb += decided.eq(self.decision_offered & ~offered_before)
        latency = Signal(COUNTER_BITS)
        m.d.comb += latency.eq(timer - stamps[oldest])
        with m.If(decided):
            m.d.sync += oldest.eq(oldest + 1)
            with m.If(latency > latency_max):
                m.d.sync += latency_max.eq(latency)
        step_issue, draining, drain = Signal(COUNTER_BITS), Signal(), Signal(COUNTER_BITS)
        m.d.comb += self.step_total.eq(step_issue + drain)
        with m.If(self.step_done):
            m.d.sync += [step_issue.eq(self.step_slots * slot_cycles(self._config)), draining.eq(1), drain.eq(0)]
        with m.Elif(draining):
            m.d.sync += drain.eq(drain + 1)
            with m.If(decided):
                m.d.sync += draining.eq(0)
                m.d.comb += self.step_counted.eq(1)
                with m.If(self.step_total > step_max):
                    m.d.sync += step_max.eq(self.step_total)

        # ---------------------------------------------------------------- registers
        faults = Signal(4)
        seen = Cat(write_data & touch, self.beat_offered & self.frame_first & ~self.frame_beat, self.framing_fault, self.engine_overrun)
        m.d.sync += faults.eq(faults | seen)
        masks = []
        for base in range(0, self._config.taxels, 16):
            at_reset = sum(1 << taxel - base for taxel in self._config.masked_taxels if base <= taxel < base + 16)
            masks.append(Signal(min(16, self._config.taxels - base), name=f"mask_{base}", init=at_reset))
        m.d.comb += self.mask.eq(Cat(*masks))
        with m.If(bus.w_stb), m.Switch(bus.addr):
            with m.Case(Register.CONTROL):
                with m.If((bus.w_data & Command.ARM).any()):
                    m.d.comb += self.clear.eq(1)
                    per_recording = (touch, touches, finishing, finished, draining, newest, oldest, in_frame, frame_cycles)
                    m.d.sync += [signal.eq(0) for signal in per_recording]
                with m.If((bus.w_data & Command.FINISH).any()):
                    m.d.sync += finishing.eq(1)
                with m.If((bus.w_data & Command.CLEAR_FAULTS).any()):
                    m.d.sync += [faults.eq(0), frame_max.eq(0), step_max.eq(0), latency_max.eq(0)]
            with m.Case(Register.MEMORY_SELECT):
                m.d.sync += select.eq(bus.w_data)
            with m.Case(Register.MEMORY_ADDRESS):
                m.d.sync += address.eq(bus.w_data)
            for k, mask in enumerate(masks):
                with m.Case(Register.MASK + k):
                    m.d.sync += mask.eq(bus.w_data)
        status = Cat(self.detector_armed, touch, self.busy, touches == 0)
        readable = {
            Register.ID: ID_VALUE, Register.VERSION: VERSION_VALUE, Register.STATUS: status, Register.FAULTS: faults,
            Register.TOUCHES: touches, Register.FRAME_CYCLES_MAX: frame_max, Register.STEP_CYCLES_MAX: step_max,
            Register.LATENCY_MAX: latency_max, Register.MEMORY_SELECT: select, Register.MEMORY_ADDRESS: address,
            **{Register.MASK + k: mask for k, mask in enumerate(masks)},
        }  # fmt: skip
        with m.If(bus.r_stb):
            m.d.sync += bus.r_data.eq(0)
            with m.Switch(bus.addr):
                for number, value in readable.items():
                    with m.Case(int(number)):
                        m.d.sync += bus.r_data.eq(value)
        return m
