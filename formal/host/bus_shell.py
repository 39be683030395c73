"""Each access of a CPU acts once and is answered: samples, decisions and the interrupt."""

from amaranth.hdl import Cat, Module, Mux, Signal

from eskin.golden.core import PRESETS
from eskin.rtl.host.bus_shell import BusShell
from eskin.rtl.host.decision_queue import decision_word
from eskin.rtl.program.memory_map import Register, ShellRegister
from formal.proof import Bug, assume, before, free, placed, proof, prove

CONFIG = PRESETS["thesis"].replace(taxels=5, feature_shift=(), margin_threshold=1)
ASKED = ("write", "whole", "address", "w_data")
LAST = 4


def _asks(m: Module, dut: BusShell) -> None:
    """One access at a time, which holds until it is answered."""
    request = dut.request
    free(request.valid, *(getattr(request, name) for name in ASKED))
    free(dut.bus.r_data, dut.any_fault, dut.decision.valid, dut.decision.payload, dut.frame.ready)
    open_ = before(request.valid & ~request.done, "open")
    for name in ASKED:
        assume(~open_ | (getattr(request, name) == before(getattr(request, name), f"was_{name}")))
    assume(~open_ | request.valid)


def _is(request, register, write):
    return (request.address == int(register)) & (request.whole if write else 1) & (request.write == write)


@proof(
    "every access is answered once, registers of the accelerator are strobed once an access and no other "
    "address reaches them; samples come in order with their marks, a pair is two, a refused one is none; "
    "no wait that only the CPU could end",
    depth=3,
    reduced="5 taxels, no queue",
    quick=True,
    bugs=(
        Bug(
            "an access acts while it is answered", "acts.eq(request.valid & ~done)", "acts.eq(request.valid)"
        ),
        Bug(
            "an address from 0x40 on reaches the registers",
            "w_stb=acts & inner & writes",
            "w_stb=acts & writes",
        ),
        Bug(
            "the second of a pair is the first again",
            "Mux(second, request.w_data[16:]",
            "Mux(0, request.w_data[16:]",
        ),
        Bug("a pair crosses the frame's end", "pair & ~second & (taxel != last)", "pair & ~second"),
        Bug(
            "a refused sample is followed by others",
            "frame.valid.eq(acts & feeds & ~refusing)",
            "frame.valid.eq(acts & feeds)",
        ),
        Bug("a decision that is read ends a refusal", "m.If(looks | arming)", "m.If(queue.asked | arming)"),
        Bug("a refusal ends unseen", "looks = request.valid & done &", "looks = acts &"),
        Bug("a CPU waits for itself", "refusing | stuck | (taken", "refusing | (taken"),
        Bug("ARM leaves the taxel", "m.d.sync += taxel.eq(0)", "m.d.sync += taxel.eq(taxel)"),
    ),
)
def answered_once(m: Module) -> None:
    dut = placed(BusShell(CONFIG, depth=0))
    _asks(m, dut)
    request, bus, frame = dut.request, dut.bus, dut.frame
    done = before(request.done, "done_before")
    prove(~request.done | request.valid & ~done, "one answer, to a request")
    strobe = bus.w_stb | bus.r_stb
    struck, had = Signal(name="struck"), Signal(2, name="had")  # in this access; samples of this access
    accepted = frame.valid & frame.ready
    m.d.sync += [struck.eq((struck | strobe) & ~request.done), had.eq(Mux(request.done, 0, had + accepted))]
    prove(
        ~strobe | ~struck & request.valid & (request.address < 0x40) & (bus.addr == request.address),
        "one strobe",
    )
    prove(~bus.w_stb | request.write & request.whole & (bus.w_data == request.w_data[:16]), "a write")
    prove(~bus.r_stb | ~request.write, "a read")
    acts = request.address < 0x40
    prove(~(request.done & acts & (request.whole | ~request.write)) | struck, "no answer without an act")
    prove(~(request.done & acts & ~request.write) | (request.r_data == bus.r_data), "what was read")
    # ---- samples
    arm = before(bus.w_stb & (bus.addr == Register.CONTROL) & bus.w_data[0], "arm")
    taxel, refused = Signal(range(LAST + 1), name="taxel_due"), Signal(name="refused")
    single, pair = _is(request, ShellRegister.SAMPLE, 1), _is(request, ShellRegister.SAMPLE_PAIR, 1)
    stuck = frame.valid & ~frame.ready & dut.decision.valid & ~dut.decision.ready
    reads = request.done & _is(request, ShellRegister.NEXT_TAXEL, 0)
    prove(~reads | (request.r_data == (taxel | refused << 31)), "NEXT_TAXEL")
    m.d.sync += [
        taxel.eq(Mux(arm, 0, Mux(accepted, Mux(taxel == LAST, 0, taxel + 1), taxel))),
        refused.eq((refused | stuck) & ~arm & ~reads),
    ]
    prove(
        ~frame.valid | request.valid & (single | pair) & ~refused & ~request.done,
        "only samples, none while refused",
    )
    prove(~frame.valid | (frame.p.first == (taxel == 0)) & (frame.p.last == (taxel == LAST)), "marks")
    half = Mux(had == 0, request.w_data[:16], request.w_data[16:])
    prove(~frame.valid | (frame.p.sample.as_unsigned() == half), "which half")
    whole = Mux(pair, (had == 2) | (had == 1) & (taxel == 0), had == 1)
    prove(~(request.done & (single | pair)) | refused | whole, "as many as are asked for")
    prove(~(request.done & ~(single | pair)) | (had == 0), "no samples by other accesses")
    prove(~before(stuck, "stuck_before") | request.done, "a wait that only the CPU could end is ended")
    prove(
        ~before(request.valid & ~request.done & ~single & ~pair, "other") | request.done,
        "others take a cycle",
    )
    queue = dut.queue
    prove(~dut.queue.asked | ~queue.shown & ~dut.queue.clear, "the queue's own rules")
    # ---- for the induction
    prove(~(queue.clear | queue.shown) | request.done, "with an answer")
    prove((dut.taxel == taxel) & (dut.refusing == refused) & (taxel <= LAST), "reference")
    prove(dut.second == ((had == 1) & ~request.done & ~refused & pair & (taxel != 0)), "second")
    prove((had <= 2) & (request.valid | request.done | ((had == 0) & ~struck)), "between accesses")
    prove((had != 2) | request.done, "two are enough")
    prove(~struck | request.done, "strobed, so answered")
    prove((had == 0) | single | pair, "whose samples")
    prove((had != 1) | ~single | request.done, "one is enough")
    prove((had == 0) | ~arm, "no ARM within")
    prove(~((had == 1) & pair & (taxel == 0)) | request.done | refused, "behind the last taxel one is enough")


