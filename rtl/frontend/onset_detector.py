"""Rest level, deviation and onset rule of every taxel: the front of the chain (docs/specification.md, section
2)."""

from types import SimpleNamespace

from amaranth.hdl import Cat, Const, Module, Mux, Signal, signed
from amaranth.lib import stream

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import (
    Block,
    clip,
    detector_status,
    drive,
    exceeds,
    forward,
    frame_layout,
    inputs,
    outputs,
    sample_layout,
)
from eskin.rtl.frontend.fault_detector import FaultDetector
from eskin.rtl.frontend.frame_aligner import FrameAligner
from eskin.rtl.frontend.frame_marks import FrameMarks, marks_of
from eskin.rtl.frontend.moving_sums import MovingSums
from eskin.rtl.frontend.onset_filter import OnsetFilter
from eskin.rtl.frontend.rest_level import RestLevel
from eskin.rtl.frontend.touch_state import TouchState
from eskin.rtl.program.timing import STATE_BEATS


class OnsetDetector(Block):
    """Takes the rest level from every sample, judges the onset rule at the end of every frame and runs ARMED,
    TOUCH, REARM.

    Parts: `FrameAligner`, `FrameMarks`, `RestLevel`, `MovingSums` (onset ``baseline``), `FaultDetector`,
    `OnsetFilter` and `TouchState`.

    Parameters
    ----------
    config:
        The accelerator's configuration.

    Ports
    -----
    i : In(stream of ``sample_layout``)
    mask : In(taxels)
        Bit k = 1: taxel k never counts for the onset.
    o : Out(stream of ``frame_layout``)
        Every frame that came in, also while no touch is open.
    status : Out(detector_status)
        A touch starts when the frame of its onset has left (opens at once: the first frame). After a framing fault
        missing taxels repeat the frame's last sample, so the frame count and every later stage stay aligned; beats
        outside a frame are dropped until the next ``first``.
    holds : Out(1)
        A beat is on its way through the detector, or what it changes is not yet written.

    Timing
    ------
    Latency `eskin.rtl.program.timing.detector_latency` cycles from ``i`` to ``o``: 1 without rest level, 2 with,
    3 with clip. One beat a cycle; onset ``baseline``: the last beat of each frame that ends a block of
    ``onset_check_frames`` waits 3 cycles for the verdict. State of a taxel is written at most 3 beats after it was
    read, which 4 taxels allow; with fewer a frame waits until the stages have been empty for 2 cycles.
    """

    def ports(self, config: AcceleratorConfig):
        return inputs(i=stream.Signature(sample_layout(config)), mask=config.sensor.taxels) | outputs(
            "holds", o=stream.Signature(frame_layout(config)), status=detector_status(config)
        )

    def elaborate(self, platform):
        config, m = self.spec, Module()
        has_rest = config.rest_level.rest != "none"
        advance = Signal()
        self.stages: dict[str, SimpleNamespace] = {}

        def stage(name: str, **fields) -> SimpleNamespace:
            """Registers that follow ``fields`` whenever the pipeline advances."""
            registers = {
                key: Signal(value.shape(), name=f"{name}_{key}", reset_less=key != "valid")
                for key, value in fields.items()
            }
            with m.If(advance):
                m.d.sync += [registers[key].eq(value) for key, value in fields.items()]
            self.stages[name] = SimpleNamespace(**registers)
            return self.stages[name]

        m.submodules.aligner = aligner = self.aligner = FrameAligner(config)
        index, offered, good = aligner.index, aligner.offered, aligner.fresh
        small = config.sensor.taxels <= STATE_BEATS
        if small:
            empty = self.empty = Signal(
                2
            )  # the stages, in this cycle and the cycle before: all state is written
            open_now = (index != 0) | empty.all()
            drive(m, aligner.i, p=self.i.p, valid=self.i.valid & open_now)
            m.d.comb += self.i.ready.eq(aligner.i.ready & open_now)
        else:
            forward(m, self, aligner, "i")
        m.d.comb += [aligner.advance.eq(advance), self.status.framing_fault.eq(aligner.framing_fault)]

        m.submodules.marks = marks = self.marks = FrameMarks(config)
        m.d.comb += marks.taken.eq(aligner.frame_taken)
        frame = {name: getattr(marks, name) for name in marks_of(config)}

        # --- pipeline: sample, deviation, clipped deviation
        now = stage(
            "taken",
            valid=offered,
            index=index,
            last=aligner.last,
            masked=self.mask.bit_select(index, 1),
            **frame,
        )
        sample = self.i.p.sample + Const(0, signed(config.sensor.sample_bits + 1))
        # of the sample held
        complement = Signal(signed(config.sensor.sample_bits + 1), reset_less=True)
        hit = Const(0)
        with m.If(advance & good):
            m.d.sync += complement.eq(~sample)
        if config.faults.fault_frames:
            m.submodules.fault_detector = faults = FaultDetector(config)
            drive(m, faults.i, valid=advance & offered, taxel=index)
            drive(m, faults, complement=complement, settling=now.settling if has_rest else 0)
            drive(m, self.status, flags=faults.flags, raised=faults.raised)
            now.masked = now.masked | faults.flag
        if config.onset_rule.onset == "band":
            outside = Signal()  # of the sample held
            with m.If(advance & good):
                m.d.sync += outside.eq(
                    exceeds(self.i.p.sample, config.onset_rule.band_high)
                    | ~exceeds(self.i.p.sample, config.onset_rule.band_low - 1)
                )
            hit = outside & ~now.masked

        def carried(stage_now: SimpleNamespace) -> dict:
            fields = {key: getattr(stage_now, key) for key in ("valid", "index", "last", "masked", *frame)}
            return fields | ({"hit": hit} if config.onset_rule.onset == "band" else {})

        before = SimpleNamespace(valid=offered, index=index)
        if has_rest:
            m.submodules.rest_level = rest_level = RestLevel(config)
            drive(
                m,
                rest_level,
                advance=advance,
                coming_index=index,
                sample=complement,
                settle_first=now.settle_first,
            )
            before, now = (
                now,
                stage("deviation", **carried(now), complement=Mux(now.settling, -1, rest_level.deviation)),
            )
            hit = now.hit if config.onset_rule.onset == "band" else hit
            complement, level_next = now.complement, rest_level.next
            drive(m, rest_level, settling=now.settling, settle_last=now.settle_last, negative=complement[-1])
        if config.rest_level.clip:
            levels = {"level": level_next} if has_rest else {}
            before, now = (
                now,
                stage(
                    "clipped", **carried(now), complement=~clip(~complement, config.rest_level.clip), **levels
                ),
            )
            hit = now.hit if config.onset_rule.onset == "band" else hit
            complement, level_next = now.complement, now.level if has_rest else None

        # --- the rule, judged when the last beat of a frame leaves
        leave = self.o.valid & self.o.ready
        frame_left = leave & now.last
        met, judged, waiting = self._rule(m, advance, before, now, complement, hit)
        if config.faults.fault_frames:
            m.d.comb += self.o.p.masked.eq(now.masked)
        m.d.comb += [
            self.o.valid.eq(now.valid & ~waiting),
            advance.eq(~now.valid | (self.o.ready & ~waiting)),
            self.o.p.complement.eq(complement),
        ]

        valid = Cat(stage.valid for stage in self.stages.values())
        unwritten = [aligner.filling]
        if small:
            m.d.comb += empty[0].eq(~valid.any())
            m.d.sync += empty[1].eq(empty[0])
            unwritten.append(empty[0] ^ empty[1])
        if config.onset_rule.onset == "baseline":
            unwritten.append(self.sums.holds)

        armed = self._touches(m, now, frame_left, judged, met)
        if has_rest:
            tracks = now.settling | (armed if config.rest_level.rest == "tracked" else 0)
            written = [
                (rest_level.w_index, now.index),
                (rest_level.w_level, level_next),
                (rest_level.w_enable, leave & tracks),
            ]
            for port, source in written:
                if config.rest_level.clip:  # level_next is a register already
                    m.d.comb += port.eq(source)
                else:
                    register = Signal(port.shape(), name="level_written")
                    m.d.sync += register.eq(source)
                    m.d.comb += port.eq(register)
            unwritten.append(rest_level.w_enable)
        m.d.comb += self.holds.eq(Cat(valid, *unwritten).any())
        return m

    def _rule(
        self,
        m: Module,
        advance: Signal,
        before: SimpleNamespace,
        now: SimpleNamespace,
        complement: Signal,
        hit,
    ) -> tuple:
        """(the rule is met by the frame that ends, it is judged, its last beat waits for the verdict)."""
        config, leave = self.spec, self.o.valid & self.o.ready
        frame_left = leave & now.last
        any_hit = Signal()
        judged = Const(1, 1)
        waiting = Const(0)
        if config.onset_rule.onset == "baseline":
            m.submodules.sums = sums = self.sums = MovingSums(config, complement.shape())
            over, decided = sums.over, sums.decided
            drive(m, sums, advance=advance, coming_valid=before.valid, coming_index=before.index)
            m.d.comb += [
                *(
                    getattr(sums, key).eq(getattr(now, key))
                    for key in ("index", "last", "block_end", "masked", "settling")
                )
            ]
            drive(m, sums, complement=complement, last_taken=self.o.ready & now.last)
            judged = now.block_end  # settling frames add 0 and meet no rule
            waiting = now.block_end & now.last & ~decided
            with m.If(over):
                m.d.sync += any_hit.eq(1)
            met = any_hit
        else:
            if config.rest_level.rest != "none":
                judged = ~now.settling
            met = any_hit | hit
            with m.If(leave & hit):
                m.d.sync += any_hit.eq(1)
        with m.If(frame_left):
            m.d.sync += any_hit.eq(0)
        if config.onset_rule.onset_span > 1 and not config.opens_at_once:
            m.submodules.onset_filter = onset_filter = OnsetFilter(config)
            drive(m, onset_filter.i, valid=frame_left & judged, hit=met)
            met = onset_filter.met
        return met, judged, waiting

    def _touches(self, m: Module, now: SimpleNamespace, frame_left, judged, met) -> Signal:
        """The detector's state and the marks of the frame that leaves; whether it is armed."""
        config = self.spec
        m.submodules.state = state = self.state = TouchState(config)
        drive(m, state, frame_left=frame_left, last=now.last, judged=judged, met=met)
        drive(m, self.status, armed=state.armed, touch=state.touch, started=state.started)
        if config.follows_touch:
            loud = now.last & (1 if config.opens_at_once else judged & met)
            ends = {"end": now.last & state.end, "longest": now.last & state.longest}
            drive(m, self.o.p, touch=state.touch, loud=loud, **ends)
        elif config.windows.window_mode == "touch":
            drive(m, self.o.p, touch=state.touch, onset=state.onset)
        else:
            drive(m, state, boundary=now.boundary, recording_first=now.recording_first)
            drive(m, self.o.p, hop_last=now.hop_last, emit=state.emit, end=state.end)
        return state.armed
