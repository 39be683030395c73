"""The loops of the image engine: which activation meets which weights, a tap a cycle
(eskin/rtl/program/image_passes.py)."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value

from eskin.rtl.common import Block, inputs, outputs
from eskin.rtl.image.layouts import pass_layout, sum_layout, tap_layout
from eskin.rtl.program.image_passes import DRAIN_CYCLES, ImagePlan


class TapSequencer(Block):
    """Runs one pass: slot after slot, in each the taps of a sum that lie inside the map.

    While a slot issues its taps, the next sum is prepared. Its first addresses are reached from the corner of
    the pool's window, one step a cycle: a place of the window, or a row or column of the kernel outside the
    map. No multiplication is needed for an address.

    Members
    -------
    now : In(pass_layout)
        Held while the pass runs.
    go : In(1)
        Pulse: run it.
    tap : Out(tap_layout)
        The first one cycle after ``begin``, then one a cycle until the sum has all.
    begin : Out(1)
        Pulse: a slot begins; the lanes' sums of the slot before are released.
    released : Out(sum_layout)
        With ``begin``: which sums these are.
    addend : Out(16)
        From the cycle after ``begin`` on: the first bias of the sum after the sum that begins.
    ending : Out(1)
        The last slot of the pass has begun: it has no taps.
    done : Out(1)
        Pulse: the map of the pass is written.

    Timing: `eskin.rtl.program.image_passes.Pass.cycles`.
    """

    def ports(self, plan: ImagePlan):
        return inputs("go", now=pass_layout(plan)) | outputs(
            "begin",
            "ending",
            "done",
            tap=tap_layout(plan),
            released=sum_layout(plan),
            addend=plan.address_bits,
        )

    def elaborate(self, platform):
        m = Module()
        plan, now = self.spec, self.now
        lanes = plan.lanes

        def register(name: str, bits: int = plan.address_bits) -> Signal:
            return Signal(bits, name=name, reset_less=True)

        # ---------------------------------------------------------------- the sum that comes next
        # above, left: places of the map before its window. below, right: places after the window's first.
        # dy, dx: its place in the window.
        above, below, left, right = (register(name, 8) for name in ("above", "below", "left", "right"))
        group, dy, dx = register("group", 8), register("dy", 1), register("dx", 1)
        # first tap of the window's first sum: of the row, of this one
        row_corner, corner = (register("row_corner"), register("corner"))
        weights, addend = register("weights"), register("addend")  # of the group
        more = Signal()  # there is one
        step = now.pool
        pairs = now.pairs if plan.pairs else Const(0, 1)
        last_dx, last_dy = ~now.pool | dx | (right == 0) | pairs, ~now.pool | dy | (below == 0)
        last_group = group == now.groups
        last_column, last_row = right <= step, below <= step
        begins = Signal()  # a slot that takes the prepared sum

        def stride(value: Value) -> Value:
            return Mux(step, value << 1, value)

        with m.If(self.go):
            m.d.sync += [
                above.eq(0),
                below.eq(now.rows),
                left.eq(0),
                right.eq(now.columns),
                group.eq(0),
                dy.eq(0),
                dx.eq(0),
                more.eq(1),
                row_corner.eq(now.corner),
                corner.eq(now.corner),
                weights.eq(now.weights),
                addend.eq(now.addends),
            ]
        with m.Elif(begins):
            m.d.sync += dx.eq(~last_dx)
            with m.If(last_dx):
                m.d.sync += dy.eq(~last_dy)
                with m.If(last_dy):
                    m.d.sync += [
                        group.eq(group + 1),
                        weights.eq(weights + now.group),
                        addend.eq(addend + Mux(now.dense, plan.dense_lanes, lanes)),
                    ]
                    with m.If(last_group):
                        m.d.sync += [
                            group.eq(0),
                            weights.eq(now.weights),
                            addend.eq(now.addends),
                            left.eq(left + 1 + step),
                            right.eq(right - 1 - step),
                            corner.eq(corner + stride(now.channels)),
                        ]
                        with m.If(last_column):
                            m.d.sync += [
                                left.eq(0),
                                right.eq(now.columns),
                                above.eq(above + 1 + step),
                                below.eq(below - 1 - step),
                                row_corner.eq(row_corner + stride(now.row)),
                                corner.eq(row_corner + stride(now.row)),
                            ]
                            with m.If(last_row):
                                m.d.sync += more.eq(0)
        m.d.comb += self.addend.eq(addend)

        # ---------------------------------------------------------------- its first addresses
        def beyond(places: Value) -> Value:
            """Kernel places outside a map that has ``places`` on this side."""
            return Mux(places >= now.radius, 0, now.radius - places)

        starts = Signal()
        walking = Signal()
        prepared = Signal()
        activation, weight, width = register("activation"), register("weight"), register("width")
        height = register("height", 3)
        down = Signal()  # steps still to take within the window
        across = Signal()
        # steps still to take of the kernel
        skips = {name: Signal(2, name=f"skip_{name}") for name in ("above", "left", "below", "right")}
        row_step, column_step = down | (skips["above"] != 0), across | (skips["left"] != 0)
        narrower = Signal()
        m.d.sync += starts.eq(self.go | (begins & ~(last_dx & last_dy & last_group & last_column & last_row)))
        arrived = Signal()
        m.d.comb += arrived.eq(walking & ~(down | across | Cat(*skips.values()).any()))
        with m.If(arrived):  # (registered, as it lets a slot begin, which reaches everything)
            m.d.sync += [prepared.eq(1), walking.eq(0)]
        with m.If(starts):
            m.d.sync += [
                activation.eq(corner),
                weight.eq(weights),
                width.eq(now.kernel_row),
                height.eq(Const(1) + (now.radius << 1)),
                down.eq(dy),
                across.eq(dx),
                walking.eq(1),
                skips["above"].eq(beyond(above + dy)),
                skips["below"].eq(beyond(below - dy)),
                skips["left"].eq(beyond(left + dx)),
                skips["right"].eq(beyond(right - (dx | pairs))),
            ]
        with m.Elif(walking):
            with m.If(down):
                m.d.sync += down.eq(0)
            with m.Elif(skips["above"] != 0):
                m.d.sync += [
                    skips["above"].eq(skips["above"] - 1),
                    weight.eq(weight + now.kernel_row),
                    height.eq(height - 1),
                ]
            with m.Elif(across):
                m.d.sync += across.eq(0)
            with m.Elif(skips["left"] != 0):
                m.d.sync += [skips["left"].eq(skips["left"] - 1), weight.eq(weight + now.channels)]
                m.d.comb += narrower.eq(1)
            with m.Elif(skips["below"] != 0):
                m.d.sync += [skips["below"].eq(skips["below"] - 1), height.eq(height - 1)]
            with m.Elif(skips["right"] != 0):
                m.d.sync += skips["right"].eq(skips["right"] - 1)
                m.d.comb += narrower.eq(1)
            with m.If(row_step | column_step):
                m.d.sync += activation.eq(activation + Mux(row_step, now.row, now.channels))
            with m.If(narrower):
                m.d.sync += width.eq(width - now.channels)
        with m.If(begins | self.go):
            m.d.sync += prepared.eq(0)

        # ---------------------------------------------------------------- the slot under way
        running = Signal()
        first = Signal()  # its slot only loads the biases
        active = Signal()
        across_left = register("across_left")
        down_left = register("down_left", 3)
        row_width = register("row_width")
        row_activation, row_weight = register("row_activation"), register("row_weight")
        next_row, next_weights = Signal.like(row_activation), Signal.like(row_weight)
        since = Signal(range(lanes + DRAIN_CYCLES + 1))  # cycles since the slot's second
        tap, ends_row = self.tap, across_left == 1
        m.d.comb += [
            next_row.eq(row_activation + now.row),
            next_weights.eq(row_weight + now.kernel_row),
            tap.valid.eq(active),
            self.begin.eq(running & (first | (~active & (since >= lanes) & (prepared | ~more)))),
            begins.eq(self.begin & ~first & more),
        ]
        with m.If(self.begin):
            m.d.sync += [since.eq(0), first.eq(0), running.eq(first | more)]
        with m.Elif(since != lanes + DRAIN_CYCLES):
            m.d.sync += since.eq(since + 1)
        ending = self.ending
        m.d.comb += self.done.eq(ending & (since == lanes + DRAIN_CYCLES - 1))
        m.d.sync += ending.eq((ending | (self.begin & ~first & ~more)) & ~self.done)
        with m.If(begins):
            m.d.sync += [
                active.eq(1),
                across_left.eq(width),
                row_width.eq(width),
                down_left.eq(height),
                tap.activation.eq(activation),
                tap.weight.eq(weight),
                row_activation.eq(activation),
                row_weight.eq(weight),
            ]
        with m.Elif(active):
            m.d.sync += [
                tap.activation.eq(tap.activation + 1),
                tap.weight.eq(tap.weight + 1),
                across_left.eq(across_left - 1),
            ]
            with m.If(ends_row):
                m.d.sync += [
                    tap.activation.eq(next_row),
                    tap.weight.eq(next_weights),
                    across_left.eq(row_width),
                    row_activation.eq(next_row),
                    row_weight.eq(next_weights),
                    down_left.eq(down_left - 1),
                    active.eq(down_left != 1),
                ]
        with m.If(self.go):
            m.d.sync += [running.eq(1), first.eq(1)]

        # ---------------------------------------------------------------- what it will release
        current = Signal(sum_layout(plan))
        with m.If(self.begin):
            m.d.sync += [
                current.valid.eq(begins),
                current.opens.eq(~dy & ~dx),
                current.closes.eq(last_dx & last_dy),
                current.alone.eq(right == 0),
                current.lanes.eq(
                    Mux(last_group, now.last_group, Mux(now.dense, plan.dense_lanes - 1, lanes - 1))
                ),
            ]
        m.d.comb += self.released.eq(current)
        return m
