"""A recording as the host sees it: touches that await their decision, and how the recording finishes."""

from amaranth.hdl import Cat, Module, Signal
from amaranth.lib.wiring import In

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import ENGINE, Block, detector_status, drive, inputs, outputs

QUIET_CYCLES = 2
"""Cycles without a beat after which everything that follows a beat that ``moving`` sees is over."""


class RecordingState(Block):
    """Counts the touches without a decision, and finishes the recording once nothing is under way.

    Members
    -------
    clear : In(1)
        The next recording begins.
    finish_asked : In(1)
        The host has sent all frames; wins over ``clear`` in the same cycle.
    detector : In(detector_status), engine : In(ENGINE)
    passing : In(1)
        A beat is offered at the input, or is on its way to the windows; nothing changes after it.
    moving : In(1)
        A sum is on its way to the engine, or (``clock_gate``) a command to its block; what it changes is settled
        3 cycles later.
    global_taken, decider_idle : In(1)
        A touch's last decision is taken; the classifier is idle.
    finish : Out(1)
        Pulse once everything in flight has been decided after ``finish_asked``.
    busy : Out(1)
        A frame, sum, step, decision or command is in flight. Otherwise nothing changes that is read later, except
        what the walk of ``checksum`` checks next and, without ``clock_gate``, what follows a command: it is low
        in the cycle after ``clear``, before the engine begins.
    touch : Out(1)
        A touch is undecided; known a cycle late.
    touched, touches : Out
        There was a touch; how many, modulo 256.
    due : Out(1)
        With ``watchdog``: the recording is being finished, or the detector's touch and the touch whose decision
        is due are not the same.
    """

    def ports(self, config: AcceleratorConfig):
        status = {"detector": In(detector_status(config)), "engine": In(ENGINE)}
        return (
            inputs("clear", "finish_asked", "passing", "moving", "global_taken", "decider_idle")
            | outputs("finish", "busy", "touch", "touched", "due", touches=8)
            | status
        )

    def elaborate(self, platform):
        m = Module()
        # More than one touch is undecided where decisions are not taken: the next begins while the last one's
        # decision waits. At most 4: at
        # the classifier, in the engine's two buffers, on the way into them.
        undecided = self.undecided = Signal(3)
        finishing = self.finishing = Signal()
        finished = self.finished = Signal()
        quiet = Signal(QUIET_CYCLES)
        # (Registered, like the events below: they come at the end of long ways through the blocks.)
        moving = Signal()
        idle = Signal()
        m.d.sync += [
            moving.eq(self.moving | self.engine.working | (finishing & self.passing)),
            quiet.eq(Cat(1, quiet[:-1])),
        ]
        # (What a command changes follows the beats that are on their way. FINISH waits as after a beat: one may
        # have come in the same cycle.)
        late = self.passing & ~quiet.all() & self.spec.hardware.clock_gate
        # (A touch of ``window_mode`` whole that FINISH ends is still to come out.)
        with m.If(moving | self.finish_asked | late | (self.finish & self.spec.follows_touch)):
            m.d.sync += quiet.eq(0)
        m.d.comb += idle.eq(quiet.all() & ~moving & self.decider_idle)
        drive(
            m,
            self,
            finish=finishing & ~finished & idle,
            busy=~idle | self.passing | finishing | self.clear | (undecided.any() ^ self.touch),
        )
        decided = self.global_taken & undecided.any()
        # (`touch` is registered, as it decides on writes.)
        m.d.sync += [
            self.touches.eq(self.touches + self.detector.started),
            self.touched.eq(self.touched | self.detector.started),
            undecided.eq(undecided + self.detector.started - decided),
            self.touch.eq(undecided.any()),
        ]
        per_recording = [undecided, self.touch, self.touched, self.touches, finishing, finished]
        if self.spec.hardware.watchdog:
            over = Signal()
            per_recording.append(over)
            with m.If(self.finish):
                m.d.sync += over.eq(1)
            apart = (
                self.touch & ~self.detector.touch
                if self.spec.opens_at_once
                else self.touch ^ self.detector.touch
            )
            m.d.comb += self.due.eq(finishing | (apart & ~over))
        with m.If(self.finish):
            m.d.sync += finished.eq(1)
        with m.If(finished & idle):  # the partial decision, if there was one, is out
            m.d.sync += [finishing.eq(0), finished.eq(0), undecided.eq(0)]
        with m.If(self.clear):
            m.d.sync += [signal.eq(0) for signal in per_recording]
        with m.If(self.finish_asked):
            m.d.sync += finishing.eq(1)
        return m
