"""What the board was taught, kept in its flash: docs/specification.md, section 18."""

from collections.abc import Iterator
from dataclasses import dataclass

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from eskin.rtl.common.fixed import wrapping_increment
from eskin.rtl.host.flash_loader import READ, FlashLoader, Serial
from eskin.rtl.program.flash_image import LogLayout
from eskin.rtl.program.memory_map import Control, Register, TeachRegister

PROGRAM, WRITE_ENABLE, STATUS = 0x02, 0x06, 0x05
HEAD_TAG = 0x80
ALL, LOADED, REFUSED, ODD = 7, 8, 8, 9
"""Bits of the registers FORGET, TEACH and TAUGHT."""
CODE_PURPOSE, COUNT_PURPOSE, IDLE_PURPOSE = range(3)
"""Why a word of PROTOTYPES is read: for a record, for a class's number, to wait for the end of a pass."""
REST = 3
"""Cycles beyond one between two commands of the flash; data sheets say 50 ns."""

request_signature = wiring.Signature(
    {"teach": Out(1), "forget": Out(1), "label": Out(7), "option": Out(1), "look": Out(1), "refused": In(1)}
)
"""Pulses: the touch that ended last, or (``option``) the next one, is of class ``label``; what ``label`` was taught
is forgotten; ``look``: now and then. ``refused``: since the last request it, or the next touch, was not taught."""


@dataclass(frozen=True)
class _Log:
    """What the steps share. half: that is read or written; counts: there is one; position: of a record in it, ``place``
    its address; heading: the record is the half's head. from_first, onward: statements, to a record's first code, to
    the next record. Of a snapshot all places of all classes are written, else the newest of the class ``target``."""

    half: Signal
    generation: Signal
    counts: Signal
    position: Signal
    full: Signal
    heading: Signal
    place: Value
    tag: Signal
    blank: Signal
    valid: Signal
    address: Signal
    last_code: Signal
    advances: Signal
    stores: Signal
    from_first: list
    onward: list
    plays: Signal
    purpose: Signal
    snapshot: Signal
    erases: Signal
    target: Signal
    slot: Signal
    to_go: Signal
    rested: Value


