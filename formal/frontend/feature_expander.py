"""The feature expander: of every deviation a beat a kind, in order, each by the specification's words,
whatever the memory held before."""

from types import SimpleNamespace

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value, signed, unsigned

import eskin.rtl.frontend.feature_expander
from eskin.golden.core import AcceleratorConfig
from eskin.rtl.frontend.feature_expander import SLOTS, FeatureExpander
from eskin.rtl.program.timing import STATE_BEATS
from formal.frontend.frame_marks import EVEN, FREE, KINDS, frames, gap_left
from formal.memory import opened
from formal.proof import (
    Bug,
    any_number,
    assume,
    free_sink,
    free_source,
    keeps_its_beat,
    opened_up,
    proof,
    prove,
)

TOUCH, RUNNING = EVEN.replace(**KINDS), FREE.replace(**KINDS)


def _of_one_taxel(
    m: Module, dut: FeatureExpander, config: AcceleratorConfig, at: SimpleNamespace, taxel: Signal
) -> SimpleNamespace:
    """What the specification says of one taxel, with the deviation at the input in it: the sum of its block
    so far and that of the block before, and what the integral is made of."""
    bound, features, touch = config.deviation_bound, config.features, config.windows.window_mode == "touch"
    wide = signed(config.integral_bits + 3)
    here, earlier, total, hop_now, hop_before = (
        Signal(wide, name=name) for name in ("here", "earlier", "total", "hop_now", "hop_before")
    )
    deviation = ~dut.i.p.complement
    now = SimpleNamespace(
        here=Mux(at.in_block == 0, 0, here) + deviation, hop_now=Mux(at.frame == 0, 0, hop_now) + deviation
    )
    begins = at.frame == 0 if touch else Const(0)
    now.total = (
        Mux(begins, 0, total) + deviation if touch else now.hop_now + Mux(at.windows == 0, hop_before, total)
    )
    mine, done = at.beat == taxel, at.beat > taxel  # of this frame: it is there, or gone
    with m.If(at.taken & mine):
        m.d.sync += here.eq(now.here)
        with m.If(at.in_block == features.activity_block - 1):
            m.d.sync += earlier.eq(now.here)
        if touch:
            m.d.sync += total.eq(now.total)
        else:  # total: of the hops of the touch that have ended
            m.d.sync += hop_now.eq(now.hop_now)
            with m.If(at.frame == config.windows.hop - 1):
                m.d.sync += [hop_before.eq(now.hop_now), total.eq(now.total)]
    # bounds: so many frames, so much
    so_far = at.frame + done
    counted = Mux(at.in_block + done == 0, features.activity_block, at.in_block + done)
    prove((here <= counted * bound) & (here >= -(counted * bound)), "a block's sum")
    prove(
        (earlier <= features.activity_block * bound) & (earlier >= -features.activity_block * bound),
        "the block before",
    )
    ended = Mux(done, at.in_block == features.activity_block - 1, (at.in_block == 0) & at.some)
    prove(~ended | (earlier == here), "a block that ended")
    hop = config.windows.hop
    if touch:
        of_touch = Mux(so_far == 0, config.last_frame, so_far)
        prove((total <= of_touch * bound) & (total >= -(of_touch * bound)), "a touch's sum")
    else:
        of_hop = Mux(so_far == 0, hop, so_far)
        prove((hop_now <= of_hop * bound) & (hop_now >= -(of_hop * bound)), "a hop's sum")
        prove((hop_before <= hop * bound) & (hop_before >= -hop * bound), "the hop before")
        ended = (at.windows + 1) * hop
        # the taxel's last beat of a hop comes before the hop ends
        whole = Signal(unsigned(8), name="frames_of_total")
        early = (at.frame == hop - 1) & done
        m.d.comb += whole.eq(ended + Mux(early, hop, 0))
        prove(
            (at.windows == 0) & ~early | (total <= whole * bound) & (total >= -(whole * bound)),
            "the sum of a touch's hops",
        )
        prove(~(early | (at.frame == 0) & ~done) | (hop_before == hop_now), "a hop that ended")
        prove((at.later | (at.frame != 0) | done) | (hop_now == 0), "nothing yet")
        prove(at.later | early | (hop_before == 0), "no hop yet")
    last = SimpleNamespace(here=here, earlier=earlier, total=total, hop_now=hop_now, hop_before=hop_before)
    return SimpleNamespace(now=now, last=last, mine=mine, done=done)


