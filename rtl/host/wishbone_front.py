"""Wishbone B4, classic cycles, in front of the shell (docs/specification_interfaces.md, section 17)."""

from amaranth.hdl import Module
from amaranth.lib import wiring

from eskin.rtl.common import drive, inputs, outputs
from eskin.rtl.host.bus_shell import ADDRESS_BITS, request_signature


class WishboneFront(wiring.Component):
    """Each classic cycle is one access. ``wb_adr`` is a byte address; ``wb_ack`` comes from a register.

    Latency: two cycles per access, plus the wait cycles of the shell.
    """

    def __init__(self) -> None:
        super().__init__(
            inputs("wb_cyc", "wb_stb", "wb_we", wb_adr=ADDRESS_BITS, wb_sel=4, wb_dat_w=32)
            | outputs(wb_dat_r=32, wb_ack=1, request=request_signature())
        )

    def elaborate(self, platform):
        m = Module()
        request = self.request
        drive(
            m,
            request,
            valid=self.wb_cyc & self.wb_stb,
            write=self.wb_we,
            whole=self.wb_sel.all(),
            address=self.wb_adr[2:],
            w_data=self.wb_dat_w,
        )
        drive(m, self, wb_dat_r=request.r_data, wb_ack=request.valid & request.done)
        return m
