"""The whole chain, wiring only: frames in, decisions out, a host bus beside it, probes for benches.

Frames to decisions: docs/specification.md, sections 2 to 7; of images section 15.
"""

from typing import Any

from amaranth.hdl import Module, ResetInserter, ResetSignal, Signal, Value
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import Out

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import decision_layout, drive, forward, has_door, inputs, outputs, probe, sample_layout
from eskin.rtl.decision.classifier import Classifier
from eskin.rtl.decision.prototype_readout import PrototypeReadout
from eskin.rtl.engine.engine import Engine
from eskin.rtl.engine.forest import ForestEngine
from eskin.rtl.frontend.frame_door import FrameDoor
from eskin.rtl.frontend.front_end import FrontEnd
from eskin.rtl.host.control import FedBy, HostControl, bus_signature
from eskin.rtl.image.image_engine import ImageEngine, refuse_hardware
from eskin.rtl.image.image_receiver import ImageReceiver
from eskin.rtl.program.image_passes import plan_of
from eskin.rtl.program.memory_map import Images, Memory
from eskin.rtl.program.timing import logit_to_decision
from eskin.rtl.top.clock_gate import gated
from eskin.rtl.top.watchdog import Watchdog

PROBES = ("sum", "fault", "feature", "state", "logit", "step")
IMAGE_PROBES = ("map", "logit", "step")