def _companded(m: Module, value, config: AcceleratorConfig) -> Signal:
    """Section 3's logarithm of a sum, by cases of its size."""
    knee, fraction, width = config.features.integral_knee, config.features.integral_frac, config.integral_bits
    b, result = Signal(unsigned(width + 1), name="b"), Signal(signed(width + fraction + 2), name="companded")
    m.d.comb += b.eq(Mux(value < 0, -value, value) + (1 << knee))
    for e in range(knee, width + 1):
        with m.If((b >> e) == 1):
            size = ((e - knee) << fraction) + ((b << fraction) >> e) - (1 << fraction)
            m.d.comb += result.eq(Mux(value < 0, -size, size))
    return result


def _beats(m: Module, config: AcceleratorConfig) -> None:
    """Any deviations, one taxel looked at, every kind of its beats."""
    with opened(eskin.rtl.frontend.feature_expander) as memories:
        dut = FeatureExpander(config)
        inside = opened_up(dut)
    features, kinds, taxels, bound = (
        config.features,
        config.features.feature_kinds,
        config.sensor.taxels,
        config.deviation_bound,
    )
    touch, block = config.windows.window_mode == "touch", features.activity_block
    free_source(dut.i)
    free_sink(dut.o)
    keeps_its_beat(dut.o, "o")
    deviation = ~dut.i.p.complement
    assume((deviation <= bound) & (deviation >= -bound))
    at = frames(m, config, dut.i, Const(1))
    taxel = any_number(range(taxels), "one")
    assume(taxel < taxels)
    ref = _of_one_taxel(m, dut, config, at, taxel)

    # ---- what leaves: of each taxel the kinds that come, in turn
    step, slot = inside.step, inside.slot
    comes = {"mean": Const(1), "activity": at.block_last, "integral": at.emit}
    made = Signal()
    kind = Signal(range(len(kinds) + 1))  # that were made of this deviation
    m.d.comb += made.eq(step & inside.made_now)
    with m.If(step):
        m.d.sync += kind.eq(Mux(at.taken, 0, kind + made))
    changed = ref.now.here - ref.last.earlier if features.activity_rule == "change" else ref.now.here
    compares = at.some | (features.activity_rule == "sum")
    activity = Mux(compares, Mux(changed < 0, -changed, changed), 0)
    integral = _companded(m, ref.now.total, config) if "integral" in kinds else Const(0)
    amounts = {"mean": deviation, "activity": activity, "integral": integral}
    expected = Signal(signed(config.sum_bits + 4))
    of_one = Signal()
    flags = [name for name in dut.i.p.shape().members if name != "complement"]
    passed = Signal(max(1, len(flags)))
    with m.If(made):
        m.d.sync += [of_one.eq(ref.mine), passed.eq(Cat(getattr(dut.i.p, name) for name in flags))]
        for number, name in enumerate(kinds):
            with m.If(kind == number):
                m.d.sync += expected.eq(amounts[name])
                prove(~made | comes[name], f"{name}: only where it says something")
    prove(~(dut.o.valid & of_one) | (~dut.o.p.complement == expected), "the feature")
    prove(~dut.o.valid | (Cat(getattr(dut.o.p, name) for name in flags) == passed[: len(flags)]), "its flags")
    prove(~at.taken | (kind + made == sum(comes[name] for name in kinds)), "all that come before the next")

    # ---- for the induction: the state of the block
    for number in range(1 + max(SLOTS[name] for name in kinds)):
        earlier = sum((comes[name] for name in kinds if SLOTS[name] < number), Const(0))
        prove((slot != number) | (kind == earlier), f"kinds made before slot {number}")
    last: Value = Const(0)
    for name in kinds:
        last = Mux(comes[name], SLOTS[name], last)
    prove(slot <= last, "slot")
    prove((slot == 0) | dut.i.valid, "a deviation that was begun stays")
    prove(inside.taxel == at.beat, "taxel")
    of_fresh = Mux(slot == 1, at.beat, Mux(at.beat == 0, taxels - 1, at.beat - 1))
    prove(~inside.written | (slot < 2) & (inside.taxel_of_fresh == of_fresh), "the write under way")
    waits: Value = Const(0)
    if taxels < STATE_BEATS:
        left = gap_left(inside, taxels)
        waits = left != 0
        prove(~waits | (slot == 0) & (at.beat == 0), "only between frames")
        wide = ~inside.written | (slot != 0) | (at.beat != 0)
        prove(wide | (left == STATE_BEATS - taxels), "the write before it is read")
    prove(inside.first == ((at.frame == 0) if touch else ~at.later & (at.frame == 0)), "the first frame")
    if "activity" in kinds:
        if block > 1:
            prove(inside.frame_in_block == at.in_block, "place")
        if features.activity_rule == "change":
            prove(inside.lone == ~at.some, "no block before")
    if "integral" in kinds and not touch:
        prove(inside.hop_first == (at.frame == 0), "the first frame of a hop")
        prove(inside.falls == ((at.frame == 0) & (at.windows == 0)), "no touch goes on")
    (memory,) = memories
    word, pending = memory.words[taxel], inside.written & (inside.taxel_of_fresh == taxel)
    started = ref.mine & (slot != 0)  # what is kept has this frame's deviation in it
    anything = at.some | (at.in_block != 0) | ref.done | started | (at.frame != 0)
    if not touch:
        anything |= at.later
    total_last = ref.last.total
    if not touch:  # the hops of the touch that ended, and the one under way
        between = Mux(ref.done, at.frame == config.windows.hop - 1, at.frame == 0)
        total_last = Signal(signed(config.integral_bits + 3), name="running")
        base = Mux(at.windows == 0, ref.last.hop_before, ref.last.total)
        m.d.comb += total_last.eq(Mux(between, ref.last.total, base + ref.last.hop_now))
    kept = {
        "block": (ref.last.here, ref.now.here),
        "change": (ref.last.here - ref.last.earlier, ref.now.here - ref.last.earlier),
        "total": (total_last, ref.now.total),
        "hop": (ref.last.hop_now, ref.now.hop_now),
    }
    # a change is r = here - earlier while its block is under way, from the second block on
    within = (
        Mux(ref.done | started, Const(1), at.in_block != 0)
        & at.some
        & ~((at.in_block == block - 1) & ref.done)
    )
    for name in inside.fresh:
        old, new = kept[name]
        fresh, width = inside.fresh[name], len(inside.fresh[name])
        defined = anything if name != "change" else within
        if name == "total" and not touch:  # after a touch's last frame the sum is of no use
            defined = defined & ~((at.frame == 0) & (at.windows == 0) & ~started & ~ref.done)
        specified = Signal(signed(width + 4), name=f"wanted_{name}")
        m.d.comb += specified.eq(Mux(started, new, old))
        prove(~(started & ((name != "change") | at.some)) | (fresh == new), f"{name}: renewed")
        if name in inside.fields:
            offset = sum(
                inside.fields[other] for other in list(inside.fields)[: list(inside.fields).index(name)]
            )
            held = Mux(pending, fresh, word[offset : offset + width].as_signed())
            prove(~defined | (held == specified), f"{name}: kept")
            read = inside.present_state[name]
            prove(waits | ~(defined & ref.mine & (slot == 0)) | (read == specified), f"{name}: read")
    if "integral" in kinds:
        knee = 1 << features.integral_knee
        size = Mux(ref.now.total < 0, -ref.now.total, ref.now.total)
        prove(
            ~(ref.mine & (slot == 2))
            | (inside.biased == size + knee) & (inside.below == (ref.now.total < 0)),
            "its size and sign",
        )


