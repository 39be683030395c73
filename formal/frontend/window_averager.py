"""The window averager: every window of every touch once, taxel by taxel, with the exact sum of its frames."""

from __future__ import annotations

from types import SimpleNamespace

from amaranth.hdl import Const, Module, Mux, Signal, signed

import eskin.rtl.frontend.window_averager
from eskin.golden.core.config import PRESETS
from eskin.rtl.frontend.window_averager import Operation, WindowAverager
from formal.engine.sequencer import table
from formal.memory import opened
from formal.proof import Bug, assume, free, free_sink, free_source, keeps_its_beat, opened_up, proof, prove

SMALL = dict(
    taxels=4,
    sample_bits=3,
    band_low=3,
    band_high=5,
    feature_shift=(),
    pretrigger_frames=0,
    hop=2,
    rearm_frames=20,
)
EVEN = PRESETS["thesis"].replace(**SMALL, window=4, steps=2, touch_frames=6)
ODD = PRESETS["thesis"].replace(**SMALL, window=5, steps=3, touch_frames=6)


def _averager(m: Module, config):
    """The averager between any sender and any receiver, its inside and the words of its memory."""
    with opened(eskin.rtl.frontend.window_averager) as memories:
        dut = WindowAverager(config)
        inside = opened_up(dut)
    (sums,) = memories
    free_source(dut.i)
    free_sink(dut.o)
    keeps_its_beat(dut.o, "o")
    return dut, inside, sums


