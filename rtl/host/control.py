"""The host's side: registers, commands, memory loading, faults and cycle counters."""

from typing import Any, Literal

from amaranth.hdl import Cat, Const, Module, Mux, Signal
from amaranth.lib import wiring

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import (
    ENGINE,
    FRAMES,
    TEACHING,
    detector_status,
    drive,
    forward,
    has_door,
    inputs,
    load_signature,
    outputs,
    parity_wrong,
)
from eskin.rtl.host.cycle_counter import CycleCounter
from eskin.rtl.host.memory_loader import MemoryLoader
from eskin.rtl.host.recording_state import RecordingState
from eskin.rtl.program.memory_map import (
    ID_VALUE,
    VERSION_VALUE,
    Fault,
    Measure,
    Register,
    TeachRegister,
    mapped,
    mask_words,
)
from eskin.rtl.program.memory_map import Control as Command

FedBy = Literal["cpu", "sensor"]
"""Sender of the frames of an accelerator behind a bus shell."""


def bus_signature() -> wiring.Signature:
    """The host bus, seen from the host: write ``w_data`` to ``addr`` with ``w_stb``, read it with ``r_stb``;
    ``r_data`` one cycle later."""
    return wiring.Signature(outputs(addr=8, w_data=16, w_stb=1, r_stb=1) | inputs(r_data=16))