CLAIM = (
    "of every deviation a beat a kind in order, with its flags; mean, activity and integral are those of "
    "the specification, no sum "
    "overflows, whatever the memory held; offers stay until taken"
)
BUGS = {
    "old touch": Bug(
        "the integral goes on from the last touch",
        "Mux(first, 0, begins_from)",
        "begins_from",
        depth=30,
        eager=True,
    ),
    "earlier": Bug(
        "the last block is forgotten",
        "Mux(block_first, -old, keep(",
        "Mux(block_first, 0, keep(",
        depth=60,
        eager=True,
    ),
    "lone": Bug(
        "a touch's first block is compared",
        "m.d.sync += lone.eq(ends)",
        "m.d.sync += lone.eq(0)",
        depth=90,
        eager=True,
    ),
    "negative": Bug(
        "falling changes count one too much", "~amount) - negative", "~amount)", depth=60, eager=True
    ),
    "end": Bug(
        "the sum runs on after a touch",
        "(self.i.p.emit & ~self.i.p.end)",
        "self.i.p.emit",
        depth=60,
        eager=True,
    ),
    "stall": Bug(
        "a beat overwrites a waiting one", "advance.eq(~self.o.valid | self.o.ready)", "advance.eq(1)"
    ),
    "write": Bug(
        "the last taxel's word is written",
        "written.eq(step & (slot == 0))",
        "written.eq(taken)",
        depth=60,
        eager=True,
    ),
    "hop": Bug(
        "a hop's sum is never begun anew", "Mux(hop_first, 0, of_hop)", "of_hop", depth=40, eager=True
    ),
}


