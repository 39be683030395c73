"""The window averager: every window of every touch once, input by input, with the exact sum of its frames."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value, signed

import eskin.rtl.frontend.window_averager
from eskin.golden.core import AcceleratorConfig
from eskin.rtl.frontend.window_averager import Operation, WindowAverager
from eskin.rtl.program.timing import STATE_BEATS
from formal.engine.sequencer import table
from formal.frontend.frame_marks import EVEN, FREE, KINDS, ODD, frames, gap_left
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


def _windows(m: Module, config: AcceleratorConfig) -> None:
    """Frame after frame of free deviations, one taxel looked at: what each window is made of by
    docs/specification.md section 2, as sums of hops."""
    with opened(eskin.rtl.frontend.window_averager) as memories:
        dut = WindowAverager(config)
        inside = opened_up(dut)
    (sums,) = memories
    free_source(dut.i)
    free_sink(dut.o)
    keeps_its_beat(dut.o, "o")
    kinds, taxels, hop = config.features.feature_kinds, config.sensor.taxels, config.windows.hop
    odd, last_hop = config.windows.window - 2 * hop, (config.last_frame - 1) // hop
    together = [k for k, (_, end) in enumerate(config.window_spans) if end == config.last_frame]
    for k, (first, end) in enumerate(
        config.window_spans
    ):  # a window is whole hops, the last one up to its end
        added = last_hop - k if k in together else 1 + odd
        assert first == ((end - 1) // hop - added) * hop + 1

    # ---- what comes in: the beat's kind is the reference's own
    last_kind, kind = Signal(name="last_kind"), Signal(range(len(kinds)), name="kind_in")
    at = frames(m, config, dut.i, last_kind)
    present = {"mean": Const(1), "activity": at.block_last, "integral": at.emit}
    more = [present[name] for name in kinds[1:]]
    m.d.comb += last_kind.eq(~(Cat(*more, Const(0, 1)) >> kind)[0])
    with m.If(at.taken):
        m.d.sync += kind.eq(Mux(last_kind, 0, kind + 1))
    for number, name in enumerate(kinds):
        prove((kind < len(kinds)) & ((kind != number) | present[name]), "a kind that comes")
    if len(kinds) > 1:
        assume(~dut.i.valid | (dut.i.p.block_last == at.block_last))
    blocks = config.features.activity_block
    bounds = {
        "mean": (config.deviation_bound, hop),
        "activity": (config.block_bound, hop // blocks),
        "integral": (config.integral_limit, 1),
    }
    value, masked = ~dut.i.p.complement, dut.i.p.masked if config.faults.fault_frames else Const(0)
    for number, name in enumerate(kinds):
        assume((kind != number) | (value <= bounds[name][0]) & (value >= -bounds[name][0]))
    prove(~at.taken | (dut.frame_last == (last_kind & (at.beat == taxels - 1))), "the frame's last beat")

    # ---- what goes out: taxel, kind and window of the beat that is made; the beat offered is the one made before
    draining, operation, index, passes = inside.draining, inside.operation, inside.index, inside.passes
    newest, begun = operation == Operation.NEWEST, operation != Operation.NEWEST
    emits = Mux(draining, 1, at.emit)
    made = Signal(name="made")
    out_taxel, out_kind, window = (
        Signal(range(taxels)),
        Signal(range(len(kinds))),
        Signal(range(config.windows.steps)),
    )
    was_taxel, was_kind, was_window = (Signal.like(signal) for signal in (out_taxel, out_kind, window))
    m.d.comb += made.eq(inside.step & inside.beat_done & inside.emits)
    out_last = out_kind == len(kinds) - 1
    with m.If(made):
        m.d.sync += [was_taxel.eq(out_taxel), was_kind.eq(out_kind), was_window.eq(window)]
        m.d.sync += out_kind.eq(Mux(out_last, 0, out_kind + 1))
        with m.If(out_last):
            m.d.sync += out_taxel.eq(Mux(out_taxel == taxels - 1, 0, out_taxel + 1))
    prove(~made | emits, "a window ends with its frame only")
    offered = dut.o.p
    prove(~dut.o.valid | (offered.taxel == was_taxel), "taxels in order")
    if len(kinds) > 1:
        prove(~dut.o.valid | (offered.kind == was_kind), "kinds in order")
        prove((out_kind < len(kinds)) & (was_kind < len(kinds)), "kinds")
    last_window = was_window == config.windows.steps - 1
    prove(~dut.o.valid | (offered.final == last_window), "final marks the last window of the touch")
    prove(
        ~dut.o.valid | (offered.length == table(m, list(config.length_index), was_window, "length")), "length"
    )
    if config.windows.window_mode == "touch":
        with m.If(made & out_last & (out_taxel == taxels - 1)):
            m.d.sync += window.eq(Mux(window == config.windows.steps - 1, 0, window + 1))
        ends = table(m, [end - 1 for _, end in config.window_spans], window, "ends")
        prove(~made | draining | (at.frame == ends), "a window leaves with its last frame")
        numbers = range(config.last_frame)
        done = table(m, [sum(end <= f for _, end in config.window_spans) for f in numbers], at.frame, "done")
        prove(window == Mux(draining, together[0] + passes, done), "windows made")
        hop_index = table(m, [f // hop for f in numbers], at.frame, "hop_index")
    else:
        m.d.comb += window.eq(at.windows)
        hop_index = at.later

    # ---- for the induction: where the block stands
    prove((passes < len(together)) & (operation.as_value() != 2), "pass, operation")
    prove(
        ~draining | (at.beat == 0) & (kind == 0) & (at.place == 0) & (at.frame == 0), "passes follow a touch"
    )
    inner = inside.kind if len(kinds) > 1 else Const(0)
    prove(
        Mux(draining, (index < taxels) & (inner < len(kinds)), (index == at.beat) & (inner == kind)), "beat"
    )
    prove(
        Mux(emits, (out_taxel == index) & (out_kind == inner), (out_taxel == 0) & (out_kind == 0)),
        "beats made",
    )
    prove(newest | (~dut.o.valid & (draining | dut.i.valid)), "a beat that was begun stays")
    hops = Signal(2, name="hops_added")
    m.d.comb += hops.eq(Mux(at.emit, 1 + odd, 0))
    for number, k in enumerate(together):
        with m.If((draining | at.end) & (passes == number)):
            m.d.comb += hops.eq(last_hop - k)
    prove(newest | (hops == 2) | (hops == 1) & (operation == Operation.PREVIOUS), "as many hops as are added")
    for name in kinds:
        first_of_hop = at.place < (blocks if name == "activity" else 1)
        prove(draining | (inside.begins[name] == (first_of_hop | (name == "integral"))), f"{name}: begins")
    waits: Value = Const(0)
    if taxels < STATE_BEATS:
        left = gap_left(inside, taxels)
        waits = left != 0
        prove(~waits | newest & (index == 0) & (inner == 0), "only between frames")
        prove(~inside.fresh | begun | (inner != 0) | (index != 0) | (left == STATE_BEATS - taxels), "at once")
    before_index = Mux(index == 0, taxels - 1, index - 1)
    frame_begins = newest & ~draining & (index == 0) & (inner == 0)
    bank = inside.parity ^ (frame_begins & (at.place == 0))
    prove(~inside.fresh | (inside.bank == bank) & (~draining | newest & (index == 0) & (inner == 0)), "bank")
    same = begun | (inner != 0)
    prove(~inside.fresh | (offered.taxel == Mux(same, index, before_index)), "the write under way")
    if len(kinds) > 1:
        prove(~(inside.fresh & same) | (offered.kind == inner - newest), "the write under way, its kind")
    prove((window < config.windows.steps) & (was_window < config.windows.steps), "windows")
    for name in kinds:
        first_of_hop = at.place < (blocks if name == "activity" else 1)
        prove(draining | (inside.begins[name] == (first_of_hop | (name == "integral"))), f"{name}: begins")
    before_index = Mux(index == 0, taxels - 1, index - 1)
    if len(kinds) == 1:
        prove(~inside.fresh | (inside.bank == inside.parity) | newest & (index == 0) & ~draining, "bank")
        prove(~inside.fresh | (offered.taxel == Mux(begun, index, before_index)), "the write under way")
    begins = Const(0)
    for number, name in enumerate(kinds):
        first_beat = newest & ~draining & inside.begins[name]
        begins |= (inner == number) & (first_beat | begun & (name == "integral"))
    prove(inside.alone == begins, "nothing of the memory is taken")

    # ---- one taxel
    taxel = any_number(range(taxels), "one")
    assume(taxel < taxels)
    here, done_beat = at.beat == taxel, at.beat > taxel
    was_masked, expected_masked = Signal(), Signal()
    bits = config.sum_bits + 4
    expected = Signal(signed(bits), name="expected")
    of_one = dut.o.valid & (was_taxel == taxel)
    with m.If(at.taken & here):
        m.d.sync += was_masked.eq(masked)
    limit = 0
    for number, name in enumerate(kinds):
        now, before, older = (
            Signal(signed(bits), name=f"{word}_{name}") for word in ("now", "before", "older")
        )
        known = Signal(2, name=f"hops_{name}")  # how many of them were begun
        done_here = done_beat | here & (kind > number)
        mine, first = here & (kind == number), (at.place < blocks) if name == "activity" else at.place == 0
        alone = Const(1) if name == "integral" else first
        with m.If(at.taken & mine):
            m.d.sync += now.eq(Mux(alone, 0, now) + value)
            with m.If(first):
                m.d.sync += [before.eq(now), older.eq(before), known.eq(Mux(known == 3, 3, known + 1))]
        # the hop's first beat of this input is still to come
        comes_last = at.in_block == blocks - 1 if name == "activity" else Const(1)
        apart = ~draining & first & ~(done_here & comes_last)
        added, (bound, count) = bounds[name][0], bounds[name]
        of_hop = Mux(
            apart,
            count,
            at.place // blocks + (done_here & comes_last) if name == "activity" else at.place + done_here,
        )
        most = Const(1) if name == "integral" else Mux(draining, count, of_hop)
        prove((now <= most * bound) & (now >= -(most * bound)), f"{name}: a hop's sum")
        for signal in (before, older):
            prove((signal <= count * bound) & (signal >= -(count * bound)), f"{name}: a hop before")
        limit = max(limit, bound * (2 * count + odd))
        # with the beat at the input in them
        going = mine & ~draining
        now_in = Mux(going, Mux(alone, 0, now) + value, now)
        before_in, older_in = Mux(going & first, now, before), Mux(going & first, before, older)
        total = now_in + Mux(hops >= 1, before_in, 0) + Mux(hops == 2, older_in, 0)
        this_made = (out_taxel == taxel) & (out_kind == number)
        with m.If(made & this_made):
            m.d.sync += [
                expected.eq(now_in if name == "integral" else total),
                expected_masked.eq(Mux(draining, was_masked, masked)),
            ]
        if name != "integral":
            needed = hops + ~(going & first)
            prove(~(emits & this_made) | (known >= needed), f"{name}: the hops were there")
        begun_hops = Mux(draining, last_hop + 1, hop_index + ~apart)
        if name != "integral":
            prove(known >= Mux(begun_hops > 3, 3, begun_hops), f"{name}: hops so far")
        started = mine & begun & ~draining
        pending = (
            inside.fresh & (offered.taxel == taxel) & ((offered.kind == number) if len(kinds) > 1 else 1)
        )

        def complement(wanted, word: str, name: str = name) -> Signal:
            held = Signal(signed(config.sum_bits), name=f"{word}_{name}")
            m.d.comb += held.eq(~wanted)
            return held

        address = [
            Cat(*([Const(number, len(inside.kind))] if len(kinds) > 1 else []), taxel, Const(bank, 1))
            for bank in (0, 1)
        ]
        words = [
            Mux(
                pending & (inside.bank == bank),
                inside.total,
                sums.words[address[bank]][: config.sum_bits].as_signed(),
            )
            for bank in (0, 1)
        ]
        here_word, other_word = (Mux(inside.parity, *pair) for pair in (words[::-1], words))
        in_bank = Mux(apart & ~started, before, Mux(started, now_in, now))
        enough = Mux(apart & ~started, known >= 2, (known >= 1) | started)
        if name == "integral":  # of the frame that ends a window, for its passes
            in_bank, enough = Mux(started, now_in, now), started | draining | (at.emit & done_here)
        prove(~enough | (here_word == complement(in_bank, "in_bank")), f"{name}: the bank of this hop")
        if name != "integral":
            in_other = Mux(apart, now, before)
            enough = Mux(apart, known >= 1, known >= 2)
            prove(~enough | (other_word == complement(in_other, "in_other")), f"{name}: the bank of the last")
        current = Mux(draining, (index == taxel) & (inner == number), mine)
        read = inside.read.data[: config.sum_bits].as_signed()
        if name != "integral":
            wanted = Mux(operation == Operation.PREVIOUS, Mux(apart, now, before), Mux(begun, before, now))
            cares = Mux(newest & ~draining, ~apart, 1) & Mux(newest, known >= 1, known >= Mux(apart, 1, 2))
            prove(
                waits | ~(current & cares & (begun | ~apart)) | (read == complement(wanted, "read")),
                f"{name}: read",
            )
            partial = now_in + Mux((operation == Operation.PREVIOUS) & (hops == 2), older_in, 0)
        else:
            prove(waits | ~(current & newest & draining) | (read == complement(now, "read")), "read")
            partial = now_in
        prove(~(current & begun) | (inside.total == complement(partial, "partial")), f"{name}: so far")
        if config.faults.fault_frames:
            bits_of = [
                Mux(
                    pending & (inside.bank == bank),
                    offered.masked,
                    sums.words[address[bank]][config.sum_bits],
                )
                for bank in (0, 1)
            ]
            mask = Mux(inside.parity, *bits_of[::-1])
            stored = Mux(started, masked, was_masked)
            prove((apart | (known == 0)) & ~started | (mask == stored), "the mask in its bank")
            mask = inside.read.data[config.sum_bits]
            prove(waits | ~(current & draining & newest) | (mask == was_masked), "read")
    prove(~of_one | (expected <= limit) & (expected >= -limit), "no sum exceeds its format")
    prove(~of_one | (~offered.complement == expected), "the sum of the window's frames")
    if config.faults.fault_frames:
        prove(~of_one | (offered.masked == expected_masked), "masked as in the window's last frame")
        mask = Mux(draining, was_masked, masked)
        prove(~(begun & (index == taxel)) | (offered.masked == mask), "masked, while hops are added")


CLAIM = (
    "steps windows a touch, a beat an input in order, marked with length and end; each sum is exact over the "
    "window's frames and fits; offered sums stay until taken"
)
SMALL = "4 taxels, deviations up to 2, hop 2"


@proof(
    CLAIM,
    depth=1,
    reduced=f"{SMALL}, 2 windows of 4 frames",
    bugs=(
        Bug("a hop goes on from the last", "alone.eq(alone_next)", "alone.eq(0)", depth=60, eager=True),
        Bug(
            "the hop's bank is not turned", "parity.eq(parity ^ turns)", "parity.eq(0)", depth=60, eager=True
        ),
    ),
)
def even(m: Module) -> None:
    _windows(m, EVEN)


@proof(
    CLAIM,
    depth=1,
    reduced=f"{SMALL}, 3 windows of 5 frames, clipped at frame 6 where two end together",
    bugs=(
        Bug(
            "the hop before the last is left out",
            "more_hops = hops[1]",
            "more_hops = 0",
            depth=80,
            eager=True,
        ),
        Bug(
            "a clipped window is forgotten",
            "Mux(at_end & ~last_pass, passes + 1, 0)",
            "0",
            depth=60,
            eager=True,
        ),
    ),
)
def odd_and_clipped(m: Module) -> None:
    _windows(m, ODD)


@proof(
    f"{CLAIM}; with a fault detector, marked as masked where the taxel is in the window's last frame",
    depth=1,
    reduced="4 taxels, 4-bit samples, deviations up to 2, 3 windows of 5 frames, hop 2, clipped at frame 6",
    bugs=(
        Bug(
            "a clipped window's mask is forgotten",
            "Mux(draining, read.data[bits], self.i.p.masked)",
            "self.i.p.masked",
            depth=60,
            eager=True,
        ),
    ),
)
def masked_sums(m: Module) -> None:
    _windows(m, ODD.replace(sample_bits=4, fault_frames=2))


@proof(
    "windows that run freely: for each frame that ends one, a beat a taxel in order, each the exact sum of "
    "the last two hops, which fits",
    depth=1,
    reduced=f"{SMALL}, windows of 4 frames",
    bugs=(
        Bug(
            "the hop's bank is not turned", "parity.eq(parity ^ turns)", "parity.eq(0)", depth=60, eager=True
        ),
    ),
)
def free_running(m: Module) -> None:
    _windows(m, FREE)


@proof(
    f"{CLAIM}; of several kinds of feature only those come that say something in their frame",
    depth=1,
    reduced=f"{SMALL}, mean and integral, 3 windows of 5 frames, clipped at frame 6",
    bugs=(
        Bug(
            "hops are added to an integral",
            '!= Operation.NEWEST) & (name == "integral")',
            "!= Operation.NEWEST) & (number == 9)",
            depth=50,
            eager=True,
        ),
        Bug("kinds that do not come are waited for", "~comes(name, self.i.p)", "0", depth=60, eager=True),
    ),
)
def several_kinds(m: Module) -> None:
    _windows(m, ODD.replace(**KINDS | dict(feature_kinds=("mean", "integral"), activity_block=1)))


@proof(
    f"{CLAIM}; activity in blocks",
    depth=1,
    reduced="4 taxels, deviations up to 2, mean and activity in blocks of 2 frames, windows of 8, hop 4",
    bugs=(
        Bug(
            "a hop's blocks go on from the last",
            "comes(name, self.i.p) if expands(config) else 1",
            "1",
            depth=90,
            eager=True,
        ),
    ),
)
def activity_in_blocks(m: Module) -> None:
    kinds = dict(feature_kinds=("mean", "activity"), activity_rule="sum", activity_block=2)
    _windows(m, FREE.replace(**kinds, hop=4, window=8))


FEW = f"{CLAIM}; of few taxels, whose sums are read again in the gap between two frames"
EARLY = dict(file="rtl/common/frame_gap.py", depth=40, eager=True)


@proof(
    FEW,
    depth=1,
    reduced="1 taxel, deviations up to 2, hop 2, 3 windows of 5 frames, clipped at frame 6",
    bugs=(Bug("the gap is a cycle short", "left.eq(STATE_BEATS - taxels)", "left.eq(1)", **EARLY),),
)
def one_taxel(m: Module) -> None:
    _windows(m, ODD.replace(taxels=1))


@proof(
    FEW,
    depth=1,
    reduced="2 taxels, deviations up to 2, hop 2, 2 windows of 4 frames",
    bugs=(Bug("there is no gap", "return left != 0", "return left > 1", **EARLY),),
)
def two_taxels(m: Module) -> None:
    _windows(m, EVEN.replace(taxels=2))


@proof(
    FEW,
    depth=1,
    reduced="3 taxels, deviations up to 2, hop 2, windows of 4 frames",
    bugs=(
        Bug(
            "the hop's bank is not turned", "parity.eq(parity ^ turns)", "parity.eq(0)", depth=60, eager=True
        ),
    ),
)
def three_taxels(m: Module) -> None:
    _windows(m, FREE.replace(taxels=3))
