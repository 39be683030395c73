"""The stopped clock: where no edge is let through, the chain would not have changed.

The chain is looked at without its gate. In a cycle that the gate would stop (`needed` low) every register has
to keep its value, no memory is written, and what a memory has read stays. So the chain with its clock stopped
in these cycles goes through the same states, and by `needed` the very cycle of a beat or of a bus access is
never one of them.
"""

from unittest import mock

from amaranth.asserts import AnySeq
from amaranth.hdl import Cat, Fragment, MemoryInstance, Module, Signal, Value
from amaranth.lib import wiring

from eskin.golden.core import PRESETS, AcceleratorConfig, QFormat
from eskin.rtl.decision.score_search import SearchOnce
from eskin.rtl.engine import lanes
from eskin.rtl.top.accelerator import Accelerator
from formal.proof import Bug, assume, before, free, free_sink, free_source, placed, proof, prove, registers

CONFIG = PRESETS["thesis"].replace(
    taxels=4,
    hidden=4,
    class_names=("a", "b"),
    lanes=2,
    state_format=QFormat(4, 12),
    pretrigger_frames=1,
    hop=2,
    window=4,
    touch_frames=8,
    rearm_frames=12,
    steps=2,
    feature_shift=(4,),
    sample_bits=4,
    band_low=4,
    band_high=9,
    clock_gate=True,
    one_port=True,
)
LONG_WAY = CONFIG.replace(
    lanes=4,
    rest="tracked",
    rest_frames=2,
    clip=7,
    onset="baseline",
    onset_mean_frames=2,
    onset_check_frames=2,
    onset_threshold=3,
    window_mode="free",
    feature_kinds=("mean", "activity"),
    activity_block=2,
    feature_shift=(4, 4),
)
DRAINED = 10
"""Cycles from any state whatever: more than the gate waits before it stops the clock."""


class _AnyLane(wiring.Component):
    """A plain lane whose sums are anything, at the edges at which the plain one takes them."""

    def elaborate(self, platform):
        m = Module()
        counts = Signal()
        with m.If(self.tick):
            m.d.sync += counts.eq(self.valid)
        with m.If(self.tick & (counts | self.swap)):
            m.d.sync += self.acc.eq(AnySeq(self.acc.shape()))
        return m


class _Ungated(Accelerator):
    def elaborate(self, platform):
        m, self.edge = self.wired()
        return m


def _stands_still(m: Module, config: AcceleratorConfig) -> None:
    with mock.patch.dict(lanes.LANE_TYPES, plain=_AnyLane):
        dut = placed(_Ungated(config))
    memories: list[MemoryInstance] = []

    def collect(part: Fragment) -> None:
        memories.extend([part] if isinstance(part, MemoryInstance) else [])
        for inner, _, _ in part.subfragments:
            collect(inner)

    collect(m.submodules.dut.elaborate(None))
    # The classifier's own proof shows this for a classifier that is not busy.
    decider, search = dut.classifier, dut.classifier.search
    scores = (search.arriving, search.judged) if isinstance(search, SearchOnce) else (search.searching,)
    under_way = (decider.o.valid, decider.tallying, decider.finished, search.found, search.number, *scores)
    assume(~decider.idle | ~Cat(under_way).any())
    # The detector's taxels follow each other.
    detector = dut.front_end.detector
    for stage in detector.stages.values():
        assume(~stage.valid | (stage.index != detector.aligner.index))
    # And the state of the recording.
    assume(~dut.control.state.finished | dut.control.state.finishing)
    free_source(dut.i)
    free_sink(dut.o)
    free(*(getattr(dut.bus, name) for name in ("addr", "w_data", "w_stb", "r_stb")))
    stopped = before(~dut.edge, "stopped")
    prove(dut.edge | ~(dut.i.valid | dut.bus.w_stb | dut.bus.r_stb), "what comes in has its edge")
    for number, signal in enumerate(registers()):
        prove(
            ~stopped | (signal == before(signal, f"was_{number}")),
            f"{signal.name} would have kept its value ({number})",
        )
    for number, memory in enumerate(memories):
        for port in memory._write_ports:
            prove(dut.edge | ~Value.cast(port._en).any(), f"no memory is written ({number})")
        for place, port in enumerate(memory._read_ports):
            if port._domain != "comb":
                was = before(port._data, f"read_{number}_{place}")
                prove(~stopped | (port._data == was), f"what a memory has read stays ({number})")


@proof(
    "in a cycle in which the clock is stopped no register would change, no memory would be written; a beat "
    "or a bus access has its edge",
    depth=DRAINED,
    method="any state",
    reduced="4 taxels, 4 units, 2 classes, 2 steps, samples of 4 bits, 2 lanes whose sums are free",
    bugs=(
        Bug(
            "a beat does not wake the chain",
            "passing=self.i.valid | front.passing",
            "passing=front.passing",
            file="rtl/top/accelerator.py",
        ),
        Bug(
            "a touch that is over is not told to the bus",
            "self.clear | (undecided.any() ^ self.touch)",
            "self.clear",
            file="rtl/host/recording_state.py",
        ),
        Bug(
            "what the ring still counts is not waited for",
            "self.holds.eq(pushed | dropped |",
            "self.holds.eq(pushed |",
            file="rtl/frontend/pretrigger_ring.py",
        ),
        Bug(
            "a chain at work is stopped",
            "bus.r_stb | state.busy |",
            "bus.r_stb |",
            file="rtl/host/control.py",
        ),
    ),
)
def stands_still(m: Module) -> None:
    _stands_still(m, CONFIG)


@proof(
    "the same with a rest level, deviations that are clipped and the onset by baseline, whose verdict waits",
    depth=DRAINED,
    method="any state",
    reduced="4 taxels, 4 units, 2 classes, 2 steps, samples of 4 bits, 4 lanes whose sums are free, blocks of 2 checks",
    bugs=(
        Bug(
            "beats in the detector are not waited for",
            "parts = (self.detector, self.ring,",
            "parts = (self.ring,",
            file="rtl/frontend/front_end.py",
        ),
    ),
)
def stands_still_after_a_verdict(m: Module) -> None:
    _stands_still(m, LONG_WAY)
