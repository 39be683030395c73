"""Decisions as words that wait for a CPU (docs/specification_interfaces.md, section 17)."""

from amaranth.hdl import Array, Cat, Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import decision_layout, drive, inputs, margin_units, outputs
from eskin.rtl.program.memory_map import DECISION_FIELDS

DEPTHS = (0, 2, 4)
"""Decisions that may wait beside the decision that the classifier offers."""


def _places(config: AcceleratorConfig) -> list[int]:
    """Bits of the decision word that may be 1 in a decision of this design."""
    widths = {
        "CLASS": (config.classes - 1).bit_length(),
        "STEP": (config.windows.steps - 1).bit_length(),
        "UNSURE": int(config.network.margin_threshold > 0),
    }
    return [
        bit
        for name, (low, high) in DECISION_FIELDS.items()
        for bit in range(low, low + min(widths.get(name, 32), high - low + 1))
    ]


def decision_word(config: AcceleratorConfig, decision: data.View) -> Value:
    """The decision word of ``decision`` (of `decision_layout`)."""
    if config.wide_decisions:
        return decision.as_value()
    fields = {
        "CLASS": decision["class"],
        "STEP": decision.step,
        "MARGIN": margin_units(config, decision.margin, decision.is_global),
        "GLOBAL": decision.is_global,
        "PARTIAL": decision.partial,
        "UNSURE": decision.unsure,
    }
    places = [(fields[name], high - low + 1) for name, (low, high) in DECISION_FIELDS.items()]
    return Cat(Cat(value, *[0] * (width - len(value)))[:width] for value, width in places)


class DecisionQueue(wiring.Component):
    """The oldest decision that waits, as a word, and up to ``depth`` - 1 more.

    Parameters
    ----------
    depth:
        One of `DEPTHS`; 0: the classifier's offer itself waits, and taking the word takes the offer.

    Members
    -------
    i : In(stream of decision_layout)
    global_only : In(1)
        Local decisions are taken and dropped.
    clear : In(1)
        Drop the waiting words and the word that is taken in this cycle.
    word : Out(32), waits : Out(1)
        The word that ``asked`` requests; a word waits.
    global_waits : Out(1)
        One of those that wait is a global one.
    asked : In(1)
        The word shows the oldest in the next cycle, or all ones where none waits; otherwise it is 0. Never in two
        cycles in a row, nor with ``clear``.
    take : In(1)
        The decision that the word shows is taken.

    Latency: a cycle; with depth 0 none.
    """

    def __init__(self, config: AcceleratorConfig, depth: int):
        self._config, self._depth = config, depth
        super().__init__(
            inputs("global_only", "clear", "asked", "take", i=stream.Signature(decision_layout(config)))
            | outputs("waits", "global_waits", word=32)
        )

    def elaborate(self, platform):
        m = Module()
        whole, places = decision_word(self._config, self.i.p), _places(self._config)
        word = Cat(whole[place] for place in places)
        dropped = self.global_only & ~self.i.p.is_global
        offered = self.i.valid & ~dropped
        room = Signal()
        m.d.comb += self.i.ready.eq(dropped | room)
        # registers, so a table of four inputs gives a bit of two entries: with `shows` low, `index` is it
        shows = self.shows = Signal()
        index = self.index = Signal(range(max(self._depth, 2)))
        if not self._depth:
            shown = self.shown = Signal()
            m.d.sync += shown.eq(self.asked)
            m.d.comb += room.eq(self.take & shows)
            drive(m, self, waits=offered, global_waits=offered & self.i.p.is_global)
            m.d.comb += [shows.eq(shown & offered), index.eq(shown)]
            head: Value = word
        else:
            # A ring, as its entries take what comes without a choice in front of them.
            entries = self.entries = [Signal(len(places), name=f"entry_{k}") for k in range(self._depth)]
            full = self.full = [Signal(name=f"full_{k}") for k in range(self._depth)]
            newest = self.newest = Signal(range(self._depth))
            oldest = self.oldest = Signal(range(self._depth))
            put, takes = offered & room, self.take & shows
            m.d.comb += [self.waits.eq(Array(full)[oldest]), room.eq(~Array(full)[newest])]
            m.d.sync += [
                newest.eq(newest + put),
                oldest.eq(oldest + takes),
                shows.eq(self.asked & self.waits),
                index.eq(Mux(self.asked & self.waits, oldest, self.asked)),
            ]
            for k, entry in enumerate(entries):
                here = put & (newest == k)
                with m.If(here):
                    m.d.sync += entry.eq(word)
                m.d.sync += full[k].eq((here | full[k] & ~(takes & (oldest == k))) & ~self.clear)
            with m.If(self.clear):
                m.d.sync += [newest.eq(0), oldest.eq(0)]
            flag = places.index(DECISION_FIELDS["GLOBAL"][0])
            waiting = [here & entry[flag] for here, entry in zip(full, entries, strict=True)]
            m.d.comb += self.global_waits.eq(Cat(waiting, offered & self.i.p.is_global).any())
            head = Value.cast(Array(entries)[index])
        none = index[0]
        bits = dict(zip(places, Mux(shows, head, none.replicate(len(places))), strict=True))
        m.d.comb += self.word.eq(Cat(bits.get(place, none & ~shows) for place in range(32)))
        return m
