"""The accelerator for a user's system: behind a bus, or with its streams under AXI-Stream names
(docs/specification.md, section 17). Wiring only."""

from typing import Any, Literal

from amaranth.hdl import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from eskin.golden.core import AcceleratorConfig, Record
from eskin.rtl.common import drive, forward, inputs, members_but
from eskin.rtl.host.axi4lite_front import Axi4LiteFront
from eskin.rtl.host.bus_shell import BusShell
from eskin.rtl.host.decision_queue import decision_word
from eskin.rtl.host.wishbone_front import WishboneFront
from eskin.rtl.program.memory_map import Images
from eskin.rtl.top.accelerator import Accelerator
from eskin.rtl.top.board import Board

Bus = Literal["wishbone", "axi4lite"]
"""Buses that there is a front for."""
FRONTS: Record = {"wishbone": WishboneFront, "axi4lite": Axi4LiteFront}
FRAMES = {
    "s_axis_tdata": In(16),
    "s_axis_tvalid": In(1),
    "s_axis_tready": Out(1),
    **inputs("s_axis_tlast", "s_axis_tuser"),
}
DECISIONS = {"m_axis_tdata": Out(32), "m_axis_tvalid": Out(1), "m_axis_tready": In(1), "m_axis_tlast": Out(1)}


class BusTop(wiring.Component):
    """Accelerator, `BusShell` and the front of ``bus``; with a converter `Board` in place of the
    accelerator.

    Parameters
    ----------
    images:
        As for `eskin.rtl.top.accelerator.Accelerator`.
    bus:
        None: decisions are an AXI-Stream, registers the accelerator's own bus.
    axis:
        Frames come as an AXI-Stream; always without ``bus``.

    Members
    -------
    The front's; irq : Out(1), with ``bus``
    s_axis_... : In, with ``axis``, which a design with a converter has not
    m_axis_... : Out and bus : In, without ``bus``
    busy : Out(1), without a converter; the pins of `Board` with one
    """

    def __init__(
        self, config: AcceleratorConfig, images: Images | None = None, *, bus: Bus | None, axis: bool = False
    ):
        self._config, self._axis = config, axis or bus is None
        self._front: Any = FRONTS[bus]() if bus else None
        self._core: Any
        if config.interface.converter.name != "none":
            self._core = Board(config, images, baud=None, sensing=True, shell=True)
        else:
            self._core = Accelerator(config, images, "sensor" if self._axis else "cpu")
        self._fed = "i" in self._core.signature.members and not self._axis
        self._shell = BusShell(config, samples=self._fed) if bus else None
        super().__init__(
            members_but(self._core, "i", "o", "any_fault", "probe", *(["bus"] if bus else []))
            | (FRAMES if self._axis else {})
            | (members_but(self._front, "request") | {"irq": Out(1)} if bus else DECISIONS)
        )

    def elaborate(self, platform):
        m = Module()
        m.submodules.accelerator = core = self._core
        forward(m, self, core)
        if self._axis:
            drive(m, core.i.p, sample=self.s_axis_tdata, first=self.s_axis_tuser, last=self.s_axis_tlast)
            m.d.comb += [core.i.valid.eq(self.s_axis_tvalid), self.s_axis_tready.eq(core.i.ready)]
        if self._shell is None:
            drive(
                m,
                self,
                m_axis_tdata=decision_word(self._config, core.o.p),
                m_axis_tlast=core.o.p.is_global,
                m_axis_tvalid=core.o.valid,
            )
            m.d.comb += core.o.ready.eq(self.m_axis_tready)
            return m
        m.submodules.shell, m.submodules.front = shell, front = self._shell, self._front
        forward(m, self, front)
        wiring.connect(m, front.request, shell.request)
        wiring.connect(m, shell.bus, core.bus)
        wiring.connect(m, core.o, shell.decision)
        if self._fed:
            wiring.connect(m, shell.frame, core.i)
        m.d.comb += [shell.any_fault.eq(core.any_fault), self.irq.eq(shell.irq)]
        return m
