"""The host's side: registers, commands, memory loading, faults and cycle counters."""

from typing import Any, Literal

from amaranth.hdl import Cat, Const, Module, Mux, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common.layouts import has_door
from eskin.rtl.common.load_port import load_signature
from eskin.rtl.common.register_check import parity_wrong
from eskin.rtl.host.cycle_counter import CycleCounter
from eskin.rtl.host.memory_loader import MemoryLoader
from eskin.rtl.host.recording_state import RecordingState
from eskin.rtl.program.memory_map import (
    ID_VALUE,
    VERSION_VALUE,
    Fault,
    Register,
    TeachRegister,
    mapped,
    mask_words,
)
from eskin.rtl.program.memory_map import Control as Command

INPUTS = (
    "frame_beat",
    "beat_offered",
    "frame_first",
    "frame_last",
    "detector_armed",
    "touch_started",
    "framing_fault",
    "moving",
    "engine_busy",
    "engine_overrun",
    "windows_open",
    "slot_done",
    "step_done",
    "global_taken",
    "decider_idle",
    "check_failed",
    "hung",
    "detector_touch",
)
"""Status bits from the other blocks."""


TEACHING = {"teach": 1, "forget": 1, "label": 7, "option": 1, "loaded": 1, "locked": 1, "look": 1}
"""Commands of a readout that is taught (`eskin.rtl.decision.prototype_readout`)."""


FedBy = Literal["cpu", "sensor"]
"""Sender of the frames of an accelerator behind a bus shell."""


