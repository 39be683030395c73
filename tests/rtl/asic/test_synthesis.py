"""What a chip's registers and memories are made of does what the design says: seen on small ones, in the
process's own cells."""

import random
from pathlib import Path

from amaranth.hdl import Module, Signal
from amaranth.lib import wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from eskin.cosim.device import Design, Device
from eskin.rtl.asic.liberty import corners, read
from eskin.rtl.asic.nets import Nets
from eskin.rtl.asic.synthesis import models, process_of, synthesise
from tests.support.table import each_row
from tests.support.tiny_cells import liberty_files

BUILDS = Path("build/simulators")


class Words(wiring.Component):
    """A memory of 6 words of 5 bits, which becomes latches, and a count with reset and enable."""

    def __init__(self):
        ports = {"to": In(3), "data": In(5), "write": In(1), "at": In(3), "look": In(1), "word": Out(5)}
        super().__init__(ports | {"counts": In(1), "count": Out(4)})

    def elaborate(self, platform):
        m = Module()
        m.submodules.memory = memory = Memory(shape=5, depth=6, init=[])
        write, look = memory.write_port(), memory.read_port()
        count = Signal(4, init=9)
        m.d.comb += [write.addr.eq(self.to), write.data.eq(self.data), write.en.eq(self.write)]
        m.d.comb += [
            look.addr.eq(self.at),
            look.en.eq(self.look),
            self.word.eq(look.data),
            self.count.eq(count),
        ]
        with m.If(self.counts):
            m.d.sync += count.eq(count + 1)
        return m


@each_row("cells", ["tiny", "real"])
def test_latches_behind_gates_and_registers_with_reset_and_enable(tmp_path, cells):
    process = process_of(
        "ihp-sg13g2", corners([read(path) for path in liberty_files(cells, tmp_path)])["typ"]
    )
    netlist = synthesise(Words(), process, tmp_path / "words", top="words")
    assert [row["kind"] for row in netlist.memories] == ["latches"]
    nets = Nets(netlist.module, process.cells)
    # A gate a word, one in front of them that a write opens, one of the word that was read, one of the count:
    # nothing else on the clock.
    on_the_clock = [nets.cells[name].kind for name, *_ in nets.receivers[nets.clock]]
    assert on_the_clock == ["gate"] * 3
    kinds = [cell.kind for cell in nets.cells.values()]
    assert kinds.count("gate") == 9
    text = (netlist.folder / "simulated.v").read_text() + models(
        {cell.name: cell for cell in nets.cells.values()}.values()
    )
    device, rng = Device(Design(text, BUILDS, top="words")), random.Random(6)
    words: dict[int, int] = {}
    seen, count = None, None
    for _ in range(600):
        reset = rng.random() < 0.05
        now = {
            "to": rng.randrange(6),
            "data": rng.getrandbits(5),
            "write": rng.getrandbits(1),
            "at": rng.randrange(6),
        }
        now |= {"look": rng.getrandbits(1), "counts": rng.getrandbits(1), "rst": int(reset)}
        for name, value in now.items():
            device.put(name, value)
        device.cycle()
        if now["look"]:
            seen = words.get(now["at"])
        if now["write"]:
            words[now["to"]] = now["data"]
        count = 9 if reset else None if count is None else (count + now["counts"]) % 16
        assert seen is None or device.get("word") == seen
        assert count is None or device.get("count") == count
