"""A chain that hangs goes back to idle: docs/specification_interfaces.md section 11."""

from amaranth.hdl import Module, Signal

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import Block, inputs, outputs
from eskin.rtl.program.memory_map import prototype_words
from eskin.rtl.program.microcode import Microcode
from eskin.rtl.program.schedule import frame_cycles, leaving_cycles, schedule, step_cycles
from eskin.rtl.program.timing import readout_cycles

QUIET_CYCLES = 64
"""Covers control's wait until nothing moves any more, and a decision's cycles apart from those per class."""


def longest_wait(config: AcceleratorConfig) -> int:
    """The most cycles for which a healthy chain is busy without ending a step or offering a decision.

    In the worst case the frames that the ring holds at the end of a touch go through the averager; a step has
    ended just before, and the next begins with the prologue.
    """
    if config.is_image:  # from the last pixel to the decision
        return step_cycles(config) + frame_cycles(config) + 4 * config.classes + QUIET_CYCLES
    if config.is_forest:
        step = step_cycles(config)
    else:
        code = Microcode(schedule(config))
        step = code.idle_words + len(code.slots)
    ring_frames = config.ring_frames if config.windows.window_mode == "touch" else 0
    ring = (ring_frames + 2) * frame_cycles(config)
    if config.follows_touch:
        ring += int(leaving_cycles(config))
    pass_cycles = prototype_words(config) + config.windows.steps if config.readout_rule.taught else 0
    return ring + 2 * step + readout_cycles(config) + pass_cycles + 4 * config.classes + QUIET_CYCLES


def bound(config: AcceleratorConfig) -> int:
    """Cycles after which the watchdog acts: the power of two above ``longest_wait``, so that one bit of its
    counter is enough."""
    return 1 << longest_wait(config).bit_length()


class Watchdog(Block):
    """Counts cycles in which something is due and does not come; at ``bound`` the chain is cleared.

    Members
    -------
    due : In(1)
        A beat is offered and not taken, a window waits or is computed, the classifier has logits or votes,
        the recording is being finished, or front end and classifier do not agree whether a touch is open.
    done : In(1)
        A step has ended, a decision is offered (while nobody takes it, it is not the chain that is waited
        for), or a memory is written, which restarts the engine.
    hung : Out(1)
        One cycle: clear the chain.
    """

    def ports(self, config: AcceleratorConfig):
        return inputs("due", "done") | outputs("hung")

    def elaborate(self, platform):
        m = Module()
        count = Signal(range(bound(self.spec) + 1))
        m.d.comb += self.hung.eq(count[-1])
        m.d.sync += count.eq(count + 1)
        with m.If(~self.due | self.done | self.hung):
            m.d.sync += count.eq(0)
        return m
