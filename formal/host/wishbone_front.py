"""Wishbone in front of the shell: one acknowledge per requesting cycle, and no effect outside one."""

from amaranth.hdl import Module, Mux, Signal
from amaranth.lib.wiring import connect

from eskin.golden.core import PRESETS
from eskin.rtl.host.bus_shell import BusShell
from eskin.rtl.host.wishbone_front import WishboneFront
from formal.proof import Bug, before, free, placed, proof, prove

CONFIG = PRESETS["thesis"].replace(taxels=4, feature_shift=())


@proof(
    "whatever a master does, also one that gives up: an acknowledge comes to a cycle with CYC and STB, never two in a "
    "row; registers are strobed only by one, a write with all bytes, at its address; a decision is taken only "
    "with an acknowledge",
    depth=2,
    reduced="4 taxels, no queue",
    bugs=(
        Bug("STB without CYC acts", "valid=self.wb_cyc & self.wb_stb", "valid=self.wb_stb"),
        Bug("a write of two bytes acts", "self.wb_sel.all()", "self.wb_sel.any()"),
        Bug("an acknowledge to nobody", "wb_ack=request.valid & request.done", "wb_ack=request.done"),
        Bug("byte addresses taken for words", "self.wb_adr[2:]", "self.wb_adr[:7]"),
        Bug(
            "a decision is lost to who gives up", "take=request.valid", "take=1", file="rtl/host/bus_shell.py"
        ),
    ),
)
def one_acknowledge(m: Module) -> None:
    dut, shell = placed(WishboneFront()), placed(BusShell(CONFIG, depth=0), "shell")
    connect(m, dut.request, shell.request)
    free(dut.wb_cyc, dut.wb_stb, dut.wb_we, dut.wb_adr, dut.wb_sel, dut.wb_dat_w)
    free(shell.bus.r_data, shell.any_fault, shell.decision.valid, shell.decision.payload, shell.frame.ready)
    request, bus = dut.wb_cyc & dut.wb_stb, shell.bus
    prove(~dut.wb_ack | request & ~before(dut.wb_ack, "acknowledged"), "to who asks, once")
    address = dut.wb_adr >> 2
    inner = request & (address < 0x40) & (bus.addr == address)
    prove(~bus.w_stb | inner & dut.wb_we & (dut.wb_sel == 0xF) & (bus.w_data == dut.wb_dat_w[:16]), "a write")
    prove(~bus.r_stb | inner & ~dut.wb_we, "a read")
    prove(~(bus.w_stb & bus.r_stb), "one of them")
    prove(
        ~(shell.decision.ready & shell.decision.valid & ~shell.queue.global_only) | dut.wb_ack, "a decision"
    )
    prove(~shell.frame.valid | request & dut.wb_we, "a sample")
    prove(~shell.queue.shown | shell.request.done, "shown with an answer")
    begun = Signal(name="begun")
    m.d.sync += begun.eq(Mux(dut.wb_ack, 0, request & (address < 0x40)))
    prove(
        ~(begun & request & before(request & ~dut.wb_ack, "same")) | dut.wb_ack, "registers take two cycles"
    )
