"""The front end: samples in, centred window sums out. Wiring only."""

from __future__ import annotations

from collections.abc import Sequence

from amaranth.hdl import Module
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from golden.config import AcceleratorConfig
from rtl.compander import Compander
from rtl.normaliser import Normaliser, centred_layout
from rtl.onset_detector import OnsetDetector, sample_layout
from rtl.pretrigger_ring import PreTriggerRing
from rtl.window_averager import WindowAverager


class FrontEnd(wiring.Component):
    """OnsetDetector -> PreTriggerRing (``window_mode`` touch) -> WindowAverager -> Compander (``compand`` log) -> Normaliser.

    Put it under a synchronous reset (``ResetInserter``) to begin a recording: memories keep their contents, which no later recording sees.

    Parameters
    ----------
    config, means:
        As for ``Normaliser``.

    Ports
    -----
    i : In(stream of ``sample_layout``)
    mask : In(taxels)
    load : the normaliser's, only with ``config.loadable``
    o : Out(stream of ``centred_layout``)
    armed, touch, touch_started, framing_fault : Out(1)
        As of ``OnsetDetector``.
    flags : Out(taxels), raised : Out(1), only with ``fault_frames``
        As of ``FaultDetector``.

    wrong : Out(1)
        As of ``Normaliser``.

    The parts are attributes (``detector``, ``ring`` or None, ``averager``, ``compander`` or None, ``normaliser``) for benches that watch a
    stage's stream.

    Timing
    ------
    Free: from the first sample of the frame that ends a window to its first centred sum, detector's latency + 3 cycles (windows 1, the
    read of the mean and the difference 2). Touch: 2 cycles more for the ring, 1 more where a window of 2 hop + 1 ends, and the frames
    that the ring is behind. Companding takes 1 cycle more.
    A taxel takes 2 cycles, in a frame that ends a window 3, or 4 where windows have 2 hop + 1 frames; see also the waits that the parts
    name.
    """

    def __init__(self, config: AcceleratorConfig, means: Sequence[int] | None = None):
        self.detector = OnsetDetector(config)
        self.ring = PreTriggerRing(config) if config.window_mode == "touch" else None
        self.averager = WindowAverager(config)
        self.compander = Compander(config) if config.compand == "log" else None
        self.normaliser = Normaliser(config, means)
        ports = {
            "i": In(stream.Signature(sample_layout(config))),
            "mask": In(config.taxels),
            "o": Out(stream.Signature(centred_layout(config))),
        } | {name: Out(1) for name in ("armed", "touch", "touch_started", "framing_fault", "wrong")}
        if config.fault_frames:
            ports |= {"flags": Out(config.taxels), "raised": Out(1)}
        if config.loadable:
            ports["load"] = In(self.normaliser.load.signature.flip())
        super().__init__(ports)

    def elaborate(self, platform):
        m = Module()
        m.submodules.onset_detector = self.detector
        m.submodules.window_averager = self.averager
        m.submodules.normaliser = self.normaliser
        connect(m, flipped(self.i), self.detector.i)
        if self.ring is None:
            connect(m, self.detector.o, self.averager.i)
        else:
            m.submodules.pretrigger_ring = self.ring
            connect(m, self.detector.o, self.ring.i)
            connect(m, self.ring.o, self.averager.i)
            m.d.comb += self.ring.touch_last.eq(self.averager.touch_last)
        if self.compander is None:
            connect(m, self.averager.o, self.normaliser.i)
        else:
            m.submodules.compander = self.compander
            connect(m, self.averager.o, self.compander.i)
            connect(m, self.compander.o, self.normaliser.i)
        connect(m, self.normaliser.o, flipped(self.o))
        if hasattr(self, "load"):
            connect(m, flipped(self.load), self.normaliser.load)
        m.d.comb += self.wrong.eq(self.normaliser.wrong)
        m.d.comb += [self.detector.mask.eq(self.mask), self.normaliser.mask.eq(self.mask)]
        told = [name for name in ("armed", "touch", "touch_started", "framing_fault", "flags", "raised") if hasattr(self, name)]
        m.d.comb += [getattr(self, name).eq(getattr(self.detector, name)) for name in told]
        return m
