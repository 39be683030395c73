"""What the board was taught, kept in its flash: docs/specification.md, section 18."""

from collections.abc import Iterator

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
        log, request, s, pins, bus = self._log, self.request, serial, self.pins, self.bus
        stride_bits, record_bits = (log.stride - 1).bit_length(), (log.half // log.stride - 1).bit_length()
        half_bits = stride_bits + record_bits
        last_record, row_words = (1 << record_bits) - 1, log.words // log.steps
        places = log.prototypes + log.taught
        # ---- where in the flash
        half, generation, counts = Signal(name="log_half"), Signal(2, init=3), Signal(name="log_counts")
        position, full, heading = Signal(record_bits, init=1), Signal(name="log_full"), Signal(init=1)
        place = Cat(
            Const(0, stride_bits),
            Mux(heading, 0, position),
            half,
            Const(log.offset >> half_bits + 1, 23 - half_bits),
        )
        # ---- of a record
        tag, blank, valid = Signal(8, name="log_tag"), Signal(), Signal(name="record_valid")
        address = Signal(range(log.words + log.classes), name="log_address")
        value, step = Signal(range(log.values), name="log_value"), Signal(range(log.steps), name="log_step")
        last_value, last_code, advances = value == log.values - 1, Signal(), Signal()
        m.d.comb += last_code.eq(last_value & (step == log.steps - 1))
        with m.If(advances):
            m.d.sync += [
                value.eq(wrapping_increment(value, log.values)),
                step.eq(step + last_value),
                address.eq(address + Mux(last_value, row_words - log.values + 1, 1)),
            ]
        with m.If(s.tick & s.checked):
            m.d.sync += blank.eq(blank & s.line)
        stores, stored = Signal(), Signal()  # a code that came: its address, then the word
        m.d.sync += [stores.eq(0), stored.eq(stores)]
        m.d.comb += advances.eq(stored)
        with m.If(stores):
            m.d.comb += [bus.addr.eq(TeachRegister.PLACES), bus.w_data.eq(address), bus.w_stb.eq(1)]
        with m.If(stored):
            m.d.comb += [
                bus.addr.eq(Register.MEMORY_DATA),
                bus.w_data.eq(s.unit[: log.bits]),
                bus.w_stb.eq(1),
            ]
        # ---- what is asked, and what is written for it
        other_looked, plays, ready, parity = Signal(), Signal(), Signal(name="log_ready"), Signal()
        label, asked_label = Signal(7, name="log_label"), Signal(7)
        asked, asked_teach, asked_option, ordered = Signal(), Signal(), Signal(), Signal()
        snapshot, erases, purpose = Signal(), Signal(), Signal(2)
        target = Signal(range(log.classes), name="log_target")
        slot, to_go = Signal(range(log.taught + 1), name="log_slot"), Signal(range(log.taught + 1))
        at_class, at_place = Signal(range(log.classes)), Signal(range(places))
        rest = Signal(2)
        m.d.sync += rest.eq(Mux(pins.cs_n, rest + (rest != REST), 0))
        rested = pins.cs_n & (rest == REST)
        going = Signal()  # of a record: the tag is out
        new_request, idle = request.teach | request.forget, Signal(name="log_idle")
        with m.If(new_request & ~idle):
            m.d.sync += request.refused.eq(1)

        def begin(command: Value | int, bits: int) -> list:
            return [pins.cs_n.eq(0), s.out.eq(Cat(Const(0, 32 - bits), command)), s.left.eq(bits - 1)]

        def write(register: int, word: Value | int) -> list:
            return [bus.addr.eq(int(register)), bus.w_data.eq(word), bus.w_stb.eq(1)]

        def from_first() -> list:
            return [value.eq(0), step.eq(0)]

        yield ready

        # ---------------------------------------------------------------- a record is read, into the touch's own place
        with m.State("SEEK"), m.If(rested):
            m.d.sync += [
                *begin(Cat(place, Const(READ, 8)), 32),
                s.check.eq(-1),
                blank.eq(1),
                address.eq(0),
                *from_first(),
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
                m.d.sync += [stores.eq(1), s.left.eq(log.bits - 1)]
                with m.If(last_code):
                    m.d.sync += s.left.eq(len(s.check) - 1)
                    m.next = "SUM"
        with m.State("SUM"):
            m.d.comb += s.checked.eq(1)
            with m.If(s.last):
                m.d.sync += [pins.cs_n.eq(1), valid.eq(s.check_now == 0)]
                m.next = "JUDGE"
        is_head = valid & tag[-1]
        with m.State("JUDGE"):
            later = is_head & (~counts | (tag[:2] == (generation + 1)[:2]))
            m.next = "SEEK"
            with m.If(~plays):
                with m.If(later):
                    m.d.sync += [generation.eq(tag), counts.eq(1)]
                with m.If(~other_looked):
                    m.d.sync += [other_looked.eq(1), half.eq(1)]
                with m.Else():
                    m.d.sync += [half.eq(later), plays.eq(1), heading.eq(0)]
                    m.next = "LISTEN"
                    with m.If(later | counts):
                        m.next = "CLEAR"
            with m.Elif(blank):
                m.next = "LISTEN"
            with m.Elif(valid & ~tag[-1]):
                m.next = "TEACH"
            with m.Else():
                m.next = "ONWARD"
        with m.State("CLEAR"):  # what the image taught is in the log, too
            m.d.comb += write(TeachRegister.FORGET, 1 << ALL)
            m.next = "SEEK"
        with m.State("TEACH"):
            m.d.comb += write(TeachRegister.TEACH, tag | 1 << LOADED)
            m.d.sync += [address.eq(0), purpose.eq(IDLE_PURPOSE)]
            m.next = "FETCH"
        with m.State("ONWARD"):
            m.d.sync += [position.eq(position + 1), full.eq(position == last_record)]
            m.next = "SEEK"
            with m.If(position == last_record):
                m.next = "LISTEN"

        # ---------------------------------------------------------------- a word of the memory, once nothing else needs it
        with m.State("FETCH"):
            m.d.comb += [s.waits.eq(1), *write(TeachRegister.PLACES, address)]
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
            with m.If(~bus.r_data.all()), m.Switch(purpose):
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
                        slot.eq(Mux(snapshot, oldest, newest)),
                        to_go.eq(Mux(snapshot, Mux(turned, log.taught, number), 1)),
                    ]
                    m.next = "WALK"
                    with m.If(number == 0):
                        m.next = "NEXT CLASS"

        # ---------------------------------------------------------------- requests
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
                *(ready.eq(1), parity.eq(bus.r_data[ODD]), ordered.eq(0), target.eq(label)),
                request.refused.eq(request.refused | refused | (taught & asked & ~ordered)),
            ]
            m.next = "IDLE"
            with m.If(ordered | taught):
                m.d.sync += asked.eq(0)
            with m.If(obeyed & asked_teach):
                m.d.sync += label.eq(asked_label)
            with m.If((obeyed & ~asked_teach) | (taught & (full | ~counts))):
                m.next = "SNAPSHOT"
            with m.Elif(taught):
                m.next = "COUNT"
            with m.Elif(asked & ~ordered):
                m.next = "MAKE WAY"
        with m.State("MAKE WAY"):
            m.d.comb += write(Register.CONTROL, int(Control.CLEAR_FAULTS))
            m.d.sync += [request.refused.eq(0), ordered.eq(1)]
            m.next = "ORDER"
        with m.State("ORDER"):
            m.d.comb += write(TeachRegister.FORGET, asked_label)
            with m.If(asked_teach):
                m.d.comb += write(TeachRegister.TEACH, Cat(asked_label, asked_option))
            m.next = "OBEYED"
        with m.State("OBEYED"):  # the readout's answer is in the register after this cycle
            m.next = "LISTEN"
        # ---------------------------------------------------------------- which places are written
        with m.State("SNAPSHOT"):
            m.d.sync += [half.eq(half ^ counts), heading.eq(1), erases.eq(1), snapshot.eq(1), target.eq(0)]
            m.next = "ENABLE"
        with m.State("COUNT"):
            m.d.sync += [address.eq(log.words + target), purpose.eq(COUNT_PURPOSE)]
            m.next = "FETCH"
        with m.State("WALK"):
            m.d.sync += [address.eq(log.values), at_class.eq(0), at_place.eq(0)]
            m.next = "WALKS"
        with m.State("WALKS"):
            m.d.sync += [address.eq(address + log.values), at_place.eq(wrapping_increment(at_place, places))]
            with m.If(at_place == places - 1):
                m.d.sync += at_class.eq(at_class + 1)
            with m.If((at_class == target) & (at_place == log.prototypes + slot)):
                m.d.sync += [address.eq(address), tag.eq(target)]
                m.next = "ENABLE"
        with m.State("NEXT CLASS"):
            m.d.sync += target.eq(target + 1)
            m.next = "COUNT"
            with m.If(target == log.classes - 1):
                m.d.sync += [heading.eq(1), tag.eq(HEAD_TAG | (generation + 1)[:2]), address.eq(0)]
                m.next = "ENABLE"

        # ---------------------------------------------------------------- a record is written, or a half erased
        with m.State("ENABLE"), m.If(rested):
            m.d.sync += begin(Const(WRITE_ENABLE, 8), 8)
            m.next = "ENABLED"
        with m.State("ENABLED"), m.If(s.last):
            m.d.sync += pins.cs_n.eq(1)
            m.next = "COMMAND"
        with m.State("COMMAND"), m.If(rested):
            m.d.sync += [
                *begin(Cat(place, Mux(erases, log.erase, Const(PROGRAM, 8))), 32),
                s.check.eq(-1),
                *from_first(),
            ]
            m.next = "COMMANDED"
        with m.State("COMMANDED"), m.If(s.last):
            m.d.sync += [s.out.eq(Cat(Const(0, 32 - log.tag_bits), tag)), s.left.eq(log.tag_bits - 1)]
            m.next = "CODE"
            with m.If(erases):
                m.d.sync += pins.cs_n.eq(1)
                m.next = "POLL"
        with m.State("CODE"):  # or the tag
            m.d.comb += [s.checked.eq(1), s.writing.eq(1), advances.eq(s.last & going)]
            with m.If(s.last):
                m.d.sync += [going.eq(1), purpose.eq(CODE_PURPOSE)]
                m.next = "FETCH"
                with m.If(going & last_code):
                    m.d.sync += [going.eq(0), s.out.eq(s.check_now), s.left.eq(len(s.check) - 1)]
                    m.next = "SUM OUT"
        with m.State("SUM OUT"), m.If(s.last):
            m.d.sync += pins.cs_n.eq(1)
            m.next = "POLL"
        with m.State("POLL"), m.If(rested):
            m.d.sync += begin(Const(STATUS << 8, 16), 16)
            m.next = "POLLED"
        with m.State("POLLED"), m.If(s.last):
            m.d.sync += pins.cs_n.eq(1)
            m.next = "WRITTEN"
            with m.If(s.line):  # lowest bit: it is still at it
                m.next = "POLL"
        with m.State("WRITTEN"):
            m.d.sync += heading.eq(0)
            with m.If(erases):
                m.d.sync += [erases.eq(0), position.eq(1), full.eq(0)]
                m.next = "COUNT"
            with m.Elif(heading):
                m.d.sync += [snapshot.eq(0), counts.eq(1), generation.eq(tag)]
                m.next = "IDLE"
            with m.Else():
                m.d.sync += [
                    position.eq(position + 1),
                    full.eq(position == last_record),
                    slot.eq(wrapping_increment(slot, log.taught)),
                    to_go.eq(to_go - 1),
                ]
                m.next = "WALK"
                with m.If(to_go == 1):
                    m.next = "NEXT CLASS"
                with m.If(~snapshot):
                    m.next = "IDLE"
