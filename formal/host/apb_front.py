"""APB4 in front of the shell: each transfer is one access, and ends with its data."""

from amaranth.hdl import Module, Mux, Signal
from amaranth.lib.wiring import connect

from eskin.golden.core import PRESETS
from eskin.rtl.host.apb_front import ApbFront
from eskin.rtl.host.bus_shell import BusShell
from formal.proof import Bug, assume, before, free, opened_up, proof, prove

CONFIG = PRESETS["thesis"].replace(taxels=4, feature_shift=())
HELD = ("paddr", "pwrite", "pstrb", "pwdata")


@proof(
    "nothing acts in the setup phase; a transfer to a register strobes it once, in its access phase, and ends in the "
    "next cycle with what was read; none ends with an error",
    depth=3,
    reduced="4 taxels, no queue",
    bugs=(
        Bug("the setup phase acts", "self.s_apb_psel & self.s_apb_penable", "self.s_apb_psel"),
        Bug("a write of two bytes acts", "self.s_apb_pstrb.all()", "self.s_apb_pstrb.any()"),
        Bug("ready before it has acted", "self.s_apb_pready.eq(request.done)", "self.s_apb_pready.eq(1)"),
        Bug("reads write", "request.write.eq(self.s_apb_pwrite)", "request.write.eq(1)"),
        Bug("byte addresses taken for words", "self.s_apb_paddr[2:]", "self.s_apb_paddr[:7]"),
    ),
)
def one_access(m: Module) -> None:
    dut, shell = ApbFront(), BusShell(CONFIG, depth=0)
    opened_up(dut)
    opened_up(shell, "shell")
    connect(m, dut.request, shell.request)
    select, enable, ready = dut.s_apb_psel, dut.s_apb_penable, dut.s_apb_pready
    lines = {name: getattr(dut, f"s_apb_{name}") for name in HELD}
    free(select, enable, *lines.values())
    free(shell.bus.r_data, shell.any_fault, shell.decision.valid, shell.decision.payload, shell.frame.ready)
    # the master: setup, then access until ready
    waits = before(select & ~(enable & ready), "waits")
    setup = before(select & ~enable, "setup")
    assume(enable == (select & waits))
    for name, line in lines.items():
        assume(~waits | select & (line == before(line, f"was_{name}")))
    bus, address = shell.bus, lines["paddr"] >> 2
    strobe, struck = bus.w_stb | bus.r_stb, Signal(name="struck")
    m.d.sync += struck.eq(Mux(enable & ready, 0, struck | strobe))
    prove(~strobe | select & enable & ~struck & (address < 0x40) & (bus.addr == address), "one strobe")
    prove(
        ~bus.w_stb | lines["pwrite"] & (lines["pstrb"] == 0xF) & (bus.w_data == lines["pwdata"][:16]),
        "a write",
    )
    prove(~bus.r_stb | ~lines["pwrite"], "a read")
    inner = select & enable & (address < 0x40)
    prove(~inner | (ready == ~setup), "registers take two cycles")
    acts = ~lines["pwrite"] | (lines["pstrb"] == 0xF)
    prove(~(inner & ready & acts) | struck, "no end without an act")
    prove(~(inner & ready & ~lines["pwrite"]) | (dut.s_apb_prdata == bus.r_data), "what was read")
    prove(~dut.s_apb_pslverr, "no error")
    # ---- for the induction
    prove(~(setup & enable) | ~ready & ~struck, "fresh")
    prove(select & enable | ~ready & ~struck, "between transfers")
    prove(~struck | ready, "strobed, so ready")
