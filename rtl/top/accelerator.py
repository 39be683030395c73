"""The whole chain, wiring only: frames in, decisions out, a host bus beside it, probes for benches.

Frames to decisions: docs/specification.md, sections 2 to 7.
"""

from functools import reduce
from operator import or_

from amaranth.hdl import Module, ResetInserter, ResetSignal, Signal, Value
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import Out

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import decision_layout, drive, forward, has_door, inputs, outputs, probe, sample_layout
from eskin.rtl.decision.classifier import Classifier
from eskin.rtl.decision.prototype_readout import PrototypeReadout
from eskin.rtl.engine.engine import Engine
from eskin.rtl.frontend.frame_door import FrameDoor
from eskin.rtl.frontend.front_end import FrontEnd
from eskin.rtl.host.control import FedBy, HostControl, bus_signature
from eskin.rtl.program.memory_map import Images, Memory
from eskin.rtl.top.clock_gate import gated
from eskin.rtl.top.watchdog import Watchdog


class HostedChain(wiring.Component):
    """The common part of the chains for recordings and for images: frames in, decisions out, a host bus,
    probes, a clock that may stop; members as of `Accelerator`.

    probes: their names. ``wired`` of a chain is (its module, whether its next clock edge is needed).
    """

    probes: tuple[str, ...]

    def __init__(self, config: AcceleratorConfig, images: Images | None = None, fed_by: FedBy | None = None):
        self._config, self._images = config, None if config.hardware.loadable else images
        self._fed_by = fed_by
        self.watching = Watchdog(config) if config.hardware.watchdog else None
        super().__init__(
            inputs(i=stream.Signature(sample_layout(config)))
            | outputs(o=stream.Signature(decision_layout(config)))
            | inputs(bus=bus_signature())
            | outputs("busy", probe=wiring.Signature({name: Out(probe()) for name in self.probes}))
            | (outputs("any_fault") if fed_by else {})
        )

    def elaborate(self, platform):
        chain, needed = self.wired()
        return gated(chain, needed, platform) if self._config.hardware.clock_gate else chain

    def wired(self) -> tuple[Module, Signal]:
        """A chain's own: its module, and whether the next clock edge is needed."""
        raise NotImplementedError

    def hosted(self, m: Module, classifier: Classifier) -> HostControl:
        """The control, wired to bus, frames and classifier."""
        m.submodules.control = control = HostControl(self._config, self._fed_by)
        forward(m, self, control, "bus")
        forward(m, self, classifier, "o")
        drive(
            m,
            control.frames,
            offered=self.i.valid,
            taken=self.i.valid & self.i.ready,
            first=self.i.p.first,
            last=self.i.p.last,
        )
        m.d.comb += [
            control.global_taken.eq(classifier.ended),
            classifier.finish.eq(control.finish),
            self.busy.eq(control.busy),
        ]
        if self._fed_by:
            m.d.comb += self.any_fault.eq(control.any_fault)
        return control

    def watched(self, m: Module, control: HostControl, done: Value, *due: Value) -> None:
        """The watchdog, if configured: ``due`` and ``done`` beside the signals that it watches in every
        chain."""
        if self.watching is not None:
            m.submodules.watchdog = watchdog = self.watching
            drive(
                m,
                watchdog,
                due=reduce(or_, (self.i.valid & ~self.i.ready, *due, control.due)),
                done=done | self.o.valid | control.load.enable,
            )
            m.d.comb += control.hung.eq(watchdog.hung)

    def probed(self, engine: wiring.Component, *names: str) -> list:
        """Statements that show the engine's probes."""
        shown = [(getattr(self.probe, name), getattr(engine, name)) for name in names]
        return [
            getattr(mine, part).eq(getattr(its, part)) for mine, its in shown for part in ("valid", "value")
        ]

    def needed(self, m: Module, control: HostControl) -> Signal:
        """True if the next clock edge is needed; unused where the clock never stops."""
        needed = Signal()
        if self._config.hardware.clock_gate:
            due = 0 if self.watching is None else self.watching.due
            m.d.comb += needed.eq(ResetSignal() | control.awake | due)
        return needed


