"""The pre-trigger ring: of every touch exactly the frames s..e, in order, nothing lost, whatever the reader
does."""

from types import SimpleNamespace
from unittest import mock

from amaranth.hdl import Cat, Const, Module, Mux, Signal

import eskin.golden.core.config
import eskin.rtl.frontend.pretrigger_ring
from eskin.golden.core import PRESETS
from eskin.rtl.frontend.pretrigger_ring import PreTriggerRing
from eskin.rtl.program.timing import STATE_BEATS
from formal.memory import opened
from formal.proof import Bug, assume, before, free, free_sink, keeps_its_beat, placed, proof, prove

SLACK = 2
"""Frames that the ring holds beyond its history and the onset's; 8 in the design."""


@proof(
    "of every touch frames s = max(1, f - pretrigger_frames) to e leave, every taxel once, in order; "
    "nothing else leaves, nothing is lost "
    "and no word overwritten however long the reader waits; offered deviations stay until taken",
    depth=2,
    reduced="4 taxels, 1 frame of history, room for 2 frames more (8 in the design)",
    bugs=(
        Bug(
            "a frame of history too few",
            "(config.windows.pretrigger_frames + 1) * frame",
            "config.windows.pretrigger_frames * frame",
            eager=True,
        ),
        Bug("a frame is dropped twice", "surplus & ~dropped & ~touch", "surplus & ~touch", eager=True),
        Bug("a beat is fetched over a waiting one", "(~fetched | (self.o.ready & ~self.touch_last))", "1"),
    ),
)
def frames_of_a_touch(m: Module) -> None:
    _frames_of_a_touch(m, 0)


@proof(
    "the same with a fault detector, and whether a taxel is masked goes with its deviation",
    depth=2,
    reduced="4 taxels, 1 frame of history, room for 2 frames more (8 in the design)",
    bugs=(
        Bug(
            "the mask is not kept",
            "*([self.i.p.masked] if config.faults.fault_frames else ()))",
            ")",
            eager=True,
        ),
    ),
)
def masked_with_their_beats(m: Module) -> None:
    _frames_of_a_touch(m, 4)


@proof(
    "the same with one port, where a touch that has caught up passes the memory by; no word is read and "
    "written in one cycle",
    depth=2,
    method="gate induction",
    reduced="4 taxels, 1 frame of history, room for 1 frame more (8 in the design)",
    bugs=(
        Bug(
            "passing goes on over a beat that waits at the output",
            "& (held == counted) & (~fetched | self.o.ready)",
            "& (held == counted)",
        ),
        Bug(
            "passing goes on behind a beat that was written", "~push & (held == counted)", "(held == counted)"
        ),
        Bug(
            "a beat passes that the reader does not take",
            "passing & self.i.valid & self.o.ready",
            "passing & self.i.valid",
        ),
        Bug("what passes is written too", "written & ~passes", "written"),
    ),
)
def passing_by(m: Module) -> None:
    _frames_of_a_touch(m, 0, one_port=True)


@proof(
    "the same of one taxel, frames 3 cycles apart",
    depth=3,
    reduced="1 taxel, 1 frame of history, room for 2 frames more (8 in the design)",
    bugs=(
        Bug(
            "the frame of an onset is too many itself",
            "frame + (frame // 2 or 1) - 1",
            "frame + frame // 2 - 1",
            eager=True,
        ),
    ),
)
def one_taxel(m: Module) -> None:
    _frames_of_a_touch(m, 0, taxels=1)


@proof(
    "the same of two taxels, frames 2 cycles apart",
    depth=3,
    reduced="2 taxels, 1 frame of history, room for 2 frames more (8 in the design)",
    bugs=(
        Bug(
            "a frame of history too few",
            "(config.windows.pretrigger_frames + 1) * frame",
            "config.windows.pretrigger_frames * frame",
            eager=True,
        ),
    ),
)
def two_taxels(m: Module) -> None:
    _frames_of_a_touch(m, 0, taxels=2)


