"""The log in the flash: what counts is never erased nor written over, nothing else in the chain is touched,
and addresses are in range. From any state in which that holds it holds in the next cycle."""

from amaranth.hdl import Cat, Module, Mux, Signal, Value

from eskin.rtl.host.taught_log import CODE_PURPOSE, COUNT_PURPOSE, IDLE_PURPOSE, TaughtLog
from eskin.rtl.program.flash_image import LogLayout
from eskin.rtl.program.memory_map import Control, Register, TeachRegister
from formal.proof import Bug, assume, before, free_inputs, opened_up, proof, prove

LAYOUT = LogLayout(
    **dict(offset=256, half=64, stride=8, erase=0x20, tag_bits=12, steps=2, values=2),
    **dict(bits=3, classes=2, prototypes=1, taught=2, words=28),
)
ROW, PLACES = LAYOUT.words // LAYOUT.steps, LAYOUT.prototypes + LAYOUT.taught
REDUCED = "2 classes, 2 steps of 2 values, 1 prototype and 2 taught places a class, halves of 8 records"
READS = ("SEEK", "SOUGHT", "TAG", "CODES", "SUM", "JUDGE", "CLEAR", "TEACH", "ONWARD")
FETCHES = ("FETCH", "LOOK", "TAKE", "TAKEN")
LISTENS = ("IDLE", "LISTEN", "HEARD", "MAKE WAY", "ORDER", "OBEYED")
PLACED = ("ENABLE", "ENABLED", "COMMAND", "COMMANDED")
WALKS = ("SNAPSHOT", "COUNT", "WALK", "WALKS", "NEXT CLASS")
SENDS = ("CODE", "SUM OUT", "POLL", "POLLED", "WRITTEN")


def _log(m: Module) -> tuple[TaughtLog, dict[str, Value]]:
    """The log, and what holds in every cycle if it held in the one before, with the sentence for it."""
    dut = TaughtLog(9, 1, log=LAYOUT, wake_cycles=2, offset=0)
    inside = opened_up(dut)
    free_inputs(dut)
    state = inside.states._data["signal"]
    now = {name: state == number for name, number in inside.states.encoding.items()}
    bus, half, counts, snapshot, erases, heading = (
        *(dut.bus, inside.half, inside.counts),
        *(inside.snapshot, inside.erases, inside.heading),
    )
    step, value, address, position = inside.step, inside.value, inside.address, inside.position

    def at(*names: str):
        return Cat(*(now[name] for name in names)).any()

    loads = at(*(name for name in now if name not in (*READS, *FETCHES, *LISTENS, *PLACED, *SENDS, *WALKS)))
    fetches, sends_code = at(*FETCHES), inside.purpose == CODE_PURPOSE
    idles, counting = inside.purpose == IDLE_PURPOSE, inside.purpose == COUNT_PURPOSE
    writes = at(*PLACED, *SENDS, *WALKS) | (fetches & ~idles)
    live, base = Signal(name="live_half"), Signal(range(LAYOUT.words), name="first_of_place")
    with m.If(now["CLEAR"] | (now["WRITTEN"] & heading & ~erases)):
        m.d.sync += live.eq(half)
    with m.If(now["WALKS"] | now["NEXT CLASS"]):
        m.d.sync += base.eq(Mux(now["WALKS"], address, 0))
    place = inside.at_class * PLACES + inside.at_place
    of_record = step * ROW + value
    walked = (inside.at_class < inside.target) | (
        (inside.at_class == inside.target) & (inside.at_place <= LAYOUT.prototypes + inside.slot)
    )
    recording = (at("WALK", "WALKS", *PLACED, *SENDS) | (fetches & sends_code)) & ~heading & ~erases
    filled = 1 + inside.target * LAYOUT.taught
    harmless = (
        (bus.addr == TeachRegister.PLACES)
        | ((bus.addr == TeachRegister.TEACH) & ~bus.w_data[8])
        | ((bus.addr == TeachRegister.FORGET) & ~bus.w_data[7])
        | ((bus.addr == Register.CONTROL) & (bus.w_data == Control.CLEAR_FAULTS))
    )
    commanded = now["COMMAND"] & inside.rested & counts
    own_store = inside.stores | inside.stored
    taught_one = now["TAKEN"] & counting & ~snapshot & ~bus.r_data.all()
    assume(~taught_one | (inside.number != 0), "a class that was taught a touch counts it")
    return dut, {
        # ---- what is asked for
        "a half that counts is not erased": ~(commanded & erases) | (half != live),
        "nor written to but behind its records": ~(commanded & ~erases)
        | (half != live)
        | (~heading & (position != 0)),
        "once it is ready no memory is loaded": ~inside.ready | ~bus.w_stb | harmless,
        "a code that comes goes to the touch's own place": ~own_store | (address == of_record),
        "addresses are in range": ~(fetches & ~idles) | (address < LAYOUT.words + LAYOUT.classes),
        # ---- and what that follows from
        "a state": loads | at(*READS, *FETCHES, *LISTENS, *PLACED, *SENDS, *WALKS),
        "a snapshot goes into the other half": ~(counts & inside.plays)
        | now["CLEAR"]
        | ((half == live) ^ snapshot),
        "loading and playing come first": ~inside.ready
        | (inside.plays & ~loads & ~at(*READS) & ~(fetches & idles) & ~inside.strobe & ~own_store),
        "then all else": inside.ready | loads | at(*READS, "LISTEN", "HEARD") | (fetches & idles),
        "heads are played first": inside.plays | loads | at(*READS[:6]),
        "the model comes before the log": ~(loads & inside.plays),
        "then the first record is next": inside.plays | ((position == 1) & ~inside.full),
        "a half is erased in a snapshot, at its head": ~erases | (snapshot & heading),
        "a snapshot is written": ~snapshot | (writes & ~now["SNAPSHOT"]),
        "a head belongs to a snapshot": ~(heading & inside.plays) | snapshot,
        "full where no record is left": ~inside.plays | (inside.full == (position == 0)),
        "none is written then": ~recording | ~inside.full | now["WRITTEN"],
        "nor counted": ~(at("COUNT") | (fetches & counting)) | snapshot | ~inside.full,
        "a snapshot has room": ~(snapshot & recording)
        | ((position <= filled + LAYOUT.taught - inside.to_go) & (position != 0)),
        "a class of it": ~(snapshot & (now["COUNT"] | (fetches & counting)))
        | ((position <= filled) & (position != 0)),
        "and the next": ~(snapshot & now["NEXT CLASS"])
        | ((position <= filled + LAYOUT.taught) & (position != 0)),
        "places to go": ~recording | ((inside.to_go != 0) & (inside.to_go <= LAYOUT.taught)),
        "places of a class": ~recording | (inside.slot < LAYOUT.taught),
        "playing, none is full": ~(inside.plays & (at(*READS) | (fetches & idles))) | ~inside.full,
        "a next class belongs to a snapshot": ~now["NEXT CLASS"] | snapshot,
        "neither head nor erasing": ~(at("COUNT", "WALK", "WALKS", "NEXT CLASS") | (fetches & counting))
        | ~(heading | erases),
        "a command is followed by the first code": ~now["COMMANDED"] | ((step == 0) & (value == 0)),
        "the last code of a record ends them": ~(now["CODES"] & own_store) | ~inside.last_code,
        "places are walked through": ~now["WALKS"]
        | ((address == (place + 1) * LAYOUT.values) & walked & (inside.at_place < PLACES)),
        "the place is kept": ~at(*PLACED) | erases | (address == base),
        "a place": (base <= ROW - LAYOUT.values) | ~(at(*PLACED, *SENDS) | (fetches & sends_code)) | erases,
        "the tag comes first": ~inside.going | now["CODE"] | (fetches & sends_code),
        "codes follow": ~((now["CODE"] & inside.going) | (fetches & sends_code))
        | (~erases & inside.going & (address == base + of_record)),
        "before the first": ~(now["CODE"] & ~inside.going)
        | (~erases & (address == base) & (step == 0) & (value == 0)),
        "the number of a class": ~(fetches & counting) | (address == LAYOUT.words + inside.target),
        "purposes": inside.purpose <= IDLE_PURPOSE,
        "a record is read from its start": ~at("TAG", "CODES") | (address == of_record),
        "before it": ~now["SOUGHT"] | ((address == 0) & (step == 0) & (value == 0)),
        "selected": ~at("SOUGHT", "TAG", "CODES", "SUM") | ~dut.pins.cs_n,
        "stored at once": (~inside.stores | (inside.phase == 0))
        & (~inside.stored | (inside.phase == 1))
        & ~(inside.stores & inside.stored)
        & (~own_store | at("CODES", "SUM")),
    }


