"""The normaliser: a beat out for each beat in, the same window, exact narrowing."""

from amaranth.hdl import Module, Mux, Signal, signed

from eskin.golden.core import PRESETS
from eskin.rtl.frontend.normaliser import Normaliser
from formal.proof import (
    Bug,
    Inside,
    any_number,
    assume,
    free,
    free_sink,
    free_source,
    keeps_its_beat,
    opened_up,
    proof,
    prove,
)

CONFIG = PRESETS["thesis"].replace(taxels=4, feature_shift=(4, 9))
MEANS = (12_345_678, -9_876_543)


def _block(m: Module, config=CONFIG, means=MEANS) -> tuple[Normaliser, Inside]:
    dut = Normaliser(config, means)
    inside = opened_up(dut)
    free_source(dut.i)
    free_sink(dut.o)
    return dut, inside


@proof(
    "each sum leaves as one centred value of its taxel and window; offered values stay until taken, "
    "whatever the mask does",
    depth=3,
    reduced="4 taxels",
    quick=True,
    bugs=(
        Bug("the mask is looked at again while the beat waits", "with m.If(~added):", "with m.If(1):"),
        Bug(
            "a beat is taken before its result",
            "self.i.ready.eq(added & self.o.ready)",
            "self.i.ready.eq(added)",
        ),
    ),
)
def stream_rules(m: Module) -> None:
    dut, _ = _block(m)
    free(dut.mask)
    keeps_its_beat(dut.o, "o")
    prove((dut.i.valid & dut.i.ready) == (dut.o.valid & dut.o.ready), "one out for one in")
    prove(
        ~dut.o.valid | (dut.o.p.last == (dut.i.p.taxel == CONFIG.sensor.taxels - 1)), "last is the last taxel"
    )
    prove(~dut.o.valid | (dut.o.p.first == (dut.i.p.taxel == 0)), "first is taxel 0")
    prove(
        ~dut.o.valid | ((dut.o.p.length == dut.i.p.length) & (dut.o.p.final == dut.i.p.final)),
        "the window's own flags",
    )


@proof(
    "centred = SAT((d - mean) >> shift) of the window's length, 0 for a masked taxel: exactly, for every sum",
    depth=3,
    reduced="4 taxels, two means in ROM",
    bugs=(
        Bug(
            "WRAP instead of SAT",
            "forced.eq(masked | (above != negative.replicate(len(above)).as_signed()))",
            "forced.eq(masked)",
            depth=8,
        ),
        Bug("a masked taxel is not forced", "forced.eq(masked | ", "forced.eq(0 | ", depth=8),
        Bug(
            "the other length's mean",
            "if several else self.i.p.length",
            "if several else ~self.i.p.length",
            depth=8,
        ),
    ),
)
def narrowing(m: Module) -> None:
    _narrowing(m, CONFIG, MEANS)


@proof(
    "the same where the bits that a shift drops are 0 in every mean and no register has them",
    depth=3,
    reduced="4 taxels, two means in ROM",
    bugs=(Bug("a bit too few", "shift + frac - low + start", "shift + frac - low + start + 1", depth=8),),
)
def narrowing_aligned(m: Module) -> None:
    _narrowing(
        m, CONFIG.replace(feature_shift=(4, 4), aligned_means=True), tuple(mean & -16 for mean in MEANS)
    )


@proof(
    "the same where means have fraction bits",
    depth=3,
    reduced="4 taxels, two means in ROM",
    bugs=(Bug("ones below d are zeros", "Const(-1, frac)", "Const(0, frac)", depth=8),),
)
def narrowing_fractions(m: Module) -> None:
    _narrowing(m, CONFIG.replace(feature_shift=(-3, 4)), tuple(8 * mean + 5 for mean in MEANS))


def _narrowing(m: Module, config, means: tuple[int, int]) -> None:
    dut, inside = _block(m, config.replace(loadable=False), means)
    # From a window's first beat to its last the length stays, also between beats
    # (formal/frontend/window_averager.py).
    open_, length, beat = (
        Signal(name="window_open"),
        Signal(name="window_length"),
        Signal(range(CONFIG.sensor.taxels), name="beat"),
    )
    taken = dut.i.valid & dut.i.ready
    last = beat == CONFIG.sensor.taxels - 1
    m.d.sync += [open_.eq((open_ | dut.i.valid) & ~(taken & last)), beat.eq(beat + taken)]
    with m.If(~open_):
        m.d.sync += length.eq(dut.i.p.length)
    assume(~open_ | (dut.i.p.length == length))
    assume(~dut.i.valid | (dut.i.p.taxel == beat))
    m.d.comb += dut.mask.eq(any_number(CONFIG.sensor.taxels, "mask_set"))
    frac = config.mean_frac
    difference, exact = (Signal(signed(CONFIG.sum_bits + frac + 1), name=name) for name in ("d", "exact"))
    m.d.comb += [
        difference.eq((~dut.i.p.complement << frac) - Mux(dut.i.p.length, means[1], means[0])),
        exact.eq(
            Mux(
                dut.i.p.length,
                difference >> config.features.feature_shift[1] + frac,
                difference >> config.features.feature_shift[0] + frac,
            )
        ),
    ]
    low, high = CONFIG.centred_format.min_code, CONFIG.centred_format.max_code
    centred = Mux(exact > high, high, Mux(exact < low, low, exact))
    masked = dut.mask.bit_select(dut.i.p.taxel, 1)
    prove(~dut.o.valid | (dut.o.p.value == Mux(masked, 0, centred)), "the centred sum")
    prove(inside.mean_read == open_, "the window's mean is read once")
    prove((open_ | (beat == 0)) & (~dut.o.valid | (dut.i.valid & open_)), "a beat that is worked on stays")
