"""ARMED, TOUCH, REARM: which frames are a touch's (docs/specification.md, section 2)."""

from amaranth.hdl import Const, Module, Mux, Signal

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import Block, drive, inputs, outputs, reaches


class TouchState(Block):
    """Advances with every frame that leaves the detector, by the result of the onset rule.

    Members
    -------
    frame_left : In(1)
        The last beat of a frame leaves.
    last : In(1)
        The beat that is offered is its frame's last.
    judged, met : In(1)
        The rule judges this frame; it is fulfilled.
    boundary, recording_first : In(1)
        Free windows only: a window of two hops could end with this frame; it is the recording's first.
    armed, touch : Out(1)
        State after the last frame that left; neither: REARM.
    onset : Out(1)
        The offered beat is the last of a frame with which a touch begins.
    emit, end : Out(1)
        A window of the touch ends with this frame (free windows); the touch ends with it.
    longest : Out(1)
        ``window_mode`` whole: the touch has had ``touch_frames`` frames with this one.
    started : Out(1)
        One cycle: the frame of an onset left (opens at once: the first frame left).
    """

    def ports(self, config: AcceleratorConfig):
        return inputs("frame_left", "last", "judged", "met", "boundary", "recording_first") | outputs(
            "armed", "touch", "onset", "emit", "end", "longest", "started"
        )

    def elaborate(self, platform):
        m = Module()
        config, frame_left, met = self.spec, self.frame_left, self.met
        armed = Signal(init=not config.opens_at_once)
        touch = Signal(init=config.opens_at_once)
        onset, end = self.onset, self.end
        drive(m, self, armed=armed, touch=touch)
        m.d.comb += onset.eq(armed & self.judged & met & self.last)
        judged_every = config.onset_rule.onset_check_frames if config.onset_rule.onset == "baseline" else 1
        needed = -(-config.onset_rule.rearm_frames // judged_every)
        follows = config.follows_touch
        quiet_counts = ~armed if follows else ~armed & ~touch
        rearming = Const(0) if config.opens_at_once else self.judged & quiet_counts
        rearmed = Signal()
        if config.windows.window_mode == "touch":
            # While armed: frames before this one in the touch that an onset now would open. In a touch: its
            # frames before this one. After it: quiet checks. rearm_frames exceed pretrigger_frames, so the
            # history is whole again when the detector is armed.
            count = self.count = Signal(range(max(config.last_frame, needed)))
            counts = Signal()
            m.d.comb += [
                end.eq(touch & reaches(count, config.last_frame - 1)),
                rearmed.eq(rearming & ~met & reaches(count, needed - 1)),
                counts.eq(
                    touch | rearming | (armed & (onset | ~reaches(count, config.windows.pretrigger_frames)))
                ),
            ]
            with m.If(frame_left & counts):
                m.d.sync += count.eq(Mux(rearmed, config.windows.pretrigger_frames, count + 1))
            # (A separate condition becomes a reset, which takes no logic cell; to a constant with ones there
            # would be two kinds of reset, and one carry chain cannot have both.)
            with m.If(frame_left & (end | (rearming & met))):
                m.d.sync += count.eq(0)
            recording_first = count == 0
        elif follows:
            # quiet frames count through the touch and after it: as many of them end both
            place = self.place = Signal(range(config.last_frame))
            quiet = self.quiet = Signal(range(needed))
            m.d.comb += [
                self.longest.eq(touch & reaches(place, config.last_frame - 1)),
                rearmed.eq(rearming & ~met & reaches(quiet, needed - 1)),
                end.eq(touch & (self.longest | rearmed)),
            ]
            with m.If(frame_left & touch):
                m.d.sync += place.eq(Mux(end, 0, place + 1))
            with m.If(frame_left & rearming):
                m.d.sync += quiet.eq(Mux(met | rearmed, 0, quiet + 1))
            recording_first = place == 0
        else:
            step = self.step = Signal(range(config.windows.steps))
            quiet = self.quiet = Signal(range(needed))
            m.d.comb += [
                self.emit.eq(touch & self.boundary),
                end.eq(self.emit & reaches(step, config.windows.steps - 1)),
                rearmed.eq(rearming & ~met & reaches(quiet, needed - 1)),
            ]
            with m.If(frame_left & self.emit):
                m.d.sync += step.eq(Mux(end, 0, step + 1))
            with m.If(frame_left & rearming):
                m.d.sync += quiet.eq(Mux(met | rearmed, 0, quiet + 1))
            recording_first = self.recording_first
        m.d.comb += self.started.eq(frame_left & (touch & recording_first if config.opens_at_once else onset))
        with m.If(frame_left):
            m.d.sync += [armed.eq((armed & ~onset) | rearmed), touch.eq((touch & ~end) | onset)]
        return m
