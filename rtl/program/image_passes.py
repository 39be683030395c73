"""Program of the image engine: a network's layers as passes, their words, the contents of the memories, and
the cycles. No hardware.

A **pass** is a convolution with the pool behind it, or a dense layer: a convolution of kernel 1 over a map of
one place. It makes one **sum** after the other: place by place of the result map, group by group of channels
(a channel a lane), and with a pool the up to four places under a window in a row. A sum has a **tap** (one
activation, one weight a lane) for each product inside the map.

A convolution with a pool whose channels fill half of the lanes works in **pairs**: the other half makes the
place on the right. Its kernel is a column wider, with zeros in the column that a half has no use for, so both
halves see the same activation in a cycle.

A **slot** starts a sum: one cycle in which lanes and chain swap, then a tap a cycle. Meanwhile the sums of
the slot before leave the chain lane by lane, the next sum's biases come in, and its first addresses are
walked to, one step a cycle.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import NamedTuple

import numpy as np

from eskin.golden.core import AcceleratorConfig, Arrays, Conv, Dense, Pool, QFormat
from eskin.golden.core.images import Stage, accumulator_bits

PASS_WORDS = 10
"""16-bit words of a pass."""
DENSE_WORD_BITS = 32
"""Bits that the memories of dense weights give in a cycle: two memories of one port and 16 bits."""
SLOT_CYCLES = 1
"""Cycles of a slot beside its taps."""
FETCH_CYCLES = PASS_WORDS + 3
"""Cycles from the end of a pass, or the start of an image, to the first slot of the next pass."""
DRAIN_CYCLES = 4
"""Cycles beyond one per lane, from the last slot's start until its results are written."""


class Word(IntEnum):
    """Words of a pass, in the order in which they are fetched."""

    FLAGS = 0  # bits 0-1: (kernel - 1) / 2; 2: pool; 3: weights in the dense memories; 4: last pass; 5: pairs; 8-12: shift
    EXTENT = 1  # columns - 1, rows - 1 of the map before, a byte each
    GROUPS = 2  # groups - 1, channels of the last group - 1, a byte each
    CHANNELS = 3  # of the map before; of a dense layer all its values
    ROW = 4  # values of a row of the map before
    KERNEL_ROW = 5  # weights of a row of a kernel, of a pair the wider one
    GROUP = 6  # weights of a channel
    WEIGHTS = 7  # address of the first
    CORNER = 8  # address of the first tap of the first sum, modulo 2^16: it may lie above and left of the map
    ADDENDS = 9  # address of the first bias


class Slot(NamedTuple):
    """begin: its first cycle. place: (row, column, dy, dx) of its sum; None: it has none. taps: of the
    sum."""

    begin: int
    place: tuple[int, int, int, int] | None
    taps: int


