"""Moves the sums of several lanes out one by one, and their next addends in (specification, section 4)."""

from amaranth.hdl import Module, Mux, Signal, signed
from amaranth.lib import data, wiring

from eskin.rtl.common import inputs, outputs


class RowChain(wiring.Component):
    """A shift register with a link for each of ``count`` lanes: sums leave at lane 0 while addends come in
    behind the last lane.

    Members
    -------
    tick : In(1)
        The slot ends with this cycle: what follows is done.
    swap : In(1)
        Take the lanes' sums; the lanes take the values in their links.
    shift : In(1)
        Move on by one lane.
    acc : In(array of signed(accumulator_bits))
    addend : In(signed(accumulator_bits))
        Goes to the last lane's link with a shift.
    load : Out(array of signed(accumulator_bits))
        Addends for the lanes, in place after as many shifts as there are lanes.
    total : Out(signed(accumulator_bits))
        After a swap the sum of lane 0, after p shifts the sum of lane p.
    """

    def __init__(self, accumulator_bits: int, count: int):
        acc = signed(accumulator_bits)
        lanes = data.ArrayLayout(acc, count)
        super().__init__(
            inputs("tick", "swap", "shift", acc=lanes, addend=acc) | outputs(load=lanes, total=acc)
        )

    def elaborate(self, platform):
        m = Module()
        lanes = len(self.acc)
        links = [Signal(self.total.shape(), name=f"link_{lane}", reset_less=True) for lane in range(lanes)]
        with m.If(self.tick & (self.swap | self.shift)):
            for lane, (link, following) in enumerate(zip(links, [*links[1:], self.addend], strict=True)):
                m.d.sync += link.eq(Mux(self.swap, self.acc[lane], following))
        m.d.comb += [self.total.eq(links[0]), *(self.load[lane].eq(link) for lane, link in enumerate(links))]
        return m
