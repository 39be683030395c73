"""Teaching: no prototype of training is changed, no touch is compared with a place that is half written, and
every address is in range."""

import dataclasses

from amaranth.hdl import Array, Cat, Module, Mux, Signal

from eskin.golden.core import PRESETS, AcceleratorConfig
from eskin.rtl.decision.prototype_readout import PrototypeReadout
from eskin.rtl.program.memory_map import prototype_words
from formal.proof import Bug, assume, before, free, free_inputs, opened_up, proof, prove

CLASSES, TRAINED = 2, 1
VALUES = CLASSES  # of a linear cell's step
CLAIM = (
    "writes that no host asked for go to the touch's own place and to taught ones; outside of a pass that teaches all "
    "words of a place come from one touch, and in it nothing is compared; addresses are in range"
)


def _bug(name: str, old: str, new: str) -> Bug:
    return Bug(name, old, new, depth=34)  # a touch, and a pass that teaches it


@proof(
    CLAIM,
    depth=2,
    reduced="2 classes, 1 step of a linear cell, 1 prototype and 1 taught place a class, 3 bits",
    bugs=(
        _bug(
            "a prototype of training is overwritten",
            "& scan.slot[-1] & (scan.slot[:-1] == newest)",
            "& (scan.slot[:-1] == newest)",
        ),
        _bug("a new recording stops a pass", "self.clear & ~teaching & ~pass_begins", "self.clear"),
        _bug("a pass ends early", "row_ends & reaches(address, words - 1)", "body & last_unit & last_slot"),
        _bug("it is taught while a touch is open", "free = ~self.locked & self.idle", "free = self.idle"),
        _bug("idle while a pass goes on", "self.idle.eq(~(busy | teaching))", "self.idle.eq(~busy)"),
    ),
)
def no_place_is_half_written(m: Module) -> None:
    _whole_places(m, steps=1, taught=1)


@proof(
    CLAIM,
    depth=2,
    reduced="2 classes, 2 steps of a linear cell, 1 prototype and 2 taught places a class, 3 bits",
    bugs=(
        Bug(
            "the counter goes on after a touch",
            "(address, moves | back, Mux(back, 0, (address + 1)[: len(address)]))",
            "(address, moves, (address + 1)[: len(address)])",
        ),
    ),
    quick=True,
)
def no_place_is_half_written_of_several_steps(m: Module) -> None:
    _whole_places(m, steps=2, taught=2)


def _config(*, steps: int, taught: int) -> AcceleratorConfig:
    rule = {"prototypes": TRAINED, "taught": taught, "state_code_bits": 3, "state_code_shift": 12}
    return (
        PRESETS["thesis"]
        .replace(taxels=4, steps=steps, feature_shift=(4,), cell="linear", class_names=("a", "b"))
        .with_readout(readout="prototypes", **rule)
    )


