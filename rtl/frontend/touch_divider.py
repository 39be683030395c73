"""Exact sums over windows that divide a whole touch (docs/specification.md, section 2: ``window_mode`` whole)."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value, signed, unsigned
from amaranth.lib import enum, stream

from eskin.golden.core import EXTREMES, AcceleratorConfig, signed_bits
from eskin.rtl.common import (
    Block,
    beat_layout,
    biased_magnitude,
    drive,
    inputs,
    logarithm,
    outputs,
    reaches,
    stored,
    sum_layout,
    working_memory,
    wrapping_increment,
)
from eskin.rtl.frontend.registered_adder import RegisteredAdder
from eskin.rtl.program.timing import STATE_BEATS


class Doing(enum.Enum, shape=3):  # type: ignore[call-arg]
    """TAKE: beats alone. HALVE: neighbours are added. COUNT: the sums of the next window are counted. BEAT: a beat
    of the next touch may come between two values. READ: the sums of a value are added. SHIFT: it loses a
    bit for each doubling. OFFER: it is taken."""

    TAKE = 0
    HALVE = 1
    COUNT = 2
    BEAT = 3
    READ = 4
    SHIFT = 5
    OFFER = 6


class TouchDivider(Block):
    """Stores the sums of a touch's hops, doubles the hop when the store is full, and divides the sums into
    windows when the touch has ended. One memory, one adder.

    ::

        memory      | sum 0 | sum 1 | ... | sum S-1 | hop under way |       a word a taxel in each

    A beat is added to its taxel's word of the hop under way; in the hop's last frame the result goes to the next
    sum instead. Nothing is ever cleared: a hop starts as its first deviation. When S sums are there, sums
    2 i and 2 i + 1 become sum i, taxel by taxel. Windows are made of the sums that count, window by window and
    taxel by taxel. Deviations come as complements and sums leave as complements, as in `WindowAverager`.

    The extremes of a hop lie in the word of its mean, with a comparison each beside the adder: they take no
    cycle of a frame. A window has the extremes of the sums up to its last.

    Parameters
    ----------
    config:
        The accelerator's configuration, ``window_mode`` whole.

    Ports
    -----
    i : In(stream of ``beat_layout``)
        Every frame.
    flush : In(1)
        The recording has ended: the touch under way ends as it is. Only while nothing is under way.
    o : Out(stream of ``sum_layout``)
        ``steps`` windows a touch, ``inputs`` beats each.
    frame_last : Out(1)
        The beat at ``i`` is its frame's last.
    holds : Out(1)
        A sum is offered or not yet written, or the store is at work.

    Timing
    ------
    One beat a cycle, from 3 taxels on; with fewer a beat of a touch every 3 cycles. ``i`` waits S taxels + 4
    cycles after the frame that fills the store. A value takes ``store_per_window`` + ``doublings`` + 6 cycles at most, a window
    ``store_per_window`` more. While values leave, beats of the next touch take turns with them, and wait
    before its first sum is stored.
    """

    def ports(self, config: AcceleratorConfig):
        return inputs("flush", i=stream.Signature(beat_layout(stored(config)))) | outputs(
            "frame_last", "holds", o=stream.Signature(sum_layout(config))
        )

    def elaborate(self, platform):
        config, m = self.spec, Module()
        beats, features, windows = stored(config), config.features, config.windows
        kinds, summed, sums = features.feature_kinds, beats.features.feature_kinds, config.stored_sums
        taxels, words = config.sensor.taxels, config.sensor.taxels * len(summed)
        doublings = max(1, config.doublings)
        longest_hop = windows.hop << config.doublings
        blocks = longest_hop // features.activity_block
        bounds = longest_hop * config.deviation_bound, blocks * config.block_bound
        word_bound = max(bound for _, bound in zip(summed, bounds, strict=False))
        bits = signed_bits(windows.store_per_window * word_bound)
        if "integral" in kinds:
            bits = max(bits, config.integral_bits)
        sum_bits, extremes = (signed_bits(word_bound), [kind for kind in EXTREMES if kind in kinds])
        width = signed_bits(config.deviation_bound)  # of an extreme
        stored_bits = sum_bits + width * len(extremes)
        read, write = working_memory(m, "store", unsigned(stored_bits), (sums + 1) * words)
        m.submodules.adder = adder = RegisteredAdder(config, bits, carry=1)
        total = adder.total
        doing = self.doing = Signal(Doing)

        # --- the beat that comes: its word in the hop under way
        several = len(summed) > 1
        index = Signal(range(words))
        second_kind = index[0] if several else Const(0)
        lone = ~self.i.p.block_last & ~second_kind if several else Const(0)  # a taxel's only word
        skips = Mux(lone, 2, 1) if several else 1
        at_last = self.frame_last
        following = Mux(at_last, 0, index + skips)
        m.d.comb += at_last.eq(index + skips == words)
        # --- the touch under way: its hop, and the sums that it has
        begins = Signal(init=1)  # the hop's first frame
        begins_block = Signal(init=1)  # no block of the hop has come
        place = Signal(range(windows.hop))
        part = Signal(doublings)  # hops of the first length in this one
        mask = Signal(doublings)  # ones: as many as doublings
        count = self.count = Signal(range(sums))
        mark = self.mark = Signal(range(sums + 1), init=1)  # sums up to the last that met the rule
        to = self.to = Signal(range(sums * words + 1))  # where the next sum goes
        first_place = reaches(place, windows.hop - 1)
        hop_last = first_place & (part == mask)
        # --- the touch that leaves
        pending = self.pending = Signal()
        counts = self.counts = Signal(range(sums))  # sums that count
        shifts = Signal(doublings)
        longest = Signal()

        # --- beats. One of a touch needs its word, which is read with the beat before.
        small, between = taxels < STATE_BEATS, doing == Doing.BEAT
        fetched = Signal()
        unwritten = Signal()  # a result is to be written
        adds = Signal()
        beat = self.i.valid & self.i.ready
        free = ((doing == Doing.TAKE) & ~pending) | (between & ~hop_last)
        m.d.comb += [self.i.ready.eq(~self.i.p.touch | (free & fetched)), adds.eq(beat & self.i.p.touch)]
        with m.If(beat):
            m.d.sync += index.eq(following)

        # --- memory and adder
        reads = Signal()  # a word of a sum is read
        arrived = Signal()  # it has come
        first = Signal()  # it is the first that is added up
        address = Signal(range(sums * words))
        goes_to = Signal(range((sums + 1) * words))
        fetch = Mux(adds, not small, ~fetched & ~unwritten)
        drive(m, read, addr=Mux(reads, address, sums * words + Mux(adds, following, index)), en=reads | fetch)
        drive(
            m,
            adder,
            step=adds | arrived,
            alone=adds & Mux(second_kind, begins_block, begins),
            word=read.data[:sum_bits].as_signed(),
            addend=Mux(adds, self.i.p.complement, total | first.as_signed()),
        )
        farthest = {}  # complements: the highest deviation has the least
        for number, name in enumerate(extremes):
            word = read.data[sum_bits:].word_select(number, width).as_signed()
            farthest[name] = extreme = Signal(signed(width), name=name, reset_less=True)
            other = Signal(signed(width), name=f"{name}_joined")
            m.d.comb += other.eq(Mux(adds, self.i.p.complement, extreme))
            farther = word < other if name == "highest" else word > other
            with m.If(adder.step):
                m.d.sync += extreme.eq(Mux(~adder.alone & (~adds & first | farther), word, other))
        data = Cat(total[:sum_bits], *farthest.values()) if extremes else total
        drive(m, write, addr=goes_to, data=data, en=unwritten)
        halves = arrived & ~first & (doing == Doing.HALVE)
        m.d.sync += [
            fetched.eq(~reads & Mux(adds, not small, fetched | fetch)),
            arrived.eq(reads),
            unwritten.eq(adds | halves),
        ]
        with m.If(arrived):
            m.d.sync += first.eq((doing == Doing.HALVE) & ~first)
        with m.If(adds):
            m.d.sync += goes_to.eq(Mux(hop_last, to, sums * words + index))
        with m.Elif(halves):
            m.d.sync += goes_to.eq(to)
        with m.If((adds & hop_last) | halves):
            m.d.sync += to.eq(to + 1)

        # --- end of a frame, of a hop, of a touch
        frame_ends, ends = adds & at_last, Signal()
        fills = self.fills = Signal()
        marked = Mux(frame_ends & self.i.p.loud, count + 1, mark)
        counted = count + (frame_ends & hop_last)
        now_marked, now_counted = Signal.like(mark), Signal.like(count)
        now_mask = Mux(fills, Cat(1, mask), mask)
        m.d.comb += [
            fills.eq(counted == sums),
            ends.eq((frame_ends & self.i.p.end) | self.flush),
            now_marked.eq(Mux(fills, (marked + 1) >> 1, marked)),
            now_counted.eq(Mux(fills, sums // 2, counted)),
        ]
        with m.If(frame_ends):
            m.d.sync += [
                begins.eq(hop_last),
                begins_block.eq(hop_last | (begins_block & ~second_kind)),
                place.eq(wrapping_increment(place, windows.hop)),
                count.eq(now_counted),
                mark.eq(now_marked),
                mask.eq(now_mask),
            ]
            with m.If(first_place):
                m.d.sync += part.eq(Mux(hop_last, 0, part + 1))
            with m.If(fills):
                m.d.sync += [doing.eq(Doing.HALVE), to.eq(0), address.eq(0), first.eq(1)]
        with m.If(ends):
            least = Mux(now_marked < now_counted, now_marked, now_counted)
            again = (begins, begins_block, place, part, mask, count, mark)
            m.d.sync += [signal.eq(signal.init) for signal in again]
            m.d.sync += [pending.eq(least != 0), to.eq(0)]
            with m.If(least != 0):  # else values of the touch before may still leave
                m.d.sync += [counts.eq(least), shifts.eq(now_mask)]
                m.d.sync += longest.eq(frame_ends & self.i.p.longest)

        # --- the work on the store
        taxel = Signal(range(taxels))  # of the value
        kind = Signal(range(len(kinds)))
        offset = Signal(range(words))
        start = Signal(range(sums * words + 1))  # the first word of the window, and of the next
        next_start = Signal(range(sums * words + 1))
        window = Signal(range(windows.steps))
        window_last = reaches(window, windows.steps - 1)
        rest = Signal(range(sums + windows.steps))
        few = Signal()  # fewer sums than windows: one each, the last one again
        hops = Signal(range(windows.store_per_window + 1))  # of the window
        up_to = Signal(range(sums + 1))  # hops from the touch's first frame on
        todo = Signal(range(sums + 1))
        left = Signal(doublings)
        result = Signal(signed(max(bits, config.sum_bits)))
        second = Signal()
        over = Signal()
        m.d.comb += [
            reads.eq(((doing == Doing.HALVE) & ~over) | ((doing == Doing.READ) & (todo != 0))),
            self.o.valid.eq(doing == Doing.OFFER),
            self.holds.eq(unwritten | arrived | pending | (doing != Doing.TAKE)),
        ]
        drive(
            m, self.o.p, complement=result, taxel=taxel, length=hops - 1, final=window_last, partial=longest
        )
        if len(kinds) > 1:
            m.d.comb += self.o.p.kind.eq(kind)
        is_integral = kind == kinds.index("integral") if "integral" in kinds else Const(0)
        of_touch = is_integral  # since its first frame
        for name in extremes:
            of_touch |= kind == kinds.index(name)
        is_activity = kind == kinds.index("activity") if "activity" in kinds else Const(0)
        with m.If(reads & ~second):
            m.d.sync += address.eq(address + words)
        with m.Switch(doing):
            with m.Case(Doing.TAKE), m.If(pending & ~unwritten):
                m.d.sync += [signal.eq(0) for signal in (pending, window, start, next_start, hops, up_to)]
                m.d.sync += [few.eq(counts < windows.steps), rest.eq(counts), doing.eq(Doing.COUNT)]
            with m.Case(Doing.HALVE):
                m.d.sync += second.eq(reads & ~second)
                with m.If(reads & second):
                    block_last = reaches(offset, words - 1)
                    m.d.sync += [
                        offset.eq(wrapping_increment(offset, words)),
                        address.eq(Mux(block_last, address + 1, address - (words - 1))),
                        over.eq(address == sums * words - 1),
                    ]
                with m.If(over & ~arrived & ~unwritten):
                    m.d.sync += [over.eq(0), doing.eq(Doing.TAKE), to.eq(Mux(pending, 0, to))]
            with m.Case(Doing.COUNT):
                more = Mux(few, ~hops.any() & (window < counts), rest >= windows.steps)
                with m.If(more):
                    m.d.sync += [rest.eq(rest - windows.steps), hops.eq(hops + 1), up_to.eq(up_to + 1)]
                    m.d.sync += next_start.eq(next_start + words)
                with m.Else():
                    # the last sum again: it begins where the window before did
                    m.d.sync += [hops.eq(Mux(few, 1, hops)), doing.eq(Doing.BEAT)]
            with m.Case(Doing.BEAT), m.If(adds | ~(self.i.valid & self.i.p.touch & ~hop_last)):
                m.d.sync += [todo.eq(Mux(of_touch, up_to, hops)), first.eq(1), doing.eq(Doing.READ)]
                m.d.sync += address.eq(Mux(of_touch, 0, start) + offset + is_activity)
            with m.Case(Doing.READ):
                with m.If(reads):
                    m.d.sync += todo.eq(todo - 1)
                with m.Elif(~arrived):
                    m.d.sync += [result.eq(total), left.eq(Mux(of_touch, 0, shifts)), doing.eq(Doing.SHIFT)]
                    for name in extremes:
                        with m.If(kind == kinds.index(name)):
                            m.d.sync += result.eq(farthest[name])
            with m.Case(Doing.SHIFT):
                m.d.sync += left.eq(left >> 1)
                with m.If(left[0]):
                    m.d.sync += result.eq(result >> 1)
                with m.Else():
                    m.d.sync += doing.eq(Doing.OFFER)
                    if "integral" in kinds:
                        with m.If(is_integral):
                            m.d.sync += result.eq(self._companded(m, result))
            with m.Case(Doing.OFFER), m.If(self.o.ready):
                last_kind = reaches(kind, len(kinds) - 1)
                m.d.sync += [kind.eq(Mux(last_kind, 0, kind + 1)), doing.eq(Doing.BEAT)]
                with m.If(last_kind):
                    taxel_last = reaches(taxel, taxels - 1)
                    m.d.sync += taxel.eq(wrapping_increment(taxel, taxels))
                    m.d.sync += offset.eq(Mux(taxel_last, 0, offset + len(summed)))
                    with m.If(taxel_last):
                        again = few & (window + 1 >= counts)
                        m.d.sync += [window.eq(window + 1), hops.eq(0), rest.eq(rest + counts)]
                        m.d.sync += [start.eq(Mux(again, start, next_start))]
                        m.d.sync += doing.eq(Mux(window_last, Doing.TAKE, Doing.COUNT))
        if config.faults.fault_frames:
            masks = Signal(taxels)
            shown = Signal(taxels)
            with m.If(adds):
                m.d.sync += masks.bit_select(index[1:] if several else index, 1).eq(self.i.p.masked)
            with m.If(doing == Doing.TAKE):
                m.d.sync += shown.eq(masks)
            m.d.comb += self.o.p.masked.eq(shown.bit_select(taxel, 1))
        return m

    def _companded(self, m: Module, complement: Value) -> Value:
        """The complement of a companded sum, whose complement is ``complement``."""
        config, features = self.spec, self.spec.features
        biased = Signal(range(config.integral_bound + (1 << features.integral_knee) + 1))
        size = Signal(config.beat_bits - 1)
        m.d.comb += biased.eq(biased_magnitude(complement, features.integral_knee))
        logarithm(m, size, biased, features.integral_knee, features.integral_frac)
        return Mux(~complement[-1], size - 1, (~Cat(size, Const(0, 1))).as_signed())
