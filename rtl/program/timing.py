"""Cycles that follow from the configuration alone: lanes, latencies.

A slot is the time of one program word: one cycle, or as long as the program waits for a window.
"""

from eskin.golden.core import AcceleratorConfig

ELEMENT_OPERAND_BITS = 16


SCALE_BITS = 15
"""Bits of a scale, which is positive; trees' engine adds a product up from them, one a cycle."""
SCALING_CYCLES = SCALE_BITS + 3
"""Cycles from a sum to the next one in the engine of trees: read, load, SCALE_BITS, store."""


def forest_cycles(config: AcceleratorConfig) -> int:
    """Cycles of a step of trees up to its last logit."""
    walks = 2 * config.forest.trees * config.forest.depth
    return 2 * config.classes + SCALING_CYCLES * config.inputs + walks + 3


STATE_BEATS = 3
"""Read-after-write distance of the per-taxel state memories, in beats."""
VERDICT_CYCLES = 3
"""Cycles for which the last beat of a frame waits for the verdict on an onset."""
FRAME_EXTRA_CYCLES = 4 + VERDICT_CYCLES
"""Most cycles of a frame beyond its taxels' cycles: the way to the windows, the read of the mean, the verdict."""


def detector_latency(config: AcceleratorConfig) -> int:
    """Cycles from a sample to its deviation: 1 without rest level, 2 with, 3 with clip."""
    return 1 + (config.rest_level.rest != "none") + bool(config.rest_level.clip)


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


class Timing:
    """Latencies of the configured engine in slots; rtl/engine/engine.py is built to these.

    A row's are counted from the issue of its group's last element, row p's p slots later; an element-wise
    operation's from the issue of its last term.

    Attributes
    ----------
    acc:
        The lane's accumulator holds the sum: address, operands, product and sum.
    gap:
        Slots lost on a lane between two dot products: the DSP block's own accumulator is loaded in place of
        an addition.
    chain:
        One where several lanes' sums are captured and forwarded one by one.
    added, valid:
        The slot in which the product of any element's issue is added; in which the lane gets the enable of that.
    row:
        Row 0's sum is at the table, the classifier or the addend memory; its value at the T memory.
    row_to_gate, row_to_stored:
        A gate or T value can be addressed: table, write, read; a partial sum or a value without table can be.
    element_to_state, element_to_table, element_to_activated:
        The new state can be addressed; the tanh index is at the table port; its tanh can be addressed in the T memory.
    """

    def __init__(self, config: AcceleratorConfig):
        kind = config.hardware.lane_type
        self.acc, self.gap, self.chain = 3, int(kind == "dsp"), int(config.hardware.lanes > 1)
        self.added = self.acc - 1
        self.valid = self.added - int(kind == "plain")
        self.row = self.acc + self.chain
        self.row_to_gate, self.row_to_stored = self.row + 2, self.row + 1
        self.element_to_state = self.element_to_table = self.acc + 1
        self.element_to_activated = self.acc + 3