class Accelerator(HostedChain):
    """Door, onset detector, pre-trigger ring, feature expander, window averager, normaliser, engine, classifier and
    control.

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
        Frames, one taxel a beat, taxel 0 first. Ready at every cycle while the engine keeps up.
    o : Out(stream of eskin.rtl.decision.classifier.decision_layout)
        Local decision after every step, global decision at the end of a touch.
    bus : In
        Host bus: rtl/program/memory_map.py.
    busy : Out(1)
        A frame, sum, step, decision or command is in flight; combinational from ``i.valid``.
    probe : Out
        ``sum``, ``fault`` (the sum's taxel is out of use; only with a fault detector ever valid),
        ``feature``, ``state``, ``logit``: output of each stage, in the cycle of its transfer; ``step``: engine
        cycles of a step. Left open in a real design, they cost nothing.

    Latency from the last taxel of a window to its decision: a few cycles of front end and
    `Schedule.decision_cycles`.
    """

    probes = ("sum", "fault", "feature", "state", "logit", "step")

    def wired(self) -> tuple[Module, Signal]:
        m, config = Module(), self._config
        if not config.hardware.loadable and self._images is None:
            raise ValueError("a ROM design (loadable false) needs its memory images")
        self.front_end = front_end = FrontEnd(config, (self._images or {}).get(Memory.MEANS))
        engine, classifier = Engine(config, self._images), Classifier(config)
        control = self.hosted(m, classifier)
        self.classifier, self.control = classifier, control
        decider_idle, readout = classifier.idle, None
        if config.has_prototypes:
            readout = self._nearest(m, engine, classifier, control)
            decider_idle = classifier.idle & readout.idle
        begin_anew = Signal()  # engine and classifier go back to where a touch begins
        m.submodules.front_end = ResetInserter(control.clear)(front_end)
        m.submodules.engine = ResetInserter(control.restart | begin_anew)(engine)
        m.submodules.classifier = ResetInserter(control.clear | begin_anew)(classifier)

        frames = wiring.flipped(self.i)
        if has_door(config):
            m.submodules.door = door = ResetInserter(control.clear)(FrameDoor(config))
            wiring.connect(m, frames, door.i)
            m.d.comb += door.every.eq(control.every)
            frames = door.o
        wiring.connect(m, frames, front_end.i)
        wiring.connect(m, front_end.o, engine.i)
        wiring.connect(m, front_end.status, control.detector)
        wiring.connect(m, engine.status, control.engine)
        loads = [readout.load] if readout is not None else []
        wiring.connect(m, control.load, front_end.load, engine.load, *loads)
        m.d.comb += [
            front_end.mask.eq(control.mask),
            classifier.logit.eq(engine.logit if readout is None else readout.score),
        ]
        drive(m, engine, decider_idle=decider_idle, blank=front_end.blank)
        if config.faults.fault_frames:
            drive(m, self.probe.fault, valid=self.probe.sum.valid, value=front_end.averager.o.p.masked)
        check_failed = engine.check_failed | front_end.wrong
        if readout is not None and config.hardware.checksum:
            check_failed |= readout.wrong
        drive(
            m,
            control,
            passing=self.i.valid | front_end.passing,
            moving=front_end.moving,
            decider_idle=decider_idle,
            check_failed=check_failed,
        )
        self.watched(m, control, engine.status.step_done, engine.status.working, ~decider_idle)
        if self.watching is not None:
            # An upset may have changed their counts of steps. The reset lets every touch begin as the first
            # one did; a first step already under way would be lost.
            decided = Signal()
            m.d.comb += begin_anew.eq(decided & ~engine.busy & ~engine.i.valid & decider_idle)
            m.d.sync += decided.eq(
                (decided | classifier.ended) & ~begin_anew & ~control.clear & ~engine.started
            )

        drive(
            m,
            self.probe.sum,
            valid=front_end.averager.o.valid & front_end.averager.o.ready,
            value=~front_end.averager.o.p.complement,
        )
        m.d.comb += [*self.probed(engine, "feature", "state", "logit", "step")]
        return m, self.needed(m, control)

    def _nearest(
        self, m: Module, engine: wiring.Component, classifier: Classifier, control: HostControl
    ) -> PrototypeReadout:
        """Prototypes in place of logits, wired to what they compare and to who decides."""
        config = self._config
        vector = engine.state if config.recurrent else engine.logit
        m.submodules.readout = readout = PrototypeReadout(config)
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
        return readout