class TaughtLog(FlashLoader):
    """A loader that, once the model is there, plays a log of taught touches, then teaches and forgets on request and
    writes what came of it.

    Two halves of the flash hold records. A half counts if its first record is a head; of two the one with the later
    generation does. A touch goes behind the last record that is not erased; where there is no room, or something is
    forgotten, all that the memory PROTOTYPES holds goes into the other half, which is erased first; its head goes
    last. What is being written when the power goes is not there, or the half it stands in does not count.

    Parameters
    ----------
    log:
        Where it is, and the memory. The rest as for `FlashLoader`.

    Members
    -------
    request : In(request_signature)
        While one is carried out, another is refused.
    """

    def __init__(self, number: int, writes: int, *, log: LogLayout, **loader: int) -> None:
        self._log = log
        super().__init__(number, writes, members={"request": In(request_signature)}, then="SEEK", **loader)

    def _beside(self, m: Module, serial: Serial) -> Iterator[Signal]:
        log, s, pins, request = self._log, serial, self.pins, self.request
        stride_bits, record_bits = (log.stride - 1).bit_length(), (log.half // log.stride - 1).bit_length()
        half_bits = stride_bits + record_bits
        last_record, row_words = (1 << record_bits) - 1, log.words // log.steps
        # ---- where in the flash
        half = Signal(name="log_half")
        generation = Signal(2, init=3)
        counts = Signal(name="log_counts")
        position = Signal(record_bits, init=1)
        full = Signal(name="log_full")
        heading = Signal(init=1)
        place = Cat(
            Const(0, stride_bits),
            Mux(heading, 0, position),
            half,
            Const(log.offset >> half_bits + 1, 23 - half_bits),
        )
        # ---- of a record
        tag = Signal(8, name="log_tag")
        blank = Signal()
        valid = Signal(name="record_valid")
        address = Signal(range(log.words + log.classes), name="log_address")
        value, step = Signal(range(log.values), name="log_value"), Signal(range(log.steps), name="log_step")
        last_value = value == log.values - 1
        last_code = Signal()
        advances = Signal()
        m.d.comb += last_code.eq(last_value & (step == log.steps - 1))
        with m.If(advances):
            m.d.sync += [
                value.eq(wrapping_increment(value, log.values)),
                step.eq(step + last_value),
                address.eq(address + Mux(last_value, row_words - log.values + 1, 1)),
            ]
        with m.If(s.tick & s.checked):
            m.d.sync += blank.eq(blank & s.line)
        stores = Signal()  # a code came: its address goes first
        stored = Signal()  # then the word
        m.d.sync += [stores.eq(0), stored.eq(stores)]
        m.d.comb += advances.eq(stored)
        with m.If(stores):
            m.d.comb += self._set(TeachRegister.PLACES, address)
        with m.If(stored):
            m.d.comb += self._set(Register.MEMORY_DATA, s.unit[: log.bits])
        # ---- what is asked, and what is written for it
        plays = Signal()
        ready = Signal(name="log_ready")
        snapshot = Signal()
        erases = Signal()
        purpose = Signal(2)
        target = Signal(range(log.classes), name="log_target")
        slot = Signal(range(log.taught + 1), name="log_slot")
        to_go = Signal(range(log.taught + 1))
        rest = Signal(2)
        m.d.sync += rest.eq(Mux(pins.cs_n, rest + (rest != REST), 0))
        rested = pins.cs_n & (rest == REST)
        new_request, idle = request.teach | request.forget, Signal(name="log_idle")
        with m.If(new_request & ~idle):
            m.d.sync += request.refused.eq(1)

        first = [value.eq(0), step.eq(0)]
        onward = [position.eq(position + 1), full.eq(position == last_record)]
        yield ready

        where = half, generation, counts, position, full, heading, place
        record = tag, blank, valid, address, last_code, advances, stores, first, onward
        shared = _Log(*where, *record, plays, purpose, snapshot, erases, target, slot, to_go, rested)
        self._read_records(m, s, shared)
        self._fetch_word(m, s, shared)
        self._obey(m, shared, ready, new_request, idle)
        self._choose_places(m, shared)
        self._write_record(m, s, shared)

    def _begin(self, s: Serial, command: Value | int, bits: int) -> list:
        return [self.pins.cs_n.eq(0), s.out.eq(Cat(Const(0, 32 - bits), command)), s.left.eq(bits - 1)]

    def _set(self, register: int, word: Value | int) -> list:
        return [self.bus.addr.eq(int(register)), self.bus.w_data.eq(word), self.bus.w_stb.eq(1)]

    def _read_records(self, m: Module, s: Serial, shared: _Log) -> None:
        """A record is read, into the touch's own place; from the first on until none is left."""
        log, pins, valid, tag = self._log, self.pins, shared.valid, shared.tag
        half, counts, heading, address = shared.half, shared.counts, shared.heading, shared.address
        other_looked = Signal()
        with m.State("SEEK"), m.If(shared.rested):
            m.d.sync += [
                *self._begin(s, Cat(shared.place, Const(READ, 8)), 32),
                s.check.eq(-1),
                shared.blank.eq(1),
                address.eq(0),
                *shared.from_first,
            ]
            m.next = "SOUGHT"
        with m.State("SOUGHT"), m.If(s.last):
            m.d.sync += s.left.eq(log.tag_bits - 1)
            m.next = "TAG"
        with m.State("TAG"):
            m.d.comb += s.checked.eq(1)
            with m.If(s.last):
                m.d.sync += [tag.eq(s.unit_now), s.left.eq(log.bits - 1)]
                m.next = "CODES"
        with m.State("CODES"):
            m.d.comb += s.checked.eq(1)
            with m.If(s.last):
                m.d.sync += [shared.stores.eq(1), s.left.eq(log.bits - 1)]
                with m.If(shared.last_code):
                    m.d.sync += s.left.eq(len(s.check) - 1)
                    m.next = "SUM"
        with m.State("SUM"):
            m.d.comb += s.checked.eq(1)
            with m.If(s.last):
                m.d.sync += [pins.cs_n.eq(1), valid.eq(s.check_now == 0)]
                m.next = "JUDGE"
        is_head = valid & tag[-1]
        with m.State("JUDGE"):
            later = is_head & (~counts | (tag[:2] == (shared.generation + 1)[:2]))
            m.next = "SEEK"
            with m.If(~shared.plays):
                with m.If(later):
                    m.d.sync += [shared.generation.eq(tag), counts.eq(1)]
                with m.If(~other_looked):
                    m.d.sync += [other_looked.eq(1), half.eq(1)]
                with m.Else():
                    m.d.sync += [half.eq(later), shared.plays.eq(1), heading.eq(0)]
                    m.next = "LISTEN"
                    with m.If(later | counts):
                        m.next = "CLEAR"
            with m.Elif(shared.blank):
                m.next = "LISTEN"
            with m.Elif(valid & ~tag[-1]):
                m.next = "TEACH"
            with m.Else():
                m.next = "ONWARD"
        with m.State("CLEAR"):  # what the image taught is in the log, too
            m.d.comb += self._set(TeachRegister.FORGET, 1 << ALL)
            m.next = "SEEK"
        with m.State("TEACH"):
            m.d.comb += self._set(TeachRegister.TEACH, tag | 1 << LOADED)
            m.d.sync += [address.eq(0), shared.purpose.eq(IDLE_PURPOSE)]
            m.next = "FETCH"
        with m.State("ONWARD"):
            m.d.sync += shared.onward
            m.next = "SEEK"
            with m.If(shared.position.all()):
                m.next = "LISTEN"

    def _fetch_word(self, m: Module, s: Serial, shared: _Log) -> None:
        """A word of the memory, once nothing else needs it."""
        log, bus = self._log, self.bus
        with m.State("FETCH"):
            m.d.comb += [s.waits.eq(1), *self._set(TeachRegister.PLACES, shared.address)]
            m.next = "LOOK"
        with m.State("LOOK"):
            m.d.comb += s.waits.eq(1)
            m.next = "TAKE"
        with m.State("TAKE"):
            m.d.comb += [s.waits.eq(1), bus.addr.eq(TeachRegister.PLACES), bus.r_stb.eq(1)]
            m.next = "TAKEN"
        number = bus.r_data[: (2 * log.taught - 1).bit_length()]
        turned = number > log.taught
        with m.State("TAKEN"):
            m.d.comb += s.waits.eq(1)
            m.next = "FETCH"
            with m.If(~bus.r_data.all()), m.Switch(shared.purpose):
                with m.Case(CODE_PURPOSE):
                    m.d.sync += [
                        s.out.eq(Cat(Const(0, 32 - log.bits), bus.r_data[: log.bits])),
                        s.left.eq(log.bits - 1),
                    ]
                    m.next = "CODE"
                with m.Case(IDLE_PURPOSE):
                    m.next = "ONWARD"
                with m.Default():
                    newest = number - 1 - Mux(turned, log.taught, 0)
                    oldest = Mux(turned, number - log.taught, 0)
                    m.d.sync += [
                        shared.slot.eq(Mux(shared.snapshot, oldest, newest)),
                        shared.to_go.eq(Mux(shared.snapshot, Mux(turned, log.taught, number), 1)),
                    ]
                    m.next = "WALK"
                    with m.If(number == 0):
                        m.next = "NEXT CLASS"

    def _obey(self, m: Module, shared: _Log, ready: Signal, new_request: Value, idle: Signal) -> None:
        """What is asked, and what was taught."""
        bus, request = self.bus, self.request
        label = Signal(7, name="log_label")
        asked_label = Signal(7)
        asked = Signal()
        asked_teach = Signal()
        asked_option = Signal()
        ordered = Signal()
        parity = Signal()
        with m.State("IDLE"):
            m.d.comb += idle.eq(1)
            with m.If(new_request):
                m.d.sync += [
                    asked.eq(1),
                    asked_teach.eq(request.teach),
                    asked_option.eq(request.option),
                    asked_label.eq(request.label),
                ]
            with m.If(request.look | asked):
                m.next = "LISTEN"
        with m.State("LISTEN"):
            m.d.comb += [bus.addr.eq(TeachRegister.TAUGHT), bus.r_stb.eq(1)]
            m.next = "HEARD"
        with m.State("HEARD"):
            refused, taught = bus.r_data[REFUSED], ready & (bus.r_data[ODD] != parity)
            obeyed = ordered & ~refused
            m.d.sync += [
                *(ready.eq(1), parity.eq(bus.r_data[ODD]), ordered.eq(0), shared.target.eq(label)),
                request.refused.eq(request.refused | refused | (taught & asked & ~ordered)),
            ]
            m.next = "IDLE"
            with m.If(ordered | taught):
                m.d.sync += asked.eq(0)
            with m.If(obeyed & asked_teach):
                m.d.sync += label.eq(asked_label)
            with m.If((obeyed & ~asked_teach) | (taught & (shared.full | ~shared.counts))):
                m.next = "SNAPSHOT"
            with m.Elif(taught):
                m.next = "COUNT"
            with m.Elif(asked & ~ordered):
                m.next = "MAKE WAY"
        with m.State("MAKE WAY"):
            m.d.comb += self._set(Register.CONTROL, int(Control.CLEAR_FAULTS))
            m.d.sync += [request.refused.eq(0), ordered.eq(1)]
            m.next = "ORDER"
        with m.State("ORDER"):
            m.d.comb += self._set(TeachRegister.FORGET, asked_label)
            with m.If(asked_teach):
                m.d.comb += self._set(TeachRegister.TEACH, Cat(asked_label, asked_option))
            m.next = "OBEYED"
        with m.State("OBEYED"):  # the readout's answer is in the register after this cycle
            m.next = "LISTEN"

    def _choose_places(self, m: Module, shared: _Log) -> None:
        """Which places are written."""
        log, address, target, tag = self._log, shared.address, shared.target, shared.tag
        half, counts, heading = shared.half, shared.counts, shared.heading
        places = log.prototypes + log.taught
        at_class = Signal(range(log.classes))
        at_place = Signal(range(places))
        with m.State("SNAPSHOT"):
            m.d.sync += [
                half.eq(half ^ counts),
                heading.eq(1),
                shared.erases.eq(1),
                shared.snapshot.eq(1),
                target.eq(0),
            ]
            m.next = "ENABLE"
        with m.State("COUNT"):
            m.d.sync += [address.eq(log.words + target), shared.purpose.eq(COUNT_PURPOSE)]
            m.next = "FETCH"
        with m.State("WALK"):
            m.d.sync += [address.eq(log.values), at_class.eq(0), at_place.eq(0)]
            m.next = "WALKS"
        with m.State("WALKS"):
            m.d.sync += [address.eq(address + log.values), at_place.eq(wrapping_increment(at_place, places))]
            with m.If(at_place == places - 1):
                m.d.sync += at_class.eq(at_class + 1)
            with m.If((at_class == target) & (at_place == log.prototypes + shared.slot)):
                m.d.sync += [address.eq(address), tag.eq(target)]
                m.next = "ENABLE"
        with m.State("NEXT CLASS"):
            m.d.sync += target.eq(target + 1)
            m.next = "COUNT"
            with m.If(target == log.classes - 1):
                m.d.sync += [heading.eq(1), tag.eq(HEAD_TAG | (shared.generation + 1)[:2]), address.eq(0)]
                m.next = "ENABLE"

    def _write_record(self, m: Module, s: Serial, shared: _Log) -> None:
        """A record is written, or a half erased."""
        log, pins, tag, heading, erases = self._log, self.pins, shared.tag, shared.heading, shared.erases
        going = Signal()  # of a record: the tag is out
        with m.State("ENABLE"), m.If(shared.rested):
            m.d.sync += self._begin(s, Const(WRITE_ENABLE, 8), 8)
            m.next = "ENABLED"
        with m.State("ENABLED"), m.If(s.last):
            m.d.sync += pins.cs_n.eq(1)
            m.next = "COMMAND"
        with m.State("COMMAND"), m.If(shared.rested):
            m.d.sync += [
                *self._begin(s, Cat(shared.place, Mux(erases, log.erase, Const(PROGRAM, 8))), 32),
                s.check.eq(-1),
                *shared.from_first,
            ]
            m.next = "COMMANDED"
        with m.State("COMMANDED"), m.If(s.last):
            m.d.sync += [s.out.eq(Cat(Const(0, 32 - log.tag_bits), tag)), s.left.eq(log.tag_bits - 1)]
            m.next = "CODE"
            with m.If(erases):
                m.d.sync += pins.cs_n.eq(1)
                m.next = "POLL"
        with m.State("CODE"):  # or the tag
            m.d.comb += [s.checked.eq(1), s.writing.eq(1), shared.advances.eq(s.last & going)]
            with m.If(s.last):
                m.d.sync += [going.eq(1), shared.purpose.eq(CODE_PURPOSE)]
                m.next = "FETCH"
                with m.If(going & shared.last_code):
                    m.d.sync += [going.eq(0), s.out.eq(s.check_now), s.left.eq(len(s.check) - 1)]
                    m.next = "SUM OUT"
        with m.State("SUM OUT"), m.If(s.last):
            m.d.sync += pins.cs_n.eq(1)
            m.next = "POLL"
        with m.State("POLL"), m.If(shared.rested):
            m.d.sync += self._begin(s, Const(STATUS << 8, 16), 16)
            m.next = "POLLED"
        with m.State("POLLED"), m.If(s.last):
            m.d.sync += pins.cs_n.eq(1)
            m.next = "WRITTEN"
            with m.If(s.line):  # lowest bit: it is still at it
                m.next = "POLL"
        with m.State("WRITTEN"):
            m.d.sync += heading.eq(0)
            with m.If(erases):
                m.d.sync += [erases.eq(0), shared.position.eq(1), shared.full.eq(0)]
                m.next = "COUNT"
            with m.Elif(heading):
                m.d.sync += [shared.snapshot.eq(0), shared.counts.eq(1), shared.generation.eq(tag)]
                m.next = "IDLE"
            with m.Else():
                m.d.sync += [
                    *shared.onward,
                    shared.slot.eq(wrapping_increment(shared.slot, log.taught)),
                    shared.to_go.eq(shared.to_go - 1),
                ]
                m.next = "WALK"
                with m.If(shared.to_go == 1):
                    m.next = "NEXT CLASS"
                with m.If(~shared.snapshot):
                    m.next = "IDLE"
