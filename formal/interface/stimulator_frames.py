"""The stimulator's frames: nothing beyond the limits, and OFF after whatever ends a touch."""

from unittest import mock

from amaranth.hdl import Module, Mux, Signal

from eskin.golden.core.groups import Interface
from eskin.rtl.interface import stimulator_frames
from eskin.rtl.interface.stimulator_frames import OFF, ON, StimulatorFrames
from formal.proof import Bug, before, free_inputs, opened_up, proof, prove

LIMITS = Interface(amplitude_limit=30, delay_limit=5000, frequency_limit=50, width_limit=256)
ON_CYCLES = 14
SA, C1, C2 = 3, 4, 5


def _frames(m: Module, on_cycles: int = ON_CYCLES):
    with mock.patch.object(stimulator_frames, "OFFS_AT_RESET", 1):
        dut = StimulatorFrames(LIMITS, on_cycles)
        inside = opened_up(dut)
    free_inputs(dut)
    return dut, inside


@proof(
    "whatever a host sets and whenever: no amplitude, delay, frequency or width on the line is above its "
    "limit, and a value's bytes are "
    "of one value",
    depth=2,
    reduced="400 cycles at most, one OFF after a reset",
    bugs=(
        Bug(
            "no limit",
            "Mux(self.settings[name] > limit, limit, self.settings[name])",
            "self.settings[name]",
            depth=20,
        ),
        Bug("settings are not held", "value = held[", "value = self.settings[", depth=34),
        Bug(
            "the width goes out as frequency",
            '"SF": "frequency", "SW": "width"',
            '"SF": "width", "SW": "frequency"',
            depth=40,
        ),
    ),
)
def limits(m: Module) -> None:
    dut, inside = _frames(m, 400)
    frame, place, held = inside.frame, inside.place, inside.held
    byte = dut.byte.payload
    body = dut.byte.valid & (place >= 4)
    bank = body & ((frame == C1) | (frame == C2)) & (place < 20)
    prove(~bank | (byte <= LIMITS.amplitude_limit), "amplitude")
    high = Signal(8)  # the byte before, as it was taken
    with m.If(dut.byte.valid & dut.byte.ready):
        m.d.sync += high.eq(byte)
    for number, low, limit, name in (
        (0, 7, LIMITS.delay_limit, "delay"),
        (1, 5, LIMITS.frequency_limit, "frequency"),
        (2, 5, LIMITS.width_limit, "width"),
    ):
        at = dut.byte.valid & (frame == number)
        prove(~(at & (place == low)) | ((high << 8 | byte) <= limit), f"{name} on the line")
        prove(~(at & (place == low)) | (high == held[name][8:]), f"{name}: its high byte")
        prove(held[name] <= limit, f"{name} is held")
    prove(held.amplitude <= LIMITS.amplitude_limit, "amplitude is held")
    prove(
        ~(dut.byte.valid & (frame == 0) & ((place == 4) | (place == 5))) | (byte == 0),
        "the delay's upper bytes",
    )
    prove(inside.sending | (place == 0), "a frame begins at its first byte")
    prove(
        ~inside.sending | (frame == OFF) | (inside.burst == frame + 1),
        "a burst's frames are under way in a burst",
    )


@proof(
    "once a burst has begun, its end, a fault, another electrode or the time limit is followed by an OFF "
    "frame before any other begins, "
    "and OFF begins in the cycle in which the frame under way is over; after a fault nothing else begins "
    "until the request has been low; "
    "ON comes only after all six frames of settings",
    depth=3,
    reduced="14 cycles at most, one OFF after a reset",
    bugs=(
        Bug("a short fault is forgotten", "with m.If(halted | ends):", "with m.If(ends):", depth=40),
        Bug(
            "a fault does not end a burst",
            "(self.electrode != electrode) | self.fault | too_long",
            "(self.electrode != electrode) | too_long",
            depth=40,
        ),
        Bug("no time limit", "self.fault | too_long\n", "self.fault\n", depth=34),
        Bug("no new touch is needed", "~self.fault & ~locked", "~self.fault", depth=45),
        Bug(
            "nothing is sent at the end",
            "frame.eq(OFF), sending.eq(1), offs.eq(OFFS - 1)",
            "frame.eq(OFF), offs.eq(0)",
            depth=40,
        ),
    ),
)
def off_follows(m: Module) -> None:
    dut, inside = _frames(m)
    frame, sending, burst = inside.frame, inside.sending, inside.burst
    begins = sending & ~before(sending, "was_sending")  # a frame's first cycle
    # ---- a reference of its own: OFF is owed; a new touch is needed; cycles since the burst began
    owed = Signal()
    needs_touch = Signal()
    alive = Signal()
    age = Signal(range(ON_CYCLES + 2), name="age_of_burst")
    chosen = Signal(range(24))
    starts = begins & (frame == 0)
    was_wanted = before(dut.electrode, "electrode_before")
    lives = alive | starts
    electrode = Mux(starts, was_wanted, chosen)
    time_over = lives & (Mux(starts, 0, age) >= ON_CYCLES)
    ends = lives & (~dut.request | dut.fault | (dut.electrode != electrode) | time_over)
    is_off = begins & (frame == OFF)
    m.d.sync += [
        owed.eq((owed & ~is_off) | (ends & ~is_off)),
        alive.eq(lives & ~is_off),
        chosen.eq(electrode),
        age.eq(Mux(lives & ~is_off, Mux(starts, 1, Mux(age > ON_CYCLES, age, age + 1)), 0)),
        needs_touch.eq((needs_touch & dut.request) | dut.fault | (time_over & (burst != 0))),
    ]
    prove(~(owed & begins) | (frame == OFF), "OFF before any other frame")
    prove(~before(owed & ~sending, "idle_and_owed") | is_off, "OFF as soon as the line is free")
    prove(~(starts & before(needs_touch, "needed")), "after a fault a new touch is needed")
    prove(~(begins & (frame == ON)) | (burst == ON + 1), "ON is the last of a burst")
    # ---- for the induction
    prove((burst == 0) | (frame + 1 == burst), "frames in order")
    prove((burst != 0) == (lives & ~is_off), "a burst goes on until its OFF begins")
    prove((burst == 0) | (inside.electrode == electrode), "the burst's electrode")
    prove((burst == 0) | (inside.age == Mux(starts, 0, Mux(age > ON_CYCLES, ON_CYCLES, age))), "age")
    prove((burst == 0) | (inside.halted == owed), "owed is known")
    prove((burst != 0) | ~owed | is_off, "nothing is owed outside of a burst")
    prove(inside.locked == needs_touch, "locked")
    prove((burst <= ON + 1) & (frame <= OFF), "ranges")
    prove(~sending | (burst != 0) | (frame == OFF), "outside of a burst only OFF")
