"""The configuration of one accelerator: every size, rule and number format, with units, and the quantities
derived from them.

Shared by the golden model and the hardware generator. A configuration that cannot work is refused on
construction, before any long work starts.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from eskin.golden.core import images
from eskin.golden.core.converters import Converter
from eskin.golden.core.errors import InputError
from eskin.golden.core.formats import QFormat, signed_bits
from eskin.golden.core.group import Refusal
from eskin.golden.core.groups import (
    GROUP_OF,
    GROUPS,
    Faults,
    Features,
    Forest,
    Formats,
    Hardware,
    Image,
    Interface,
    Network,
    Onset,
    ReadoutRule,
    RestLevel,
    Sensor,
    Windows,
)

WIDEST_ACCUMULATOR = 48
"""Largest width of a row accumulator, bits. At this width an addend takes three host words, and float64 holds
every sum exactly."""

MOST_INPUTS = 512
"""Highest number of inputs of a network."""

VOTE_BITS = 8
"""Bits of a tree's vote, signed, in units of a logit's last place."""

WIDEST_SCORE = 16
"""Bits of a score, and of a margin."""

MOST_TAUGHT = 255
"""Highest number of taught-touch slots; the count must fit the 8-bit field of register TAUGHT."""

WIDEST_DSP_ACCUMULATOR = 32
"""Bits of the accumulator inside an SB_MAC16."""

IMAGE_ROWS_HZ = 1000.0
"""Default rows of an image per second; a still image has no rate."""

MOST_MEAN_FRAC = 10
"""Highest number of fraction bits of the normaliser's means. Sensors with two code levels need them, because
their windows differ by a few counts."""

RING_SLACK_FRAMES = 8
"""Frames that the pre-trigger ring can hold beyond its history while the rest of the chain is held up."""


@dataclass(frozen=True, kw_only=True)
class AcceleratorConfig:
    """One accelerator. docs/specification.md defines each rule; widths and counts derived here are
    used by model and RTL alike.

    The fields stand in groups (groups.py): ``config.sensor.taxels``. Each group checks itself; this class
    checks conditions between groups.

    Raises
    ------
    InputError
        One sentence that names the field and the fix.
    """

    name: str = "custom"
    sensor: Sensor = Sensor()
    rest_level: RestLevel = RestLevel()
    onset_rule: Onset = Onset()
    faults: Faults = Faults()
    windows: Windows = Windows()
    features: Features = Features()
    network: Network = Network()
    readout_rule: ReadoutRule = ReadoutRule()
    forest: Forest = Forest()
    image: Image = Image()
    formats: Formats = Formats()
    hardware: Hardware = Hardware()
    interface: Interface = Interface()

    # ------------------------------------------------------------------ checks
    def __post_init__(self) -> None:
        name = self.name
        printable = isinstance(name, str) and name.isprintable() and not set(name) & set("/\\")
        if not printable or len(name.encode()) > 100:
            raise InputError(
                f"configuration, field name: is {name!r:.120}; give up to 100 printable letters without / "
                "and \\"
            )
        for field, why in self._refusals():
            raise InputError(f"configuration '{name}', field {field}: {why}")

    def _refusals(self) -> Iterator[Refusal]:
        """Reasons why fields do not fit together. The user sees the first one."""
        yield from self._front_end_refusals()
        if self.is_image:
            yield from self._image_refusals()
        else:
            yield from self._feature_refusals()
            yield from self._forest_refusals() if self.is_forest else self._format_refusals()
            yield from self._readout_refusals()
        # the front end takes an input every second cycle
        clock, least = self.hardware.clock_hz, 2 * self.inputs * self.sensor.scan_rate_hz
        if clock < least:
            kinds = f" with {self.kinds} kinds of feature" if self.kinds > 1 else ""
            yield (
                "clock_hz",
                f"is {clock:g}: {clock / self.sensor.scan_rate_hz:.3g} cycles a frame cannot take "
                f"{self.sensor.taxels} taxels{kinds}; use at least {least:g}",
            )
        yield from self.interface.converter.misfits(self)
        if self.interface.position:
            yield from self._position_refusals()
        yield from self._stimulator_refusals()

    def _front_end_refusals(self) -> Iterator[Refusal]:
        rest, rule, windows, network = self.rest_level.rest, self.onset_rule, self.windows, self.network
        lowest, bits, before = self.sample_format.min_code, self.sensor.sample_bits, windows.pretrigger_frames
        if rest == "tracked" and rule.onset == "immediate":
            yield (
                "rest",
                "is 'tracked' with onset 'immediate', where the gate is never closed; use 'initial' or "
                "'none'",
            )
        if rule.onset == "band" and not 0 <= rule.band_low - lowest <= rule.band_high - lowest:
            yield (
                "band_low",
                f"is {rule.band_low} with band_high {rule.band_high}; give two sample codes, the lower one first",
            )
        if rule.onset == "baseline" and rest == "none":
            yield "rest", "is 'none' with onset 'baseline', which needs a rest level; use 'tracked'"
        if self.faults.fault_frames and bits < 4:
            yield (
                "fault_frames",
                f"is {self.faults.fault_frames} with samples of {bits} bits, and a fault detector needs at least 4; give 0",
            )
        if windows.window_mode == "touch":
            if self.opens_at_once and before:
                yield "pretrigger_frames", "must be 0 when the gate opens at once"
            if not self.opens_at_once and rule.rearm_frames < self.ring_frames:
                yield (
                    "rearm_frames",
                    f"is {rule.rearm_frames}; it must be at least {self.ring_frames}, the frames the "
                    "pre-trigger ring holds",
                )
            if self.last_frame < before + 2:
                yield (
                    "pretrigger_frames",
                    f"is {before}, but a touch ends with its frame {self.last_frame}, which must come after "
                    "the onset; lower pretrigger_frames or raise steps or hop",
                )
        if self.follows_touch and network.decision == "early":
            yield (
                "decision",
                "is 'early' with window_mode 'whole', which decides at the end; use 'last' or 'vote'",
            )
        if self.follows_touch and not self.opens_at_once and rule.rearm_frames < windows.hop:
            yield (
                "rearm_frames",
                f"is {rule.rearm_frames}; with window_mode 'whole' it is at least one hop, {windows.hop} frames",
            )
        if network.decision == "early" and network.early_steps > windows.steps:
            yield (
                "early_steps",
                f"is {network.early_steps} in a touch of {windows.steps} steps; give at most {windows.steps}",
            )

    def _feature_refusals(self) -> Iterator[Refusal]:
        features, hop, bits, lengths = self.features, self.windows.hop, self.sum_bits, self.window_lengths
        shifts, kinds = features.feature_shift, features.feature_kinds
        if self.inputs > MOST_INPUTS:
            yield (
                "feature_kinds",
                f"{self.kinds} kinds of {self.sensor.taxels} taxels make {self.inputs} inputs, above the limit of "
                f"{MOST_INPUTS}; use fewer kinds",
            )
        common = math.gcd(hop, *lengths)
        if "activity" in kinds and common % features.activity_block:
            works = ", ".join(str(block) for block in range(1, 65) if common % block == 0)
            yield (
                "activity_block",
                f"is {features.activity_block} with hops of {hop} and windows of "
                f"{', '.join(map(str, lengths))} frames; blocks must fill both: use {works}",
            )
        knee, width = features.integral_knee, self.integral_bits
        # 2**knee is added to a magnitude before its logarithm; the sum still fits the word if 2**knee is at
        # most half of the largest magnitude
        if "integral" in kinds and knee > width - 2:
            yield "integral_knee", f"is {knee} for integrals of {width} bits; give at most {width - 2}"
        if len(shifts) not in (0, len(self.feature_units)):
            of_kinds = f" of {self.kinds} kinds of feature" if self.kinds > 1 else ""
            yield (
                "feature_shift",
                f"has {len(shifts)} values for {len(lengths)} distinct window lengths{of_kinds}",
            )
        if any(not -self.most_mean_frac <= shift <= bits for shift in shifts):
            yield "feature_shift", f"must lie in {-self.most_mean_frac}..{bits}"

    def _format_refusals(self) -> Iterator[Refusal]:
        formats, lane = self.formats, self.hardware.lane_type
        if self.recurrent:
            yield from self._recurrent_refusals()
        if self.logit_shift < 1:
            yield (
                "logit_format",
                f"{formats.logit_format} is finer than the dense products; lower its fraction bits",
            )
        if self.dense_bias_shift < 0:
            yield (
                "dense_bias_format",
                f"{formats.dense_bias_format} is finer than the dense products; lower its fraction bits",
            )
        bits = self.accumulator_bits  # after the checks of the shifts, because its bound depends on them
        if bits > WIDEST_ACCUMULATOR:
            yield (
                "weight_format" if self.recurrent else "dense_format",
                f"needs a {bits}-bit accumulator in the worst case, above the limit of {WIDEST_ACCUMULATOR}; "
                "narrow the weights",
            )
        if lane == "dsp" and bits > WIDEST_DSP_ACCUMULATOR:
            yield (
                "lane_type",
                f"is 'dsp', whose accumulator has {WIDEST_DSP_ACCUMULATOR} bits, and these formats need "
                f"{bits}; use plain lanes or narrow the weights",
            )

    def _forest_refusals(self) -> Iterator[Refusal]:
        trees, logit = self.forest.trees, self.formats.logit_format
        if trees << VOTE_BITS - 1 > logit.max_code:
            yield (
                "trees",
                f"is {trees}, whose votes of {VOTE_BITS} bits do not add up in {logit}; use fewer trees or a wider "
                "logit_format",
            )
        if self.has_prototypes:
            yield "readout", "is 'prototypes', and trees have no trajectory to compare; use 'dense'"

    def _recurrent_refusals(self) -> Iterator[Refusal]:
        cell, reset = self.network.cell, self.network.reset
        feature = self.formats.feature_format
        state = self.formats.state_format
        bias = self.formats.bias_format
        if self.feature_align < 0:
            yield (
                "feature_format",
                f"{feature} has {-self.feature_align} fraction bits too many: input products must not be "
                "finer than recurrent ones (state + recurrent weight fraction bits)",
            )
        if self.operand_bits > 16:
            yield (
                "feature_format",
                f"{feature} needs {self.operand_bits} bits on the lanes' scale, above the limit of 16; raise the "
                "fraction bits of weight_format or lower those of recurrent_format or state_format",
            )
        for field, signal, shift in (
            ("table_entries", "sigmoid", self.sigmoid_shift),
            ("table_entries", "tanh", self.tanh_shift),
            ("recurrent_format", "value", self.value_shift),
        ):
            if shift < 1:
                yield (
                    field,
                    f"the {signal} narrowing would be {shift} bits; products need more fraction bits than "
                    "their result",
                )
        if (cell == "lstm" or reset == "after") and state.frac_bits < self.tanh_frac + 1:
            yield (
                "state_format",
                f"{state} needs at least {self.tanh_frac + 1} fraction bits to address the tanh table",
            )
        if cell == "gru" and state.frac_bits > 14:
            yield (
                "state_format",
                f"{state} has too many fraction bits; a GRU takes differences of states, which leave room "
                "for 14 in 16-bit operands",
            )
        if self.bias_shift < 0:
            yield (
                "bias_format",
                f"{bias} is finer than the products; it has at most {self.product_frac} fraction bits",
            )

    def _readout_refusals(self) -> Iterator[Refusal]:
        if not self.has_prototypes:
            return
        rule, most = self.readout_rule, (1 << WIDEST_SCORE - 1) - 1
        if self.distance_bound > most:
            yield (
                "state_code_bits",
                f"is {rule.state_code_bits}: distances of {self.trajectory_width} values per step reach "
                f"{self.distance_bound}, above the limit of {most}; use fewer bits",
            )
        if rule.state_code_shift >= self.trajectory_format.width:
            yield (
                "state_code_shift",
                f"is {rule.state_code_shift} and the values have {self.trajectory_format.width} bits; use less",
            )
        if self.classes - rule.spare_classes < 2:
            yield (
                "spare_classes",
                f"is {rule.spare_classes} of {self.classes} classes; leave at least two for training",
            )
        if rule.taught * self.classes > MOST_TAUGHT:
            yield (
                "taught",
                f"is {rule.taught} for each of {self.classes} classes; the limit is {MOST_TAUGHT} slots in all",
            )
        if not self.hardware.loadable:
            yield (
                "loadable",
                "is false, but the host must fill the memory of prototypes; set it to true, or quantise without "
                "`readout`",
            )
        # one more: the current touch has a slot, so that it can be taught after its end
        places = self.classes * (rule.prototypes + rule.taught) + 1
        if self.windows.steps * places * self.trajectory_width + self.classes > 1 << 16:
            yield (
                "prototypes",
                f"is {rule.prototypes} with {rule.taught} taught ones for each of {self.classes} classes; with "
                f"{self.windows.steps} steps of {self.trajectory_width} values they exceed a memory of 65536 "
                "words: use fewer",
            )
        if rule.unknown_above and self.network.decision == "vote":
            yield (
                "unknown_above",
                "is set with decision 'vote', which has no distance of a touch; use 'last' or leave it out",
            )
        if rule.unknown_above * self.windows.steps > self.distance_bound:
            yield (
                "unknown_above",
                f"is {rule.unknown_above}, and no touch of {self.windows.steps} steps can be that far from a "
                f"prototype; give at most {self.distance_bound // self.windows.steps}",
            )

    def _image_refusals(self) -> Iterator[Refusal]:
        image, cell, logit = self.image, self.network.cell, self.formats.logit_format
        if cell != "image" or not image.layers:
            yield (
                "cell",
                f"is '{cell}' with {len(image.layers)} layers in group image; cell 'image' and layers go "
                "together",
            )
        if (outputs := self.stages[-1].outputs) != self.classes:
            yield (
                "layers",
                f"end with {outputs} outputs and there are {self.classes} classes; give one each",
            )
        for field, fixed in _of_every_image(image).items():
            if self.value(field) != fixed:
                yield (
                    field,
                    f"is {self.value(field)!r} in a network for images, where it is always {fixed!r}",
                )
        for group in ("rest_level", "faults", "features", "readout_rule"):
            if getattr(self, group) != GROUPS[group]():
                yield group, "is set, and images have none of it; leave the group out"
        if self.interface.position or self.interface.converter.name != "none":
            yield "interface", "has a converter or position, which images do not have; leave it out"
        if logit.width != images.LOGIT_BITS:
            yield "logit_format", f"is {logit}; logits of images have {images.LOGIT_BITS} bits"
        for stage, shift in zip(self.weighted_stages, self.layer_shifts, strict=True):
            if not 0 <= shift <= images.MOST_SHIFT:
                yield (
                    "weight_formats",
                    f"make a shift of {shift} behind '{stage.layer}'; it must lie in 0..{images.MOST_SHIFT}: "
                    "quantise again",
                )

    def _position_refusals(self) -> Iterator[Refusal]:
        array, taxels, fmt = self.interface, self.sensor.taxels, self.sample_format
        if array.rows * array.columns != taxels:
            yield (
                "rows",
                f"is {array.rows} with {array.columns} columns, and there are {taxels} taxels; give "
                "the rows and columns of the array",
            )
        if taxels < 16:
            yield ("position", f"needs at least 16 taxels, and there are {taxels}; leave it out")
        if not fmt.min_code <= array.position_rest <= fmt.max_code:
            yield (
                "position_rest",
                f"is {array.position_rest}; give a sample, {fmt.min_code} to {fmt.max_code}",
            )
        if array.position_threshold >= fmt.max_code - array.position_rest:
            yield (
                "position_threshold",
                f"is {array.position_threshold}; no sample is that far above position_rest, so lower it",
            )

    def _stimulator_refusals(self) -> Iterator[Refusal]:
        source, electrodes = self.interface.stimulator, self.interface.electrodes
        if source == "positions" and not self.interface.position:
            yield (
                "stimulator",
                "is 'positions' without position; set position and the array's rows and columns",
            )
        if source == "decisions" and electrodes and len(electrodes) != self.classes:
            yield "electrodes", f"has {len(electrodes)} values for {self.classes} classes; give one each"
        if source == "decisions" and not electrodes and self.classes > 24:
            yield (
                "electrodes",
                f"is empty with {self.classes} classes and 24 electrodes; name one for each class",
            )

    # ------------------------------------------------------------------ sensor and windows
    @property
    def sample_format(self) -> QFormat:
        """Format of one A/D code."""
        return QFormat(self.sensor.sample_bits, 0, self.sensor.sample_signed)

    @property
    def classes(self) -> int:
        """Number of classes C."""
        return len(self.network.class_names)

    @property
    def wide_decisions(self) -> bool:
        """True if a class needs more than the 5 bits that a decision has for it; decisions then have the form
        of the decision word of section 17."""
        return self.classes > 32

    @property
    def fault_bits(self) -> int:
        """Lowest bits of a sample that the fault detector looks at."""
        return min(self.sensor.sample_bits, 8)

    @property
    def opens_at_once(self) -> bool:
        """True when the gate is open from frame 1 and one touch ends the recording."""
        return self.onset_rule.onset == "immediate"

    @cached_property
    def deviation_bits(self) -> int:
        """Bits of the signed deviation (sample - rest, clipped): the value that windows add up."""
        return signed_bits(self.deviation_bound)

    @property
    def deviation_bound(self) -> int:
        """Largest absolute deviation, codes."""
        span = (
            self.sample_format.magnitude
            if self.rest_level.rest == "none"
            else self.sample_format.max_code - self.sample_format.min_code
        )
        return min(self.rest_level.clip, span) if self.rest_level.clip else span

    @property
    def ring_frames(self) -> int:
        """Frames the pre-trigger ring holds: history, the frame of the onset, and slack."""
        return self.windows.pretrigger_frames + 1 + RING_SLACK_FRAMES

    @property
    def follows_touch(self) -> bool:
        """True if the windows divide the whole touch (``window_mode`` whole): every decision comes at its end."""
        return self.windows.window_mode == "whole"

    @property
    def stored_sums(self) -> int:
        """Sums that the store of ``window_mode`` whole holds of one taxel and kind."""
        return self.windows.steps * self.windows.store_per_window

    @cached_property
    def doublings(self) -> int:
        """How often the hop doubles in the longest touch of ``window_mode`` whole."""
        hops = self.windows.touch_frames // self.windows.hop
        return (hops // self.stored_sums).bit_length()

    @cached_property
    def window_spans(self) -> tuple[tuple[int, int], ...]:
        """First and last frame of windows 1..steps, 1-based from the start of the touch's first window.

        Free: ``hop (k-1) + 1 .. hop (k-1) + 2 hop``. Touch: the same with ``window`` frames, clipped at
        touch_frames. Whole: the spans of the longest touch, where all parts are equal.
        """
        if self.follows_touch:
            frames, steps = self.windows.touch_frames, self.windows.steps
            return tuple((frames * k // steps + 1, frames * (k + 1) // steps) for k in range(steps))
        # 1 << 62: beyond every frame, and still an int64
        limit = self.windows.touch_frames if self.windows.window_mode == "touch" else 1 << 62
        return tuple(
            (self.windows.hop * k + 1, min(self.windows.hop * k + self.windows.window, limit))
            for k in range(self.windows.steps)
        )

    @cached_property
    def window_lengths(self) -> tuple[int, ...]:
        """Distinct window lengths, frames, in order of first appearance; each has separate normaliser
        constants. Whole: 1 to ``store_per_window`` hops, in frames before the hop doubled."""
        if self.follows_touch:
            return tuple(self.windows.hop * (hops + 1) for hops in range(self.windows.store_per_window))
        return tuple(dict.fromkeys(last - first + 1 for first, last in self.window_spans))

    @cached_property
    def length_index(self) -> tuple[int, ...]:
        """For each window, the index of its length in window_lengths; whole: the longest, though each touch has
        separate ones (`Touches.lengths`)."""
        if self.follows_touch:
            return (self.windows.store_per_window - 1,) * self.windows.steps
        return tuple(self.window_lengths.index(last - first + 1) for first, last in self.window_spans)

    @property
    def last_frame(self) -> int:
        """Frame (1-based from the first window's start) that completes the last window: the end of the
        touch, whole: of the longest."""
        return self.window_spans[-1][1]

    @property
    def touch_s(self) -> float:
        """Seconds from the first window's start to the last one's end."""
        return self.last_frame / self.sensor.scan_rate_hz

    # ------------------------------------------------------------------ features
    @property
    def kinds(self) -> int:
        """Number of kinds of feature per taxel."""
        return len(self.features.feature_kinds)

    @property
    def inputs(self) -> int:
        """Inputs of the network, D = taxels x kinds: all kinds of taxel 0, then all of taxel 1, and so on."""
        return self.sensor.taxels * self.kinds

    @property
    def constants(self) -> int:
        """Number of normaliser constants per window length: one per kind, or with ``feature_scale`` taxel one
        per input."""
        return self.inputs if self.features.feature_scale == "taxel" else self.kinds

    @cached_property
    def input_kinds(self) -> tuple[int, ...]:
        """For each input the index of its kind in ``feature_kinds``."""
        return tuple(index % self.kinds for index in range(self.inputs))

    @cached_property
    def input_constants(self) -> tuple[int, ...]:
        """Index of each input's normaliser constants in ``constants``."""
        return tuple(index % self.constants for index in range(self.inputs))

    @cached_property
    def input_mask(self) -> tuple[bool, ...]:
        """For each input, True if its taxel is in ``masked_taxels``."""
        return tuple(index // self.kinds in self.sensor.masked_taxels for index in range(self.inputs))

    @property
    def deviation_span(self) -> int:
        """Largest difference of two deviations of a taxel, codes."""
        low, high = -self.deviation_bound, self.deviation_bound
        if self.rest_level.rest == "none":
            low, high = max(low, self.sample_format.min_code), min(high, self.sample_format.max_code)
        return max(high - low, 0)

    @property
    def block_bound(self) -> int:
        """Largest activity of one block, codes: its absolute sum, or the absolute change of that sum."""
        return self.features.activity_block * (
            self.deviation_span if self.features.activity_rule == "change" else self.deviation_bound
        )

    @property
    def integral_bound(self) -> int:
        """Largest absolute sum of deviations in a touch, codes, before companding."""
        return self.last_frame * self.deviation_bound

    @property
    def integral_bits(self) -> int:
        """Bits of the sum of deviations in a touch."""
        return signed_bits(self.integral_bound)

    def _value_bits(self, frames: int) -> int:
        """Bits of any kind's value of so many frames."""
        bounds = {
            "mean": frames * self.deviation_bound,
            # rounded up: blocks that do not fill the window are refused later, with this width in use
            "activity": -(-frames // self.features.activity_block) * self.block_bound,
            # log2 of twice the bound over the knee, rounded up: 1 + |d| / 2**knee is at most twice the larger of its
            # summands
            "integral": max(self.integral_bits - self.features.integral_knee, 1)
            << self.features.integral_frac,
        }
        return signed_bits(
            max(bounds.get(kind, self.deviation_bound) for kind in self.features.feature_kinds)
        )

    @cached_property
    def beat_bits(self) -> int:
        """Bits of one contribution to a window, for one input: a deviation, a block's activity, a companded
        integral or an extreme."""
        return self._value_bits(1)

    @cached_property
    def sum_bits(self) -> int:
        """Bits of a window's value for one input: a mean is at most window times deviation_bound, an activity
        blocks times block_bound, an extreme deviation_bound."""
        return self._value_bits(self.window_lengths[-1] if self.follows_touch else self.windows.window)

    def feature_unit(self, length: int, kind: str) -> float:
        """Divisor from a window's value to the feature before scaling.

        Mean: frames of a window of ``length``; activity: its blocks; integral: 2 to the
        power of its fraction bits; extremes: 1.
        """
        units = {"mean": length, "activity": length / self.features.activity_block}
        return float(units.get(kind, 2.0**self.features.integral_frac if kind == "integral" else 1.0))

    @property
    def feature_units(self) -> tuple[float, ...]:
        """``feature_unit`` for each window length and, within it, each kind, in the order of
        ``feature_shift``."""
        return tuple(
            self.feature_unit(length, kind)
            for length in self.window_lengths
            for kind in self.features.feature_kinds
        )

    @property
    def mean_frac(self) -> int:
        """Fraction bits of the normaliser's means, as negative shifts require; usually 0."""
        return max((0, *(-shift for shift in self.features.feature_shift)))

    @property
    def most_mean_frac(self) -> int:
        """Highest permitted number of fraction bits of means: a mean and its parity bit must fit two host
        words."""
        return max(0, min(MOST_MEAN_FRAC, 32 - self.hardware.checksum - self.sum_bits))

    @property
    def mean_format(self) -> QFormat:
        """Format of a mean: the bits of a window's value, and fraction bits in addition."""
        return QFormat(self.sum_bits, self.mean_frac)

    @property
    def mean_words(self) -> int:
        """16-bit words in which the host loads one mean constant, low word first; with ``checksum`` the
        highest bit is a parity bit."""
        return -(-(self.mean_format.width + self.hardware.checksum) // 16)

    # ------------------------------------------------------------------ network sizes
    @property
    def recurrent(self) -> bool:
        """True for cells with a hidden state; False for the linear cell, whose logits add up over the
        windows, and for trees."""
        return self.network.cell in ("gru", "lstm")

    @property
    def threshold_format(self) -> QFormat:
        """Format of a feature of trees, or of the difference of two."""
        feature = self.formats.feature_format
        return QFormat(feature.int_bits + 1, feature.frac_bits)

    @property
    def is_forest(self) -> bool:
        """True for trees: the group ``forest`` has their sizes."""
        return self.network.cell == "trees"

    @property
    def has_prototypes(self) -> bool:
        """True if the nearest prototype decides and not the logits (``readout``)."""
        return self.readout_rule.readout == "prototypes"

    @property
    def is_image(self) -> bool:
        """True for a network for images. Its sizes and formats are in the group ``image``; the properties
        about windows, features and cells are undefined."""
        return self.network.cell == "image" or bool(self.image.layers)

    @cached_property
    def stages(self) -> tuple[images.Stage, ...]:
        """The layers of a network for images, each with the shapes of its maps; empty for other networks."""
        return self.image.stages()

    @property
    def weighted_stages(self) -> tuple[images.Stage, ...]:
        """The entries of ``stages`` that have weights, in order."""
        return tuple(stage for stage in self.stages if stage.weights)

    @property
    def layer_shifts(self) -> tuple[int, ...]:
        """The right shift of each of ``weighted_stages``: fraction bits of its weights and inputs, less the fraction bits
        of its outputs. 0 until the model is quantised."""
        if not self.image.weight_formats:
            return (0,) * len(self.weighted_stages)
        formats = (images.PIXEL_FORMAT, *self.image.map_formats, self.formats.logit_format)
        return tuple(
            weight.frac_bits + before.frac_bits - after.frac_bits
            for weight, before, after in zip(self.image.weight_formats, formats, formats[1:], strict=False)
        )

    @property
    def sets(self) -> int:
        """Number of sets of weights: one per window for a linear cell, or 1 with ``weight_sets`` one; 1 for
        other cells."""
        return (
            self.windows.steps
            if self.network.cell == "linear" and self.network.weight_sets == "window"
            else 1
        )

    @property
    def gates(self) -> tuple[str, ...]:
        """Names of the gate rows in program order (the order of the integer archive's arrays is free); empty
        for a linear cell."""
        if not self.recurrent:
            return ()
        return ("i", "f", "g", "o") if self.network.cell == "lstm" else ("z", "r", "n")

    @property
    def parameter_count(self) -> int:
        """Trainable parameters: G (H (D+H) + H) + C (H+1), torch's second bias row added for reset after;
        linear: a C x D matrix for each set of weights, + C; trees: a threshold a node, a vote a leaf; images: the
        parameters of all layers, batch norm included."""
        if self.is_image:
            return sum(stage.parameters for stage in self.stages)
        if self.is_forest:
            return 2 * self.forest.nodes + self.forest.trees
        if not self.recurrent:
            return self.sets * self.classes * self.inputs + self.classes
        rows = len(self.gates) * self.network.hidden
        extra = rows if self.network.cell == "gru" and self.network.reset == "after" else 0
        return (
            rows * (self.inputs + self.network.hidden + 1) + extra + self.classes * (self.network.hidden + 1)
        )

    @property
    def multiplies(self) -> int:
        """Multiplications per step: GRU 3H(D+H) + 2H + CH, LSTM 4H(D+H) + 3H + CH, linear CD, trees none;
        images: all layers, products with the zero padding included."""
        if self.is_image:
            return sum(stage.multiplies for stage in self.stages)
        h, d = self.network.hidden, self.inputs
        if not self.recurrent:
            return 0 if self.is_forest else self.classes * d
        elementwise = 3 if self.network.cell == "lstm" else 2
        return len(self.gates) * h * (d + h) + elementwise * h + self.classes * h

    # ------------------------------------------------------------------ formats that follow
    @property
    def gate_one(self) -> int:
        """The gate code of 1.0."""
        return 1 << self.formats.gate_frac

    @property
    def gate_format(self) -> QFormat:
        """Format of gate codes 0..2**gate_frac, as a signed operand of the element-wise lane."""
        return QFormat(2, self.formats.gate_frac)

    @property
    def product_frac(self) -> int:
        """Fraction bits of gate-row products and accumulators."""
        return self.formats.recurrent_format.frac_bits + self.formats.state_format.frac_bits

    @property
    def dense_product_frac(self) -> int:
        """Fraction bits of dense products: weights times states, or times features in a linear cell."""
        return (
            self.formats.dense_format.frac_bits
            + (self.formats.state_format if self.recurrent else self.formats.feature_format).frac_bits
        )

    @property
    def feature_align(self) -> int:
        """Zeros appended to a feature code so that W x and U h products share one scale (exact, no
        narrowing); 0 in a linear cell."""
        if not self.recurrent:
            return 0
        return (
            self.product_frac - self.formats.weight_format.frac_bits - self.formats.feature_format.frac_bits
        )

    @property
    def operand_bits(self) -> int:
        """Bits of a vector operand on the lanes: the wider of state and aligned feature; in a linear
        cell the feature."""
        if not self.recurrent:
            return self.formats.feature_format.width
        return max(self.formats.state_format.width, self.formats.feature_format.width + self.feature_align)

    @property
    def weight_bits(self) -> int:
        """Bits of a weight word: the widest of the three weight formats; in a linear cell the format of
        the dense weights; for images the widest layer."""
        if self.is_image:
            return max((fmt.width for fmt in self.image.weight_formats), default=8)
        if not self.recurrent:
            return self.formats.dense_format.width
        return max(
            self.formats.weight_format.width,
            self.formats.recurrent_format.width,
            self.formats.dense_format.width,
        )

    @property
    def index_bits(self) -> int:
        """Bits of an activation table index."""
        return self.formats.table_entries.bit_length() - 1

    @property
    def index_format(self) -> QFormat:
        """Signed table index, an integer."""
        return QFormat(self.index_bits, 0)

    @property
    def tanh_frac(self) -> int:
        """Fraction bits of a tanh index (step 8 / table_entries)."""
        return self.index_bits - 3

    @property
    def sigmoid_shift(self) -> int:
        """Bits rounded away from a gate accumulator to a sigmoid index."""
        return self.product_frac - (self.index_bits - 4)  # of an index's step, 16 / table_entries

    @property
    def tanh_shift(self) -> int:
        """Bits rounded away from an accumulator to a tanh index."""
        return self.product_frac - self.tanh_frac

    @property
    def value_shift(self) -> int:
        """Bits rounded away from an accumulator to a state-format value (reset after: U h and W x)."""
        return self.product_frac - self.formats.state_format.frac_bits

    @property
    def state_index_shift(self) -> int:
        """Bits rounded away from a state-format value to a tanh index (reset after, LSTM cell state)."""
        return self.formats.state_format.frac_bits - self.tanh_frac

    @property
    def trajectory_width(self) -> int:
        """Number of values per step that are compared with a prototype: hidden states, or in a linear cell
        logits."""
        return self.network.hidden if self.recurrent else self.classes

    @property
    def trajectory_format(self) -> QFormat:
        """Format of the values that are compared with a prototype."""
        return self.formats.state_format if self.recurrent else self.formats.logit_format

    @property
    def state_code_format(self) -> QFormat:
        """Format of a stored value of a prototype."""
        return QFormat(self.readout_rule.state_code_bits, 0)

    @property
    def distance_bound(self) -> int:
        """Largest distance of a touch from a prototype that the formats allow: over all steps, or with
        decision ``vote`` over one."""
        steps = 1 if self.network.decision == "vote" else self.windows.steps
        return steps * self.trajectory_width * ((1 << self.readout_rule.state_code_bits) - 1)

    @property
    def score_format(self) -> QFormat:
        """Format of a class's score, a logit or a negative distance; a step decides for the class with the
        largest score."""
        return (
            QFormat(signed_bits(self.distance_bound), 0) if self.has_prototypes else self.formats.logit_format
        )

    @property
    def logit_shift(self) -> int:
        """Bits rounded away from a dense accumulator to a logit."""
        return self.dense_product_frac - self.formats.logit_format.frac_bits

    @property
    def bias_shift(self) -> int:
        """Left shift of a bias code to the scale of products."""
        return self.product_frac - self.formats.bias_format.frac_bits

    @property
    def dense_bias_shift(self) -> int:
        """Left shift of a dense bias code to the scale of products."""
        return self.dense_product_frac - self.formats.dense_bias_format.frac_bits

    @property
    def centred_format(self) -> QFormat:
        """(sum - mean) >> shift, saturated: the normaliser's operand."""
        return QFormat(16, 0)

    @property
    def scale_format(self) -> QFormat:
        """The normaliser's constant, an operand of the element-wise lane."""
        return QFormat(16, 0)

    @cached_property
    def accumulator_bound(self) -> int:
        """Largest absolute value that any row accumulator, addend and rounding half included, can reach under
        the formats."""
        if not self.recurrent:
            return self.dense_bound
        state = self.formats.state_format.magnitude
        feature = self.formats.feature_format.magnitude << self.feature_align
        gate_row = (
            self.inputs * self.formats.weight_format.magnitude * feature
            + self.network.hidden * self.formats.recurrent_format.magnitude * state
            + (self.formats.bias_format.magnitude << self.bias_shift)
            + (1 << max(self.sigmoid_shift, self.tanh_shift, self.value_shift) - 1)
        )
        return max(gate_row, self.dense_bound)

    @cached_property
    def dense_bound(self) -> int:
        """Largest absolute value that a dense row's accumulator, addend and rounding half included, can reach
        under the formats; a linear cell accumulates over all steps of a touch."""
        operands = self.network.hidden * self.formats.state_format.magnitude
        if not self.recurrent:
            operands = self.windows.steps * self.inputs * self.formats.feature_format.magnitude
        products = operands * self.formats.dense_format.magnitude
        return (
            products
            + (self.formats.dense_bias_format.magnitude << self.dense_bias_shift)
            + (1 << self.logit_shift - 1)
        )

    @property
    def logit_proven(self) -> bool:
        """True if no weights that the formats can hold make a logit saturate."""
        return self.dense_bound >> self.logit_shift <= self.formats.logit_format.max_code

    @cached_property
    def accumulator_bits(self) -> int:
        """Bits of a row accumulator, so many that no sum can overflow. At least 18, so that an addend never
        fits one host word."""
        if self.is_forest:
            return self.formats.logit_format.width
        if self.is_image:
            return images.accumulator_bits(self.stages, self.weight_bits, self.layer_shifts)
        return max(18, signed_bits(self.accumulator_bound))

    @property
    def addend_parts(self) -> int:
        """16-bit words in which the host loads one addend, low word first: two, or three if the accumulator
        has more than 32 bits."""
        return -(-self.accumulator_bits // 16)

    @cached_property
    def elementwise_bits(self) -> int:
        """Bits of the element-wise accumulator: two products of 16-bit operands with gates or scales, and a
        rounding half. A linear cell only normalises and has one product."""
        # gate_one instead of the rounding half, gate_one / 2: the bound is simpler and takes no bit more
        if not self.recurrent:
            return signed_bits(self.centred_format.magnitude * self.scale_format.magnitude + self.gate_one)
        operand = max(self.formats.state_format.magnitude, self.centred_format.magnitude)
        return signed_bits(
            max(
                2 * self.formats.state_format.magnitude * self.gate_one, operand * self.scale_format.magnitude
            )
            + self.gate_one
        )

    @property
    def step_ideal(self) -> int:
        """ceil(multiplies / lanes), of trees comparisons; cycles."""
        if self.is_forest:
            return self.forest.trees * self.forest.depth
        return -(-self.multiplies // self.hardware.lanes)

    # ------------------------------------------------------------------ fields by name, files
    @classmethod
    def of(cls, **fields: Any) -> AcceleratorConfig:
        """A configuration with ``fields``, given by name without their groups; the others have their
        defaults. As in a file, fields of other variants are dropped."""
        own, of_group = _by_group(fields)
        with _in_configuration(own.get("name", cls.name)):
            groups: dict[str, Any] = {group: GROUPS[group].of(values) for group, values in of_group.items()}
        return cls(**own, **groups)

    @classmethod
    def of_image(
        cls,
        height: int,
        width: int,
        layers: Sequence[images.Layer | str],
        class_names: Sequence[str],
        **fields: Any,
    ) -> AcceleratorConfig:
        """Configuration of a network for images of ``height`` x ``width`` pixels. The last of ``layers`` has
        one output for each of ``class_names``. An image is one touch of height frames with one window and one
        step, and its gate opens at once. ``fields``: other fields, by name without their groups."""
        image = Image(height=height, width=width, layers=tuple(map(str, layers)))
        defaults = {"sample_rate_hz": IMAGE_ROWS_HZ, "logit_format": QFormat(8, 8)}
        network = {"cell": "image", "class_names": tuple(class_names)}
        values = _of_every_image(image) | defaults | fields | network
        return cls.of(**values | vars(image))

    def with_lanes(self, lanes: int | None = None, lane_type: str | None = None) -> AcceleratorConfig:
        """A copy with other lanes. None keeps the current value."""
        fields = {"lanes": lanes, "lane_type": None if lane_type is None else str(lane_type)}
        return self.replace(**{field: value for field, value in fields.items() if value is not None})

    def with_readout(self, **fields: Any) -> AcceleratorConfig:
        """A copy whose ``readout_rule`` has ``fields``, and defaults for its other fields."""
        return dataclasses.replace(self, readout_rule=ReadoutRule(**fields))

    def replace(self, **changes: Any) -> AcceleratorConfig:
        """A copy with ``changes`` (fields by name without their groups), checked again."""
        own, of_group = _by_group(changes)
        with _in_configuration(own.get("name", self.name)):
            groups = {group: getattr(self, group).replace(**fields) for group, fields in of_group.items()}
        return dataclasses.replace(self, **own, **groups)

    def value(self, field: str) -> Any:
        """Value of the field called ``field``, in whichever group it is."""
        return self.name if field == "name" else getattr(getattr(self, GROUP_OF[field]), field)

    def fields(self) -> dict[str, Any]:
        """Every field by its name, without groups; formats as ``SQ(int,frac)``."""
        return {"name": self.name} | {field: _plain(self.value(field)) for field in GROUP_OF}

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, group by group; formats as ``SQ(int,frac)``."""
        fields = self.fields()
        return {"name": self.name} | {
            group: {field: fields[field] for field in vars(getattr(self, group))} for group in GROUPS
        }

    @property
    def content(self) -> dict[str, Any]:
        """Everything that a result can depend on."""
        return self.to_dict()

    @classmethod
    def from_dict(cls, values: dict[str, Any], source: str = "configuration") -> AcceleratorConfig:
        """The configuration in ``values``, as `to_dict` makes them; missing fields have their defaults.
        ``source`` names the file in errors."""
        if not isinstance(values, dict):
            raise InputError(
                f"{source}: holds no configuration; it must be a JSON object of groups of fields"
            )
        values = {key: value for key, value in values.items() if key != "model_hash"}
        parts = {key: value for key, value in values.items() if key != "name"}
        for key, value in parts.items():
            if key not in GROUPS:
                raise InputError(f"{source}: unknown group {key}; known groups are {', '.join(GROUPS)}")
            if not isinstance(value, dict):
                raise InputError(f"{source}, group {key}: must be a JSON object of fields")
            if unknown := sorted(field for field in value if GROUP_OF.get(field) != key):
                fields = ", ".join(field for field, group in GROUP_OF.items() if group == key)
                raise InputError(
                    f"{source}, group {key}: unknown field {unknown[0]}; known fields are {fields}"
                )
        try:
            return cls(**values | {key: GROUPS[key].of(value) for key, value in parts.items()})
        except InputError as error:
            raise InputError(f"{source}: {error}") from None

    def to_json(self, model_hash: str = "") -> str:
        """Text of config.json, with the hash of an integer model (`model_hash`), which nothing reads back."""
        line = {"model_hash": model_hash} if model_hash else {}
        return json.dumps(line | self.to_dict(), indent=2) + "\n"

    @classmethod
    def load(cls, name_or_path: str | Path) -> AcceleratorConfig:
        """A preset by name, or the configuration in a JSON file."""
        if str(name_or_path) in PRESETS:
            return PRESETS[str(name_or_path)]
        path = Path(name_or_path)
        try:
            values = json.loads(path.read_text())
        except OSError as error:
            raise InputError(
                f"configuration '{path}': {error.strerror}; give a preset ({', '.join(PRESETS)}) or a JSON "
                "file"
            ) from None
        except (ValueError, RecursionError) as error:
            raise InputError(f"configuration '{path}': is not JSON ({error})") from None
        return cls.from_dict(values, str(path))


@contextmanager
def _in_configuration(name: str) -> Iterator[None]:
    """Puts the configuration's name, which a group does not know, into a group's error."""
    try:
        yield
    except InputError as error:
        raise InputError(str(error).replace("configuration,", f"configuration '{name}',", 1)) from None


def _by_group(fields: dict[str, Any]) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """The configuration's own fields, and the others by their groups."""
    own: dict[str, Any] = {}
    of_group: dict[str, dict[str, Any]] = {}
    for field, value in fields.items():
        if field == "name":
            own[field] = value
        elif field in GROUP_OF:
            of_group.setdefault(GROUP_OF[field], {})[field] = value
        else:
            raise TypeError(f"a configuration has no field '{field}'")
    return own, of_group


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return tuple(map(_plain, value))
    if isinstance(value, Converter):
        return value.settings()
    return str(value) if isinstance(value, QFormat) else value


def _of_every_image(image: Image) -> dict[str, Any]:
    """Fields outside of group ``image`` whose values are fixed in a network for images of this size."""
    height = image.height
    sensor: dict[str, Any] = dict(
        taxels=image.width, scan_every=1, sample_bits=8, sample_signed=False, masked_taxels=()
    )
    # every configuration has windows of two hops; touch_frames cuts this one to the single image
    gate: dict[str, Any] = dict(
        onset="immediate", window_mode="touch", pretrigger_frames=0, touch_frames=height
    )
    return sensor | gate | dict(hop=height, window=2 * height, steps=1, decision="last")


_THESIS_VOLT = 4.096 / 65536

PRESETS: dict[str, AcceleratorConfig] = {
    "thesis": AcceleratorConfig.of(
        name="thesis",
        onset="band",
        band_low=25920,
        band_high=26880,
        rest="none",
        decision="last",
        volt_per_code=_THESIS_VOLT,
    ),
    "synthetic": AcceleratorConfig.of(
        name="synthetic",
        onset="baseline",
        rest="tracked",
        rest_frames=64,
        onset_threshold=120,
        volt_per_code=_THESIS_VOLT,
    ),
    "pvdf": AcceleratorConfig.of(
        name="pvdf",
        taxels=8,
        sample_rate_hz=2000.0,
        sample_bits=16,
        volt_per_code=62.40939955748836e-6,
        rest="tracked",
        rest_frames=64,
        clip=300,
        onset="baseline",
        onset_threshold=12,
        window_mode="free",
        hop=96,
        window=192,
        steps=20,
        hidden=12,
        class_names=("Cube3", "Cube5", "Cube7", "Cube10", "Cube11"),
    ),
    "fabric": AcceleratorConfig.of(
        name="fabric",
        taxels=16,
        sample_rate_hz=35.6,
        sample_bits=16,
        sample_signed=True,
        rest="initial",
        rest_frames=5,
        onset="immediate",
        decision="last",
        window_mode="free",
        hop=6,
        window=12,
        steps=20,
        hidden=12,
        class_names=("BeigeCotton", "BrownCotton", "Canvas", "Denim", "DenimFlex", "Linen", "WovenFabric"),
    ),
}
"""The named configurations; other fields have their defaults."""