def _bug(name: str, old: str, new: str) -> Bug:
    return Bug(name, old, new)


@proof(
    "the half that counts is not erased nor written but behind its last record; once the log is played no memory is loaded; "
    "what is played goes to the touch's own place; addresses are in range",
    depth=2,
    method="any state",
    reduced=REDUCED,
    quick=True,
    bugs=(
        _bug("a snapshot goes into the half that counts", "half.eq(half ^ counts)", "half.eq(half)"),
        _bug(
            "a full half is appended to", "taught & (shared.full | ~shared.counts)", "taught & ~shared.counts"
        ),
        _bug(
            "a record is written in place of the head",
            "m.d.sync += heading.eq(0)",
            "m.d.sync += heading.eq(heading)",
        ),
        _bug("the place that is walked to is one too far", "[address.eq(address), tag", "[tag"),
        _bug(
            "a touch is taught as one that a host loaded",
            "Cat(asked_label, asked_option)",
            "Cat(asked_label, asked_option, 1)",
        ),
        _bug("the next class begins at the class before", "log.words + target", "log.words + 2 * target"),
        _bug(
            "codes of a record go one further",
            "row_words - log.values + 1, 1)",
            "row_words - log.values + 2, 1)",
        ),
    ),
)
def what_counts_stays(m: Module) -> None:
    _, holds = _log(m)
    every = Signal(name="all_hold")
    m.d.comb += every.eq(Cat(*holds.values()).all())
    held = before(every, "all_held")
    for text, condition in holds.items():
        prove(~held | condition, text)


@proof(
    "all of that holds after a reset",
    depth=3,
    method="bounded",
    reduced=REDUCED,
    quick=True,
    bugs=(
        _bug("the first record is at the head", "Signal(record_bits, init=1)", "Signal(record_bits, init=0)"),
    ),
)
def begins_so(m: Module) -> None:
    _, holds = _log(m)
    for text, condition in holds.items():
        prove(condition, text)
