"""The largest of a step's scores, and by how much (docs/specification.md, section 7): in few cells, or in few
cycles."""

from amaranth.hdl import Cat, Module, Mux, Signal, unsigned
from amaranth.lib.memory import Memory

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import Block, before_an_adder, drive, inputs, outputs, struct
from eskin.rtl.program.timing import holds_two_largest


class Search(Block):
    """The ports of a search.

    Members
    -------
    score : In(struct)
        ``value`` in offset binary where ``valid``, class by class, never held up; none while a search goes
        on.
    number : Out
        Class of the next score.
    best, margin : Out
        Class of the largest (ties: the lowest) and its distance from the largest of the others, from the
        cycle after ``found`` on, until the next scores come.
    found : Out(1)
        Pulse: the search ends with this cycle.
    """

    def ports(self, config: AcceleratorConfig):
        width = max(config.score_format.width, 10)  # votes are scores too
        return inputs(score=struct("valid", value=width)) | outputs(
            "found", number=range(config.classes), best=range(config.classes), margin=width
        )


class SearchTwice(Search):
    """Search in few cells: two passes over stored scores.

    The first pass reads each score as soon as it is written and finds the largest. The second finds the
    largest of the others. ``number`` is the class that is written or asked for; ``reading`` is one cycle
    behind it and ``compared``, whose score has arrived, two. Latency: ``found`` comes classes + 3 cycles
    after the last score.
    """

    def elaborate(self, platform):
        m = Module()
        score = self.score
        number = Signal.like(self.number)
        classes = self.spec.classes
        best = Signal.like(self.best, reset_less=True)
        held = Signal.like(self.margin, reset_less=True)
        m.submodules.scores = scores = Memory(
            shape=unsigned(len(held)), depth=classes, init=[], attrs=before_an_adder(platform)
        )
        write, read = scores.write_port(), scores.read_port()
        reading = Signal.like(number, reset_less=True)
        compared = self.compared = Signal.like(number, reset_less=True)
        last, compared_last = number == classes - 1, compared == classes - 1
        # the second pass
        searching = self.searching = Signal()
        reading_others = Signal()
        others = Signal()
        subtracting = Signal()
        fetched = Signal()
        comparing = Signal()
        taken_unseen = Signal()
        # `held` is the complement of the largest score so far, and in the end the margin. It takes one cell a
        # bit: the carries compare, and the same cells compute the value to load.
        total = Cat(subtracting, held) + Cat(subtracting, read.data)
        exceeds = total[-1]  # strictly: ties stay with the lowest class
        search_ends = others & compared_last
        drive(m, write, addr=number, en=score.valid, data=score.value)
        m.d.comb += read.addr.eq(Mux(search_ends, best, reading))
        drive(m, self, number=number, best=best, margin=held, found=subtracting)
        m.d.sync += [
            reading.eq(number),
            fetched.eq(write.en | searching),
            reading_others.eq(searching),
            compared.eq(reading),
            comparing.eq(fetched),
            others.eq(reading_others),
            subtracting.eq(search_ends),
            taken_unseen.eq((fetched & (reading == 0)) | search_ends),
        ]
        with m.If(write.en | searching):
            m.d.sync += [number.eq(Mux(last, 0, number + 1)), searching.eq(searching ^ last)]
        # The first score of a pass is taken without comparing. If it is the largest itself, the second pass
        # takes the smallest value there is. (The carries come late, so a single gate behind them enables both
        # registers. Gates choose the value: synthesis would turn a multiplexer into a second enable.)
        is_best, settled = others & (compared == best), others | subtracting
        with m.If(taken_unseen | (comparing & ~is_best & exceeds)):
            m.d.sync += [
                held.eq(Mux(is_best & ~subtracting, -1, Mux(subtracting, total >> 1, ~read.data))),
                best.eq((best & settled.replicate(len(best))) | (compared & (~settled).replicate(len(best)))),
            ]
        return m


class SearchOnce(Search):
    """Search in few cycles: the largest score so far and its lead are held.

    ``new`` is the score of the cycle before, ``compared`` its class. ``above`` comes a cycle later: its
    distance from the largest score before it, less one. Latency: ``found`` comes 2 cycles after the last
    score.
    """

    def elaborate(self, platform):
        m = Module()
        score = self.score
        number = Signal.like(self.number)
        last_class = self.spec.classes - 1
        best = Signal.like(self.best, reset_less=True)
        margin = Signal.like(self.margin, reset_less=True)
        compared = self.compared = Signal.like(number, reset_less=True)
        arriving = self.arriving = Signal()
        ending = Signal()
        new = Signal.like(score.value, reset_less=True)
        below = Signal.like(score.value, reset_less=True)
        above = Signal.like(score.value, reset_less=True)
        larger = Signal()
        unseen = Signal()
        judged = self.judged = Signal()
        m.d.sync += [new.eq(score.value), compared.eq(number), arriving.eq(score.valid)]
        with m.If(score.valid):
            m.d.sync += number.eq(Mux(number == last_class, 0, number + 1))
        # `below` is the complement of the largest, so one chain of carries compares and subtracts.
        first, difference = compared == 0, new + below
        exceeds = difference[-1]  # strictly: ties stay with the lowest class
        with m.If(arriving & (first | exceeds)):
            m.d.sync += [below.eq(~new), best.eq(compared)]
        # The next cycle. A new largest score has its margin over the largest before, which was at least as near
        # as any other. The first score has the largest margin there is.
        m.d.sync += [judged.eq(arriving), ending.eq(arriving & (compared == last_class))]
        with m.If(arriving):
            m.d.sync += [above.eq(difference), larger.eq(exceeds & ~first), unseen.eq(first | exceeds)]
        with m.If(arriving & first):
            m.d.sync += above.eq(0)
        nearer = (margin + above)[-1]
        with m.If(judged & (unseen | nearer)):
            m.d.sync += margin.eq(Mux(larger, above + 1, ~above))
        drive(m, self, number=number, best=best, margin=margin, found=ending)
        return m


def make_search(config: AcceleratorConfig) -> Search:
    """The search that suits the length of a step."""
    return (SearchOnce if holds_two_largest(config) else SearchTwice)(config)
