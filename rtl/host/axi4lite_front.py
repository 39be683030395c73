"""AXI4-Lite in front of the shell (docs/specification_interfaces.md, section 17)."""

from amaranth.hdl import Module, Mux, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from eskin.rtl.common import drive
from eskin.rtl.host.bus_shell import ADDRESS_BITS, request_signature


class Axi4LiteFront(wiring.Component):
    """One access at a time, writes first; every output comes from a register, and every response is OKAY.

    A write begins when address and data are offered, and they are taken together. In that cycle a read may
    begin, so none waits for two writes. A response comes in the cycle after its request was taken.

    Latency: four cycles from request to response, and as many more as the shell waits.
    """

    def __init__(self) -> None:
        super().__init__(
            {
                "s_axi_awaddr": In(ADDRESS_BITS),
                "s_axi_awprot": In(3),
                "s_axi_awvalid": In(1),
                "s_axi_awready": Out(1),
                "s_axi_wdata": In(32),
                "s_axi_wstrb": In(4),
                "s_axi_wvalid": In(1),
                "s_axi_wready": Out(1),
                "s_axi_bresp": Out(2),
                "s_axi_bvalid": Out(1),
                "s_axi_bready": In(1),
                "s_axi_araddr": In(ADDRESS_BITS),
                "s_axi_arprot": In(3),
                "s_axi_arvalid": In(1),
                "s_axi_arready": Out(1),
                "s_axi_rdata": Out(32),
                "s_axi_rresp": Out(2),
                "s_axi_rvalid": Out(1),
                "s_axi_rready": In(1),
                "request": Out(request_signature()),
            }
        )

    def elaborate(self, platform):
        m = Module()
        request = self.request
        busy = self.busy = Signal()
        chosen = self.chosen = Signal()
        write = Signal()
        ends = Signal()
        # a request that is being taken, or whose response waits, must not act again
        writable = self.s_axi_awvalid & self.s_axi_wvalid & ~self.s_axi_awready & ~self.s_axi_bvalid
        readable = self.s_axi_arvalid & ~self.s_axi_arready & ~self.s_axi_rvalid
        m.d.comb += write.eq(Mux(busy, chosen, writable))
        drive(
            m,
            request,
            valid=busy | writable | readable,
            write=write,
            whole=self.s_axi_wstrb.all(),
            address=Mux(write, self.s_axi_awaddr, self.s_axi_araddr)[2:],
            w_data=self.s_axi_wdata,
        )
        m.d.comb += ends.eq(request.valid & request.done)
        m.d.sync += [
            busy.eq(request.valid & ~request.done),
            chosen.eq(write),
            self.s_axi_awready.eq(ends & write),
            self.s_axi_wready.eq(ends & write),
            self.s_axi_arready.eq(ends & ~write),
            self.s_axi_bvalid.eq(self.s_axi_awready | (self.s_axi_bvalid & ~self.s_axi_bready)),
            self.s_axi_rvalid.eq(self.s_axi_arready | (self.s_axi_rvalid & ~self.s_axi_rready)),
        ]
        with m.If(ends & ~write):
            m.d.sync += self.s_axi_rdata.eq(request.r_data)
        return m