class HostControl(wiring.Component):
    """Registers of rtl/program/memory_map.py, and the life of a recording: arm, frames, finish.

    Parameters
    ----------
    fed_by:
        For a design behind a bus shell. A CPU's pauses are not INPUT_STALLED.

    Members
    -------
    any_fault : Out(1), only with ``fed_by``
        A bit of FAULTS is set.
    bus : In
        One access a cycle.
    clear : Out(1)
        Synchronous reset of the datapath for one cycle, the cycle after ``arm`` was written.
    restart : Out(1)
        Synchronous reset of the engine: with ``clear``, and in the cycle after a memory word was written. The
        write may make stale what the engine has computed ahead of its next step.
    finish : Out(1)
        Pulse once everything in flight has been decided after the command.
    every : Out(1), only where frames have a door
        Output of `FrameDoor`, from ``clear`` on.
    load : Out
        Memory writes. They are refused and flagged from the second cycle of an open touch on; before its
        first window is whole, nothing reads what they change.
    mask : Out(taxels)
        Bit set: taxel out of use.
    frames : In(FRAMES), detector : In(detector_status), engine : In(ENGINE)
        Of `eskin.rtl.common.status`.
    teaching : Out(TEACHING), only with taught places
        Register TAUGHT shows its ``in_use``; its ``place`` is a word of PLACES, read from 2 cycles after the access to
        it before.
    passing, moving : In(1)
        As of `RecordingState`.
    global_taken, decider_idle : In(1)
        A touch's last decision is taken; the classifier is idle.
    check_failed : In(1)
        A word of a memory is wrong (``checksum``).
    hung : In(1)
        The chain hangs (``watchdog``): cleared as at ``arm``.
    anew : In(1)
        The engine begins anew, beside ``restart`` (``watchdog``).
    due : Out(1)
        The recording is being finished, or the detector's touch and the touch whose decision is due are not the
        same (``watchdog``).
    busy : Out(1)
        As of `RecordingState`.
    awake : Out(1)
        Work, an access or a count is under way; otherwise the clock may stop (``clock_gate``).

    Parts: `RecordingState`, `MemoryLoader` and `CycleCounter` (register ``MEASURE`` names what it counts).
    """

    def __init__(self, config: AcceleratorConfig, fed_by: FedBy | None = None):
        self._config, self._fed_by = config, fed_by
        super().__init__(
            inputs(
                "passing",
                "moving",
                "global_taken",
                "decider_idle",
                "check_failed",
                "hung",
                "anew",
                bus=bus_signature(),
                frames=FRAMES,
                detector=detector_status(config),
                engine=ENGINE,
            )
            | outputs(
                "clear",
                "restart",
                "finish",
                "busy",
                "due",
                "awake",
                load=load_signature(config),
                mask=config.sensor.taxels,
            )
            | (outputs("any_fault") if fed_by else {})
            | (outputs("every") if has_door(config) else {})
            | (outputs(teaching=TEACHING) if config.readout_rule.taught else {})
        )

    def elaborate(self, platform):
        m = Module()
        config, bus, frames = self._config, self.bus, self.frames
        m.submodules.state = state = self.state = RecordingState(config)
        m.submodules.loader = loader = self.loader = MemoryLoader(config)
        m.submodules.cycles = cycles = CycleCounter()
        forward(m, self, loader, "load")
        forward(m, self, cycles, "clear", "frames", "engine")
        forward(m, self, state, "clear", "detector", "engine", "passing", "global_taken", "decider_idle")
        forward(m, self, state, "finish", "busy", "due")
        # (Registered, as both reach every block.)
        arm = Signal()
        measured = Signal()
        forgotten = Signal()
        m.d.sync += [self.clear.eq(arm | self.hung), self.restart.eq(arm | self.hung | self.load.enable)]
        touch = state.touch
        measure = Signal(2)
        begun = bus.w_stb | self.clear | self.restart | ~self.decider_idle
        awake = bus.w_stb | bus.r_stb | state.busy | cycles.awake
        m.d.comb += [
            state.moving.eq(self.moving | (begun if config.hardware.clock_gate else 0)),
            self.awake.eq(awake | self.teaching.look if config.readout_rule.taught else awake),
        ]
        drive(
            m,
            loader,
            data=bus.w_data,
            written=bus.w_stb & (bus.addr == Register.MEMORY_DATA),
            locked=touch | ~self.decider_idle if config.readout_rule.taught else touch,
        )
        # an engine that begins anew issues slots of its next step again
        again = (self.restart | self.anew) & (measure == Measure.STEP)
        drive(m, cycles, measure=measure, anew=measured | again, forget=measured | forgotten)

        wrong = []  # configuration registers with the wrong parity
        known = Signal()
        with m.Switch(bus.addr), m.Case(*mapped(config)):
            m.d.comb += known.eq(1)
        events = {
            Fault.WRITE_REFUSED: loader.refused,
            Fault.INPUT_STALLED: frames.offered & frames.first & ~frames.taken,
            Fault.FRAMING: self.detector.framing_fault,
            Fault.OVERRUN: self.engine.overrun,
            Fault.ADDRESS: (bus.w_stb | bus.r_stb) & ~known,
        }
        masks = []
        for k, at_reset in enumerate(mask_words(config)):
            masks.append(Signal(min(16, config.sensor.taxels - 16 * k), name=f"mask_{16 * k}", init=at_reset))
        m.d.comb += self.mask.eq(Cat(*masks))
        if config.hardware.checksum:
            registers = {Register.MEASURE: measure} | {
                Register.MASK + k: mask for k, mask in enumerate(masks)
            }
            wrong = [
                parity_wrong(m, value, bus.w_stb & (bus.addr == number), bus.w_data)
                for number, value in registers.items()
            ]
        if config.hardware.checksum or config.hardware.watchdog:
            events |= {Fault.CHECKSUM: Cat(self.check_failed, *wrong).any(), Fault.WATCHDOG: self.hung}
        if config.faults.fault_frames:
            events[Fault.TAXEL] = self.detector.raised
        if self._fed_by == "cpu":
            del events[Fault.INPUT_STALLED]
        sticky = Signal(len(events))
        faults = Signal(len(Fault))
        bits = self.bits = dict(zip(events, sticky, strict=True))
        m.d.sync += sticky.eq(sticky | Cat(*events.values()))
        m.d.comb += faults.eq(Cat(bits.get(fault, Const(0, 1)) for fault in Fault))
        if self._fed_by:
            m.d.comb += self.any_fault.eq(sticky.any())
        with m.If(bus.w_stb), m.Switch(bus.addr):
            with m.Case(Register.CONTROL):
                m.d.comb += [
                    arm.eq((bus.w_data & Command.ARM).any()),
                    state.finish_asked.eq((bus.w_data & Command.FINISH).any()),
                ]
                if has_door(config):
                    with m.If(arm):
                        m.d.sync += self.every.eq((bus.w_data & Command.EVERY).any())
                with m.If((bus.w_data & Command.CLEAR_FAULTS).any()):
                    m.d.comb += forgotten.eq(1)
                    m.d.sync += sticky.eq(0)
            with m.Case(Register.MEASURE):
                m.d.comb += measured.eq(1)
                m.d.sync += measure.eq(bus.w_data)
            with m.Case(Register.MEMORY_SELECT):
                m.d.comb += loader.chosen.eq(1)
            for k, mask in enumerate(masks):
                with m.Case(Register.MASK + k):
                    m.d.sync += mask.eq(bus.w_data)
        status = Cat(self.detector.armed, touch, self.busy, ~state.touched, faults[4:6].any())
        readable: dict[int, Any] = {
            Register.ID: ID_VALUE,
            Register.VERSION: VERSION_VALUE,
            Register.STATUS: status,
            Register.FAULTS: faults,
            Register.LONGEST: cycles.longest,
            Register.TOUCHES: state.touches,
        }
        if config.faults.fault_frames:
            readable |= {Register.TAXEL_FAULTS + k: self.detector.flags[16 * k :] for k in range(len(masks))}
        if config.readout_rule.taught:
            teaching = self.teaching
            refused = Signal()
            odd = Signal(name="taught_odd")
            fresh = self.fresh = Signal()
            given = self.given = Signal()
            at_places = bus.addr == TeachRegister.PLACES
            looks = bus.r_stb & at_places
            m.d.sync += [refused.eq((refused & ~forgotten) | teaching.refused), odd.eq(odd ^ teaching.done)]
            # the memory is read ahead; what comes between, a touch or a write, makes that stale
            m.d.sync += [
                teaching.look.eq(loader.seek | loader.onward),
                fresh.eq((fresh | teaching.look) & ~(loader.locked | bus.w_stb)),
            ]
            drive(
                m,
                teaching,
                teach=bus.w_stb & (bus.addr == TeachRegister.TEACH),
                forget=bus.w_stb & (bus.addr == TeachRegister.FORGET),
            )
            m.d.comb += [
                Cat(teaching.label, teaching.option, teaching.loaded).eq(bus.w_data),
                teaching.locked.eq(touch),
                given.eq(fresh & ~teaching.look & ~loader.locked),
            ]
            drive(m, loader, seek=bus.w_stb & at_places, onward=looks & given)
            readable |= {
                TeachRegister.TAUGHT: Cat(teaching.in_use, refused, odd),
                TeachRegister.PLACES: Mux(given, Cat(teaching.place, loader.load.address), 0xFFFF),
            }
        with m.If(bus.r_stb):
            m.d.sync += bus.r_data.eq(0)
            with m.Switch(bus.addr):
                for number, value in readable.items():
                    with m.Case(int(number)):
                        m.d.sync += bus.r_data.eq(value)
        return m
