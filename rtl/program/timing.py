"""Cycles that follow from the configuration alone: lanes, latencies.

A slot is the time of one program word: one cycle, or as long as the program waits for a window.
"""

from dataclasses import dataclass

from eskin.golden.core import AcceleratorConfig

ELEMENT_OPERAND_BITS = 16


FRAME_WAY_CYCLES = 3
"""Cycles of a frame beyond those of its taxels: the way to the windows."""
STATE_BEATS = 3
"""Read-after-write distance of the per-taxel state memories, in beats."""
FRAME_EXTRA_CYCLES = FRAME_WAY_CYCLES + 4
"""The way to the windows, 3 for the verdict on an onset, 1 for the read of the mean."""


def logit_to_decision(config: AcceleratorConfig) -> int:
    """Cycles from a step's last logit to the offer of its decision."""
    return readout_cycles(config) + (3 if holds_two_largest(config) else config.classes + 4)


def holds_two_largest(config: AcceleratorConfig) -> bool:
    """True if the two largest scores are held as they come, in more cells. Otherwise all scores are read
    again, in classes + 1 more cycles. Steps of a linear cell, and those on 4 lanes and more, are short, so
    they hold them."""
    return not config.recurrent or config.hardware.lanes >= 4


def readout_cycles(config: AcceleratorConfig) -> int:
    """Cycles from a step's last logit to its last score, where prototypes decide: one a code, and one a value
    and one more where touches are taught."""
    if not config.has_prototypes:
        return 0
    rule, values = config.readout_rule, config.trajectory_width
    places = config.classes * (rule.prototypes + rule.taught)
    return places * values + (values + 1) * (rule.taught > 0) + 3


def shares_lane(config: AcceleratorConfig) -> bool:
    """True where one multiplier serves rows and element-wise operations."""
    return config.hardware.lanes == 1


@dataclass(frozen=True)
class Timing:
    """Latencies of the engine in slots; rtl/engine/engine.py is built to these.

    A row's are counted from the issue of its group's last element, row p's p slots later; an element-wise
    operation's from the issue of its last term.

    Parameters
    ----------
    acc:
        The lane's accumulator holds the sum: address, operands, product and sum.
    gap:
        Slots lost on a lane between two dot products: the DSP block's own accumulator is loaded in place of
        an addition.
    chain:
        One where several lanes' sums are captured and forwarded one by one.
    early:
        One where a lane gets the enable of an addition one slot before it.
    """

    acc: int
    gap: int
    chain: int
    early: int

    @property
    def row(self) -> int:
        """Row 0's sum is at the table, the classifier or the addend memory; its value at the T memory."""
        return self.acc + self.chain

    @property
    def row_to_gate(self) -> int:
        """Gate or T value can be addressed: table, write, read."""
        return self.row + 2

    @property
    def row_to_stored(self) -> int:
        """A partial sum or a value without table can be addressed."""
        return self.row + 1

    @property
    def element_to_state(self) -> int:
        """The new state can be addressed."""
        return self.acc + 1

    @property
    def element_to_table(self) -> int:
        """The tanh index is at the table port."""
        return self.acc + 1

    @property
    def element_to_activated(self) -> int:
        """Its tanh can be addressed in the T memory."""
        return self.acc + 3

    @property
    def added(self) -> int:
        """The slot in which the product of any element's issue is added."""
        return self.acc - 1

    @property
    def valid(self) -> int:
        """The slot in which the lane gets that enable."""
        return self.added - self.early


def timing(config: AcceleratorConfig) -> Timing:
    """Latencies of the configured lanes."""
    kind = config.hardware.lane_type
    return Timing(
        acc=3, gap=int(kind == "dsp"), chain=int(config.hardware.lanes > 1), early=int(kind == "plain")
    )