@proof(
    CLAIM,
    depth=1,
    reduced="4 taxels, deviations up to 2, blocks of 2 frames, touches of 6",
    bugs=tuple(BUGS[name] for name in ("old touch", "earlier", "stall", "write")),
)
def in_touches(m: Module) -> None:
    _beats(m, TOUCH)


@proof(
    f"{CLAIM}; windows that run freely: at an onset the integral has seen what the first window has seen",
    depth=1,
    reduced="4 taxels, deviations up to 2, blocks and hops of 2 frames, touches of 2 windows of 4",
    bugs=(BUGS["hop"],),
)
def running_freely(m: Module) -> None:
    _beats(m, RUNNING)


@proof(
    f"{CLAIM}; a touch's integral ends with it",
    depth=1,
    reduced="4 taxels, deviations up to 2, the integral alone, hops of 2 frames, touches of 1 window of 4",
    bugs=(BUGS["end"],),
)
def integrals_alone(m: Module) -> None:
    _beats(m, RUNNING.replace(feature_kinds=("integral",), steps=1))


@proof(
    f"{CLAIM}; changes from block to block",
    depth=1,
    reduced="4 taxels, deviations up to 2, activity alone in blocks of 2 frames, touches of 6",
    bugs=tuple(BUGS[name] for name in ("lone", "negative")),
)
def changes_of_blocks(m: Module) -> None:
    _beats(m, TOUCH.replace(feature_kinds=("activity",)))


@proof(
    f"{CLAIM}; changes from frame to frame",
    depth=1,
    reduced="4 taxels, deviations up to 2, activity alone in blocks of 1 frame, touches of 6",
    bugs=(
        Bug(
            "the frame before is the frame itself",
            'next_state["change"] = deviation - old',
            'next_state["change"] = deviation',
            depth=30,
        ),
    ),
)
def changes_of_frames(m: Module) -> None:
    _beats(m, TOUCH.replace(feature_kinds=("activity",), activity_block=1))


@proof(
    f"{CLAIM}; the activity of a block is the size of its sum",
    depth=1,
    reduced="4 taxels, deviations up to 2, mean and activity in blocks of 2 frames",
    bugs=(
        Bug(
            "a sum is never begun anew",
            "Mux(block_first, 0, old) + deviation if",
            "old + deviation if",
            depth=40,
            eager=True,
        ),
    ),
)
def sums_of_blocks(m: Module) -> None:
    _beats(m, RUNNING.replace(feature_kinds=("mean", "activity"), activity_rule="sum"))


FEW = f"{CLAIM}; of few taxels, whose state is read again in the gap between two frames"
EARLY = dict(file="rtl/common/frame_gap.py", depth=40, eager=True)


@proof(
    FEW,
    depth=1,
    reduced="1 taxel, deviations up to 2, blocks of 2 frames, touches of 6",
    bugs=(Bug("the gap is a cycle short", "left.eq(STATE_BEATS - taxels)", "left.eq(1)", **EARLY),),
)
def one_taxel(m: Module) -> None:
    _beats(m, TOUCH.replace(taxels=1))


@proof(
    FEW,
    depth=1,
    reduced="2 taxels, deviations up to 2, blocks of 2 frames, touches of 6",
    bugs=(Bug("there is no gap", "return left != 0", "return left > 1", **EARLY),),
)
def two_taxels(m: Module) -> None:
    _beats(m, TOUCH.replace(taxels=2))


@proof(
    FEW,
    depth=1,
    reduced="3 taxels, deviations up to 2, blocks and hops of 2 frames, touches of 2 windows of 4",
    bugs=(BUGS["hop"],),
)
def three_taxels(m: Module) -> None:
    _beats(m, RUNNING.replace(taxels=3))
