"""The image engine: a network of convolutions, pools and dense layers over one image, pass after pass
(specification, section 15)."""

from amaranth.hdl import Cat, Module, Mux, Signal, signed
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from eskin.rtl.common.load_port import image_lines, lines_signature
from eskin.rtl.common.status import probe
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


class ImageEngine(wiring.Component):
    """Computes the logits of one image: the passes of `eskin.rtl.program.image_passes` in hardware.

    Parameters
    ----------
    plan:
        Sizes and formats. Any network whose passes, weights and maps are no larger can be loaded.
    lane_type:
        ``plain`` or ``dsp``, `eskin.rtl.engine.lanes.LANE_TYPES`.

    Members
    -------
    fill : In(struct: valid, address, value)
        While not ``busy``: a pixel of the image.
    start : In(1)
        Pulse while not ``busy``: the image is there.
    busy : Out(1)
        From the cycle after ``start`` until the one that ends the last pass.
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
    """

    def __init__(self, plan: ImagePlan, lane_type: str = "plain") -> None:
        self._plan, self._lane_type = plan, lane_type
        super().__init__(
            {
                "fill": In(data.StructLayout({"valid": 1, "address": plan.address_bits, "value": 8})),
                "start": In(1),
                "busy": Out(1),
                "done": Out(1),
                "logit": Out(data.StructLayout({"valid": 1, "value": signed(plan.logit_format.width)})),
                "load": In(lines_signature(len(image_lines(plan)))),
                "check_failed": Out(1),
                "map": Out(probe()),
            }
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
        written = Signal(plan.address_bits)
        m.d.comb += [
            fetch.fetch.eq(self.start | (sequencer.done & ~now.last)),
            fetch.rewind.eq(self.start),
            self.done.eq(sequencer.done & now.last),
            sequencer.now.eq(now),
        ]
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
        m.d.comb += [
            maps.source.eq(source),
            maps.read.eq(tap.valid),
            maps.read_address.eq(tap.activation),
            maps.write.eq(Mux(self.busy, drain.value.valid, self.fill.valid)),
            maps.write_address.eq(Mux(self.busy, written, self.fill.address)),
            maps.write_value.eq(Mux(self.busy, drain.value.value, self.fill.value)),
            weights.read.eq(tap.valid),
            weights.dense.eq(now.dense),
            weights.address.eq(tap.weight),
            self.map.valid.eq(drain.value.valid),
            self.map.value.eq(drain.value.value),
        ]

        # ---------------------------------------------------------------- lanes
        # A tap's operands come a cycle after its addresses. `valid` comes with them for the plain lane, and a
        # cycle later for the DSP block.
        fetched = Signal()
        begun = Signal()
        swap = Signal()
        multiplied = Signal()
        released = [Signal(sum_layout(plan), name=f"released_{k}") for k in range(2)]
        m.d.sync += [fetched.eq(tap.valid), multiplied.eq(fetched), begun.eq(sequencer.begin), swap.eq(begun)]
        m.d.sync += [released[0].eq(sequencer.released), released[1].eq(released[0])]
        signature = lane_signature(
            ACTIVATION_BITS, plan.weight_bits, plan.accumulator_bits, load_with_operands=False
        )
        for number in range(plan.lanes):
            m.submodules[f"lane_{number}"] = lane = LANE_TYPES[self._lane_type](signature)
            m.d.comb += [
                lane.tick.eq(1),
                lane.a.eq(maps.value),
                lane.b.eq(weights.weights[number]),
                lane.swap.eq(swap),
                lane.load.eq(chain.load[number]),
                lane.valid.eq(multiplied if self._lane_type == "dsp" else fetched),
                chain.acc[number].eq(lane.acc),
            ]
        m.d.comb += [
            biases.restart.eq(begun),
            biases.first.eq(sequencer.addend),
            chain.tick.eq(1),
            chain.swap.eq(swap),
            chain.shift.eq(drain.move),
            chain.addend.eq(biases.addend),
            drain.swap.eq(swap),
            drain.sums.eq(released[1]),
            drain.shift.eq(now.shift),
            drain.last.eq(now.last),
            drain.pairs.eq(now.pairs),
            drain.total.eq(chain.total),
            self.logit.eq(drain.logit),
        ]

        if plan.checksum:
            m.submodules.check = check = ImageCheck(plan)
            m.d.comb += [
                check.begins.eq(self.start),
                check.arrives.eq(fetch.arrives),
                check.word.eq(fetch.arrived),
                check.checks.eq(fetch.checks),
                check.multiplies.eq(fetched),
                check.weights.eq(weights.weights),
                check.dense.eq(now.dense),
                check.ends.eq(swap & sequencer.ending & now.last),
                check.shifts.eq(drain.move),
                check.addend.eq(Cat(biases.addend, biases.parity)),
                self.check_failed.eq(check.fault),
            ]

        # ---------------------------------------------------------------- the host's writes
        m.d.comb += [
            fetch.write.eq(load.enable & load.select[lines[ImageMemory.PASSES]]),
            fetch.address.eq(load.address),
            fetch.word.eq(load.data),
            biases.load.eq(load.enable & load.select[lines[ImageMemory.BIASES]]),
            biases.load_address.eq(load.address),
            biases.load_word.eq(load.data),
            weights.load.eq(load.enable),
            *(weights.column[column].eq(load.select[lines[column]]) for column in range(plan.columns)),
            weights.load_dense[0].eq(load.select[lines[ImageMemory.DENSE_LOW]]),
            weights.load_dense[1].eq(load.select[lines[ImageMemory.DENSE_HIGH]]),
            weights.load_address.eq(load.address),
            weights.load_word.eq(load.data),
        ]
        return m
