"""Public names of rtl.common: ports, layouts, memories, number formats in hardware."""

from eskin.rtl.common.collisions import (
    NO_COLLISION,
    open_collisions,
    without_contents,
    working_memory,
    written_memories,
)
from eskin.rtl.common.compare import exceeds, greater, reaches
from eskin.rtl.common.fixed import (
    biased_magnitude,
    clip,
    logarithm,
    narrow,
    not_all_equal,
    saturate,
    shape_of,
    wrapping_increment,
)
from eskin.rtl.common.frame_gap import frame_gap
from eskin.rtl.common.layouts import (
    beat_layout,
    centred_layout,
    comes,
    decision_layout,
    expands,
    frame_layout,
    has_door,
    margin_units,
    sample_layout,
    stored,
    sum_layout,
    touch_layout,
    window_layout,
)
from eskin.rtl.common.load_port import HOST_BITS, image_lines, lines_signature, load_lines, load_signature
from eskin.rtl.common.mac16 import sb_mac16
from eskin.rtl.common.memory_style import (
    CHIP,
    SMALL_FAMILY,
    addends_memory,
    before_an_adder,
    begins_as_told,
    lanes_in_large_memories,
    means_memory,
    program_memory,
    prototypes_memory,
    short_of_blocks,
)
from eskin.rtl.common.one_port_memory import OnePortMemory
from eskin.rtl.common.ports import Block, bare, drive, forward, inputs, members_but, outputs, struct
from eskin.rtl.common.register_check import at_end, parity_wrong
from eskin.rtl.common.status import ENGINE, FRAMES, TEACHING, detector_status, probe
