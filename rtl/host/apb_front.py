"""APB4 in front of the shell (docs/specification.md, section 17)."""

from amaranth.hdl import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from eskin.rtl.host.bus_shell import ADDRESS_BITS, request_signature


class ApbFront(wiring.Component):
    """Each transfer is one access; none ends with an error, and protection does not count.

    Latency: an access phase takes two cycles, and as many more as the shell waits.
    """

    def __init__(self) -> None:
        super().__init__(
            {
                "s_apb_paddr": In(ADDRESS_BITS),
                "s_apb_psel": In(1),
                "s_apb_penable": In(1),
                "s_apb_pwrite": In(1),
                "s_apb_pprot": In(3),
                "s_apb_pstrb": In(4),
                "s_apb_pwdata": In(32),
                "s_apb_prdata": Out(32),
                "s_apb_pready": Out(1),
                "s_apb_pslverr": Out(1),
                "request": Out(request_signature()),
            }
        )

    def elaborate(self, platform):
        m = Module()
        request = self.request
        m.d.comb += [
            request.valid.eq(self.s_apb_psel & self.s_apb_penable),
            request.write.eq(self.s_apb_pwrite),
            request.whole.eq(self.s_apb_pstrb.all()),
            request.address.eq(self.s_apb_paddr[2:]),
            request.w_data.eq(self.s_apb_pwdata),
            self.s_apb_prdata.eq(request.r_data),
            self.s_apb_pready.eq(request.done),
        ]
        return m