class Accelerator(wiring.Component):
    """Control and classifier; in front of them door, onset detector, pre-trigger ring, feature expander, window
    averager, normaliser and engine, or for a network for images receiver and image engine. Its clock may stop.

    Parameters
    ----------
    images:
        Memory contents (`eskin.rtl.program.memory_map.memory_images`) for a ROM design (``loadable`` false);
        otherwise None: the host loads them.
    fed_by:
        Behind a bus shell, as of `HostControl`; there is ``any_fault`` then.

    Members
    -------
    i : In(stream of sample_layout)
        Frames, one taxel a beat, taxel 0 first. Ready at every cycle while the engine keeps up. An image: one pixel a
        beat, the first ``height`` frames after ``arm``; later frames are ignored.
    o : Out(stream of eskin.rtl.decision.classifier.decision_layout)
        Local decision after every step, global decision at the end of a touch. An image is one step.
    bus : In
        Host bus: rtl/program/memory_map.py.
    busy : Out(1)
        A frame, sum, step, decision or command is in flight; combinational from ``i.valid``.
    probe : Out
        ``sum``, ``fault`` (the sum's taxel is out of use; only with a fault detector ever valid),
        ``feature``, ``state``, ``logit``: output of each stage, in the cycle of its transfer; ``map``: every value of
        an image's map, as it is written; ``step``: cycles of a step, of an image from its start to its decision. Left
        open in a real design, they cost nothing.

    Latency from the last taxel of a window to its decision: a few cycles of front end and
    `Schedule.decision_cycles`; from the last pixel `eskin.rtl.program.schedule.decision_cycles`.

    Raises
    ------
    InputError
        Hardware that images do not have (`refuse_hardware`).
    """

    def __new__(cls, config: AcceleratorConfig, *_: Any) -> "Accelerator":
        if config.is_image:  # refused before there is a component, which Amaranth would say is never used
            refuse_hardware(config)
        return super().__new__(cls)

    def __init__(self, config: AcceleratorConfig, images: Images | None = None, fed_by: FedBy | None = None):
        self._config, self._images = config, None if config.hardware.loadable else images
        self._fed_by = fed_by
        self.watching = Watchdog(config) if config.hardware.watchdog else None
        names = IMAGE_PROBES if config.is_image else PROBES
        super().__init__(
            inputs(i=stream.Signature(sample_layout(config)))
            | outputs(o=stream.Signature(decision_layout(config)))
            | inputs(bus=bus_signature())
            | outputs("busy", probe=wiring.Signature({name: Out(probe()) for name in names}))
            | (outputs("any_fault") if fed_by else {})
        )

    def elaborate(self, platform):
        chain, needed = self.wired()
        return gated(chain, needed, platform) if self._config.hardware.clock_gate else chain

    def wired(self) -> tuple[Module, Signal]:
        """Its module, and whether the next clock edge is needed; unused where the clock never stops."""
        m, config = Module(), self._config
        if not config.hardware.loadable and self._images is None:
            raise ValueError("a ROM design (loadable false) needs its memory images")
        m.submodules.control = control = self.control = HostControl(config, self._fed_by)
        classifier = self.classifier = Classifier(config)
        readout = PrototypeReadout(config) if config.has_prototypes else None
        idle = classifier.idle if readout is None else classifier.idle & readout.idle
        begin_anew = Signal()  # engine and classifier go back to where a touch begins
        front, engine = self._image(m) if config.is_image else self._recording(m, begin_anew, idle)
        m.submodules.classifier = ResetInserter(control.clear | begin_anew)(classifier)
        if readout is not None:
            self._nearest(m, readout, engine)

        forward(m, self, control)
        forward(m, self, classifier, "o")
        drive(
            m,
            control.frames,
            offered=self.i.valid,
            taken=self.i.valid & self.i.ready,
            first=self.i.p.first,
            last=self.i.p.last,
        )
        wiring.connect(m, front.status, control.detector)
        wiring.connect(m, engine.status, control.engine)
        parts: list[Any] = [front, engine, readout]
        wiring.connect(m, control.load, *(part.load for part in parts if hasattr(part, "load")))
        drive(m, classifier, logit=engine.logit if readout is None else readout.score, finish=control.finish)
        wrong = engine.check_failed | front.wrong
        if readout is not None and config.hardware.checksum:
            wrong |= readout.wrong
        drive(
            m,
            control,
            passing=self.i.valid | front.passing,
            moving=front.moving,
            decider_idle=idle,
            global_taken=classifier.ended,
            check_failed=wrong,
        )
        for name in self.probe.signature.members:
            if name in engine.signature.members:
                shown = getattr(engine, name)
                drive(m, getattr(self.probe, name), valid=shown.valid, value=shown.value)
        needed = Signal()
        awake: Value = ResetSignal() | control.awake
        if self.watching is not None:
            m.submodules.watchdog = watchdog = self.watching
            stalled = self.i.valid & ~self.i.ready
            drive(
                m,
                watchdog,
                due=stalled | engine.status.working | ~idle | control.due,
                done=engine.status.step_done | self.o.valid | control.load.enable,
            )
            m.d.comb += control.hung.eq(watchdog.hung)
            awake |= watchdog.due
        if config.hardware.clock_gate:
            m.d.comb += needed.eq(awake)
        return m, needed

    def _image(self, m: Module) -> tuple[Any, Any]:
        """Receiver and engine of images."""
        config, clear = self._config, self.control.clear
        receiver = ImageReceiver(config)
        engine = ImageEngine(
            plan_of(config), config.hardware.lane_type, to_decision=logit_to_decision(config)
        )
        m.submodules.receiver = ResetInserter(clear)(receiver)
        m.submodules.engine = ResetInserter(clear)(engine)
        forward(m, self, receiver, "i")
        m.d.comb += receiver.free.eq(self.classifier.idle)
        drive(m, engine, fill=receiver.fill, start=receiver.start, waiting=receiver.waiting)
        return receiver, engine

    def _recording(self, m: Module, begin_anew: Signal, idle: Value) -> tuple[Any, Any]:
        """Front end and engine of recordings."""
        config, control = self._config, self.control
        front_end = self.front_end = FrontEnd(config, (self._images or {}).get(Memory.MEANS))
        engine = (ForestEngine if config.is_forest else Engine)(config, self._images)
        m.submodules.front_end = ResetInserter(control.clear)(front_end)
        m.submodules.engine = ResetInserter(control.restart | begin_anew)(engine)
        frames = wiring.flipped(self.i)
        if has_door(config):
            m.submodules.door = door = ResetInserter(control.clear)(FrameDoor(config))
            wiring.connect(m, frames, door.i)
            m.d.comb += door.every.eq(control.every)
            frames = door.o
        wiring.connect(m, frames, front_end.i)
        wiring.connect(m, front_end.o, engine.i)
        drive(m, front_end, mask=control.mask, flush=control.finish)
        m.d.comb += self.classifier.longest.eq(engine.partial)
        drive(m, engine, decider_idle=idle, blank=front_end.blank)
        sums = front_end.averager.o
        drive(m, self.probe.sum, valid=sums.valid & sums.ready, value=~sums.p.complement)
        if config.faults.fault_frames:
            drive(m, self.probe.fault, valid=self.probe.sum.valid, value=sums.p.masked)
        if self.watching is not None:
            # An upset may have changed their counts of steps. The reset lets every touch begin as the first
            # one did; a first step already under way would be lost.
            decided = Signal()
            m.d.comb += begin_anew.eq(decided & ~engine.busy & ~engine.i.valid & idle)
            m.d.comb += control.anew.eq(begin_anew)
            m.d.sync += decided.eq(
                (decided | self.classifier.ended) & ~begin_anew & ~control.clear & ~engine.started
            )
        return front_end, engine

    def _nearest(self, m: Module, readout: PrototypeReadout, engine: Engine) -> None:
        """Connect the prototype readout: vectors in, scores to the classifier."""
        config, classifier, control = self._config, self.classifier, self.control
        vector = engine.state if config.recurrent else engine.logit
        m.submodules.readout = readout
        drive(m, readout.vector, valid=vector.valid, value=vector.value)
        drive(
            m,
            readout,
            logit_valid=engine.logit.valid,
            step_done=engine.status.step_done,
            ended=classifier.ended,
            # not with engine and classifier: the touch that ended may be taught
            clear=control.clear,
        )
        if config.readout_rule.unknown_above:
            m.d.comb += classifier.far.eq(readout.far)
        if config.readout_rule.taught:
            wiring.connect(m, control.teaching, readout.commands)