@dataclass(frozen=True, kw_only=True)
class Pass:
    """One pass.

    rows, columns, channels: of its input map, which a dense layer sees as one place. outputs: channels of its
    result. group: lanes that it fills at once. pairs: these make the channels of two places. weights,
    addends: where this pass's addends begin. number: of its layer.
    """

    number: int
    rows: int
    columns: int
    channels: int
    kernel: int
    outputs: int
    pool: bool
    dense: bool
    last: bool
    shift: int
    group: int
    pairs: bool
    weights: int
    addends: int

    @property
    def groups(self) -> int:
        """Groups of channels; the last may be smaller."""
        return 1 if self.pairs else -(-self.outputs // self.group)

    @property
    def span(self) -> int:
        """Columns that a sum's taps cover: the kernel's, of a pair one more."""
        return self.kernel + self.pairs

    @property
    def taps(self) -> int:
        """Taps of all groups' sums in the middle of the map: words of weights."""
        return self.groups * self.kernel * self.span * self.channels

    @property
    def radius(self) -> int:
        """Places that a kernel reaches beyond its centre."""
        return self.kernel // 2

    @property
    def multiplies(self) -> int:
        """Products, those with the zeros around the map counted."""
        return self.rows * self.columns * self.kernel**2 * self.channels * self.outputs

    @property
    def result(self) -> tuple[int, int, int]:
        """Rows, columns, channels of the map it leaves."""
        step = 2 if self.pool else 1
        return -(-self.rows // step), -(-self.columns // step), self.outputs

    def words(self) -> list[int]:
        """Its words, in the order of `Word`."""
        row, kernel_row = self.columns * self.channels, self.span * self.channels
        flags = (
            self.radius
            | self.pool << 2
            | self.dense << 3
            | self.last << 4
            | self.pairs << 5
            | self.shift << 8
        )
        last_group = self.group if self.pairs else self.outputs - (self.groups - 1) * self.group
        values = {
            Word.FLAGS: flags,
            Word.EXTENT: self.columns - 1 | self.rows - 1 << 8,
            Word.GROUPS: self.groups - 1 | last_group - 1 << 8,
            Word.CHANNELS: self.channels,
            Word.ROW: row,
            Word.KERNEL_ROW: kernel_row,
            Word.GROUP: self.kernel * kernel_row,
            Word.WEIGHTS: self.weights,
            Word.CORNER: -self.radius * (row + self.channels),
            Word.ADDENDS: self.addends,
        }
        return [values[word] & 0xFFFF for word in Word]

    def sums(self) -> Iterator[tuple[int, int, int, int]]:
        """(row, column, dy, dx) of every sum of a group, in order: its place (of a pair the left one), and
        that in the pool's window."""
        step = 2 if self.pool else 1
        for top in range(0, self.rows, step):
            for left in range(0, self.columns, step):
                for _ in range(self.groups):
                    for dy in range(min(step, self.rows - top)):
                        for dx in range(1 if self.pairs else min(step, self.columns - left)):
                            yield top + dy, left + dx, dy, dx

    def inside(self, place: int, extent: int) -> int:
        """Taps of a kernel along one axis that lie in the map."""
        return min(place, self.radius) + 1 + min(extent - 1 - place, self.radius)

    def across(self, column: int) -> int:
        """Columns of a sum's taps that lie in the map; ``column``: its place."""
        return min(column, self.radius) + 1 + min(self.columns - 1 - column, self.radius + self.pairs)

    def slots(self, lanes: int) -> Iterator[Slot]:
        """The slots in order, cycles counted from the fetch of the pass's words.

        The first slot has no taps and brings in the first biases. Then there is one a sum. In the last, again
        without taps, the last sums leave.
        """
        begin = FETCH_CYCLES
        sums = list(self.sums())
        yield Slot(begin, None, 0)
        begin += max(lanes + 1, self._walk(*sums[0]) - 1)
        for place, following in zip(sums, [*sums[1:], None], strict=True):
            row, column, _, _ = place
            taps = self.inside(row, self.rows) * self.across(column) * self.channels
            yield Slot(begin, place, taps)
            begin += max(SLOT_CYCLES + taps, lanes + 1, self._walk(*following) if following else 0)
        yield Slot(begin, None, 0)

    def cycles(self, lanes: int) -> int:
        """Cycles from the fetch of its words until its map is written."""
        *_, last = self.slots(lanes)
        return last.begin + lanes + DRAIN_CYCLES

    def _walk(self, row: int, column: int, dy: int, dx: int) -> int:
        """Cycles from a slot's start until the addresses of the next sum are ready."""
        skipped = self.kernel - self.inside(row, self.rows) + self.span - self.across(column)
        return 3 + dy + dx + skipped


class ImagePlan:
    """A network on a number of lanes.

    Parameters
    ----------
    stages:
        `eskin.golden.core.images.layer_stages`.
    weight_bits, shifts, logit_format:
        Number formats: bits of a weight, a shift for each layer with weights, the format of logits.
    checksum:
        Passes and biases have check words and bits (`eskin.rtl.program.image_signature`).
    lanes:
        P: channels at once in a convolution; 1, 2, 4, 8 or 16. Dense layers have as many as their memories
        give weights for in a cycle.

    Attributes
    ----------
    passes:
        In their order. A dense layer's weights begin with a word of the memories. pairs: one of them works in pairs.
    dense_lanes, dense_taps:
        Lanes that work in a dense layer; taps whose weights one word of the dense memories holds.
    accumulator_bits:
        Bits of a sum: enough for any weights and biases.
    map_values:
        Values that each of the two memories of maps holds at most: the image and every second map, and the others.
    conv_words, dense_words, columns:
        Words, a weight a lane, of all convolutions; of the dense memories; 16-bit memories that hold one of the former.
    addend_words:
        Biases, groups filled up to their lanes; with ``checksum`` the last one to all lanes, which take it in.
    program_words:
        Words of the passes; with ``checksum`` one more each, and two of the last one.
    address_bits:
        Bits of an address of an activation or of a tap's weights, and of a count of either.
    multiplies:
        Products of an image, those with the zeros around the maps counted.
    """

    def __init__(
        self,
        stages: Sequence[Stage],
        *,
        weight_bits: int,
        shifts: Sequence[int],
        logit_format: QFormat,
        lanes: int,
        checksum: bool = False,
    ):
        self.stages, self.weight_bits, self.logit_format = tuple(stages), weight_bits, logit_format
        self.lanes, self.checksum = lanes, checksum
        self.dense_lanes = min(lanes, DENSE_WORD_BITS // weight_bits)
        self.dense_taps = DENSE_WORD_BITS // weight_bits // self.dense_lanes
        self.accumulator_bits = accumulator_bits(self.stages, weight_bits, tuple(shifts))
        passes = self.passes = self._passes(shifts)
        self.pairs = any(pass_.pairs for pass_ in passes)
        sizes = [math.prod(self.stages[0].source), *(math.prod(pass_.result) for pass_ in passes[:-1])]
        self.map_values = max(sizes[0::2]), max(sizes[1::2], default=1)
        self.conv_words = sum(pass_.taps for pass_ in passes if not pass_.dense)
        self.dense_words = sum(
            -(-pass_.groups * pass_.channels // self.dense_taps) for pass_ in passes if pass_.dense
        )
        self.columns = -(-lanes * weight_bits // 16)
        self.addend_words = sum(pass_.groups * pass_.group for pass_ in passes)
        self.addend_words += checksum * (lanes - passes[-1].group)
        self.program_words = (PASS_WORDS + checksum) * len(passes) + checksum
        taps = max(self.conv_words, self.dense_words * self.dense_taps)
        self.address_bits = max(*self.map_values, taps, self.addend_words).bit_length()
        self.multiplies = sum(pass_.multiplies for pass_ in passes)

    def _passes(self, shifts_of_layers: Sequence[int]) -> tuple[Pass, ...]:
        passes: list[Pass] = []
        shifts, place, addends = iter(shifts_of_layers), {False: 0, True: 0}, 0
        for stage, following in zip(self.stages, [*self.stages[1:], None], strict=True):
            if isinstance(stage.layer, Pool):
                continue
            dense, pool = (
                isinstance(stage.layer, Dense),
                following is not None and isinstance(following.layer, Pool),
            )
            conv = isinstance(stage.layer, Conv)
            rows, columns, channels = (1, 1, math.prod(stage.source)) if dense else stage.source
            pass_ = Pass(
                number=stage.number,
                rows=rows,
                columns=columns,
                channels=channels,
                kernel=1 if isinstance(stage.layer, Dense) else stage.layer.kernel,
                outputs=stage.outputs,
                pool=pool,
                dense=dense,
                last=stage.last,
                shift=next(shifts),
                group=self.dense_lanes if dense else self.lanes,
                pairs=pool and conv and 2 * stage.outputs == self.lanes,
                weights=place[dense],
                addends=addends,
            )
            passes.append(pass_)
            place[dense] += pass_.taps
            if dense:
                place[True] = -(-place[True] // self.dense_taps) * self.dense_taps
            addends += pass_.groups * pass_.group
        return tuple(passes)

    def program(self) -> list[int]:
        """Words of all passes."""
        return [word for pass_ in self.passes for word in pass_.words()]

    def addends(self, arrays: Arrays) -> list[int]:
        """Biases with the rounding half of their layer."""
        words = []
        for pass_ in self.passes:
            half = 1 << pass_.shift - 1 if pass_.shift else 0
            biases = [int(value) + half for value in arrays[f"b_{pass_.number}"]] * (1 + pass_.pairs)
            words += biases + [0] * (pass_.groups * pass_.group - len(biases))
        return words + [0] * (self.addend_words - len(words))

    def dense_weights(self, arrays: Arrays) -> list[int]:
        """Words of the dense memories: the first tap's weights in the lowest bits."""
        words, bits = [], self.dense_lanes * self.weight_bits
        for pass_ in self.passes:
            if pass_.dense:
                taps = self.packed(pass_, arrays)
                taps += [0] * (-len(taps) % self.dense_taps)
                for first in range(0, len(taps), self.dense_taps):
                    words.append(
                        sum(tap << bits * k for k, tap in enumerate(taps[first : first + self.dense_taps]))
                    )
        return words

    def packed(self, pass_: Pass, arrays: Arrays) -> list[int]:
        """The weights of a pass's taps, its lanes' side by side, lane 0's in the lowest bits."""
        rows = np.asarray(arrays[f"W_{pass_.number}"], dtype=np.int64) & (1 << self.weight_bits) - 1
        if pass_.pairs:
            west, east = (np.pad(rows, ((0, 0), (0, 0), zeros, (0, 0))) for zeros in ((0, 1), (1, 0)))
            rows = np.concatenate([west, east])
        rows = rows.reshape(len(rows), -1)
        words = []
        for first in range(0, len(rows), pass_.group):
            group = rows[first : first + pass_.group]
            for tap in range(rows.shape[1]):
                words.append(
                    sum(int(weight) << self.weight_bits * lane for lane, weight in enumerate(group[:, tap]))
                )
        return words

    @cached_property
    def cycles(self) -> int:
        """Cycles from the start of an image until the engine is done."""
        return sum(pass_.cycles(self.lanes) for pass_ in self.passes)

    @property
    def logit_cycles(self) -> int:
        """Cycles from the start of an image until its last logit is given; lanes without a class follow
        it."""
        last = self.passes[-1]
        return self.cycles - (self.lanes - (last.outputs - (last.groups - 1) * last.group))


def plan_of(config: AcceleratorConfig) -> ImagePlan:
    """The network of a configuration for images, on its lanes."""
    return ImagePlan(
        config.stages,
        weight_bits=config.weight_bits,
        shifts=config.layer_shifts,
        logit_format=config.formats.logit_format,
        lanes=config.hardware.lanes,
        checksum=config.hardware.checksum,
    )
