"""rtl/frontend/pretrigger_ring.py: frames s..e of every touch, bit for bit, whatever stalls."""

import pytest
from amaranth.hdl import Module, Mux, Signal
from amaranth.lib import wiring

from eskin.rtl.frontend.pretrigger_ring import PreTriggerRing
from tests.support.front_end_cases import CASES, detect, frame_beats, make_stream, touch_beats
from tests.support.stream_bench import Bench, play, values
from tests.support.table import each_row


class Ring(wiring.Component):
    """The ring and a reader's count of beats, which says ``touch_last`` with the last of frame e, as the
    averager does."""

    def __init__(self, config):
        self.block, self.beats = PreTriggerRing(config), config.last_frame * config.sensor.taxels
        super().__init__(
            {name: port for name, port in self.block.signature.members.items() if name != "touch_last"}
        )

    def elaborate(self, platform):
        m, left = Module(), Signal(range(self.beats), init=self.beats - 1)
        m.submodules.ring = self.block
        wiring.connect(m, wiring.flipped(self.i), self.block.i)
        wiring.connect(m, self.block.o, wiring.flipped(self.o))
        accepted = self.o.valid & self.o.ready
        m.d.comb += self.block.touch_last.eq(left == 0)
        with m.If(accepted):
            m.d.sync += left.eq(Mux(left == 0, self.beats - 1, left - 1))
        return m


RINGS = (
    "thesis 6 taxels",
    "short first window",
    "immediate touch, faults",
    "no pretrigger",
    "two end together, faults",
    "synthetic faults",
)
"""Every length of history and of touch; what opens the touch is not the ring's."""


@pytest.mark.parametrize("one_port", [False, True])
@pytest.mark.parametrize("name", RINGS)
def test_frames_of_every_touch(name, one_port):
    """In turn at full rate, with a slow sender, with a slow reader; with one port the slow sender's touches
    catch up, and the reader is not always ready for what passes."""
    stalls = ((0.0, 0.0), (0.5, 0.1), (0.0, 0.6)) if not one_port else ((0.0, 0.0), (0.7, 0.3), (0.8, 0.0))
    config, stalls = CASES[name].replace(one_port=one_port), stalls[RINGS.index(name) % 3]
    seen = detect(config, make_stream(config, 250, seed=11))
    out, _ = play(Ring(config), frame_beats(config, seen), stalls, seed=2)
    assert values(out) == touch_beats(config, seen)


@each_row("taxels, gap, pause", [(4, 0, 1), (8, 0, 0), (4, 1, 0)])
def test_latency_and_full_rate(taxels, gap, pause):
    """The replay begins 3 cycles after the onset's last beat, and every cycle brings a beat until it has
    caught up; nothing is held up.

    In a frame of less than 6 taxels, one a cycle, the frame too many has not gone when the last one comes: a
    cycle's pause for both.
    """
    config = CASES["thesis"].replace(taxels=taxels)
    seen = detect(config, make_stream(config, 100, seed=5, touches=[30]))
    beats = frame_beats(config, seen)
    out, accepted = play(Ring(config), beats, gaps=[gap] * len(beats))
    last = 30 * taxels - 1
    assert accepted == [gap + beat * (1 + gap) + pause * (beat > last + 1) for beat in range(len(accepted))]
    replayed = [beat.cycle for beat in out[: 40 * taxels]]
    assert replayed[: 5 * taxels] == [accepted[last] + 3 + pause + n for n in range(5 * taxels)]
    # at the pace of its reader it never catches up
    assert replayed[-1] - accepted[65 * taxels - 1] == (3 if gap else 5 * taxels + 2)


@each_row("wait", [0, 1, 20])
def test_what_has_caught_up_passes_by(wait):
    """At a slow pace a touch of one port has caught up after some frames: from then on a beat leaves in the
    cycle in which it comes. One for which the reader is not ready waits in the ring, and those after it pass
    again."""
    config = CASES["thesis"].replace(one_port=True)
    seen = detect(config, make_stream(config, 100, seed=5, touches=[30]))
    dut, beats = Ring(config), frame_beats(config, seen)
    bench = Bench(dut, quiet=100)
    accepted = bench.drive(dut.i, beats, gaps=[5] * len(beats))
    wanted, out = touch_beats(config, seen)[: 40 * 4], []
    late = 100  # the beat of the touch for which the reader is not ready

    async def reader(ctx):
        cycle, waited = 0, 0
        while len(out) < len(wanted):
            waits = len(out) == late and waited < wait
            waited += bool(waits) and bool(ctx.get(dut.i.valid))
            ctx.set(dut.o.ready, not waits)
            _, _, valid, complement = await ctx.tick().sample(dut.o.valid, dut.o.p.complement)
            if valid and not waits:
                out.append({"complement": complement, "cycle": cycle})
            cycle += 1

    bench.process(reader)
    bench.run()
    assert [{"complement": beat["complement"]} for beat in out] == wanted
    first = (seen.touches[0][1] - 1) * 4
    delays = [beat["cycle"] - accepted[first + number] for number, beat in enumerate(out)]
    caught_up = delays.index(0)
    assert 5 * 4 < caught_up < late and delays[caught_up:late] == [0] * (late - caught_up)
    later = 0 if not wait else next(k for k, delay in enumerate(delays[late:]) if delay == 0)
    assert later == {0: 0, 1: 1, 20: 24}[wait] and delays[late + later :] == [0] * (160 - late - later)
