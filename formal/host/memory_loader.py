"""The host's writes into the memories: nothing while locked, one memory at a time, its words in order."""

from amaranth.hdl import Module, Mux, Signal

from eskin.golden.core import PRESETS
from eskin.rtl.host.memory_loader import MemoryLoader
from formal.proof import Bug, assume, before, placed_free, proof, prove

CONFIG = PRESETS["thesis"].replace(taxels=4, feature_shift=(4, 9), checksum=True)


@proof(
    "no word is taken while locked, and each that is not is told; words of the chosen memory go to "
    "addresses from 0 on",
    depth=2,
    reduced="4 taxels",
    quick=True,
    bugs=(
        Bug("a word is let through while locked", "self.written & ~refuses & int", "self.written & int"),
        Bug("a word that is not taken counts", "address + self.load.enable", "address + self.written"),
        Bug(
            "the address goes on in the next memory",
            "m.d.sync += address.eq(0)",
            "m.d.sync += address.eq(address)",
        ),
    ),
)
def in_order(m: Module) -> None:
    dut = placed_free(MemoryLoader(CONFIG))
    assume(~(dut.chosen & dut.written))  # one register a write
    words = Signal.like(dut.address, name="words_taken")
    m.d.sync += words.eq(Mux(dut.chosen, 0, words + dut.load.enable))
    prove(~dut.load.enable | (dut.written & ~dut.locked), "only what is written, and not while locked")
    prove(dut.load.enable | (dut.refused == dut.written), "what is not taken is told")
    prove(~dut.load.enable | ~dut.refused, "what is taken is not")
    prove(dut.load.address == words, "word after word")
    prove(dut.load.data == dut.data, "the host's word")
    select = dut.load.select
    prove((select & (select - 1)) == 0, "one memory at most")
    prove(
        before(dut.chosen, "chosen_before") | (select == before(select, "memory_before")) | (words == 0),
        "the memory stays",
    )
