"""The model from the flash: the loader ends from any state, and the model is there only after a correct
checksum."""

from unittest import mock

from amaranth.hdl import Cat, Module, Mux, Signal

from eskin.rtl.host import flash_loader
from eskin.rtl.host.flash_loader import FlashLoader
from formal.proof import Bug, before, less_is_to_go, placed_free, proof, prove

WRITES, WAKE_CYCLES, MAGIC, NUMBER = 1, 2, 5, 9
UNIT, HEAD, CHECK = 17, 18, 4
REDUCED = "1 write, units of 17 bits, a command of 18, a checksum of 4, 2 cycles to wake"
ORDER = ("START", "WAKE", "WAIT", "ASK", "MAGIC", "NUMBER", "WRITES", "CHECK", "ARM")
"""States in the order in which they follow one another; then DONE or FAILED."""


def _loader(m: Module):
    with mock.patch.multiple(flash_loader, UNIT=UNIT, HEAD=HEAD, CHECK=CHECK, MAGIC=MAGIC, TAPS=3):
        dut = placed_free(FlashLoader(NUMBER, WRITES, wake_cycles=WAKE_CYCLES, offset=0))
    return dut, {name: dut.states._data["signal"] == number for name, number in dut.states.encoding.items()}


@proof(
    "whatever comes from the flash, in every cycle the loader goes on towards the model being there or "
    "refused, and there it stays",
    depth=3,
    reduced=REDUCED,
    quick=True,
    bugs=(
        Bug("bits are not counted", "left.eq(left - (left != 0))", "left.eq(left)"),
        Bug(
            "the time to wake stops at one", "timer.eq(timer - (timer != 0))", "timer.eq(timer - (timer > 1))"
        ),
    ),
)
def comes_to_an_end(m: Module) -> None:
    dut, now = _loader(m)
    rank, left = Signal(4, name="rank"), Signal(24, name="to_go")
    m.d.comb += rank.eq(
        sum((Mux(now[name], len(ORDER) - place, 0) for place, name in enumerate(ORDER)), start=0)
    )
    shifting = Cat(~dut.phase, dut.left)
    within = Mux(now["WAIT"], dut.timer, shifting | Mux(now["WRITES"], dut.writes << 7, 0))
    m.d.comb += left.eq(rank << 12 | within)
    ended = before(dut.done | dut.failed, "ended")
    less_is_to_go(left, ended)
    prove(~ended | (dut.done | dut.failed), "the end stays")
    prove(~(dut.done & dut.failed), "one end")
    prove(dut.done | dut.failed | (rank != 0), "a state")
    # ---- for the induction
    shifts = ~(now["START"] | now["WAIT"] | now["ARM"] | now["DONE"] | now["FAILED"])
    prove(~shifts | ~dut.flash.cs_n, "selected while bits go")
    prove(~(now["MAGIC"] | now["NUMBER"] | now["WRITES"]) | (dut.writes < WRITES), "writes to go")
    prove(dut.timer <= WAKE_CYCLES, "timer")
    longest = {"WAKE": 8, "ASK": HEAD, "MAGIC": UNIT, "NUMBER": UNIT, "WRITES": UNIT, "CHECK": CHECK}
    for name, bits in longest.items():
        prove(~now[name] | (dut.left < bits), f"bits of {name}")
    prove(~(now["START"] | now["WAIT"]) | dut.flash.cs_n, "not selected in between")


@proof(
    "ARM is written, and the model said to be there, only in the cycles behind a checksum that is right; "
    "nothing is written without the "
    "head, nor after a refusal",
    depth=3,
    reduced=REDUCED,
    bugs=(
        Bug("the checksum is not looked at", "with m.If(check_now == 0):", "with m.If(1):"),
        Bug("another design's image", "with m.If(unit_now == expected):", "with m.If(1):"),
    ),
)
def only_behind_a_right_checksum(m: Module) -> None:
    dut, now = _loader(m)
    last = (dut.phase == 3) & (dut.left == 0)
    right = before(now["CHECK"] & last & (dut.check_now == 0), "right")
    ready = Signal()
    m.d.sync += ready.eq(ready | right)
    prove(~now["ARM"] | right, "ARM comes behind the right checksum")
    prove(~dut.done | ready, "the model is there behind it")
    # ---- a reference of the head: both units were as they must be
    magic = before(now["MAGIC"] & last & (dut.unit_now == MAGIC), "magic")
    number = before(now["NUMBER"] & last & (dut.unit_now == NUMBER), "number")
    head = Signal()
    both = Signal()
    m.d.sync += [head.eq(head | magic), both.eq(both | (number & (head | magic)))]
    prove(~dut.bus.w_stb | both | (number & head), "nothing is written without the head")
    prove(~(dut.failed & before(dut.failed, "refused")) | ~dut.bus.w_stb, "nothing after a refusal")
    prove(~(now["NUMBER"]) | head | magic, "the magic was right")
    prove(
        ~(now["WRITES"] | now["CHECK"] | now["ARM"] | now["DONE"]) | both | (number & head), "both were right"
    )
    prove(~dut.bus.w_stb | now["ARM"] | both, "a strobe comes from a write")
