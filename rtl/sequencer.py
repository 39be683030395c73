"""Runs one of the engine's two instruction lists (lanes, element-wise lane)."""

from __future__ import annotations

from amaranth.hdl import Module, Mux, Signal
from amaranth.lib import data, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out


class Sequencer(wiring.Component):
    """Steps through runs: each run counts its index up once per ``advance``, then the next follows without a gap.

    A run marked ``wait`` holds at its first index until ``go``. After the run marked ``end`` the list goes on at ``again``, or at 0 with
    ``restart``.

    Parameters
    ----------
    fields:
        Layout of the operation's own fields.
    runs:
        One dict a run: ``length`` (indices, 1 or more), ``index`` (the first), ``wait``, ``end`` and the operation's fields.
    again:
        Run at which a further pass starts.

    Members
    -------
    advance : In(1)
        Take this cycle's index; ignored while ``valid`` is low.
    go, restart : In(1)
    valid : Out(1)
        ``word`` and ``index`` stand for an operation to issue.
    blocked : Out(1)
        Held at a ``wait`` run: ``valid`` follows ``go`` in the same cycle.
    word, index : Out
        The run's operation, and the index counted up.
    first, last : Out(1)
        First and last index of the run.
    ended : Out(1)
        The last index of the ``end`` run is taken in this cycle.
    """

    def __init__(self, fields: dict, runs: list[dict], again: int) -> None:
        longest = max(run["length"] for run in runs)
        top = max(run["index"] + run["length"] for run in runs)
        self._layout = data.StructLayout(
            {"length": range(longest), "index": range(top), "wait": 1, "end": 1, **fields}
        )
        self._runs, self._again = runs, again
        super().__init__(
            {
                "advance": In(1), "go": In(1), "restart": In(1), "valid": Out(1), "blocked": Out(1),
                "word": Out(self._layout), "index": Out(range(top)), "first": Out(1), "last": Out(1), "ended": Out(1),
            }
        )  # fmt: skip

    def elaborate(self, platform):
        m = Module()
        words = [{**run, "length": run["length"] - 1} for run in self._runs]
        m.submodules.program = program = Memory(shape=self._layout, depth=len(words), init=words)
        fetch = program.read_port()
        pc = Signal(range(len(words)))
        count = Signal.like(self.word.length)
        primed = Signal()  # the first word after a reset takes one cycle to arrive
        m.d.sync += primed.eq(1)

        # The go may come in a cycle that does not advance: it is remembered until the first index is taken.
        went = Signal()
        held = self.word.wait & (count == 0) & ~went
        run_done = Signal()
        m.d.comb += [
            self.word.eq(fetch.data),
            self.index.eq(self.word.index + count),
            self.first.eq(count == 0),
            self.last.eq(count == self.word.length),
            self.blocked.eq(primed & held),
            self.valid.eq(primed & (~held | self.go)),
            run_done.eq(self.valid & self.advance & self.last),
            self.ended.eq(run_done & self.word.end),
            fetch.addr.eq(pc),
        ]
        with m.If(self.go & held & ~self.advance):
            m.d.sync += went.eq(1)
        with m.Elif(self.advance):
            m.d.sync += went.eq(0)
        with m.If(self.valid & self.advance):
            m.d.sync += count.eq(Mux(self.last, 0, count + 1))
        with m.If(run_done):
            following = Mux(self.word.end, Mux(self.restart, 0, self._again), pc + 1)
            m.d.comb += fetch.addr.eq(following)
            m.d.sync += pc.eq(following)
        return m
