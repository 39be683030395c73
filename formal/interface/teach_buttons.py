"""The two buttons: bouncing contacts say nothing, and a press says one thing."""

from unittest import mock

from amaranth.hdl import Module, Mux, Signal

from eskin.rtl.interface import teach_buttons
from eskin.rtl.interface.teach_buttons import TeachButtons
from formal.proof import Bug, free_inputs, opened_up, proof, prove

LOOK, HELD = 3, 4


@proof(
    "a button says something only once two looks in a row saw it pressed, and of one press one thing alone: held after "
    "so many looks that saw it down, else short when two looks saw it released",
    depth=3,
    reduced=f"a look every {LOOK} cycles, held after {HELD} looks",
    quick=True,
    bugs=(
        Bug("one look is enough", "with m.If(now == before):", "with m.If(1):", depth=16),
        Bug("a held button also says short", "now & down & (looks != HELD)", "now & down", depth=44),
        Bug("held is said again and again", "looks == HELD - 1", "looks >= HELD - 1", depth=44),
        Bug(
            "short presses add up to a held one",
            "Mux(now, 0, looks + (looks != HELD))",
            "Mux(now, looks, looks + (looks != HELD))",
            depth=60,
        ),
    ),
)
def one_press_says_one_thing(m: Module) -> None:
    with mock.patch.object(teach_buttons, "HELD", HELD):
        dut = TeachButtons(LOOK)
        inside = opened_up(dut)
    free_inputs(dut)
    # the last button's line behind its synchroniser; the other one is made the same way
    line, looks_now = inside.now, inside.looks_now
    seen, run, said = Signal(2, init=3), Signal(range(HELD + 1)), Signal()
    down = Signal(name="is_down")
    both_down, both_up = ~line & ~seen[0], line & seen[0]
    with m.If(looks_now):
        m.d.sync += seen.eq(line)
        with m.If(both_down):
            m.d.sync += [down.eq(1), run.eq(run + (run != HELD))]
        with m.If(both_up):
            m.d.sync += [down.eq(0), run.eq(0)]
    was = Signal(4)  # what may be said in this cycle
    m.d.sync += was.eq(
        Mux(looks_now, (both_up & down & (run != HELD)) | (both_down & (run == HELD - 1)) << 1, 0)
    )
    prove(dut.taught == was[0], "short")
    prove(dut.named == was[1], "held")
    m.d.sync += said.eq((said | dut.taught | dut.named) & ~(looks_now & both_down & ~down))
    prove(inside.before == seen[0], "line before")
    prove((inside.down == down) & (inside.looks == run), "as the reference has it")
    prove(run <= HELD, "looks")
    prove(inside.left < LOOK, "cycles to the next look")