@proof(
    "a decision leaves the classifier only in the answer that carries its word; what waits and is enabled "
    "raises the interrupt a cycle later, and nothing else does",
    depth=3,
    reduced="5 taxels, no queue",
    quick=True,
    bugs=(
        Bug("another read takes a decision", "own & (place == ShellRegister.DECISION - FIRST),", "own,"),
        Bug("a write takes a decision", "acts & reads & own", "acts & own"),
        Bug(
            "a decision is taken before the answer",
            "shown.eq(self.asked)",
            "shown.eq(self.asked)\n            shown = self.asked",
            file="rtl/host/decision_queue.py",
        ),
        Bug("a decision is asked for while one is answered", "asked=acts", "asked=request.valid"),
        Bug(
            "a fault does not interrupt",
            "queue.global_waits, space, self.any_fault)",
            "queue.global_waits, space, 0)",
        ),
        Bug(
            "a partial write enables",
            "writes, reads = request.write & request.whole, ~",
            "writes, reads = request.write, ~",
        ),
    ),
)
def decisions_and_interrupt(m: Module) -> None:
    dut = placed(BusShell(CONFIG, depth=0))
    _asks(m, dut)
    request, decision = dut.request, dut.decision
    enable, only = Signal(4, name="enabled"), Signal(name="only")
    writes = request.valid & ~request.done & _is(request, ShellRegister.ENABLE, 1)
    with m.If(writes):
        m.d.sync += [enable.eq(request.w_data), only.eq(request.w_data[8])]
    waits = decision.valid & ~(only & ~decision.p.is_global)
    answers = request.done & _is(request, ShellRegister.DECISION, 0)
    word = Signal(32, name="word")
    m.d.comb += word.eq(decision_word(CONFIG, decision.p) & (0x0FFF_8F83 | 0xF000_0000))
    prove(~answers | (request.r_data == Mux(waits, word, 0xFFFF_FFFF)), "the word, or none")
    prove(~waits | (decision.ready == answers), "taken with its answer and only then")
    prove(waits | ~decision.valid | decision.ready, "dropped at once")
    space = dut.frame.ready & ~dut.refusing
    events = Cat(waits, waits & decision.p.is_global, space, dut.any_fault)
    prove(dut.queue.shown == answers, "shown with its answer")
    prove(dut.irq == before((events & enable).any(), "due"), "interrupt")
    prove((dut.enable == enable) & (dut.queue.global_only == only), "reference")
    read = request.done & ~request.write
    prove(~(read & _is(request, ShellRegister.EVENTS, 0)) | (request.r_data == events), "EVENTS")
    prove(
        ~(read & _is(request, ShellRegister.ENABLE, 0)) | (request.r_data == (enable | only << 8)), "ENABLE"
    )
