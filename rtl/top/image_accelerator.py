"""The whole chain for images, wiring only: frames in, decisions out, the host bus beside it, probes for
benches."""

from amaranth.hdl import Module, Mux, ResetInserter, Signal
from amaranth.lib import wiring

from eskin.golden.core import AcceleratorConfig, InputError
from eskin.rtl.common import drive, forward
from eskin.rtl.decision.classifier import Classifier
from eskin.rtl.host.control import FedBy
from eskin.rtl.image.image_engine import ImageEngine
from eskin.rtl.image.image_receiver import ImageReceiver
from eskin.rtl.program.image_passes import plan_of
from eskin.rtl.program.memory_map import Images
from eskin.rtl.program.timing import logit_to_decision
from eskin.rtl.top.accelerator import Accelerator, HostedChain

LANES = (1, 2, 4, 8, 16)


def refuse_hardware(config: AcceleratorConfig) -> None:
    """Refuse (InputError) features that the hardware for images does not have."""
    hardware = config.hardware

    def refuse(field: str, why: str) -> None:
        raise InputError(f"configuration '{config.name}', field {field}: {why}")

    if hardware.lanes not in LANES:
        refuse(
            "lanes",
            f"is {hardware.lanes}; a network for images runs on {', '.join(map(str, LANES[:-1]))} or "
            f"{LANES[-1]} lanes",
        )
    if not hardware.loadable:
        refuse(
            "loadable",
            "is false; the weights of images lie in memories that only the host can fill: give true",
        )
    if hardware.one_port:
        refuse("one_port", "is on; a network for images has no ring: leave it out")
    if hardware.one_phase:
        refuse("one_phase", "is on; a network for images has no phases: leave it out")
    if not config.image.weight_formats:
        refuse("weight_formats", "is empty; quantise the model first")


class ImageAccelerator(HostedChain):
    """Receiver, image engine, classifier and control; in place of `eskin.rtl.top.accelerator.Accelerator` for
    a network for images.

    The first ``height`` frames after ``arm`` are the image; later frames are ignored. Its only step gives a
    local and then a global decision.

    Members
    -------
    i : In(stream of sample_layout)
        Frames, one pixel a beat.
    o, bus, busy
        As of the `Accelerator`.
    probe : Out
        ``map``: every value of a map, as it is written; ``logit``; ``step``: cycles from the start of an
        image to its decision.

    Latency from the last pixel to the decision: `eskin.rtl.program.schedule.decision_cycles`.
    """

    probes = ("map", "logit", "step")

    def wired(self) -> tuple[Module, Signal]:
        m, config = Module(), self._config
        engine = ImageEngine(plan_of(config), config.hardware.lane_type)
        receiver, classifier = ImageReceiver(config), Classifier(config)
        control = self.hosted(m, classifier)
        m.submodules.receiver = ResetInserter(control.clear)(receiver)
        m.submodules.engine = ResetInserter(control.clear)(engine)
        m.submodules.classifier = ResetInserter(control.clear)(classifier)
        forward(m, self, receiver, "i")
        wiring.connect(m, receiver.status, control.detector)
        wiring.connect(m, control.load, engine.load)
        last_logit = Signal()
        number = Signal(range(config.classes))
        m.d.comb += last_logit.eq(engine.logit.valid & (number == config.classes - 1))
        with m.If(engine.logit.valid):
            m.d.sync += number.eq(number + 1)
        with m.If(last_logit | control.clear):
            m.d.sync += number.eq(0)
        working = engine.busy | receiver.waiting
        m.d.comb += receiver.free.eq(classifier.idle)
        drive(m, engine, fill=receiver.fill, start=receiver.start)
        m.d.comb += classifier.logit.eq(engine.logit)
        drive(
            m,
            control.engine,
            working=working,
            windows_open=working,
            slot_done=engine.busy,
            step_done=last_logit,
        )
        drive(
            m,
            control,
            passing=self.i.valid,
            moving=self.i.valid | receiver.fill.valid,
            decider_idle=classifier.idle,
            check_failed=engine.check_failed,
        )
        self.watched(m, control, last_logit, engine.busy, receiver.waiting, ~classifier.idle)
        cycles = Signal(32)  # since the start
        m.d.sync += cycles.eq(Mux(engine.start, 1, cycles + 1))
        m.d.comb += [*self.probed(engine, "map", "logit")]
        drive(m, self.probe.step, valid=last_logit, value=cycles + logit_to_decision(config))
        return m, self.needed(m, control)


def make_accelerator(
    config: AcceleratorConfig, images: Images | None = None, fed_by: FedBy | None = None
) -> Accelerator | ImageAccelerator:
    """The chain of the configuration; parameters as of `Accelerator`.

    Raises
    ------
    InputError
        Hardware that images do not have (`refuse_hardware`).
    """
    if config.is_image:
        refuse_hardware(config)
    return (ImageAccelerator if config.is_image else Accelerator)(config, images, fed_by)
