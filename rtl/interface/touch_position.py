"""Position of the touch, and direction of a slide (docs/specification_interfaces.md section 13)."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, signed

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import Block, drive, inputs, outputs, sample_layout, struct

FRACTION = 4
"""Fraction bits of a position."""

position_layout = struct(x=8, y=8, peak=8, ended=1, direction=3)
"""A position: centre in sixteenths of a cell, largest cell; with ``ended`` the values of the touch's last frame
and the direction of its slide: 0 none, 1 right, 2 left, 3 down, 4 up."""


def up_to(largest: int) -> range:
    """Numbers from 0 to ``largest``."""
    return range(largest + 1)


class TouchPosition(Block):
    """Cells above the threshold, their weighted centre and the largest of them.

    With v the heights, R rows and C columns: the sum S, the sum U of what the row has had so far, over all
    cells, and the sum Q of what the frame has had so far, over the ends of rows, are adders alone, and sum(v
    * column) = C S - U, sum(v * row) = R S - Q. A divider of one bit a cycle makes x, then y.

    Parameters
    ----------
    config:
        ``rows``, ``columns`` and the ``position_...`` fields; at least 16 taxels.

    Members
    -------
    i : In(struct: valid, payload of sample_layout)
        A beat that is being taken; never held up.
    clear : In(1)
        Forget the touch and the frame, without a word; of a frame under way what follows is not looked at
        either.
    o : Out(struct: valid, payload of position_layout)
        ``valid`` for one cycle.

    From the last taxel to ``o``: 2 q + 1 cycles, q = bits of a coordinate + 1 (at most 9); with ``ended`` 1.
    The next frame must not end earlier.
    """

    def ports(self, config: AcceleratorConfig):
        return inputs("clear", i=struct("valid", payload=sample_layout(config))) | outputs(
            o=struct("valid", payload=position_layout)
        )

    def elaborate(self, platform):
        m = Module()
        interface, cells = self.spec.interface, self.spec.sensor.taxels
        sample = self.i.payload.sample
        above = Signal(signed(len(sample) + 2))
        m.d.comb += above.eq(sample - Const(interface.position_rest, signed(len(sample) + 1)))
        span = self.spec.sample_format
        top = span.max_code - span.min_code
        height = Signal(up_to(top))
        m.d.comb += height.eq(Mux(above > interface.position_threshold, above, 0))

        # ---------------------------------------------------------------- one frame's sums; widths: all cells at the top
        total = Signal(up_to(cells * top))
        in_row = Signal(up_to(interface.columns * top))
        across = Signal(up_to(cells * interface.columns * top))
        down = Signal(up_to(cells * interface.rows * top))
        place = Signal(range(cells))
        column = Signal(range(interface.columns))
        largest = Signal.like(height)
        at = Signal(range(cells))
        row_now, total_now = in_row + height, total + height
        end_of_row = column == interface.columns - 1
        across_now = across + row_now
        down_now = down + Mux(end_of_row, total_now, 0)
        is_larger = height > largest
        at_now = Mux(is_larger, place, at)
        frame = [total, in_row, across, down, place, column, largest, at]
        last = Signal()
        inside = Signal()
        taken = Signal()
        m.d.comb += [
            taken.eq(self.i.valid & (inside | self.i.payload.first)),
            last.eq(taken & self.i.payload.last),
        ]
        with m.If(taken):
            m.d.sync += [
                inside.eq(~self.i.payload.last),
                total.eq(total_now),
                in_row.eq(Mux(end_of_row, 0, row_now)),
                across.eq(across_now),
                down.eq(down_now),
                place.eq(place + 1),
                column.eq(Mux(end_of_row, 0, column + 1)),
                largest.eq(Mux(is_larger, height, largest)),
                at.eq(at_now),
            ]
        # ---------------------------------------------------------------- the divider: the quotient's bits, highest first
        whole = (max(interface.rows, interface.columns) - 1).bit_length()  # bits in front of the point
        bits = whole + FRACTION + 1  # one more, to round
        rest = Signal(up_to(2 * max(interface.rows, interface.columns) * cells * top))
        other = Signal(up_to(interface.rows * cells * top))
        divisor = Signal.like(total)
        quotient = Signal(bits)
        left = Signal(up_to(bits))
        second = Signal()
        scaled = divisor << whole
        doubled = rest << 1
        fits = doubled >= scaled
        rounded = (Cat(fits, quotient)[:bits] + 1) >> 1
        touch = Signal()
        x = Signal(8)
        y = Signal(8)
        peak = Signal(8)
        first_x = Signal(8)
        first_y = Signal(8)
        known = Signal()  # x and y belong to a frame
        m.d.sync += known.eq(0)
        with m.If(left != 0):
            m.d.sync += [
                rest.eq(Mux(fits, doubled - scaled, doubled)),
                quotient.eq(Cat(fits, quotient)),
                left.eq(left - 1),
            ]
            with m.If(left == 1):
                with m.If(second):
                    m.d.sync += [y.eq(rounded), known.eq(1)]
                with m.Else():
                    m.d.sync += [x.eq(rounded), rest.eq(other), left.eq(bits), second.eq(1)]
        over = Signal()  # the frame has no touched cell, and the frame before had
        m.d.sync += over.eq(last & (total_now == 0) & touch)
        with m.If(last):
            m.d.sync += [*(signal.eq(0) for signal in frame), touch.eq(total_now != 0)]
            with m.If(total_now != 0):
                m.d.sync += [
                    rest.eq(interface.columns * total_now - across_now),
                    other.eq(interface.rows * total_now - down_now),
                    divisor.eq(total_now),
                    peak.eq(at_now),
                    left.eq(bits),
                    second.eq(0),
                ]
        # ---------------------------------------------------------------- the way from a touch's first position to its last
        fresh = Signal(init=1)  # the next position is a touch's first
        with m.If(known):
            m.d.sync += fresh.eq(0)
            with m.If(fresh):
                m.d.sync += [first_x.eq(x), first_y.eq(y)]
        ways = []
        for now, begin in ((x, first_x), (y, first_y)):
            way = now - begin
            ways.append((way[-1], abs(way)))
        (is_left, wide), (is_up, high) = ways
        is_across = wide >= high
        is_slide = Mux(is_across, wide, high) >= interface.slide_least
        heading = Mux(is_across, Mux(is_left, 2, 1), Mux(is_up, 4, 3))
        m.d.comb += self.o.valid.eq(known | over)
        drive(m, self.o.payload, x=x, y=y, peak=peak, ended=over, direction=Mux(over & is_slide, heading, 0))
        with m.If(over):
            m.d.sync += fresh.eq(1)
        with m.If(self.clear):
            m.d.sync += [
                signal.eq(signal.init) for signal in (*frame, inside, left, touch, known, over, fresh)
            ]
        return m
