"""Takes finished rows off the lanes one by one: addend, narrowing, and where the result goes."""

from __future__ import annotations

from amaranth.hdl import Module, Mux, Signal, signed
from amaranth.lib import data, enum, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from golden.config import AcceleratorConfig
from rtl.fixed import saturate
from rtl.schedule import Schedule


class Dest(enum.Enum, shape=3):
    """Where a row's result goes."""

    PARTIAL = 0
    SIGMOID = 1
    TANH = 2
    VALUE = 3
    LOGIT = 4


class RowDrain(wiring.Component):
    """Captures the accumulators of a group of rows and finishes one row a cycle: ``narrow(acc + addend)`` of SPECIFICATION.md section 4.

    The addend holds the rounding half, so the narrowing here is a floor shift and SAT. The order of groups is fixed by the schedule,
    which this block walks through by itself.

    Members
    -------
    capture : In(1)
        All lanes' accumulators are complete in this cycle.
    acc : In(array of signed(accumulator_bits))
    addend_address : Out, addend : In(signed(accumulator_bits))
        Read port of the addend memory, latency 1. The address of row p is there p cycles after ``capture``.
    partial, partial_address, total : Out
        Write ``total`` to the addend memory (3 + p cycles after an address cycle: see rtl/schedule.py).
    index, tanh : Out
        Table index and which table, one cycle after ``total``.
    value, logit : Out
        Narrowed to state_format and logit_format, with ``index``.
    result : Out(struct)
        With ``index``: which memory (``gate``, ``t``) or the classifier (``logit``) gets it, region and index.

    One row a cycle.
    """

    def __init__(self, config: AcceleratorConfig, plan: Schedule) -> None:
        self._config, self._plan = config, plan
        program = plan.program
        self._regions = max(len(program.gate_regions), len(program.t_regions))
        self._words = len(plan.bias_rows) + plan.partial_rows
        acc = signed(config.accumulator_bits)
        self.route_layout = data.StructLayout(
            {"gate": 1, "t": 1, "logit": 1, "tabled": 1, "region": range(self._regions), "index": range(max(config.hidden, config.classes))}
        )
        super().__init__(
            {
                "capture": In(1), "acc": In(data.ArrayLayout(acc, config.lanes)),
                "addend_address": Out(range(self._words)), "addend": In(acc),
                "partial": Out(1), "partial_address": Out(range(self._words)), "total": Out(acc),
                "index": Out(signed(config.index_bits)), "tanh": Out(1),
                "value": Out(signed(config.state_format.width)), "logit": Out(signed(config.logit_format.width)),
                "result": Out(self.route_layout),
            }
        )  # fmt: skip

    def _entries(self) -> tuple[data.StructLayout, list[dict]]:
        """The group list as memory words."""
        regions = {
            "sigmoid": self._plan.program.gate_regions, "tanh": self._plan.program.t_regions, "value": self._plan.program.t_regions,
        }  # fmt: skip
        top = max(self._words, self._config.hidden, self._config.classes)
        region, dest = range(self._regions), range(top)
        layout = data.StructLayout(
            {"rows": range(self._config.lanes), "addend": range(self._words), "kind": Dest, "region": region, "dest": dest}
        )
        entries = []
        for group in self._plan.groups:
            named = regions.get(group.block.dest, ())
            entries.append(
                {
                    "rows": group.rows - 1, "addend": group.addend, "kind": Dest[group.block.dest.upper()],
                    "region": named.index(group.block.region) if named else 0, "dest": group.dest,
                }
            )  # fmt: skip
        return layout, entries

    def elaborate(self, platform):
        m = Module()
        config = self._config
        layout, entries = self._entries()
        m.submodules.groups = groups = Memory(shape=layout, depth=len(entries), init=entries)
        fetch = groups.read_port()
        group = Signal(range(len(entries)))
        following = Mux(group == len(entries) - 1, 0, group + 1)
        m.d.comb += fetch.addr.eq(group)
        entry = fetch.data

        # Cycle 3 after a group's last issue: address the addends, row by row.
        row, running = Signal(range(config.lanes)), Signal()
        active, now = Signal(), Signal.like(row)
        m.d.comb += [active.eq(self.capture | running), now.eq(Mux(self.capture, 0, row)), self.addend_address.eq(entry.addend + now)]
        with m.If(active):
            m.d.sync += [row.eq(now + 1), running.eq(now != entry.rows)]
            with m.If(now == entry.rows):
                m.d.comb += fetch.addr.eq(following)
                m.d.sync += group.eq(following)

        # Cycle 4: the captured accumulators shift towards row 0's place; the addend arrives.
        captured = [Signal(signed(config.accumulator_bits), name=f"captured_{lane}") for lane in range(config.lanes)]
        for lane, word in enumerate(captured):
            onward = captured[lane + 1] if lane + 1 < config.lanes else word
            m.d.sync += word.eq(Mux(self.capture, self.acc[lane], onward))
        route = data.StructLayout({"valid": 1, "kind": Dest, "region": range(self._regions), "dest": layout["dest"].shape})
        route_4, route_5 = Signal(route), Signal(route)
        m.d.sync += [
            route_4.valid.eq(active), route_4.kind.eq(entry.kind), route_4.region.eq(entry.region), route_4.dest.eq(entry.dest + now),
            route_5.eq(route_4),
            self.total.eq(captured[0] + self.addend),
        ]  # fmt: skip

        # Cycle 5: the total is there. Partial sums go back whole, everything else is narrowed.
        m.d.comb += [self.partial.eq(route_5.valid & (route_5.kind == Dest.PARTIAL)), self.partial_address.eq(route_5.dest)]
        kind = route_5.kind
        index = Mux(
            kind == Dest.TANH,
            saturate(self.total >> config.tanh_shift, config.index_format),
            saturate(self.total >> config.sigmoid_shift, config.index_format),
        )
        m.d.sync += [
            self.index.eq(index),
            self.tanh.eq(kind == Dest.TANH),
            self.value.eq(saturate(self.total >> config.value_shift, config.state_format)),
            self.logit.eq(saturate(self.total >> config.logit_shift, config.logit_format)),
            self.result.gate.eq(route_5.valid & (kind == Dest.SIGMOID)),
            self.result.t.eq(route_5.valid & ((kind == Dest.TANH) | (kind == Dest.VALUE))),
            self.result.logit.eq(route_5.valid & (kind == Dest.LOGIT)),
            self.result.tabled.eq(kind != Dest.VALUE),
            self.result.region.eq(route_5.region),
            self.result.index.eq(route_5.dest),
        ]
        return m