def bus_signature() -> wiring.Signature:
    """The host bus, seen from the host: write ``w_data`` to ``addr`` with ``w_stb``, read it with ``r_stb``;
    ``r_data`` one cycle later."""
    return wiring.Signature(
        {"addr": Out(8), "w_data": Out(16), "w_stb": Out(1), "r_stb": Out(1), "r_data": In(16)}
    )


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
        Synchronous reset of the datapath for one cycle, the one after ``arm`` was written.
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
    frame_beat, beat_offered, frame_first, frame_last : In(1)
        Input beat taken; offered; its first and last flags.
    detector_armed, touch_started, framing_fault : In(1)
    moving : In(1)
        Anything between input and engine offers a beat.
    engine_busy, engine_overrun : In(1)
    windows_open : In(1)
        A window waits or is computed.
    flags : In(taxels), raised : In(1), only with ``fault_frames``
        Outputs of `FaultDetector`: the content of the registers TAXEL_FAULTS while no frame is under way; a fault.
    slot_done, step_done : In(1)
        A slot of a step, a step ends with this cycle.
    global_taken, decider_idle : In(1)
        A touch's last decision is taken; the classifier is idle.
    check_failed : In(1)
        A word of a memory is wrong (``checksum``).
    hung : In(1)
        The chain hangs (``watchdog``): cleared as at ``arm``.
    teach, forget, label, option, loaded, locked, look : Out, only with taught places
        As of the readout; teaching_refused, teaching_done : In(1), taught : In(8): what register TAUGHT shows;
        place : In(9): a word of PLACES, read from 2 cycles after the access to it before.
    due : Out(1)
        The recording is being finished, or the detector's touch and the one whose decision is due are not the
        same (``watchdog``).
    detector_touch : In(1)
    busy : Out(1)
        A frame, sum, step, decision or command is in flight.
    awake : Out(1)
        Work, an access or a count is under way; otherwise the clock may stop (``clock_gate``).

    Parts: `RecordingState`, `MemoryLoader` and `CycleCounter` (register ``MEASURE`` names what it counts).
    """

    def __init__(self, config: AcceleratorConfig, fed_by: FedBy | None = None) -> None:
        self._config, self._fed_by = config, fed_by
        super().__init__(
            {
                "bus": In(bus_signature()),
                "clear": Out(1),
                "restart": Out(1),
                "finish": Out(1),
                "load": Out(load_signature(config)),
                "mask": Out(config.sensor.taxels),
                "busy": Out(1),
                "due": Out(1),
                "awake": Out(1),
                **{name: In(1) for name in INPUTS},
                **({"any_fault": Out(1)} if fed_by else {}),
                **({"every": Out(1)} if has_door(config) else {}),
                **(
                    {name: Out(width) for name, width in TEACHING.items()}
                    | {"teaching_refused": In(1), "teaching_done": In(1), "taught": In(8), "place": In(9)}
                    if config.readout_rule.taught
                    else {}
                ),
                **(
                    {"flags": In(config.sensor.taxels), "raised": In(1)} if config.faults.fault_frames else {}
                ),
            }
        )

    def elaborate(self, platform):
        m = Module()
        config, bus = self._config, self.bus
        m.submodules.state = state = self.state = RecordingState(config)
        m.submodules.loader = loader = self.loader = MemoryLoader(config)
        m.submodules.cycles = cycles = CycleCounter()
        wiring.connect(m, loader.load, wiring.flipped(self.load))
        # (Registered, as both reach every block.)
        arm = Signal()
        measured = Signal()
        forgotten = Signal()
        m.d.sync += [self.clear.eq(arm | self.hung), self.restart.eq(arm | self.hung | self.load.enable)]
        touch = state.touch
        measure = Signal(2)
        # The clock must not stop before the effects of a command or of a decision's end have reached every
        # block.
        begun = bus.w_stb | self.clear | self.restart | ~self.decider_idle
        lingers = Signal()  # the edge after busy fell, at which what depends on it settles
        if config.hardware.clock_gate:
            m.d.sync += lingers.eq(state.busy)
        awake = bus.w_stb | bus.r_stb | state.busy | lingers | cycles.counts
        m.d.comb += [
            state.clear.eq(self.clear),
            *(
                getattr(state, name).eq(getattr(self, name))
                for name in ("engine_busy", "touch_started", "global_taken")
            ),
            *(getattr(state, name).eq(getattr(self, name)) for name in ("decider_idle", "detector_touch")),
            state.moving.eq(self.moving | (begun if config.hardware.clock_gate else 0)),
            self.awake.eq(awake | self.look if config.readout_rule.taught else awake),
            *(getattr(self, name).eq(getattr(state, name)) for name in ("finish", "busy", "due")),
            loader.data.eq(bus.w_data),
            loader.written.eq(bus.w_stb & (bus.addr == Register.MEMORY_DATA)),
            loader.locked.eq(touch | ~self.decider_idle if config.readout_rule.taught else touch),
            cycles.measure.eq(measure),
            cycles.clear.eq(self.clear),
            cycles.anew.eq(measured),
            cycles.forget.eq(measured | forgotten),
            cycles.offered.eq(self.beat_offered),
            cycles.first.eq(self.frame_first),
            cycles.taken.eq(self.frame_beat),
            cycles.last.eq(self.frame_last),
            *(
                getattr(cycles, name).eq(getattr(self, name))
                for name in ("slot_done", "step_done", "windows_open")
            ),
        ]

        wrong = []  # configuration registers with the wrong parity
        known = Signal()
        with m.Switch(bus.addr), m.Case(*mapped(config)):
            m.d.comb += known.eq(1)
        events = {
            Fault.WRITE_REFUSED: loader.refused,
            Fault.INPUT_STALLED: self.beat_offered & self.frame_first & ~self.frame_beat,
            Fault.FRAMING: self.framing_fault,
            Fault.OVERRUN: self.engine_overrun,
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
            events[Fault.TAXEL] = self.raised
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
                m.d.comb += arm.eq((bus.w_data & Command.ARM).any())
                m.d.comb += state.finish_asked.eq((bus.w_data & Command.FINISH).any())
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
        status = Cat(self.detector_armed, touch, self.busy, ~state.touched, faults[4:6].any())
        readable: dict[int, Any] = {
            Register.ID: ID_VALUE,
            Register.VERSION: VERSION_VALUE,
            Register.STATUS: status,
            Register.FAULTS: faults,
            Register.LONGEST: cycles.longest,
            Register.TOUCHES: state.touches,
        }
        if config.faults.fault_frames:
            readable |= {Register.TAXEL_FAULTS + k: self.flags[16 * k :][:16] for k in range(len(masks))}
        if config.readout_rule.taught:
            refused = Signal()
            odd = Signal(name="taught_odd")
            fresh = self.fresh = Signal()
            given = self.given = Signal()
            at_places = bus.addr == TeachRegister.PLACES
            asked = bus.r_stb & at_places
            m.d.sync += [
                refused.eq((refused & ~forgotten) | self.teaching_refused),
                odd.eq(odd ^ self.teaching_done),
            ]
            # the memory is read ahead; what comes between, a touch or a write, makes that stale
            m.d.sync += [
                self.look.eq(loader.seek | loader.onward),
                fresh.eq((fresh | self.look) & ~(loader.locked | bus.w_stb)),
            ]
            m.d.comb += [
                self.teach.eq(bus.w_stb & (bus.addr == TeachRegister.TEACH)),
                self.forget.eq(bus.w_stb & (bus.addr == TeachRegister.FORGET)),
                Cat(self.label, self.option, self.loaded).eq(bus.w_data),
                self.locked.eq(touch),
                given.eq(fresh & ~self.look & ~loader.locked),
                loader.seek.eq(bus.w_stb & at_places),
                loader.onward.eq(asked & given),
            ]
            readable |= {
                TeachRegister.TAUGHT: Cat(self.taught, refused, odd),
                TeachRegister.PLACES: Mux(given, Cat(self.place, loader.load.address[:7]), 0xFFFF),
            }
        with m.If(bus.r_stb):
            m.d.sync += bus.r_data.eq(0)
            with m.Switch(bus.addr):
                for number, value in readable.items():
                    with m.Case(int(number)):
                        m.d.sync += bus.r_data.eq(value)
        return m