def _frames_of_a_touch(m: Module, fault_frames: int, one_port: bool = False, taxels: int = 4) -> None:
    slack = SLACK - one_port
    with mock.patch.object(eskin.golden.core.config, "RING_SLACK_FRAMES", slack):
        config = PRESETS["thesis"].replace(
            taxels=taxels,
            sample_bits=8,
            band_low=100,
            band_high=150,
            feature_shift=(),
            pretrigger_frames=1,
            hop=4,
            window=8,
            steps=2,
            rearm_frames=4,
            touch_frames=20,
            fault_frames=fault_frames,
            one_port=one_port,
        )
        with opened(eskin.rtl.frontend.pretrigger_ring) as memories:
            dut = placed(PreTriggerRing(config))
        assert config.ring_frames == 2 + slack
        ring_frames = config.ring_frames
    (ring,) = memories
    (write,), (read,) = ring.writes, ring.reads
    history = config.windows.pretrigger_frames + 1
    keeps_its_beat(dut.o, "o")
    free_sink(dut.o)
    push, popped = dut.i.valid & dut.i.ready, dut.o.valid & dut.o.ready
    passes = dut.passes if one_port else Const(0, 1)

    # Beats are numbered modulo 256, frame * taxels + taxel. What the ring is given to keep is how many it kept
    # before, those that passed it by not counted: it never looks at it.
    word, wanted_word = Signal(8), Signal(8)  # of the next beat in; of the next beat out
    passed = Signal(8) if one_port else Const(0, 8)
    number, wanted = Signal(8), Signal(8)  # the same with those that passed
    m.d.comb += [number.eq(word + passed), wanted.eq(wanted_word + passed)]
    since = Signal(6)  # beats since arm or since the end of the last touch that was read, 63 for more
    free(dut.i.valid)
    m.d.comb += dut.i.p.complement.eq(word | (1 << 8))
    if fault_frames:
        m.d.comb += dut.i.p.masked.eq(number.xor())
        prove(~dut.o.valid | (dut.o.p.masked == wanted.xor()), "masked goes with its beat")
    if one_port:
        m.d.sync += passed.eq(passed + passes)
    m.d.sync += [word.eq(word + (push & ~passes)), since.eq(since + (push & (since != 63)))]
    last_taxel = (number & (taxels - 1)) == taxels - 1
    if taxels <= STATE_BEATS:  # the detector waits
        pushed = before(push, "pushed")
        recent = pushed | before(pushed, "pushed_before")
        assume(~dut.i.valid | ((number & (taxels - 1)) != 0) | ~recent)

    # The detector: an onset any time when it is armed, the touch's last frame any later one, then
    # rearm_frames frames at least.
    touch, left, quiet = (
        Signal(name="in_touch"),
        Signal(4, name="frames_left"),
        Signal(range(ring_frames + 1), name="quiet"),
    )
    more = Signal(4, name="frames_more")
    free(more)
    free(dut.i.p.onset)
    free(dut.i.p.touch)
    armed = ~touch & (quiet == 0)
    assume(~dut.i.p.onset | (armed & last_taxel))
    assume((more >= 1) & (more <= 6))
    onset = push & dut.i.p.onset
    with m.If(onset):
        m.d.sync += [touch.eq(1), left.eq(more)]
    with m.Elif(push & last_taxel & touch):
        m.d.sync += [left.eq(left - 1), touch.eq(left != 1), quiet.eq(Mux(left == 1, ring_frames, 0))]
    with m.Elif(push & last_taxel & (quiet != 0)):
        m.d.sync += quiet.eq(quiet - 1)

    # The reader: waits for the touch's frames and knows its last beat.
    reading = Signal()
    end = Signal(8)  # a touch is read; its last beat's number
    # the first beat of frame f - pretrigger_frames, seen at the last beat of frame f
    start = word - (history * taxels - 1)
    with m.If(onset):
        m.d.sync += [
            reading.eq(1),
            wanted_word.eq(Mux(since >= history * taxels - 1, start, word - since)),
            end.eq(number + more * taxels),
        ]
    with m.Elif(popped):
        m.d.sync += wanted_word.eq(wanted_word + ~passes)
        with m.If(dut.touch_last):
            m.d.sync += [reading.eq(0), since.eq(number + push - wanted - 1)]
    m.d.comb += dut.touch_last.eq(wanted == end)
    prove(~dut.o.valid | reading, "nothing leaves but a touch")
    prove(~dut.o.valid | ((dut.o.p.complement & 255) == wanted_word), "the next beat of the touch")
    prove(~push | (dut.held < (1 << len(dut.held)) - 1), "the ring never overflows")

    # ---- for the induction
    stored_before, frame = Signal.like(dut.held, name="in_the_ring"), taxels
    m.d.comb += stored_before.eq(dut.held - dut.counted)
    prove(dut.held >= dut.counted, "a beat that was fetched was there")
    oldest, first = Signal(8, name="oldest_word"), Signal(8, name="first_held")
    m.d.comb += [oldest.eq(word - stored_before), first.eq(oldest + passed)]
    mask = ring.depth - 1
    prove(write.addr == (word & mask), "where it writes")
    prove(read.addr == (oldest & mask), "where it reads")
    capacity = ring_frames * taxels
    prove(stored_before <= capacity + 1, "the most it holds")
    prove((stored_before <= capacity) | dut.full, "full in time")
    for address, content in enumerate(ring.words):
        place = Signal(8, name=f"place_{address}")
        m.d.comb += place.eq((address - oldest) & mask)
        beat = Signal(8, name=f"beat_{address}")
        m.d.comb += beat.eq(oldest + place)
        stored = Cat(beat, beat.xor()) if fault_frames else beat
        prove((place >= stored_before) | (content == stored), "what it holds")
    dut_touch, starting, fetched = dut.touch, dut.starting, dut.fetched
    earlier = SimpleNamespace(held=Signal.like(dut.held), push=Signal(), fetch=Signal(), starting=Signal())
    m.d.sync += [
        earlier.held.eq(dut.held),
        earlier.push.eq(push & ~passes),
        earlier.fetch.eq(read.en),
        earlier.starting.eq(starting),
    ]
    prove(dut.counted == earlier.fetch, "a beat fetched is counted a cycle late")
    prove(~dut.counted | dut_touch & dut.fetched, "only in a touch")
    uncounted = Signal()  # of the fetch two cycles ago
    m.d.sync += uncounted.eq(dut.counted)
    prove(
        earlier.held + earlier.push == dut.held + Mux(dut.dropped, frame, 0) + uncounted, "what a cycle did"
    )
    prove(dut.surplus == (earlier.held >= history * frame + (frame // 2 or 1)), "surplus, a cycle late")
    prove(dut.some == (earlier.held > uncounted + earlier.fetch), "something to fetch, a cycle late")
    prove(~(dut_touch & dut.dropped), "nothing is dropped as a touch begins")
    prove(~fetched | dut_touch, "fetched in a touch")
    begun = dut.begun if taxels == 1 else Const(0)
    prove(~(starting & dut_touch) & ~(begun & (starting | dut_touch)), "starting ends with the touch's begin")
    prove(~(onset & reading), "a touch is read to its end before the next onset")
    frame_start, to_end, after_end = (
        number & ~Const(taxels - 1, 8),
        Signal(8, name="to_end"),
        Signal(8, name="after_end"),
    )
    m.d.comb += [to_end.eq(end - wanted), after_end.eq(frame_start - end - 1)]
    prove(~reading | ((end & (taxels - 1)) == taxels - 1), "a touch ends with a frame")
    prove(~reading | (to_end < 64), "its end is ahead")
    prove(
        ~touch | reading & (end == (frame_start + left * taxels - 1)[:8]) & (left != 0) & (left <= 6),
        "frames left",
    )
    prove((quiet == 0) | ~touch & (quiet <= ring_frames), "quiet after the touch")
    prove(
        touch
        | ~reading
        | Mux(quiet == 0, after_end >= ring_frames * taxels, after_end == (ring_frames - quiet) * taxels),
        "frames since",
    )
    prove(~reading | touch | (after_end < 64), "not long ago")
    prove(reading == (begun | starting | dut_touch), "a touch is read from its onset on")
    prove(~dut_touch | (oldest == (wanted_word + fetched)[:8]), "the next beat that is read")
    if one_port:
        idle = (dut.held == 0) & ~dut.counted & ~fetched & ~dut.full
        prove(~dut.passing | (dut_touch & idle), "the memory is empty where beats pass it by")
        prove(~(read.en & write.en), "one port")
    prove(~fetched | (read.data[:8] == wanted_word), "the beat that was read")
    if fault_frames:
        prove(~fetched | (read.data[8] == wanted.xor()), "and its mask")
    prove(dut_touch | ((first & (taxels - 1)) == 0), "whole frames are dropped")
    # without a touch: nothing is dropped that a touch could want which begins with the frame under way
    at = number & (taxels - 1)
    prove(reading | (stored_before >= (history - 1) * frame + at) | (stored_before == since), "history")
    prove(reading | (stored_before <= since), "nothing older than the last touch's end")
    if taxels <= STATE_BEATS:
        prove(~(begun | starting) | (at == 0), "no beat of a frame that begins before its touch")
        begins = before(pushed, "pushed_then") if taxels == 1 else pushed
        prove(~starting | earlier.starting | begins, "a touch begins with a beat")
        prove(~begun | pushed, "a touch begins with the beat before")
    opening = begun | starting
    drops = Signal(8)
    m.d.comb += drops.eq(wanted - first)
    ahead = number - wanted  # beats of the touch that are there
    prove(~opening | (drops <= stored_before) & ((drops & (frame - 1)) == 0), "whole frames too many")
    prove(
        ~opening | (drops == 0) | (ahead[:8] >= history * frame), "frames are too many where history is whole"
    )
    prove(
        ~opening | (ahead[:8] <= history * frame + (earlier.starting if taxels > STATE_BEATS else 0)),
        "one beat more at most before a touch begins",
    )
    prove(~(starting & earlier.starting) | dut.full, "no beat while frames are dropped for a touch")
