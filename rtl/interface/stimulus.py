"""Stimulus: the wanted electrode, for decisions by a table, for positions by the array's size
(docs/specification_interfaces.md section 14)."""

from amaranth.hdl import Array, Const, Module, Mux, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import decision_layout, inputs, outputs, struct
from eskin.rtl.interface.touch_position import position_layout

ROWS, COLUMNS = 6, 4


class Stimulus(wiring.Component):
    """``request`` with an electrode from a decision or a position on, for ``hold_cycles`` after the last; a
    touch's end takes it back.

    Decisions: the class's electrode of the configuration (none: no request). Positions: column floor(4 (x +
    1/2) / columns) and row floor(6 (y + 1/2) / rows) of the electrodes, x and y in cells.

    Members
    -------
    decision : In(struct: valid, payload), with ``stimulator`` decisions
    position : In(struct: valid, payload), with positions
        Valid for one cycle.
    clear : In(1)
        The request is taken back.
    request : Out(1), electrode : Out(range(24))
        From registers, a cycle later.
    """

    def __init__(self, config: AcceleratorConfig, hold_cycles: int):
        self._config, self._hold = config, hold_cycles
        by_decision = config.interface.stimulator == "decisions"
        layout = decision_layout(config) if by_decision else position_layout
        told = In(struct("valid", payload=layout))
        super().__init__(
            inputs("clear")
            | outputs("request", electrode=range(24))
            | {"decision" if by_decision else "position": told}
        )

    def elaborate(self, platform):
        m = Module()
        config, interface = self._config, self._config.interface
        told = Signal()
        wanted = Signal()
        electrode = Signal.like(self.electrode)
        if interface.stimulator == "decisions":
            table = interface.electrodes or tuple(range(1, config.classes + 1))
            label = self.decision.payload["class"]
            m.d.comb += [
                told.eq(self.decision.valid),
                wanted.eq(Array([Const(number != 0, 1) for number in table])[label]),
                electrode.eq(Array([Const(max(number, 1) - 1, 5) for number in table])[label]),
            ]
        else:
            p = self.position.payload

            # sixteenths of a cell: how many of the inner borders lie at or below the place
            def part(place, parts: int, cells: int):
                return sum(
                    (parts * (place + 8) >= 16 * cells * k for k in range(1, parts)), start=Const(0, 1)
                )

            m.d.comb += [
                told.eq(self.position.valid),
                wanted.eq(~p.ended),
                electrode.eq(
                    COLUMNS * part(p.y, ROWS, interface.rows) + part(p.x, COLUMNS, interface.columns)
                ),
            ]
        left = Signal(range(self._hold + 1))
        m.d.comb += self.request.eq(left != 0)
        m.d.sync += left.eq(Mux(self.clear, 0, Mux(told, Mux(wanted, self._hold, 0), left - (left != 0))))
        with m.If(told & wanted):
            m.d.sync += self.electrode.eq(electrode)
        return m
