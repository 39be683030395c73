"""What the host sees: the register map of the bus, and the memory images that an integer model becomes.

Plain Python (no Amaranth), so that command line, C header and benches can share it.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum, IntFlag

import numpy as np

from golden.config import AcceleratorConfig
from rtl.microcode import Layout, Microcode
from rtl.schedule import CellProgram, RowGroup, is_compact, schedule
from rtl.signature import check_words, parity

ID_VALUE = 0xE5C1
VERSION_VALUE = 3
ADDRESS_BITS = 5
"""Bits of a register's address that are looked at; one more with a fault detector."""


class Register(IntEnum):
    """Addresses of 16-bit registers."""

    ID = 0x00  # ro: 0xE5C1
    VERSION = 0x01  # ro: version of this map
    CONTROL = 0x02  # wo: Control bits, each a command
    STATUS = 0x03  # ro: Status bits
    FAULTS = 0x04  # ro: Fault bits, sticky until Control.CLEAR_FAULTS
    LONGEST = 0x05  # ro: the most of what MEASURE names, saturating
    MEASURE = 0x06  # wo: a Measure; writing it begins anew
    TOUCHES = 0x07  # ro: touches begun since arm, modulo 256
    MEMORY_SELECT = 0x08  # wo: Memory to load from its first word on
    MEMORY_DATA = 0x09  # wo: the next 16-bit word
    MASK = 0x10  # wo: 16 taxels a register from here on, bit set = taxel out of use
    TAXEL_FAULTS = 0x20  # ro, with a fault detector: 16 taxels a register from here on, bit set = flag raised; between frames


class Control(IntFlag):
    """Commands."""

    ARM = 1  # begin a recording: clear ring, rest levels, sums, state, a cycle after the write; frames from then on
    FINISH = 2  # the recording has ended: decide an open touch as partial
    CLEAR_FAULTS = 4  # clear FAULTS and LONGEST


class Measure(IntEnum):
    """What LONGEST is the most of since it was chosen or cleared."""

    FRAME = 0  # from a frame's first beat offered to its last beat taken
    STEP = 1  # slots (cycles, but for several serial lanes) of a step, up to its last logit
    WINDOWS = 2  # without a break, from a window's last taxel taken by the engine until no window waits and the last one's logits are out


class Status(IntFlag):
    """Status bits."""

    ARMED = 1  # waiting for an onset
    TOUCH = 2  # a touch is open (onset found, its last decision not yet given)
    BUSY = 4  # a frame, sum, step, decision or command is in flight
    NO_TOUCH = 8  # no onset since arm
    FAULT = 16  # CHECKSUM or WATCHDOG is set in FAULTS


class Fault(IntFlag):
    """Sticky faults."""

    WRITE_REFUSED = 1  # a memory write was dropped: it came during a touch, or (``checksum``) behind the memory's last word
    INPUT_STALLED = 2  # a frame was offered while not ready: at the sensor's pace, an overrun
    FRAMING = 4  # first/last did not agree with the number of taxels
    OVERRUN = 8  # a window was complete while both feature slots were waiting
    CHECKSUM = 16  # a word of a memory or a configuration register is wrong (``checksum``)
    WATCHDOG = 32  # the chain hung and was put back to idle (``watchdog``)
    TAXEL = 64  # the fault detector raised a taxel's flag: TAXEL_FAULTS


class Memory(IntEnum):
    """Values of MEMORY_SELECT; lanes' weights are 0..lanes-1."""

    ADDENDS = 0x40  # words of 2 x 16 bits, low half first
    CONSTANTS = 0x41
    MEANS = 0x42  # words of as many 16-bit words as a window sum needs, low word first


