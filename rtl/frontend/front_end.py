"""The front end: samples in, centred window sums out. Wiring only (docs/specification.md, sections 2 and
3)."""

from collections.abc import Sequence
from typing import Any

from amaranth.hdl import Cat, Module
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import connect

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import (
    centred_layout,
    detector_status,
    drive,
    expands,
    forward,
    inputs,
    load_signature,
    outputs,
    sample_layout,
    stored,
    touch_layout,
)
from eskin.rtl.frontend.feature_expander import FeatureExpander
from eskin.rtl.frontend.frame_marks import TouchMarks
from eskin.rtl.frontend.normaliser import Normaliser
from eskin.rtl.frontend.onset_detector import OnsetDetector
from eskin.rtl.frontend.pretrigger_ring import PreTriggerRing
from eskin.rtl.frontend.touch_divider import TouchDivider
from eskin.rtl.frontend.window_averager import WindowAverager


class FrontEnd(wiring.Component):
    """OnsetDetector -> PreTriggerRing (``window_mode`` touch) -> FeatureExpander (``feature_kinds`` beyond
    the mean) -> WindowAverager, or TouchDivider (``window_mode`` whole) -> Normaliser.

    A synchronous reset (``ResetInserter``) begins a recording. Memories keep their contents, but no later
    recording sees them.

    Parameters
    ----------
    config, means:
        As for ``Normaliser``.

    Ports
    -----
    i : In(stream of ``sample_layout``)
    flush : In(1)
        ``window_mode`` whole: the recording has ended, and with it the touch under way.
    mask : In(taxels)
    load : In(load_signature)
        The host's writes.
    o : Out(stream of ``centred_layout``)
    status : Out(detector_status)
        The onset detector's.
    passing, moving : Out(1)
        As of `eskin.rtl.host.recording_state.RecordingState`, without the beat offered at ``i``.
    wrong, blank : Out(1)
        As of ``Normaliser``.

    The parts are attributes (``detector``, ``ring`` or None, ``expander`` or None, ``averager``,
    ``normaliser``) for benches that watch a stage's stream.

    Timing
    ------
    Free: from the first sample of the frame that ends a window to its first centred sum, detector's latency +
    3 cycles (windows 1, the read of the mean and the difference 2). Touch: 2 cycles more for the ring, 1 more
    where a window of 2 hop + 1 ends, and the frames that the ring is behind. The expander takes 1 more
    (``mean``), 2 (an extreme alone) or 3 (``integral`` alone). An input takes 2 cycles, in a frame that ends a
    window 3, or 4 where windows have 2 hop + 1 frames, and one more where means differ from input to input;
    see also the waits that the parts name.
    """

    def __init__(self, config: AcceleratorConfig, means: Sequence[int] | None = None):
        self.config, self.detector = config, OnsetDetector(config)
        self.ring = PreTriggerRing(config) if config.windows.window_mode == "touch" else None
        beats = stored(config) if config.follows_touch else config
        self.expander = FeatureExpander(beats) if expands(beats) else None
        self.averager: Any = (TouchDivider if config.follows_touch else WindowAverager)(config)
        self.normaliser = Normaliser(config, means)
        super().__init__(
            inputs(
                "flush",
                i=stream.Signature(sample_layout(config)),
                mask=config.sensor.taxels,
                load=load_signature(config),
            )
            | outputs(
                "passing",
                "moving",
                "wrong",
                "blank",
                o=stream.Signature(centred_layout(config)),
                status=detector_status(config),
            )
        )

    def elaborate(self, platform):
        m = Module()
        m.submodules.onset_detector = self.detector
        m.submodules.window_averager = self.averager
        m.submodules.normaliser = self.normaliser
        windows = self.averager  # what counts the frames of a touch
        if self.expander is not None:
            windows = m.submodules.feature_expander = self.expander
            connect(m, self.expander.o, self.averager.i)
        if self.ring is None:
            connect(m, self.detector.o, windows.i)
        else:
            m.submodules.pretrigger_ring = self.ring
            connect(m, self.detector.o, self.ring.i)
            m.submodules.touch_marks = marks = TouchMarks(self.config)
            m.d.comb += [
                windows.i.valid.eq(self.ring.o.valid),
                self.ring.o.ready.eq(windows.i.ready),
                *(windows.i.p[name].eq(self.ring.o.p[name]) for name in touch_layout(self.config).members),
                *(windows.i.p[name].eq(getattr(marks, name)) for name in ("hop_last", "emit", "end")),
                marks.taken.eq(windows.i.valid & windows.i.ready & windows.frame_last),
                self.ring.touch_last.eq(marks.end & windows.frame_last),
            ]
        connect(m, self.averager.o, self.normaliser.i)
        if self.config.follows_touch:
            m.d.comb += self.averager.flush.eq(self.flush)
        parts = (self.detector, self.ring, self.expander, self.averager)
        drive(
            m,
            self,
            passing=Cat(part.holds for part in parts if part is not None).any(),
            moving=self.averager.o.valid,  # the normaliser takes a beat in the cycle in which one leaves it
        )
        forward(m, self, self.normaliser, "o", "load", "mask", "wrong", "blank")
        forward(m, self, self.detector, "i", "mask", "status")
        return m
