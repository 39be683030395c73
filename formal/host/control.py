"""The host's side: writes during a touch, addresses without a register."""

from amaranth.hdl import Module, Mux, Signal
from amaranth.lib.wiring import In

from eskin.golden.core import PRESETS
from eskin.rtl.host.control import HostControl
from eskin.rtl.program.memory_map import Control, Fault, Register, TeachRegister
from formal.proof import Bug, assume, before, free, placed, placed_free, proof, prove, registers

STATE, LOADER = "rtl/host/recording_state.py", "rtl/host/memory_loader.py"
CONFIG = PRESETS["thesis"].replace(taxels=4, feature_shift=(4, 9))
UNDECIDED = 4
"""Touches that can wait for their decision at once: one at the classifier, two in the engine's buffers, one
on its way into them."""


def _writes(dut: HostControl, register: Register):
    return dut.bus.w_stb & (dut.bus.addr == register)


def _commands(dut: HostControl, command: Control):
    return _writes(dut, Register.CONTROL) & (dut.bus.w_data & command).any()


def _cleared(m: Module, dut: HostControl) -> Signal:
    """The cycle after an arm command or a hang."""
    return before(_commands(dut, Control.ARM) | dut.hung, "cleared")


def _undecided(m: Module, dut: HostControl) -> tuple[Signal, Signal]:
    """Touches begun and not decided, as the ports report; none once the recording is over, no touch begins then
    before the next is."""
    count, over = Signal(range(UNDECIDED + 1), name="undecided"), Signal(name="over")
    arm = _cleared(m, dut)
    assume(~dut.global_taken | (count != 0) | over)
    assume(~dut.detector.started | ((count != UNDECIDED) & ~over))
    m.d.sync += over.eq((over | dut.finish) & ~arm)
    prove(dut.clear == arm, "cleared a cycle after arm or a hang")
    prove(
        dut.restart == arm | before(dut.load.enable, "written"),
        "the engine starts anew after arm and after every write",
    )
    m.d.sync += count.eq(Mux(arm | dut.finish | over, 0, count + dut.detector.started - dut.global_taken))
    return count, over


@proof(
    "no memory is written while a touch is undecided (from the cycle after its onset on), also when the "
    "next begins before the decision "
    "of the last is taken; the cycle after a write, an arm command or a hang starts the engine anew",
    depth=2,
    reduced="4 taxels",
    quick=True,
    bugs=(
        Bug(
            "a weight write let through during a touch",
            "locked=touch | ~self.decider_idle if config.readout_rule.taught else touch",
            "locked=0",
        ),
        Bug(
            "one flag for all touches",
            "undecided + self.detector.started",
            "undecided + (self.detector.started & ~self.touch)",
            file=STATE,
        ),
        Bug("a write does not start the engine anew", "self.hung | self.load.enable)", "self.hung)"),
    ),
)
def no_write_during_a_touch(m: Module) -> None:
    dut = placed_free(HostControl(CONFIG))
    undecided, over = _undecided(m, dut)
    open_for_a_cycle = before(undecided != 0, "open") & (undecided != 0)
    prove(~open_for_a_cycle | dut.state.touch, "a touch is known a cycle after its onset")
    prove(
        ~dut.load.enable | ~open_for_a_cycle,
        "no write while a touch is undecided, but for the cycle of its onset",
    )
    state = dut.state
    prove(over | (state.undecided == undecided), "the count is the number of undecided touches")
    prove(~state.finished | over, "only finish ends the recording")
    prove((undecided <= UNDECIDED) & (~over | (undecided == 0)), "the reference's own state")


def _twins(m: Module):
    """Two copies with the same inputs. The second gets an additional write where ``more`` is high, to any
    address. All their outputs are the same, and so is their state, except read data and faults."""
    left, right = placed_free(HostControl(CONFIG), name="one"), placed(HostControl(CONFIG), "other")
    more = Signal()
    free(more)
    ports = zip(left.signature.flatten(left), right.signature.flatten(right), strict=True)
    m.d.comb += [its.eq(mine) for (_, member, mine), (*_, its) in ports if member.flow is In]
    m.d.comb += right.bus.w_stb.eq(left.bus.w_stb | more)
    for name in ("clear", "restart", "finish", "mask", "busy", "due"):
        prove(getattr(left, name) == getattr(right, name), f"{name} is the same")
    prove(left.load.enable == right.load.enable, "the same writes reach the memories")
    for mine, its in zip(registers("one"), registers("other"), strict=True):
        if mine.name not in ("sticky", "bus__r_data"):
            prove(mine == its, "the same state")
    return left, right, more


