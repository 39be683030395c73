"""The I2C port: it comes back to idle from any state, moves the lines only where the bus allows it, and
leaves the chips their bits."""

from amaranth.hdl import Cat, Module, Mux, Signal

from eskin.rtl.interface.i2c_master import I2cMaster, I2cOp
from formal.proof import Bug, assume, before, free_inputs, less_is_to_go, opened_up, proof, prove

QUARTER = 3


def _port(m: Module):
    dut = I2cMaster(QUARTER)
    inside = opened_up(dut)
    free_inputs(dut)
    return dut, inside


@proof(
    "from any state of its counters an operation goes on towards idle in every cycle",
    depth=2,
    reduced="3 cycles a quarter",
    quick=True,
    bugs=(
        Bug("the timer stops at one", "timer.eq(timer - 1)", "timer.eq(timer - (timer > 1))", depth=12),
        Bug(
            "a byte never ends",
            "quarters.eq(quarters - 1)]",
            "quarters.eq(Mux(quarters == 1, 36, quarters - 1))]",
            depth=20,
        ),
    ),
)
def back_to_idle(m: Module) -> None:
    dut, inside = _port(m)
    left = Signal(16)
    m.d.comb += left.eq(Mux(inside.quarters == 0, 0, (inside.quarters << len(inside.timer)) + inside.timer))
    less_is_to_go(left, before(left == 0, "was_idle"))
    prove(dut.idle == (left == 0), "idle where nothing is to go")


@proof(
    "the data line moves while the clock is high only in START, where it falls, and in STOP, where it "
    "rises; it is let go for every bit of "
    "a byte that is read and for the acknowledge of one that is written; the clock is low and high for two "
    "quarters at least",
    depth=3,
    reduced="3 cycles a quarter",
    bugs=(
        Bug("data change under a high clock", "with m.Case(0):\n", "with m.Case(2):\n", depth=60),
        Bug(
            "our one over the chip's acknowledge",
            "out.eq(Cat(1, self.byte))",
            "out.eq(Cat(0, self.byte))",
            depth=150,
        ),
        Bug("the clock rises a quarter early", "pins.scl_low.eq(0)", "pins.scl_low.eq(1)", depth=60),
        Bug("a byte that is read is answered in its first bit", "out.eq(0x1FE)", "out.eq(0x0FE)", depth=60),
    ),
)
def lines(m: Module) -> None:
    dut, inside = _port(m)
    pins, op, quarters, phase, timer = dut.pins, inside.op, inside.quarters, inside.phase, inside.timer
    # a message begins with START; only nine free clocks may come before it
    begins = dut.start & dut.idle
    assume(~begins | (dut.op <= I2cOp.LAST.value))
    assume(~begins | pins.scl_low | (dut.op == I2cOp.START) | (dut.op == I2cOp.LAST))
    was_sda, was_scl, running = (
        before(pins.sda_low, "was_sda"),
        before(pins.scl_low, "was_scl"),
        before(1, "running"),
    )
    moved = running & (pins.sda_low != was_sda)
    high = ~pins.scl_low & ~was_scl
    is_start, is_stop = op == I2cOp.START, op == I2cOp.STOP
    reads = (op == I2cOp.READ) | (op == I2cOp.LAST)
    prove(~(moved & high) | Mux(pins.sda_low, is_start, is_stop), "under a high clock only START and STOP")
    is_byte = ~is_start & ~is_stop
    fresh = (quarters == 36) | (quarters == 0)  # the line is still as the operation before left it
    prove(~(reads & ~fresh & (quarters > 4)) | ~pins.sda_low, "the line is let go where it is read")
    last_bit = (quarters != 0) & (quarters < 4)
    prove(~((op == I2cOp.WRITE) & last_bit) | ~pins.sda_low, "the line is let go for the acknowledge")
    time = Signal(5, name="time_since_the_clock_moved")
    changed = running & (pins.scl_low != was_scl)
    now = Mux(changed, 0, time)
    m.d.sync += time.eq(Mux(now == 31, 31, now + 1))
    ever = Signal()
    m.d.sync += ever.eq(ever | changed)
    prove(~(changed & ever) | (time >= 2 * QUARTER), "two quarters")
    # ---- for the induction
    prove((quarters <= 36) & (timer < QUARTER) & (op <= I2cOp.LAST.value), "ranges")
    prove(~(is_start | is_stop) | (quarters <= 4), "a bit")
    done = quarters == 0
    prove(~done | ~pins.sda_low | pins.scl_low, "a free bus")
    prove(done | ~is_byte | (phase < 2) | ~pins.scl_low, "high half")
    prove(~(is_start | is_stop) | done | (phase < 2) | ~pins.scl_low, "high half of a bit")
    prove(done | (phase >= 2) | (quarters > 32) | pins.scl_low | is_start, "low half")
    prove(
        done | (phase >= 2) | (quarters <= 32) | pins.scl_low | (op == I2cOp.LAST),
        "low half of the first bit",
    )
    prove(~(is_stop & ~done & (phase < 2)) | pins.scl_low, "low half of STOP")
    prove(done | (phase >= 2) | pins.scl_low | ~pins.sda_low, "a free bus until the clock moves")
    held = phase * QUARTER + (QUARTER - 1 - timer)  # cycles of this bit that are over
    prove(done | ~is_stop | (phase == 0) | (phase == 3) | pins.sda_low, "STOP holds the line")
    prove(done | ~is_start | (phase == 0) | (phase == 3) | ~pins.sda_low, "START lets go first")
    prove(done | ~is_start | (phase < 3) | pins.sda_low, "START has begun")
    prove(done | ~is_stop | (phase < 3) | ~pins.sda_low, "STOP is over")
    in_bit = held < 2 * QUARTER
    prove(~ever | done | in_bit | (now >= held - 2 * QUARTER), "time in the high half")
    prove(~ever | done | ~in_bit | (now >= held), "time in the low half")
    # of the byte's bits so far: the acknowledge stands there
    shifts = 9 - ((quarters + 3) >> 2) + (phase == 3)
    for count in range(10):
        here = ~done & is_byte & (shifts == count)
        others = Cat(inside.out[bit] for bit in range(9) if bit != count).all()
        prove(~here | ~reads | others, f"let go after {count} bits")
        prove(
            ~here | (op != I2cOp.WRITE) | (inside.out[count] if count < 9 else 1),
            f"acknowledge after {count} bits",
        )
    prove(
        done | ~is_byte | ((phase != 1) & (phase != 2)) | (pins.sda_low == ~inside.out[8]),
        "the line is the bit",
    )
