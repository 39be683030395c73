"""Marks that follow from the number of a frame alone, in a recording or in a touch: settling, blocks of the
onset rule, hops, windows (docs/specification.md, section 2)."""

from amaranth.hdl import Const, Module, Mux, Signal
from amaranth.lib.wiring import Out
from amaranth.utils import ceil_log2

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import Block, drive, inputs, outputs, reaches


def marks_of(config: AcceleratorConfig) -> tuple[str, ...]:
    """The marks that this configuration's frames have."""
    return (
        *(("settling", "settle_first", "settle_last") if config.rest_level.rest != "none" else ()),
        *(("block_end",) if config.onset_rule.onset == "baseline" else ()),
        *(("hop_last", "boundary", "recording_first") if config.windows.window_mode == "free" else ()),
    )


class FrameMarks(Block):
    """Counts frames as they come in; each output is of the frame that comes.

    Members
    -------
    taken : In(1)
        The last beat of a frame goes in.
    settling, settle_first, settle_last : Out(1)
        The rest level settles; its first, its last frame.
    block_end : Out(1)
        The onset rule ``baseline`` judges this frame.
    hop_last, boundary, recording_first : Out(1)
        The last frame of a hop; the same, but not of the first hop; the recording's first frame.
    """

    def ports(self, config: AcceleratorConfig):
        return inputs("taken") | outputs(*marks_of(config))

    def elaborate(self, platform):
        m = Module()
        config = self.spec
        if config.rest_level.rest != "none":
            settle_left = Signal(range(config.rest_level.rest_frames + 1), init=config.rest_level.rest_frames)
            with m.If(self.taken & (settle_left != 0)):
                m.d.sync += settle_left.eq(settle_left - 1)
            drive(
                m,
                self,
                settling=settle_left != 0,
                settle_first=settle_left == config.rest_level.rest_frames,
                settle_last=settle_left == 1,
            )
        if config.onset_rule.onset == "baseline":
            check = Signal(ceil_log2(config.onset_rule.onset_check_frames))
            with m.If(self.taken):
                m.d.sync += check.eq(check + 1)
            m.d.comb += self.block_end.eq(check.all() if len(check) else Const(1, 1))
        if config.windows.window_mode == "free":
            hop_frame = self.hop_frame = Signal(range(config.windows.hop))
            hop_zero = self.hop_zero = Signal(init=1)
            hop_last = reaches(hop_frame, config.windows.hop - 1)
            with m.If(self.taken):
                m.d.sync += [hop_frame.eq(Mux(hop_last, 0, hop_frame + 1)), hop_zero.eq(hop_zero & ~hop_last)]
            drive(
                m,
                self,
                hop_last=hop_last,
                boundary=hop_last & ~hop_zero,
                recording_first=(hop_frame == 0) & hop_zero,
            )
        return m


class TouchMarks(Block):
    """Counts the frames of a touch as they come; each output is of the frame that comes.

    All are registers: they are compared a frame early, so that nothing in the windows waits for it.

    Members
    -------
    taken : In(1)
        The last beat of a frame goes in.
    hop_last, emit, end : Out(1)
        As of ``eskin.rtl.common.layouts.window_layout``.
    """

    def ports(self, config: AcceleratorConfig):
        first = {"hop_last": int(config.windows.hop == 1), "emit": 0, "end": 0}  # no touch is one frame
        return inputs("taken") | {name: Out(1, init=value) for name, value in first.items()}

    def elaborate(self, platform):
        m = Module()
        hop_frames, frames = self.spec.windows.hop, self.spec.last_frame
        odd = self.spec.windows.window > 2 * hop_frames
        hop = self.hop = Signal(range(max(2, -(-frames // hop_frames))))
        place = self.place = Signal(range(hop_frames))
        turns = self.hop_last
        # of the next frame: it is its hop's last; a window ends with it, the last frame of two hops or the
        # first after them; the touch ends
        last_hop, last_place = divmod(frames - 2, hop_frames)
        hop_last = reaches(place, hop_frames - 2) & ~turns if hop_frames > 1 else Const(1, 1)
        whole = (turns if odd else hop_last) & ((hop != 0) if odd or hop_frames > 1 else 1)
        end = reaches(hop, last_hop) & reaches(place, last_place)
        with m.If(self.taken):
            m.d.sync += [
                hop.eq(hop + turns),
                place.eq(place + 1),
                self.hop_last.eq(hop_last | end),
                self.emit.eq(whole | end),
                self.end.eq(end),
            ]
        # (Not within the condition before, so that it becomes a reset, which takes no logic cell.)
        with m.If(self.taken & turns):
            m.d.sync += place.eq(0)
        with m.If(self.taken & self.end):
            m.d.sync += [hop.eq(0), *(port.eq(port.init) for port in (turns, self.emit, self.end))]
        return m