def _touches(m: Module, config) -> None:
    """Touch after touch of free deviations, against what each window is by docs/specification.md section
    2."""
    dut, inside, sums = _averager(m, config)
    taxels, spans, steps, frames = (
        config.sensor.taxels,
        config.window_spans,
        config.windows.steps,
        config.last_frame,
    )
    bound = config.deviation_bound
    deviation, masked = ~dut.i.p.complement, dut.i.p.masked if config.faults.fault_frames else Const(0)
    assume((deviation <= bound) & (deviation >= -bound))

    # ---- what came in: the frame under way (0-based in its touch) and its taxel
    taken = dut.i.valid & dut.i.ready
    frame = Signal(range(frames))
    beat = Signal(range(taxels))
    with m.If(taken):
        m.d.sync += beat.eq(Mux(beat == taxels - 1, 0, beat + 1))
        with m.If(beat == taxels - 1):
            m.d.sync += frame.eq(Mux(frame == frames - 1, 0, frame + 1))
    prove((frame < frames) & (beat < taxels), "the reference's own place")
    prove(
        ~taken | (dut.touch_last == ((frame == frames - 1) & (beat == taxels - 1))),
        "the touch's last beat is known",
    )

    # ---- what goes out: window and taxel of the next beat that is made; the beat offered is the one made before
    window = Signal(range(steps))
    taxel = Signal(range(taxels))
    last_window = Signal(range(steps))
    last_taxel = Signal(range(taxels))
    made = Signal()
    m.d.comb += made.eq(inside.step & inside.now.emit)
    with m.If(made):
        m.d.sync += [
            last_window.eq(window),
            last_taxel.eq(taxel),
            taxel.eq(Mux(taxel == taxels - 1, 0, taxel + 1)),
            window.eq(Mux(taxel == taxels - 1, Mux(window == steps - 1, 0, window + 1), window)),
        ]
    prove(~dut.o.valid | (dut.o.p.taxel == last_taxel), "taxels in order")
    prove(
        ~dut.o.valid | (dut.o.p.final == (last_window == steps - 1)),
        "final marks the last window of the touch",
    )
    prove(
        ~dut.o.valid | (dut.o.p.length == table(m, list(config.length_index), last_window, "length")),
        "the window's length",
    )

    # the normaliser reads a window's mean once
    lengths = table(m, list(config.length_index), window, "length_under_way")
    prove((taxel == 0) | (dut.o.p.length == lengths), "the length stays between the beats of a window")
    # ---- for the induction: the state of the block
    draining = inside.now.draining
    hop, place, operation, passes, index = (
        inside.hop,
        inside.frame_in_hop,
        inside.operation,
        inside.passes,
        inside.index,
    )
    together = [k for k, (_, last) in enumerate(spans) if last == frames]
    reads = {2: Operation.ENDING, 1: Operation.OLDER, 0: Operation.NEWEST}
    last_hop, last_place = divmod(frames - 1, config.windows.hop)
    prove(Mux(draining, (frame == 0) & (beat == 0), index == beat), "taxel")
    prove(index < taxels, "index")
    prove(
        Mux(
            draining,
            hop == last_hop,
            hop == table(m, [f // config.windows.hop for f in range(frames)], frame, "hop"),
        ),
        "hop",
    )
    prove(
        Mux(
            draining,
            place == last_place,
            place == table(m, [f % config.windows.hop for f in range(frames)], frame, "place"),
        ),
        "place",
    )
    prove(inside.now.begins == (place == 0), "begins")
    prove(passes < len(together), "passes")
    ending = (operation == Operation.ENDING) <= inside.now.ending
    prove(draining | ((operation.as_value() != 3) & ending), "operation")
    prove(
        (operation == Operation.OLDER)
        | draining
        | (dut.touch_last == ((frame == frames - 1) & (beat == taxels - 1))),
        "touch_last",
    )
    prove((operation == Operation.OLDER) | draining | dut.i.valid, "a beat that was begun stays")
    of_this = (dut.o.p.taxel == index) & (inside.bank == ~hop[0]) & ~draining
    of_last = dut.o.p.taxel == Mux(index == 0, taxels - 1, index - 1)
    prove(
        ~inside.fresh | Mux((operation == Operation.OLDER) | draining, of_last, of_this),
        "the write under way",
    )
    prove(
        (window < steps) & (taxel < taxels) & (last_window < steps) & (last_taxel < taxels),
        "window and taxel",
    )
    # beats made so far: those of windows that ended with earlier frames, then those of the frame under way
    progress = Signal(range(4 * steps * taxels))
    with m.If(draining), m.Switch(passes):
        for number, k in enumerate(together):
            with m.Case(number):
                m.d.comb += progress.eq(k * taxels + index)
                if number:
                    prove(operation == reads[last_hop - k], "the operation of the pass")
    with m.Else(), m.Switch(frame):
        for f in range(frames):
            with m.Case(f):
                done = sum(last <= f for _, last in spans)
                ends = [k for k, (_, last) in enumerate(spans) if last == f + 1]
                ahead = (
                    operation.as_value() > reads[f // config.windows.hop - ends[0]].value
                    if ends
                    else Const(0)
                )
                m.d.comb += progress.eq(done * taxels + (index + ahead if ends else 0))
    prove(window * taxels + taxel == Mux(progress == steps * taxels, 0, progress), "beats made")
    for one in range(taxels):
        _sums_of_taxel(
            m,
            config,
            dut,
            inside,
            sums,
            one,
            SimpleNamespace(
                frame=frame,
                beat=beat,
                taken=taken,
                made=made,
                window=window,
                taxel=taxel,
                last_taxel=last_taxel,
                progress=progress,
                deviation=deviation,
                masked=masked,
            ),
        )


def _sums_of_taxel(m: Module, config, dut, inside, sums, one: int, at: SimpleNamespace) -> None:
    """The sums of one taxel over each window's frames: as they leave, and for the induction as the two banks
    hold them."""
    spans, steps, frames, taxels, bound = (
        config.window_spans,
        config.windows.steps,
        config.last_frame,
        config.sensor.taxels,
        config.deviation_bound,
    )
    frame, beat, taken, made, window, taxel = at.frame, at.beat, at.taken, at.made, at.window, at.taxel
    draining = inside.now.draining
    last_taxel, progress, deviation = at.last_taxel, at.progress, at.deviation
    hop, operation, passes, index = inside.hop, inside.operation, inside.passes, inside.index
    together = [k for k, (_, last) in enumerate(spans) if last == frames]
    seen = Signal(range(frames + 1), name=f"frames_seen_{one}")  # of that taxel in this touch
    m.d.comb += seen.eq(Mux(draining, frames, frame + (beat > one)))
    exact = [Signal(signed(config.sum_bits + 4), name=f"exact_{one}_{k}") for k in range(steps)]
    here = taken & (beat == one)
    was_masked, expected_masked = Signal(name=f"was_masked_{one}"), Signal(name=f"expected_masked_{one}")
    with m.If(here):
        m.d.sync += was_masked.eq(at.masked)
    with m.If(made & (taxel == one)):
        m.d.sync += expected_masked.eq(Mux(draining, was_masked, at.masked))
    if config.faults.fault_frames:
        prove(
            ~dut.o.valid | (last_taxel != one) | (dut.o.p.masked == expected_masked),
            "masked as in the window's last frame",
        )
    expected = Signal(signed(config.sum_bits + 4), name=f"expected_{one}")
    for k, (first, last) in enumerate(spans):
        with m.If(here & (frame >= first - 1) & (frame < last)):
            m.d.sync += exact[k].eq(Mux(frame == first - 1, 0, exact[k]) + deviation)
        # a window ends with its last frame: the beat that is made may still wait to be taken
        adds = ~draining & (beat == one) & (frame == last - 1)
        begins = adds & (frame == first - 1)
        with m.If(made & (window == k) & (taxel == one)):
            m.d.sync += expected.eq(Mux(begins, 0, exact[k]) + Mux(adds, deviation, 0))
            prove(draining | (frame == last - 1), "a window leaves with its last frame")
        count = Mux(seen < first, 0, Mux(seen > last, last, seen) - (first - 1))
        prove(
            (seen < first) | ((exact[k] <= count * bound) & (exact[k] >= -(count * bound))),
            "a sum is bounded by its frames",
        )
    limit = config.windows.window * bound
    prove(
        ~dut.o.valid | (last_taxel != one) | ((expected <= limit) & (expected >= -limit)),
        "no sum exceeds its format",
    )
    prove(
        ~dut.o.valid | (last_taxel != one) | (~dut.o.p.complement == expected),
        "the sum of the window's frames",
    )

    # what the banks hold of that taxel, the write that is under way included
    pending = inside.fresh & (dut.o.p.taxel == one)
    for k, (first, _) in enumerate(spans):
        bank = k % 2
        added = ~draining & (index == one) & (operation != Operation.OLDER) & (hop == k + 1)
        word = Mux(
            pending & (inside.bank == bank),
            inside.total,
            sums.words[one | bank << len(index)][: config.sum_bits].as_signed(),
        )
        value = Signal(signed(config.sum_bits), name=f"value_{one}_{k}")
        m.d.comb += value.eq(~(exact[k] + Mux(added, deviation, 0)))
        waits = (seen >= first) & (progress <= k * taxels + one)
        prove(~waits | (word == value), "the sum in its bank")
        now = (index == one) & Mux(
            draining,
            passes + together[0] == k,
            Mux(
                operation == Operation.OLDER,
                hop == k + 1,
                Mux(operation == Operation.ENDING, hop == k + 2, (hop == k) & ~inside.now.begins),
            ),
        )
        read = Signal(signed(config.sum_bits), name=f"read_{one}_{k}")
        m.d.comb += read.eq(~exact[k])
        # of the touch's last frame, for the passes that add nothing
        if config.faults.fault_frames and k in together:
            last_frame = (seen == frames) | (added & (frame == frames - 1))
            held = Mux(
                pending & (inside.bank == bank),
                dut.o.p.masked,
                sums.words[one | bank << len(index)][config.sum_bits],
            )
            mask = Mux(added, at.masked, was_masked)
            prove(~(waits & last_frame) | (held == mask), "the mask in its bank")
            prove(
                ~(waits & now & draining) | (inside.read.data[config.sum_bits] == was_masked),
                "the mask that was read",
            )
        prove(
            ~(waits & now) | (inside.read.data[: config.sum_bits].as_signed() == read),
            "the sum that was read",
        )


CLAIM = (
    "steps windows a touch, a beat a taxel in order, marked with length and end; each sum is exact over the "
    "window's frames and fits; "
    "the touch's last beat is known; offered sums stay until taken"
)
BUGS = (
    Bug(
        "hop off by one",
        "hop_last = reaches(frame_in_hop, config.windows.hop - 1)",
        "hop_last = Const(1, 1)",
        depth=40,
    ),
    Bug(
        "the last beat is known too late",
        "self.touch_last.eq(now.at_end & at_last & ~now.draining)",
        "self.touch_last.eq(0)",
        depth=60,
        eager=True,
    ),
)


@proof(
    CLAIM,
    depth=1,
    reduced="4 taxels, 3-bit samples, 2 windows of 4 frames, hop 2",
    bugs=(
        Bug(
            "the older window misses a frame",
            "now.begins & (operation == Operation.NEWEST)",
            "now.begins",
            depth=40,
            eager=True,
        ),
        BUGS[1],
    ),
)
def even(m: Module) -> None:
    _touches(m, EVEN)


@proof(
    CLAIM,
    depth=1,
    reduced="4 taxels, 3-bit samples, 3 windows of 5 frames, hop 2, clipped at frame 6 where two end "
    "together",
    bugs=(
        BUGS[1],
        Bug(
            "a clipped window is forgotten", "(passes == 0) | clipped", "(passes == 0)", depth=60, eager=True
        ),
    ),
)
def odd_and_clipped(m: Module) -> None:
    _touches(m, ODD)


FAULTS = ODD.replace(sample_bits=4, fault_frames=2)


@proof(
    f"{CLAIM}; with a fault detector, marked as masked where the taxel is in the window's last frame",
    depth=1,
    reduced="4 taxels, 4-bit samples, 3 windows of 5 frames, hop 2, clipped at frame 6 where two end "
    "together",
    bugs=(
        Bug(
            "a clipped window's mask is forgotten",
            "Mux(now.draining, read.data[bits], self.i.p.masked)",
            "self.i.p.masked",
            depth=60,
            eager=True,
        ),
    ),
)
def masked_sums(m: Module) -> None:
    _touches(m, FAULTS)


FREE = PRESETS["pvdf"].replace(
    **(SMALL | dict(rearm_frames=4)),
    clip=3,
    rest_frames=4,
    onset_mean_frames=4,
    onset_check_frames=2,
    window=4,
    steps=2,
)


@proof(
    "windows that run freely: for each frame that ends one, a beat a taxel in order, each the exact sum of "
    "the last two hops, which fits",
    depth=1,
    reduced="4 taxels, deviations up to 3, hop 2, windows of 4 frames",
    bugs=(
        Bug(
            "the older window is begun anew",
            "now.begins & (operation == Operation.NEWEST)",
            "now.begins",
            depth=40,
            eager=True,
        ),
    ),
)
def free_running(m: Module) -> None:
    config, taxels, hop = FREE, FREE.sensor.taxels, FREE.windows.hop
    dut, inside, sums = _averager(m, config)
    bound, bits = config.deviation_bound, config.sum_bits + 4
    deviation, taken = ~dut.i.p.complement, dut.i.valid & dut.i.ready
    assume((deviation <= bound) & (deviation >= -bound))
    # the detector's marks, on every beat of their frame (formal/frontend/onset_detector.py: touches_free)
    beat, place, later = (
        Signal(range(taxels), name="beat"),
        Signal(range(hop), name="place"),
        Signal(name="later_hop"),
    )
    ends, emits, last = taken & (beat == taxels - 1), Signal(name="emits"), Signal(name="last_window")
    with m.If(taken):
        m.d.sync += beat.eq(beat + 1)
    next_marks = Signal(2)
    free(next_marks)
    with m.If(ends):
        m.d.sync += [place.eq(Mux(place == hop - 1, 0, place + 1)), later.eq(later | (place == hop - 1))]
        m.d.sync += [emits.eq(next_marks[0]), last.eq(next_marks[1])]
    emit = emits & later & (place == hop - 1)
    marks = dut.i.p
    assume(
        ~dut.i.valid
        | (marks.hop_last == (place == hop - 1)) & (marks.emit == emit) & (marks.end == (emit & last))
    )

    made, taxel = inside.step & inside.now.emit, Signal(range(taxels), name="taxel")
    last_taxel = Signal(range(taxels))
    last_final = Signal()
    with m.If(made):
        m.d.sync += [last_taxel.eq(taxel), taxel.eq(taxel + 1), last_final.eq(last)]
    prove(
        ~dut.o.valid | (dut.o.p.taxel == last_taxel) & (dut.o.p.final == last_final),
        "taxels in order, the last window marked",
    )
    prove(~made | emit, "a window ends with its frame only")

    index, operation, newest = inside.index, inside.operation, inside.operation == Operation.NEWEST
    parity, begins = inside.now.parity, place == 0
    prove((index == beat) & (place < hop) & (inside.now.begins == begins), "place")
    prove(newest | (operation == Operation.OLDER), "operation")
    prove(~newest | dut.i.valid, "a beat that was begun stays")
    prove(taxel == Mux(emit, (index + newest)[: len(taxel)], 0), "beats made")
    this = (dut.o.p.taxel == index) & (inside.bank == ~parity)
    prove(
        ~inside.fresh | Mux(newest, this, dut.o.p.taxel == Mux(index == 0, taxels - 1, index - 1)),
        "the write under way",
    )
    for one in range(taxels):
        hop_sum, hop_before = (
            Signal(signed(bits), name=f"{name}_{one}") for name in ("hop_sum", "hop_before")
        )
        expected, done = Signal(signed(bits), name=f"expected_{one}"), beat > one
        with m.If(taken & (beat == one)):
            m.d.sync += hop_sum.eq(Mux(begins, 0, hop_sum) + deviation)
            with m.If(begins):
                m.d.sync += hop_before.eq(hop_sum)
        apart = begins & ~done  # its first beat of this hop is still to come
        older = Mux(apart, hop_sum, hop_before + hop_sum)
        with m.If(made & (taxel == one)):
            m.d.sync += expected.eq(older + deviation)
        prove(~dut.o.valid | (last_taxel != one) | (~dut.o.p.complement == expected), "the sum of two hops")
        frames = Mux(apart, Mux(later, hop, 0), place + done)
        prove((hop_sum <= frames * bound) & (hop_sum >= -(frames * bound)), "a hop's sum")
        prove((hop_before <= hop * bound) & (hop_before >= -(hop * bound)), "the hop before")
        limit = config.windows.window * bound
        prove((expected <= limit) & (expected >= -limit), "a window's sum")

        def complement(value, name: str, one: int = one) -> Signal:
            held = Signal(signed(config.sum_bits), name=f"{name}_{one}")
            m.d.comb += held.eq(~value)
            return held

        pending = inside.fresh & (dut.o.p.taxel == one)
        held = [sums.words[one | bank << len(index)][: config.sum_bits].as_signed() for bank in range(2)]
        banks = [Mux(pending & (inside.bank == bank), inside.total, held[bank]) for bank in range(2)]
        added = older + Mux(newest & (index == one), deviation, 0)
        prove(
            ~later | (Mux(parity, banks[0], banks[1]) == complement(added, "older")),
            "the older window's bank",
        )
        prove(
            apart | (place + done == 0) | (Mux(parity, banks[1], banks[0]) == complement(hop_sum, "newest")),
            "the newest's",
        )
        wanted = Mux(newest, complement(hop_sum, "read_newest"), complement(older, "read_older"))
        read = inside.read.data[: config.sum_bits].as_signed()
        prove((index != one) | Mux(newest, begins, ~later) | (read == wanted), "the sum that was read")