def _whole_places(m: Module, *, steps: int, taught: int) -> None:
    config = _config(steps=steps, taught=taught)
    places, words, whole = TRAINED + taught, prototype_words(config), steps
    every = CLASSES * places
    row_words = (every + 1) * VALUES
    dut = PrototypeReadout(config)
    inside = opened_up(dut)
    driven = ("vector", "logit_valid", "load")
    free_inputs(dut, but=driven)
    free(dut.vector.valid, dut.vector.value, dut.load.enable, dut.load.address, dut.load.data)
    m.d.comb += [dut.logit_valid.eq(dut.vector.valid), dut.load.select.eq(-1)]

    # ---- as engine, classifier and host behave
    given, done = Signal(range(VALUES)), Signal(range(whole + 1), name="steps_done")
    last = given == VALUES - 1
    assume(dut.step_done == (dut.vector.valid & last))
    assume(~dut.vector.valid | (given != 0) | (dut.idle & (done != whole)))
    assume(~dut.ended | (dut.idle & (given == 0) & (done != 0) & ~dut.vector.valid))
    opened = dut.vector.valid | (given != 0) | (done != 0)
    assume(~opened | dut.locked)
    assume(
        ~dut.load.enable
        | (dut.idle & ~dut.locked & ~dut.teach & ~dut.forget & (dut.load.address < words + CLASSES))
    )
    assume(~(dut.teach & dut.forget))
    with m.If(dut.vector.valid):
        m.d.sync += [given.eq(Mux(last, 0, given + 1)), done.eq(done + last)]
    with m.If(dut.ended | dut.clear):
        m.d.sync += [given.eq(0), done.eq(0)]

    # ---- what an address means
    place_at = Array([(number % row_words) // VALUES for number in range(words)])  # 0: the touch's own
    trained = Array([place != 0 and (place - 1) % places < TRAINED for place in range(every + 1)])
    loads = dut.load.enable
    own_write = inside.written
    prove(~own_write | (inside.address < words), "a write in range")
    prove(~inside.reading | (inside.address < words), "a read in range")
    prove(~own_write | loads | ~trained[place_at[inside.address]], "prototypes of training stay")
    prove((inside.place < every) & (inside.kept < every), "sums in range")
    prove(~(loads & own_write), "the host writes while nothing else does")

    # ---- a pass that teaches writes all of one place, and nothing is compared meanwhile
    wrote = Signal(range(whole * VALUES + 1))
    taught_write = own_write & (place_at[inside.address] != 0)
    m.d.sync += wrote.eq(Mux(inside.pass_begins, 0, wrote + taught_write))
    prove(inside.teaching | (wrote == 0) | (wrote == whole * VALUES), "a place is written as a whole")
    prove(
        ~inside.teaching | ~(inside.comparing | inside.whole_place | inside.told),
        "nothing is compared in a pass",
    )
    prove(~taught_write | inside.teaching, "a taught place is written in a pass alone")
    prove(~dut.vector.valid | ~inside.teaching, "no touch comes in a pass")

    # ---- for the induction: one thing at a time, and the address that belongs to it
    phases = (inside.head, inside.gap, inside.body)
    head, gap, body = phases
    slot = Mux(inside.slot[-1], TRAINED, 0) + inside.slot[:-1]
    position = inside.label * places + slot
    before_step = done  # rows of the touch that are done, while none is under way
    scanning = Signal()
    m.d.sync += scanning.eq((scanning | dut.step_done) & ~inside.closes & ~dut.clear)
    prove(~(head & gap) & ~(head & body) & ~(gap & body), "one phase")
    prove(~(inside.busy & inside.teaching), "a step or a pass")
    prove(inside.busy == (scanning | (given != 0)), "busy")
    prove((done <= whole) & ((given == 0) | (done != whole)), "done in range")
    prove(~(scanning & (given != 0)), "the next step waits")
    prove(~scanning | (done != 0), "a step that was given")
    prove(~inside.teaching | ((done == 0) & (given == 0)), "no touch is open in a pass")
    prove(~(head | gap) | (position == 0), "at the first place")
    prove(~gap | (inside.unit == 0), "at the first value")
    prove(~(head | gap | body) | (inside.place == position), "its sum")
    prove(inside.slot[:-1] < Mux(inside.slot[-1], taught, TRAINED), "places in range")
    prove((inside.unit < VALUES) & (inside.label < CLASSES), "counters in range")
    under_way = head | gap | body
    prove(~under_way | scanning | inside.teaching, "phases belong to something")
    prove(~inside.teaching | under_way, "a pass goes on")
    rows = Signal(range(whole + 1), name="rows")  # of a pass
    m.d.sync += rows.eq(Mux(inside.pass_begins, 0, rows + (inside.teaching & inside.row_ends)))
    prove(~inside.teaching | (rows < whole), "rows of a pass")
    row = Mux(inside.teaching, rows, before_step - (scanning & under_way))
    inner = Mux(head, inside.unit, Mux(gap, VALUES, Mux(body, VALUES + position * VALUES + inside.unit, 0)))
    prove(inside.address == row * row_words + inner, "the address")
    count = Array(inside.numbers)[inside.chosen]
    place = (
        inside.chosen * places + TRAINED + Mux(count > taught, count - 1 - taught, (count - 1)[:1] % taught)
    )
    prove(~taught_write | (place_at[inside.address] == 1 + place), "the newest place is written")
    prove(
        Mux(inside.teaching, inside.first == (rows == 0), inside.first == (done == scanning)),
        "the first step or row",
    )
    prove(count < 2 * taught, "numbers in range")
    passed = Mux(body, Mux(position > place, VALUES, Mux(position == place, inside.unit, 0)), 0)
    prove(~inside.teaching | (wrote == rows * VALUES + passed), "words of the place")
    # a class ends in the sums: where its last value is compared, its sum is whole, its score is told
    ends = (
        inside.comparing & inside.end_of & inside.last_done,
        inside.whole_place & inside.last_done,
        inside.told,
    )
    prove(~(ends[0] & ends[1]) & ~(ends[1] & ends[2]) & ~(ends[0] & ends[2]), "one class ends at a time")
    drained = scanning & ~under_way
    last = ((ends[0] | ends[1]) & inside.label_done) | (ends[2] & inside.told_all)
    prove(~scanning | (last == drained), "the step's last class, when no other is left")
    prove(~inside.told_all | inside.told, "the last class is told")
    prove(~drained | ends[0] | ends[1] | ends[2], "the last class comes")
    prove(scanning | ~(inside.comparing | inside.whole_place | inside.told), "sums belong to a step")
    prove(~body | ~scanning | ~ends[0] | ((slot == 0) & (inside.unit == 0)), "compared, then the next class")
    prove(~body | ~scanning | ~ends[1] | ((slot == 0) & (inside.unit == 1)), "whole, and one further")
    prove(~body | ~scanning | ~ends[2] | ((slot == 1) & (inside.unit == 0)), "told, and two further")
    prove(~(head | gap) | ~(inside.comparing | inside.whole_place | inside.told), "a step begins at rest")
    first_value = body & (inside.unit == 0)
    prove(~inside.comparing | ~first_value | inside.end_of, "the last value of the place before")
    prove(~inside.comparing | first_value | ~body | ~inside.end_of, "no last value within a place")
    prove(
        ~inside.comparing | ~first_value | (inside.last_done == (slot == 0)),
        "the last place of the class before",
    )


@proof(
    "from a code of the wrong parity on, a place is nobody's nearest until the touch ends, unless it is its class's first",
    depth=2,
    reduced="2 classes, 2 steps of a linear cell, 1 prototype and 2 taught places a class, 3 bits",
    quick=True,
    bugs=(
        Bug("it counts all the same", "used_done & ~damaged if checks", "used_done if checks"),
        Bug(
            "the next value mends it", "Mux(begin_of, was_damaged, damaged)", "Mux(begin_of, was_damaged, 0)"
        ),
        Bug(
            "the next step mends it",
            "Mux(begin_of, was_damaged, damaged)",
            "Mux(begin_of, 0, damaged)",
            depth=44,
        ),
    ),
)
def no_damaged_place_is_nearest(m: Module) -> None:
    config = _config(steps=2, taught=2).replace(checksum=True)
    dut = PrototypeReadout(config)
    inside = opened_up(dut)
    free_inputs(dut)
    odd = inside.comparing & (inside.read.data.xor() ^ inside.codes[: inside.stored].xor())
    prove(dut.wrong == ((odd & inside.used) | inside.upset_seen), "flagged where the place is in use")
    prove(~before(odd, "odd") | inside.damaged, "known with the sum")
    ends = inside.comparing & ~inside.begin_of
    prove(~before(ends & inside.damaged, "within") | inside.damaged, "until the place ends")
    begins = inside.comparing & inside.begin_of
    known = ~inside.first & inside.sum_read.data[-1]
    prove(~before(begins & known, "begins") | inside.damaged, "of a step before")
    loses = inside.whole_place & inside.damaged & ~inside.first_done
    was = Signal.like(inside.nearest, name="nearest_before")
    m.d.sync += was.eq(inside.nearest)
    prove(~before(loses, "loses") | (inside.nearest == was), "the nearest stays")


@proof(
    "a class without a place in use is as far as can be said",
    depth=2,
    reduced="3 classes, one of them spare, 1 step of a linear cell, 1 prototype and 1 taught place a class, 3 bits",
    quick=True,
    bugs=(Bug("it is as far as a place not in use", "nearness.eq(0)", "nearness.eq(~total)", depth=26),),
)
def untaught_spare_class_is_far(m: Module) -> None:
    config = _config(steps=1, taught=1)
    rule = dataclasses.replace(config.readout_rule, spare_classes=1)
    config = dataclasses.replace(config.replace(class_names=("a", "b", "c")), readout_rule=rule)
    dut = PrototypeReadout(config)
    inside = opened_up(dut)
    free_inputs(dut)
    none = Signal(name="none_in_use")
    with m.If(inside.whole_place):
        m.d.sync += none.eq((none | inside.first_done) & ~inside.used_done)
    prove(~none | inside.nearest.all(), "as far as can be")


@proof(
    "whatever the registers hold, one whose parity is wrong is flagged in that cycle, and no code is written",
    depth=1,
    method="any state",
    reduced="2 classes, 2 steps of a linear cell, 1 prototype and 2 taught places a class, 3 bits",
    quick=True,
    bugs=(
        Bug("codes are written all the same", "(body & target)) & sound", "(body & target))"),
        Bug("numbers of touches are not looked at", "guards.append(guard)", "guards.append(Const(0, 1))"),
        Bug("the last of the registers is not looked at", "Cat(guards).any()", "Cat(guards[:-1]).any()"),
    ),
)
def no_upset_goes_unseen(m: Module) -> None:
    dut = PrototypeReadout(_config(steps=2, taught=2).replace(checksum=True))
    inside = opened_up(dut)
    free_inputs(dut)
    held = {register.name: register for register in inside.registers}
    counts = [name for name in held if name.startswith("count_") and not name.endswith("_parity")]
    for names in (
        *([name] for name in ("address", "unit", "slot", "label", "place", "chosen", "state")),
        counts,
    ):
        wrong = Cat(part for name in names for part in (held[name], held[f"{name}_parity"])).xor()
        prove(~wrong | dut.wrong, f"{names[0]} is flagged")
        prove(~wrong | ~inside.written, f"{names[0]} keeps codes from being written")


@proof(
    "a taught place is as far as its distance without the lowest bits, a prototype as all of it",
    depth=2,
    reduced="2 classes, 1 step of a linear cell, 1 prototype and 1 taught place a class, 3 bits, shift 1",
    quick=True,
    bugs=(
        Bug(
            "a taught place is as far as all of it",
            "total >> rule.taught_shift, total",
            "total, total",
            depth=26,
        ),
        Bug("a prototype is nearer", "Mux(taught_done, total", "Mux(~taught_done, total", depth=26),
    ),
)
def taught_places_are_nearer(m: Module) -> None:
    config = _config(steps=1, taught=1)
    rule = dataclasses.replace(config.readout_rule, taught_shift=1)
    dut = PrototypeReadout(dataclasses.replace(config, readout_rule=rule))
    inside = opened_up(dut)
    free_inputs(dut)
    taught = [Signal(name=f"taught_{cycles}_before") for cycles in (1, 2)]
    m.d.sync += Cat(taught).eq(Cat(inside.slot[-1], taught[0]))
    ended = inside.comparing & inside.end_of
    prove(~ended | (inside.taught_done == taught[0]), "the place that ended")
    prove(~ended | ~inside.body | (inside.unit == 0), "the next one has begun")
    prove(~inside.whole_place | (inside.taught_done == taught[1]), "whose sum is whole")
    far, was = Mux(taught[1], inside.total >> 1, inside.total), Signal.like(inside.total, name="far_before")
    m.d.sync += was.eq(far)
    nearer = inside.whole_place & (inside.first_done | (inside.used_done & (far < inside.nearest)))
    prove(~before(nearer, "nearer") | (inside.nearest == was), "as far as that")
