"""The host's side: registers, commands, memory loading, faults and cycle counters."""

from __future__ import annotations

from amaranth.hdl import Cat, Const, Module, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from eskin.golden.core.config import AcceleratorConfig
from eskin.rtl.common.load_port import load_lines, load_signature
from eskin.rtl.common.register_check import at_end, parity_wrong
from eskin.rtl.program.memory_map import ID_VALUE, VERSION_VALUE, Fault, Measure, Register, load_words, mapped, mask_words
from eskin.rtl.program.memory_map import Control as Command

COUNTER_BITS = 16


def bus_signature() -> wiring.Signature:
    """The host bus, seen from the host: write ``w_data`` to ``addr`` with ``w_stb``, read it with ``r_stb``; ``r_data`` one cycle later."""
    return wiring.Signature({"addr": Out(8), "w_data": Out(16), "w_stb": Out(1), "r_stb": Out(1), "r_data": In(16)})


class HostControl(wiring.Component):
    """Registers of rtl/program/memory_map.py, and the life of a recording: arm, frames, finish.

    Members
    -------
    bus : In
        One access a cycle.
    clear : Out(1)
        Synchronous reset of the datapath for one cycle, the one after ``arm`` was written.
    restart : Out(1)
        Synchronous reset of the engine: with ``clear``, and in the cycle after a memory word was written, which may make stale what the
        engine has computed ahead of its next step.
    finish : Out(1)
        Pulse once everything in flight has been decided after the command.
    load : Out
        Memory writes; refused (and flagged) while a touch is open, from the second cycle on: until its first window is whole nobody reads
        what they change.
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
        Of `FaultDetector`: what the registers TAXEL_FAULTS show, while no frame is under way; a fault.
    slot_done, step_done : In(1)
        A slot of a step, a step ends with this cycle.
    global_taken, decider_idle : In(1)
        A touch's last decision is taken; the classifier is idle.
    check_failed : In(1)
        A word of a memory is wrong (``checksum``).
    hung : In(1)
        The chain hangs (``watchdog``): cleared as at ``arm``.
    due : Out(1)
        The recording is being finished, or the detector's touch and the one whose decision is due are not the same (``watchdog``).
    detector_touch : In(1)
    busy : Out(1)
        A frame, sum, step, decision or command is in flight.

    One counter measures what ``MEASURE`` names and keeps the longest; it saturates at 65535.
    """

    def __init__(self, config: AcceleratorConfig) -> None:
        self._config = config
        inputs = (
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
                **{name: In(1) for name in inputs},
                **({"flags": In(config.sensor.taxels), "raised": In(1)} if config.faults.fault_frames else {}),
            }
        )

    def elaborate(self, platform):
        m = Module()
        bus = self.bus

        # ---------------------------------------------------------------- life of a recording
        # Touches begun and not yet decided. More than one where decisions are not taken: the next touch begins while the last one's
        # decision waits. At most 4: at the classifier, in the engine's two buffers, on the way into them.
        undecided = Signal(3)
        touch, touched, finishing, finished = Signal(), Signal(), Signal(), Signal()
        touches = Signal(8)
        # A beat spends at most a few cycles between the offers that `moving` sees: quiet for 15 cycles means nothing is under way.
        quiet = Signal(4, init=15)
        # (Registered, like the events below: they come at the end of long ways through the blocks.)
        moving = Signal()
        m.d.sync += [moving.eq(self.moving | self.engine_busy), quiet.eq(quiet + ~quiet.all())]
        with m.If(moving):
            m.d.sync += quiet.eq(0)
        idle = Signal()
        m.d.comb += [
            idle.eq(quiet.all() & ~moving & self.decider_idle),
            self.finish.eq(finishing & ~finished & idle),
            self.busy.eq(~idle | finishing | self.clear),
        ]
        m.d.sync += touches.eq(touches + self.touch_started)
        decided = self.global_taken & undecided.any()
        # (`touch` is registered, as it decides on writes.)
        m.d.sync += [
            touched.eq(touched | self.touch_started),
            undecided.eq(undecided + self.touch_started - decided),
            touch.eq(undecided.any()),
        ]
        watched: tuple[Signal, ...] = ()
        if self._config.hardware.watchdog:
            (over,) = watched = (Signal(name="over"),)
            with m.If(self.finish):
                m.d.sync += over.eq(1)
            apart = touch & ~self.detector_touch if self._config.opens_at_once else touch ^ self.detector_touch
            m.d.comb += self.due.eq(finishing | (apart & ~over))
        with m.If(self.finish):
            m.d.sync += finished.eq(1)
        with m.Elif(finished & idle):  # the partial decision, if there was one, is out
            m.d.sync += [finishing.eq(0), finished.eq(0), undecided.eq(0)]

        # ---------------------------------------------------------------- memory loading
        lane_bits = max(2, (self._config.hardware.lanes - 1).bit_length())  # the other memories are told apart by two
        lines = load_lines(self._config)
        select = Signal(len(lines), init=1)  # one line a memory: decoded as it is chosen, not as it is written
        address = Signal(range(load_words(self._config) + self._config.hardware.checksum))
        write_data, refused = Signal(), Signal()
        m.d.comb += [
            write_data.eq(bus.w_stb & (bus.addr == Register.MEMORY_DATA)),
            refused.eq(touch),
            self.load.enable.eq(write_data & ~refused & int(self._config.hardware.loadable)),
            self.load.select.eq(select),
            self.load.address.eq(address),
            self.load.data.eq(bus.w_data),
        ]
        if self._config.hardware.checksum:
            behind = at_end(self._config, select, address)
            m.d.comb += refused.eq(touch | behind)
        m.d.sync += address.eq(address + self.load.enable)

        # ---------------------------------------------------------------- cycles
        measure = Signal(2)
        in_frame = Signal()
        frame_open = in_frame | (self.beat_offered & self.frame_first)
        frame_taken = self.frame_beat & self.frame_last
        m.d.sync += in_frame.eq(frame_open & ~frame_taken)
        counting, ending, counts, ends = Signal(), Signal(), Signal(), Signal()
        m.d.sync += [counts.eq(counting), ends.eq(ending)]
        with m.Switch(measure):
            with m.Case(Measure.FRAME):
                m.d.comb += [counting.eq(frame_open), ending.eq(frame_taken)]
            with m.Case(Measure.STEP):
                m.d.comb += [counting.eq(self.slot_done), ending.eq(self.step_done)]
            with m.Default():
                m.d.comb += [counting.eq(self.windows_open), ending.eq(~self.windows_open)]
        # The longest grows with the current one as soon as that is as long: no comparison of sizes, no copy.
        elapsed, longest = Signal(COUNTER_BITS), Signal(COUNTER_BITS)
        # (Adding a bit, here and below, takes one cell a bit where an addition under a condition takes two.)
        m.d.sync += [elapsed.eq(elapsed + counts), longest.eq(longest + (counts & (elapsed == longest) & ~longest.all()))]
        with m.If(ends):
            m.d.sync += elapsed.eq(0)

        # ---------------------------------------------------------------- registers
        wrong = []  # configuration registers with the wrong parity
        known = Signal()
        with m.Switch(bus.addr), m.Case(*mapped(self._config)):
            m.d.comb += known.eq(1)
        seen = {
            Fault.WRITE_REFUSED: write_data & refused,
            Fault.INPUT_STALLED: self.beat_offered & self.frame_first & ~self.frame_beat,
            Fault.FRAMING: self.framing_fault,
            Fault.OVERRUN: self.engine_overrun,
            Fault.ADDRESS: (bus.w_stb | bus.r_stb) & ~known,
        }
        masks = []
        for k, at_reset in enumerate(mask_words(self._config)):
            masks.append(Signal(min(16, self._config.sensor.taxels - 16 * k), name=f"mask_{16 * k}", init=at_reset))
        m.d.comb += self.mask.eq(Cat(*masks))
        if self._config.hardware.checksum:
            registers = {Register.MEASURE: measure} | {Register.MASK + k: mask for k, mask in enumerate(masks)}
            wrong = [parity_wrong(m, value, bus.w_stb & (bus.addr == number), bus.w_data) for number, value in registers.items()]
        if self._config.hardware.checksum or self._config.hardware.watchdog:
            seen |= {Fault.CHECKSUM: Cat(self.check_failed, *wrong).any(), Fault.WATCHDOG: self.hung}
        if self._config.faults.fault_frames:
            seen[Fault.TAXEL] = self.raised
        sticky, faults = Signal(len(seen)), Signal(len(Fault))
        bits = dict(zip(seen, sticky, strict=True))
        m.d.sync += sticky.eq(sticky | Cat(*seen.values()))
        m.d.comb += faults.eq(Cat(bits.get(fault, Const(0, 1)) for fault in Fault))
        # (Registered, as both reach every block.)
        arm = Signal()
        m.d.sync += [self.clear.eq(arm | self.hung), self.restart.eq(arm | self.hung | self.load.enable)]
        with m.If(self.clear):
            per_recording = (undecided, touch, touched, touches, finishing, finished, in_frame, counts, elapsed, *watched)
            m.d.sync += [signal.eq(0) for signal in per_recording]
        with m.If(bus.w_stb), m.Switch(bus.addr):
            with m.Case(Register.CONTROL):
                m.d.comb += arm.eq((bus.w_data & Command.ARM).any())
                with m.If((bus.w_data & Command.FINISH).any()):
                    m.d.sync += finishing.eq(1)
                with m.If((bus.w_data & Command.CLEAR_FAULTS).any()):
                    m.d.sync += [sticky.eq(0), longest.eq(0)]
            with m.Case(Register.MEASURE):
                m.d.sync += [measure.eq(bus.w_data), counts.eq(0), elapsed.eq(0), longest.eq(0)]
            with m.Case(Register.MEMORY_SELECT):
                m.d.sync += address.eq(0)
                for number, line in lines.items():
                    lane, special = number & (1 << lane_bits) - 1, number >> 6
                    m.d.sync += select[line].eq((bus.w_data[:lane_bits] == lane) & (bus.w_data[6] == special))
            for k, mask in enumerate(masks):
                with m.Case(Register.MASK + k):
                    m.d.sync += mask.eq(bus.w_data)
        status = Cat(self.detector_armed, touch, self.busy, ~touched, faults[4:6].any())
        readable = {
            Register.ID: ID_VALUE,
            Register.VERSION: VERSION_VALUE,
            Register.STATUS: status,
            Register.FAULTS: faults,
            Register.LONGEST: longest,
            Register.TOUCHES: touches,
        }
        if self._config.faults.fault_frames:
            readable |= {Register.TAXEL_FAULTS + k: self.flags[16 * k :][:16] for k in range(len(masks))}
        with m.If(bus.r_stb):
            m.d.sync += bus.r_data.eq(0)
            with m.Switch(bus.addr):
                for number, value in readable.items():
                    with m.Case(int(number)):
                        m.d.sync += bus.r_data.eq(value)
        return m
