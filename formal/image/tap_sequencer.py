"""The loops of the image engine: for every small pass no address outside map and weights, every product, an
end."""

from amaranth.hdl import Module, Mux, Signal

from eskin.golden.core import Conv, Dense, Pool, QFormat
from eskin.golden.core.images import layer_stages
from eskin.rtl.image.tap_sequencer import TapSequencer
from eskin.rtl.program.image_passes import ImagePlan
from formal.proof import Bug, any_number, assume, proof, prove

PLAN = ImagePlan(
    layer_stages(4, 4, [Conv(3, 1), Dense(2)]),
    weight_bits=8,
    shifts=(0, 0),
    logit_format=QFormat(16, 0),
    lanes=1,
)
LONGEST = 44
"""Cycles that the longest of the passes takes, and some more."""


@proof(
    "every pass of 1 or 2 rows, columns and groups, 1 or 2 channels, kernel 1 or 3, with or without a pool: "
    "each tap's activation lies in "
    "the map and its weight in the kernel's, there are as many taps as products inside the map, every place "
    "of the result is written "
    "once, and the pass ends",
    method="bounded",
    depth=LONGEST + 4,
    reduced="passes of 2 x 2 at most, one lane",
    bugs=(
        Bug("a kernel's row above the map is not skipped", "beyond(above + dy)", "beyond(above + 1)"),
        Bug(
            "a kernel's column beside the map is not skipped",
            "beyond(right - (dx | pairs))",
            "beyond(right + 1)",
        ),
        Bug("a group's weights begin late", "weights + now.group)", "weights + now.group + 1)"),
        Bug("a pool's second row is left out", "dy | (below == 0)", "dy | (below == 1)"),
    ),
)
def small_passes(m: Module) -> None:
    m.submodules.dut = dut = TapSequencer(PLAN)
    now = dut.now
    # each less one
    rows, columns, channels, groups = (
        any_number(1, name) for name in ("rows", "columns", "channels", "groups")
    )
    kernel, pool = any_number(1, "kernel"), any_number(1, "pool")
    channel_count, row, kernel_row, group = (
        Signal(6, name=name) for name in ("channel_count", "row", "kernel_row", "group")
    )
    m.d.comb += [
        channel_count.eq(1 + channels),
        row.eq(Mux(columns, channel_count << 1, channel_count)),
        kernel_row.eq(Mux(kernel, channel_count * 3, channel_count)),
        group.eq(Mux(kernel, kernel_row * 3, kernel_row)),
        now.radius.eq(kernel),
        now.pool.eq(pool),
        now.rows.eq(rows),
        now.columns.eq(columns),
        now.groups.eq(groups),
        now.channels.eq(channel_count),
        now.row.eq(row),
        now.kernel_row.eq(kernel_row),
        now.group.eq(group),
        now.corner.eq(Mux(kernel, -(row + channel_count), 0)),
    ]
    time = Signal(range(LONGEST + 2))
    m.d.sync += time.eq(time + (time != LONGEST + 1))
    m.d.comb += dut.go.eq(time == 0)
    # Taps along an axis of 1 or 2 places: kernel 1: as many as places; kernel 3: 1 of one place, 4 of two.
    across, down = (Mux(extent, Mux(kernel, 4, 2), 1) for extent in (columns, rows))
    products = Signal(8)
    m.d.comb += products.eq((across * down * channel_count) << groups)
    results = Signal(4)
    m.d.comb += results.eq(Mux(pool, 1, (rows + 1) * (columns + 1)) << groups)
    taps = Signal(8)
    closed = Signal(4)
    ended = Signal()
    m.d.sync += [taps.eq(taps + dut.tap.valid), ended.eq(ended | dut.done)]
    m.d.sync += closed.eq(closed + (dut.begin & dut.released.valid & dut.released.closes))
    assume(products <= 16)  # the others are as long again
    values = Mux(rows, row << 1, row)
    prove(~dut.tap.valid | (dut.tap.activation < values), "activation in the map")
    prove(~dut.tap.valid | (dut.tap.weight < (group << groups)), "weight in the kernels")
    prove(~dut.done | (taps == products), "as many taps as products")
    prove(~dut.done | (closed == results), "every place of the result")
    prove(ended | (time <= LONGEST), "the pass ends")


PAIRS = ImagePlan(
    layer_stages(4, 4, [Conv(3, 1), Pool(), Dense(2)]),
    weight_bits=8,
    shifts=(0, 0),
    logit_format=QFormat(16, 0),
    lanes=2,
)
LONGEST_PAIRS = 40
"""Cycles that the longest of the passes in pairs takes, and some more."""


@proof(
    "every pass in pairs of 1 or 2 rows, 1 to 3 columns: each tap's activation lies in the map and its "
    "weight in the wider "
    "kernel, there are as many taps as places inside the map, a place alone is told, and the pass ends",
    method="bounded",
    depth=LONGEST_PAIRS + 4,
    reduced="passes of 2 x 3 at most, kernel 3, one channel, two lanes",
    bugs=(
        Bug(
            "the right place reaches no further than the left one",
            "beyond(right - (dx | pairs))",
            "beyond(right - dx)",
        ),
        Bug("a place alone is counted as a pair", "current.alone.eq(right == 0)", "current.alone.eq(0)"),
        Bug("the right place has a sum of its own", "(right == 0) | pairs,", "(right == 0),"),
    ),
)
def passes_in_pairs(m: Module) -> None:
    m.submodules.dut = dut = TapSequencer(PAIRS)
    now = dut.now
    rows, columns = any_number(1, "rows"), any_number(2, "columns")  # each less one
    row = Signal(3)
    m.d.comb += [
        row.eq(columns + 1),
        now.radius.eq(1),
        now.pool.eq(1),
        now.pairs.eq(1),
        now.rows.eq(rows),
        now.columns.eq(columns),
        now.groups.eq(0),
        now.channels.eq(1),
        now.row.eq(row),
        now.kernel_row.eq(4),
        now.group.eq(12),
        now.corner.eq(-(row + 1)),
    ]
    time = Signal(range(LONGEST_PAIRS + 2))
    m.d.sync += time.eq(time + (time != LONGEST_PAIRS + 1))
    m.d.comb += dut.go.eq(time == 0)
    assume(columns != 3)
    # Columns that the sums of a row see: of one that, of two both, of three all and then the last two.
    across, down = Mux(columns == 2, 5, columns + 1), Mux(rows, 4, 1)
    taps = Signal(8)
    singles = Signal(3)
    ended = Signal()
    m.d.sync += [taps.eq(taps + dut.tap.valid), ended.eq(ended | dut.done)]
    m.d.sync += singles.eq(singles + (dut.begin & dut.released.valid & dut.released.alone))
    prove(~dut.tap.valid | (dut.tap.activation < Mux(rows, row << 1, row)), "activation in the map")
    prove(~dut.tap.valid | (dut.tap.weight < now.group), "weight in the kernel")
    prove(~dut.done | (taps == across * down), "as many taps as places")
    prove(~dut.done | (singles == Mux(columns[0], 0, rows + 1)), "a place alone")
    prove(ended | (time <= LONGEST_PAIRS), "the pass ends")
