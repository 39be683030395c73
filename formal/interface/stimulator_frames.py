"""The stimulator's frames: OFF after whatever ends a touch."""

from unittest import mock

from amaranth.hdl import Module, Mux, Signal

from eskin.golden.core.groups import Interface
from eskin.rtl.interface import stimulator_frames
from eskin.rtl.interface.stimulator_frames import OFF, ON, StimulatorFrames
from formal.proof import Bug, before, placed_free, proof, prove

ON_CYCLES = 14


@proof(
    "once a burst has begun, its end, a fault, another electrode or the time limit is followed by an OFF "
    "frame before any other begins, "
    "and OFF begins in the cycle in which the frame under way is over; after a fault nothing else begins "
    "until the request has been low; "
    "ON comes only after all six frames of settings",
    depth=3,
    reduced="14 cycles at most, one OFF after a reset",
    bugs=(
        Bug("a short fault is forgotten", "with m.If(halted | ends):", "with m.If(ends):"),
        Bug(
            "a fault does not end a burst",
            "(self.electrode != electrode) | self.fault | too_long",
            "(self.electrode != electrode) | too_long",
        ),
        Bug("no time limit", "self.fault | too_long\n", "self.fault\n"),
        Bug("no new touch is needed", "~self.fault & ~locked", "~self.fault"),
        Bug(
            "nothing is sent at the end",
            "frame.eq(OFF), sending.eq(1), offs.eq(OFFS - 1)",
            "frame.eq(OFF), offs.eq(0)",
        ),
    ),
)
def off_follows(m: Module) -> None:
    with mock.patch.object(stimulator_frames, "OFFS_AT_RESET", 1):
        dut = placed_free(StimulatorFrames(Interface(), ON_CYCLES))
    frame, sending, burst = dut.frame, dut.byte.valid, dut.burst
    begins = sending & ~before(sending, "was_sending")  # a frame's first cycle
    # ---- a reference: OFF is owed; a new touch is needed; cycles since the burst began
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
    prove((burst == 0) | (dut.of_burst == electrode), "the burst's electrode")
    prove((burst == 0) | (dut.age == Mux(starts, 0, Mux(age > ON_CYCLES, ON_CYCLES, age))), "age")
    prove((burst == 0) | (dut.halted == owed), "owed is known")
    prove((burst != 0) | ~owed | is_off, "nothing is owed outside of a burst")
    prove(dut.locked == needs_touch, "locked")
    prove((burst <= ON + 1) & (frame <= OFF), "ranges")
    prove(~sending | (burst != 0) | (frame == OFF), "outside of a burst only OFF")