def memory_images(
    config: AcceleratorConfig, arrays: Mapping[str, np.ndarray], program: CellProgram | None = None
) -> dict[int, list[int]]:
    """Integer contents of every memory by MEMORY_SELECT value.

    Lanes: weight codes in the order the schedule reads them (0 for a lane without a row). ADDENDS: biases at product scale plus the
    rounding half of their narrowing, room for partial sums, and the half of element-wise operations where they share a lane. CONSTANTS:
    the scales, one, zero, with ``checksum`` the check words; on a shared lane the dense layer's weights too, each row from a power of two
    on. MEANS: one a window length.
    The compact engine has the weights' bits in the order of their use, and CONSTANTS with bias codes and scales as its data memory begins
    (`rtl.compact_program`); ADDENDS it has none.
    ``program``: another cell's, with its arrays; the configured cell's by default.
    """
    plan = schedule(config, program)
    means = [int(mean) for mean in arrays["mean"]]
    if is_compact(config):
        code = plan.compact
        return {0: code.weight_image(arrays), Memory.CONSTANTS: code.constant_image(arrays), Memory.MEANS: means}

    def weight(lane: int, group: RowGroup, matrix: str, column: int) -> int:
        return int(arrays[matrix][group.first_row + lane, column]) if lane < group.rows else 0

    images: dict[int, list[int]] = {lane: [weight(lane, *word) for word in plan.weight_words] for lane in range(config.lanes)}
    shifts = {
        "sigmoid": config.sigmoid_shift, "tanh": config.tanh_shift, "value": config.value_shift, "logit": config.logit_shift,
    }  # fmt: skip
    addends = []
    for block, row in plan.bias_rows:
        scale = config.dense_bias_shift if block.narrowing == "logit" else config.bias_shift
        addends.append((int(arrays[block.bias][row]) << scale) + (1 << shifts[block.narrowing] - 1))
    half = [1 << config.gate_frac - 1] if plan.shared else []
    images[Memory.ADDENDS] = addends + [0] * plan.partial_rows + half
    images[Memory.CONSTANTS] = constants = [*(int(scale) for scale in arrays["scale"]), config.gate_one, 0]
    place = Layout(config, plan.program)
    for op in (*plan.mac_before, *plan.mac_after):
        if plan.beside(op):
            group = plan.groups[op.group]
            constants += [0] * (place.dense_offset(group.first_row) + op.index - len(constants))
            constants.append(weight(0, group, group.block.terms[op.term][0], op.index))
    images[Memory.MEANS] = means
    if config.checksum:
        code = Microcode(plan)
        constants += [0] * (code.layout.constant_words - len(constants))
        found = check_words(code, [images[lane] for lane in range(config.lanes)], images[Memory.ADDENDS], constants)
        constants[place.check_base : place.check_base + len(found)] = found
        images[Memory.MEANS] = [mean_word(config, mean) for mean in images[Memory.MEANS]]
    return images


def mean_word(config: AcceleratorConfig, mean: int) -> int:
    """A word of the means' memory with ``checksum``: the mean, and on top the bit that makes the number of ones even."""
    top = 16 * config.mean_words - 1
    return mean & (1 << top) - 1 | parity(mean, top) << top


def memory_words(config: AcceleratorConfig) -> dict[int, int]:
    """Words of every memory that the host loads, by MEMORY_SELECT value."""
    plan = schedule(config)
    if is_compact(config):
        return {0: plan.compact.weight_words, Memory.CONSTANTS: plan.compact.constant_words, Memory.MEANS: len(config.window_lengths)}
    return {lane: len(plan.weight_words) for lane in range(config.lanes)} | {
        Memory.ADDENDS: plan.addend_words, Memory.CONSTANTS: Layout(config, plan.program).constant_words,
        Memory.MEANS: len(config.window_lengths),
    }  # fmt: skip


def words_per_entry(config: AcceleratorConfig, select: int) -> int:
    """16-bit words of one entry of a memory, low word first."""
    return {Memory.ADDENDS: 2, Memory.MEANS: config.mean_words}.get(select, 1)


def load_words(config: AcceleratorConfig) -> int:
    """16-bit words of the largest memory that the host loads."""
    return max(count * words_per_entry(config, select) for select, count in memory_words(config).items())


def load_writes(config: AcceleratorConfig, arrays: Mapping[str, np.ndarray]) -> list[tuple[int, int]]:
    """The (register, 16-bit word) writes that load an integer model over the bus, masked taxels included."""
    writes: list[tuple[int, int]] = []
    for select, words in memory_images(config, arrays).items():
        halves = words_per_entry(config, select)
        writes.append((Register.MEMORY_SELECT, int(select)))
        writes += [(Register.MEMORY_DATA, word >> 16 * half & 0xFFFF) for word in words for half in range(halves)]
    for base in range(0, config.taxels, 16):
        mask = sum(1 << taxel - base for taxel in config.masked_taxels if base <= taxel < base + 16)
        writes.append((Register.MASK + base // 16, mask))
    return writes
