"""The image engine: a network of convolutions, pools and dense layers over one image, pass after pass
(specification, section 15)."""

from amaranth.hdl import Cat, Module, Mux, Signal, signed
from amaranth.lib import wiring

from eskin.golden.core import AcceleratorConfig, InputError
from eskin.rtl.common import ENGINE, drive, image_lines, inputs, lines_signature, outputs, probe, struct
from eskin.rtl.engine.lanes import LANE_TYPES, lane_signature
from eskin.rtl.engine.row_chain import RowChain
from eskin.rtl.image.bias_memory import BiasMemory
from eskin.rtl.image.image_check import ImageCheck
from eskin.rtl.image.layouts import sum_layout
from eskin.rtl.image.map_memory import MapMemory
from eskin.rtl.image.pass_fetch import PassFetch
from eskin.rtl.image.sum_drain import SumDrain
from eskin.rtl.image.tap_sequencer import TapSequencer
from eskin.rtl.image.weight_memory import WeightMemory
from eskin.rtl.program.image_passes import ImagePlan
from eskin.rtl.program.memory_map import ImageMemory

ACTIVATION_BITS = 9
"""An activation as a lane takes it: 8 bits and a sign."""
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


class ImageEngine(wiring.Component):
    """Computes the logits of one image: the passes of `eskin.rtl.program.image_passes` in hardware.

    Parameters
    ----------
    plan:
        Sizes and formats. Any network whose passes, weights and maps are no larger can be loaded.
    lane_type:
        ``plain`` or ``dsp``, `eskin.rtl.engine.lanes.LANE_TYPES`.
    to_decision:
        Cycles from the last logit to the decision.

    Members
    -------
    fill : In(struct: valid, address, value)
        While not ``busy``: a pixel of the image.
    start : In(1)
        Pulse while not ``busy``: the image is there.
    waiting : In(1)
        It is, and not yet started.
    busy : Out(1)
        From the cycle after ``start`` until the cycle that ends the last pass.
    done : Out(1)
        Pulse: the last logit has been given. `ImagePlan.cycles` cycles after ``start``.
    logit : Out(struct: valid, value)
        In logit_format, class by class; cannot be held up.
    load : In
        The host's writes, a line a memory (`eskin.rtl.common.load_port.image_lines`); not while ``busy``.
    check_failed : Out(1)
        With ``checksum``, of `ImageCheck`: a word of the passes, weights or biases is wrong.
    map : Out(valid, value)
        For benches: each value of a map as it is written.
    step : Out(valid, value)
        For benches: cycles from ``start`` to the decision.
    status : Out(ENGINE)
        Of `eskin.rtl.common.status`; the image is its window, and its step.
    """

    def __init__(self, plan: ImagePlan, lane_type: str = "plain", to_decision: int = 0):
        self._plan, self._lane_type, self._to_decision = plan, lane_type, to_decision
        super().__init__(
            inputs(
                "start",
                "waiting",
                fill=struct("valid", address=plan.address_bits, value=8),
                load=lines_signature(len(image_lines(plan))),
            )
            | outputs(
                "busy",
                "done",
                "check_failed",
                logit=struct("valid", value=signed(plan.logit_format.width)),
                map=probe(),
                step=probe(),
                status=ENGINE,
            )
        )

    def elaborate(self, platform):
        m = Module()
        plan, load, lines = self._plan, self.load, image_lines(self._plan)
        m.submodules.fetch = fetch = PassFetch(plan)
        m.submodules.sequencer = sequencer = TapSequencer(plan)
        m.submodules.maps = maps = MapMemory(plan)
        m.submodules.weights = weights = WeightMemory(plan)
        m.submodules.biases = biases = BiasMemory(plan)
        m.submodules.chain = chain = RowChain(plan.accumulator_bits, plan.lanes)
        m.submodules.drain = drain = SumDrain(plan)
        tap, now = sequencer.tap, fetch.now

        # ---------------------------------------------------------------- pass after pass
        # source: memory of maps that is read; while idle the other one
        source = Signal(init=1)
        written = Signal.like(maps.write_address)
        drive(m, fetch, fetch=self.start | (sequencer.done & ~now.last), rewind=self.start)
        m.d.comb += [self.done.eq(sequencer.done & now.last), sequencer.now.eq(now)]
        m.d.sync += sequencer.go.eq(fetch.fetched)
        with m.If(self.start):
            m.d.sync += [self.busy.eq(1), source.eq(0)]
        with m.Elif(sequencer.done):
            m.d.sync += [self.busy.eq(~now.last), source.eq(now.last | ~source)]

        # ---------------------------------------------------------------- operands
        with m.If(sequencer.go):
            m.d.sync += written.eq(0)
        with m.Elif(drain.value.valid):
            m.d.sync += written.eq(written + 1)
        drive(
            m,
            maps,
            source=source,
            read=tap.valid,
            read_address=tap.activation,
            write=Mux(self.busy, drain.value.valid, self.fill.valid),
            write_address=Mux(self.busy, written, self.fill.address),
            write_value=Mux(self.busy, drain.value.value, self.fill.value),
        )
        drive(m, weights, read=tap.valid, dense=now.dense, address=tap.weight)
        drive(m, self.map, valid=drain.value.valid, value=drain.value.value)

        # ---------------------------------------------------------------- lanes
        # A tap's operands come a cycle after its addresses. `valid` comes with them for the plain lane, and a
        # cycle later for the DSP block.
        fetched = Signal()
        begun = Signal()
        swap = Signal()
        multiplied = Signal()
        released = [Signal(sum_layout(plan), name=f"released_{k}") for k in range(2)]
        m.d.sync += [
            fetched.eq(tap.valid),
            multiplied.eq(fetched),
            begun.eq(sequencer.begin),
            swap.eq(begun),
            released[0].eq(sequencer.released),
            released[1].eq(released[0]),
        ]
        signature = lane_signature(
            ACTIVATION_BITS, plan.weight_bits, plan.accumulator_bits, load_with_operands=False
        )
        for number in range(plan.lanes):
            m.submodules[f"lane_{number}"] = lane = LANE_TYPES[self._lane_type](signature)
            drive(
                m,
                lane,
                tick=1,
                a=maps.value,
                b=weights.weights[number],
                swap=swap,
                load=chain.load[number],
                valid=multiplied if self._lane_type == "dsp" else fetched,
            )
            m.d.comb += chain.acc[number].eq(lane.acc)
        drive(m, biases, restart=begun, first=sequencer.addend)
        drive(m, chain, tick=1, swap=swap, shift=drain.move, addend=biases.addend)
        drive(
            m,
            drain,
            swap=swap,
            sums=released[1],
            shift=now.shift,
            last=now.last,
            pairs=now.pairs,
            total=chain.total,
        )
        m.d.comb += self.logit.eq(drain.logit)

        # ---------------------------------------------------------------- status
        number = Signal(range(plan.stages[-1].outputs))
        last_logit = Signal()
        cycles = Signal.like(self.step.value)  # since the start
        working = self.busy | self.waiting
        m.d.comb += last_logit.eq(self.logit.valid & (number == plan.stages[-1].outputs - 1))
        m.d.sync += cycles.eq(Mux(self.start, 1, cycles + 1))
        with m.If(self.logit.valid):
            m.d.sync += number.eq(Mux(last_logit, 0, number + 1))
        drive(
            m, self.status, working=working, windows_open=working, slot_done=self.busy, step_done=last_logit
        )
        drive(m, self.step, valid=last_logit, value=cycles + self._to_decision)

        if plan.checksum:
            m.submodules.check = check = ImageCheck(plan)
            drive(
                m,
                check,
                begins=self.start,
                arrives=fetch.arrives,
                word=fetch.arrived,
                checks=fetch.checks,
                multiplies=fetched,
                weights=weights.weights,
                dense=now.dense,
                ends=swap & sequencer.ending & now.last,
                shifts=drain.move,
                addend=Cat(biases.addend, biases.parity),
            )
            m.d.comb += self.check_failed.eq(check.fault)

        # ---------------------------------------------------------------- the host's writes
        drive(
            m,
            fetch,
            write=load.enable & load.select[lines[ImageMemory.PASSES]],
            address=load.address,
            word=load.data,
        )
        drive(
            m,
            biases,
            load=load.enable & load.select[lines[ImageMemory.BIASES]],
            load_address=load.address,
            load_word=load.data,
        )
        m.d.comb += [
            weights.load.eq(load.enable),
            *(weights.column[column].eq(load.select[lines[column]]) for column in range(plan.columns)),
            weights.load_dense[0].eq(load.select[lines[ImageMemory.DENSE_LOW]]),
            weights.load_dense[1].eq(load.select[lines[ImageMemory.DENSE_HIGH]]),
        ]
        drive(m, weights, load_address=load.address, load_word=load.data)
        return m