@proof(
    "a memory write during a touch changes nothing but the fault flag",
    depth=2,
    reduced="4 taxels",
    bugs=(
        Bug(
            "a refused write becomes a mask",
            "m.Case(Register.MASK + k):",
            "m.Case(Register.MASK + k, Register.MEMORY_DATA):",
        ),
        Bug("a refused write reaches the memories", "self.written & ~refuses", "self.written", file=LOADER),
    ),
)
def refused_write_changes_nothing(m: Module) -> None:
    left, right, refused = _twins(m)
    assume(~refused | (left.state.touch & ~left.bus.w_stb & (right.bus.addr == Register.MEMORY_DATA)))
    prove(
        ~left.load.enable | ((left.load.select == right.load.select) & (left.load.data == right.load.data)),
        "the same memory and word",
    )
    prove(left.load.address == right.load.address, "the same address")
    unlike = Signal()
    m.d.sync += unlike.eq(Mux(left.bus.r_stb, left.bus.addr == Register.FAULTS, unlike))
    prove(unlike | (left.bus.r_data == right.bus.r_data), "every other register reads the same")


@proof(
    "an access to an address without a register changes nothing but its fault flag, and reads 0",
    depth=2,
    reduced="4 taxels",
    quick=True,
    bugs=(
        Bug(
            "five bits of the address decoded for writes",
            "m.If(bus.w_stb), m.Switch(bus.addr):",
            "m.If(bus.w_stb), m.Switch(bus.addr[:5]):",
        ),
        Bug(
            "five bits of the address decoded for reads",
            "            with m.Switch(bus.addr):\n                for number",
            "            with m.Switch(bus.addr[:5]):\n                for number",
        ),
        Bug(
            "a write to no register goes unnoticed", "(bus.w_stb | bus.r_stb) & ~known", "bus.r_stb & ~known"
        ),
    ),
)
def no_register_no_effect(m: Module) -> None:
    left, right, stray = _twins(m)
    nowhere = (left.bus.addr > Register.MEMORY_DATA) & (left.bus.addr != Register.MASK)
    assume(~stray | (nowhere & ~left.bus.w_stb & ~left.bus.r_stb))
    prove(~before(left.bus.r_stb & nowhere, "read_nothing") | (left.bus.r_data == 0), "it reads 0")
    flag = right.bits[Fault.ADDRESS]
    prove(
        ~before(stray | right.bus.r_stb & nowhere & ~_commands(right, Control.CLEAR_FAULTS), "astray") | flag,
        "and sets its flag",
    )
    for fault, bit in left.bits.items():
        if fault != Fault.ADDRESS:
            prove(bit == right.bits[fault], f"{fault.name} is the same")


TAUGHT = CONFIG.replace(cell="linear", decision="last").with_readout(
    readout="prototypes", prototypes=1, taught=1, state_code_bits=3, state_code_shift=12
)


@proof(
    "a word of PLACES was read ahead from the place whose number comes with it, and since then no touch was open and "
    "nothing written; the place goes on only with a word that was given",
    depth=2,
    reduced="4 taxels, 1 prototype and 1 taught place a class",
    bugs=(
        Bug(
            "a word is given while it is read",
            "given.eq(fresh & ~teaching.look & ~loader.locked)",
            "given.eq(fresh)",
        ),
        Bug("a touch does not make it stale", "~(loader.locked | bus.w_stb)", "~bus.w_stb"),
        Bug("a write does not make it stale", "~(loader.locked | bus.w_stb)", "~loader.locked"),
        Bug("the place goes on with every question", "onward=looks & given", "onward=looks"),
    ),
)
def words_of_places(m: Module) -> None:
    dut = placed_free(HostControl(TAUGHT))
    loader, look = dut.loader, dut.teaching.look
    looks = dut.bus.r_stb & (dut.bus.addr == TeachRegister.PLACES)
    # what the readout holds: the word at the place looked at last, while it was free
    waiting, at = Signal(name="held"), Signal(len(loader.load.address), name="looked_at")
    written = dut.bus.w_stb | dut.load.enable
    m.d.sync += waiting.eq((waiting | look) & ~loader.locked & ~written)
    with m.If(look):
        m.d.sync += at.eq(loader.load.address)
    prove(
        ~dut.given | (waiting & ~look & ~loader.locked & (at == loader.load.address)), "the word of the place"
    )
    # ---- for the induction
    prove(waiting == dut.fresh, "the reference's own state")
    prove(~waiting | look | (at == loader.load.address), "the place stays")
    was = Signal(len(loader.load.address), name="place_before")
    m.d.sync += was.eq(loader.load.address)
    moved = loader.load.address != was
    acted = before(looks & dut.given, "gave") | before(written, "wrote")
    prove(~moved | acted, "the place goes on with a word given")
