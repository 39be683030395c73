"""Rest level, deviation and onset rule of every taxel: the front of the chain (docs/specification.md, section 2)."""

from __future__ import annotations

from types import SimpleNamespace

from amaranth.hdl import Cat, Const, Module, Mux, Signal, signed, unsigned
from amaranth.lib import stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out
from amaranth.utils import ceil_log2

from eskin.golden.core.config import AcceleratorConfig
from eskin.rtl.common.collisions import NO_COLLISION
from eskin.rtl.common.compare import exceeds, reaches
from eskin.rtl.common.fixed import clip
from eskin.rtl.common.layouts import frame_layout, sample_layout
from eskin.rtl.frontend.fault_detector import FaultDetector
from eskin.rtl.frontend.frame_aligner import FrameAligner
from eskin.rtl.frontend.moving_sums import MovingSums
from eskin.rtl.frontend.onset_filter import OnsetFilter
from eskin.rtl.frontend.touch_state import TouchState


class OnsetDetector(wiring.Component):
    """Takes the rest level from every sample, judges the onset rule at the end of every frame and runs ARMED, TOUCH, REARM.

    The rest level is kept with ``level_frac`` fraction bits, at least the 4 of the specification. For a ``rest_frames`` that is a
    power of two the settling sum IS the level (its finer bits stay inert, and the half that rounds it is the sum's initial value);
    otherwise the sum is multiplied by a reciprocal that the constructor proves exact.

    Parts: `FrameAligner`, `MovingSums` (onset ``baseline``), `FaultDetector`, `OnsetFilter` and `TouchState`.

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
    armed, touch : Out(1)
        Detector state after the last frame that left.
    touch_started : Out(1)
        One cycle: the frame of an onset left (opens at once: the first frame left).
    flags : Out(taxels), raised : Out(1), only with ``fault_frames``
        As of ``FaultDetector``.
    framing_fault : Out(1)
        One cycle: ``first`` or ``last`` did not agree with the taxel count. The missing taxels of the frame repeat its last sample, so
        that the frame count and every later stage stay aligned; beats outside a frame are dropped until the next ``first``.

    Timing
    ------
    Latency ``latency`` cycles from ``i`` to ``o``: 1 without rest level, 2 with, 3 with clip. One beat a cycle; onset ``baseline``: the
    last beat of each frame that ends a block of ``onset_check_frames`` waits 3 cycles for the verdict. State of a taxel is written
    at most 3 beats after it was read, which 4 taxels allow.
    """

    def __init__(self, config: AcceleratorConfig):
        self.config = config
        self.latency = 1 + (config.rest_level.rest != "none") + bool(config.rest_level.clip)
        if config.rest_level.rest != "none":
            frames, span = config.rest_level.rest_frames, config.sample_format
            self.level_frac, self.reciprocal = max(4, ceil_log2(frames)), None
            self.level_bits = config.sensor.sample_bits + self.level_frac
            if frames & (frames - 1):
                self.level_frac = 4
                # sums of offset-binary samples: 0..top; the quotient of (16 S + B/2) / B must be exact on all of them
                self.reciprocal = exact_reciprocal(frames, 16 * frames * (span.max_code - span.min_code) + frames // 2)
        super().__init__(
            {
                "i": In(stream.Signature(sample_layout(config))),
                "mask": In(config.sensor.taxels),
                "o": Out(stream.Signature(frame_layout(config))),
                "armed": Out(1),
                "touch": Out(1),
                "touch_started": Out(1),
                "framing_fault": Out(1),
            }
            | ({"flags": Out(config.sensor.taxels), "raised": Out(1)} if config.faults.fault_frames else {})
        )

    def elaborate(self, platform):
        config, m = self.config, Module()
        has_rest, has_sums = config.rest_level.rest != "none", config.onset_rule.onset == "baseline"
        advance = Signal()

        def stage(name: str, **fields) -> SimpleNamespace:
            """Registers that follow ``fields`` whenever the pipeline advances."""
            registers = {key: Signal(value.shape(), name=f"{name}_{key}", reset_less=key != "valid") for key, value in fields.items()}
            with m.If(advance):
                m.d.sync += [registers[key].eq(value) for key, value in fields.items()]
            return SimpleNamespace(**registers)

        m.submodules.aligner = aligner = FrameAligner(config)
        index, offered, good, frame_taken = aligner.index, aligner.offered, aligner.fresh, aligner.frame_taken
        wiring.connect(m, wiring.flipped(self.i), aligner.i)
        m.d.comb += [aligner.advance.eq(advance), self.framing_fault.eq(aligner.framing_fault)]

        # --- what follows from the frame number alone
        frame = {}
        if has_rest:
            settle_left = Signal(range(config.rest_level.rest_frames + 1), init=config.rest_level.rest_frames)
            with m.If(frame_taken & (settle_left != 0)):
                m.d.sync += settle_left.eq(settle_left - 1)
            frame["settling"] = settle_left != 0
            frame["settle_first"] = settle_left == config.rest_level.rest_frames
            frame["settle_last"] = settle_left == 1
        if has_sums:
            check = Signal(ceil_log2(config.onset_rule.onset_check_frames))
            with m.If(frame_taken):
                m.d.sync += check.eq(check + 1)
            frame["block_end"] = check.all() if len(check) else Const(1, 1)
        if config.windows.window_mode == "free":
            hop_frame = Signal(range(config.windows.hop))
            hop_zero = Signal(init=1)
            hop_last = reaches(hop_frame, config.windows.hop - 1)
            with m.If(frame_taken):
                m.d.sync += [hop_frame.eq(Mux(hop_last, 0, hop_frame + 1)), hop_zero.eq(hop_zero & ~hop_last)]
            frame["hop_last"] = hop_last
            frame["boundary"] = hop_last & ~hop_zero
            frame["recording_first"] = (hop_frame == 0) & hop_zero

        # --- pipeline: sample, deviation, clipped deviation
        now = stage("taken", valid=offered, index=index, last=aligner.last, masked=self.mask.bit_select(index, 1), **frame)
        sample = self.i.p.sample + Const(0, signed(config.sensor.sample_bits + 1))
        complement, hit = Signal(signed(config.sensor.sample_bits + 1), reset_less=True), Const(0, 1)  # of the sample held
        with m.If(advance & good):
            m.d.sync += complement.eq(~sample)
        if config.faults.fault_frames:
            m.submodules.fault_detector = faults = FaultDetector(config)
            m.d.comb += [
                faults.i.valid.eq(advance & offered),
                faults.i.taxel.eq(index),
                faults.complement.eq(complement),
                faults.settling.eq(now.settling if has_rest else 0),
                self.flags.eq(faults.flags),
                self.raised.eq(faults.raised),
            ]
            now.masked = now.masked | faults.flag
        if config.onset_rule.onset == "band":
            outside = Signal()  # of the sample held
            with m.If(advance & good):
                m.d.sync += outside.eq(
                    exceeds(self.i.p.sample, config.onset_rule.band_high) | ~exceeds(self.i.p.sample, config.onset_rule.band_low - 1)
                )
            hit = outside & ~now.masked

        def carried(stage_now: SimpleNamespace) -> dict:
            fields = {key: getattr(stage_now, key) for key in ("valid", "index", "last", "masked", *frame)}
            return fields | ({"hit": hit} if config.onset_rule.onset == "band" else {})

        before = SimpleNamespace(valid=offered, index=index)
        if has_rest:
            level_bits = self.level_bits
            m.submodules.level = level = Memory(shape=unsigned(level_bits), depth=config.sensor.taxels, init=[], attrs=NO_COLLISION)
            read, write = level.read_port(), level.write_port()
            m.d.comb += [read.addr.eq(index), read.en.eq(advance)]
            # levels are kept of offset-binary samples: never negative
            inverted = Cat(
                complement[: config.sensor.sample_bits - 1], complement[config.sensor.sample_bits - 1] ^ config.sensor.sample_signed
            )
            baseline = read.data[self.level_frac - 4 :][: config.sensor.sample_bits + 4]
            # ~(sample - ((baseline + 8) >> 4)) = ~sample + (baseline >> 4) + bit 3 of baseline, as one adder
            deviation = Cat(Const(1, 1), inverted, Const(1, 1)).as_signed() + Cat(baseline[3:], Const(0, 1)).as_signed()
            deviation = deviation[1 : config.sensor.sample_bits + 2].as_signed()
            before, now = (
                now,
                stage(
                    "deviation",
                    **carried(now),
                    sample=~inverted,
                    complement=Mux(now.settling, -1, deviation),
                    at_level=~inverted == baseline[4:],
                    level=Mux(now.settle_first, self._initial_level(), read.data),
                ),
            )
            hit = now.hit if config.onset_rule.onset == "band" else hit
            complement, level_next = now.complement, Signal(level_bits)
            m.d.comb += level_next.eq(self._next_level(now))
        if config.rest_level.clip:
            levels = {"level": level_next} if has_rest else {}
            before, now = now, stage("clipped", **carried(now), complement=~clip(~complement, config.rest_level.clip), **levels)
            hit = now.hit if config.onset_rule.onset == "band" else hit
            complement, level_next = now.complement, now.level if has_rest else None

        # --- the rule, judged when the last beat of a frame leaves
        leave = self.o.valid & self.o.ready
        frame_left = leave & now.last
        any_hit, judged, waiting = Signal(), Const(1, 1), Const(0, 1)
        if has_sums:
            m.submodules.sums = sums = MovingSums(config, complement.shape())
            over, decided = sums.over, sums.decided
            m.d.comb += [
                sums.advance.eq(advance),
                sums.coming_valid.eq(before.valid),
                sums.coming_index.eq(before.index),
                *(getattr(sums, key).eq(getattr(now, key)) for key in ("index", "last", "block_end", "masked", "settling")),
                sums.complement.eq(complement),
                sums.last_taken.eq(self.o.ready & now.last),
            ]
            judged = now.block_end  # settling frames add 0 and meet no rule
            waiting = now.block_end & now.last & ~decided
            with m.If(over):
                m.d.sync += any_hit.eq(1)
            met = any_hit
        else:
            if has_rest:
                judged = ~now.settling
            met = any_hit | hit
            with m.If(leave & hit):
                m.d.sync += any_hit.eq(1)
        with m.If(frame_left):
            m.d.sync += any_hit.eq(0)
        if config.onset_rule.onset_span > 1 and not config.opens_at_once:
            m.submodules.onset_filter = onset_filter = OnsetFilter(config)
            m.d.comb += [onset_filter.i.valid.eq(frame_left & judged), onset_filter.i.hit.eq(met)]
            met = onset_filter.met
        if config.faults.fault_frames:
            m.d.comb += self.o.p.masked.eq(now.masked)
        m.d.comb += [
            self.o.valid.eq(now.valid & ~waiting),
            advance.eq(~now.valid | (self.o.ready & ~waiting)),
            self.o.p.complement.eq(complement),
        ]

        m.submodules.state = state = TouchState(config)
        armed, onset = state.armed, state.onset
        m.d.comb += [
            state.frame_left.eq(frame_left),
            state.last.eq(now.last),
            state.judged.eq(judged),
            state.met.eq(met),
            self.armed.eq(armed),
            self.touch.eq(state.touch),
            self.touch_started.eq(state.started),
        ]
        if config.windows.window_mode == "touch":
            m.d.comb += [self.o.p.touch.eq(state.touch), self.o.p.onset.eq(onset)]
        else:
            m.d.comb += [
                state.boundary.eq(now.boundary),
                state.recording_first.eq(now.recording_first),
                self.o.p.hop_last.eq(now.hop_last),
                self.o.p.emit.eq(state.emit),
                self.o.p.end.eq(state.end),
            ]

        if has_rest:
            tracks = now.settling | (armed if config.rest_level.rest == "tracked" else 0)
            written = [(write.addr, now.index), (write.data, level_next), (write.en, leave & tracks)]
            for port, source in written:
                if config.rest_level.clip:  # level_next is a register already
                    m.d.comb += port.eq(source)
                else:
                    register = Signal(port.shape(), name="level_written")
                    m.d.sync += register.eq(source)
                    m.d.comb += port.eq(register)
        return m

    def _initial_level(self) -> Const:
        """What the settling sum starts from: the half that makes its final shift round half up."""
        half = 0 if self.reciprocal or self.level_frac == 4 else 1 << self.level_frac - 5
        return Const(half, self.level_bits)

    def _next_level(self, now: SimpleNamespace):
        """The level after this frame: one adder for the settling sum and for the tracking step of 1/16 code."""
        config = self.config
        frames, low = config.rest_level.rest_frames, self.level_frac - 4
        settled = now.sample if self.reciprocal else now.sample << self.level_frac - ceil_log2(frames)
        baseline = now.level[low:][: config.sensor.sample_bits + 4]
        if config.rest_level.rest == "tracked":
            # sign(16 sample - baseline): the sample equals the baseline's integer part, or the deviation's sign says it
            up = now.complement[-1] & ~now.at_level
            hold = now.at_level & (baseline[:4] == 0)
            step = Cat(Const(0, low), ~hold, (~hold & ~up).replicate(len(baseline) - 1))
            total = now.level + Mux(now.settling, settled, step)
        else:
            total = now.level + settled
        if self.reciprocal:
            factor, shift = self.reciprocal
            mean = ((total << 4) + frames // 2) * factor >> shift
            return Mux(now.settle_last, mean, total)
        return total


def exact_reciprocal(divisor: int, largest: int) -> tuple[int, int]:
    """``(factor, shift)`` with ``n * factor >> shift == n // divisor`` for every n in 0..largest: the smallest that is proven.

    With factor = ceil(2**shift / divisor) and excess = factor * divisor - 2**shift, ``largest * excess < 2**shift`` suffices
    (Granlund and Montgomery 1994).
    """
    for shift in range(1, 64):
        factor = -(-(1 << shift) // divisor)
        if largest * (factor * divisor - (1 << shift)) < 1 << shift:
            return factor, shift
    raise ValueError(f"no reciprocal of {divisor} is exact up to {largest}")
