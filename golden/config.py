"""The configuration of one accelerator: every size, rule and number format, with units, and what follows from them.

Shared by the golden model and the hardware generator. A configuration that cannot work is refused on construction, before any long
work starts.
"""

from __future__ import annotations

import dataclasses
import json
import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from golden.errors import InputError
from golden.formats import QFormat, signed_bits

RING_SLACK_FRAMES = 8
"""Frames that the pre-trigger ring can hold beyond its history while the rest of the chain is held up."""


@dataclass(frozen=True, kw_only=True)
class AcceleratorConfig:
    """One accelerator. SPECIFICATION.md gives the meaning of each rule; widths and counts derived here are used by model and RTL alike.

    Sensor
        name; taxels (4..160); sample_rate_hz (frames a second); sample_bits, sample_signed (A/D code); volt_per_code (volt, 0 when the
        recordings are not voltages); masked_taxels (taxel indices, from 0, that are out of use at reset).
    Rest level
        rest: ``none`` (0), ``tracked`` (mean of the first rest_frames frames, then 1/16 code a frame by sign, frozen during a touch) or
        ``initial`` (mean of the first rest_frames, then frozen). clip: codes; a deviation from rest is held within +-clip, 0 = no clip.
    Onset
        onset: ``band`` (any taxel outside band_low..band_high, codes), ``baseline`` (every onset_check_frames frames, any taxel whose
        mean deviation over onset_mean_frames exceeds onset_threshold codes) or ``immediate`` (gate open from frame 1, one touch).
        rearm_frames: quiet frames before the next touch may begin. onset_hits of onset_span: judged frames out of the last so many in
        which the rule must hold (M of K); 1 of 1 = at once.
    Faults
        fault_frames: length of the blocks in which every taxel is judged stuck, silent or saturated, and masked then; 0 = no detector.
        fault_activity: codes; a taxel whose samples change by no more than this in a whole block, added up, has failed.
    Windows
        window_mode: ``touch`` (hops start pretrigger_frames before the onset; windows clipped at touch_frames) or ``free`` (hops run
        from arm). hop, window: frames; steps: windows, so recurrent steps, a touch.
    Companding
        compand: ``none``, or ``log``: sums are companded before the normaliser, to log2(1 + |sum| / 2**compand_knee) with its sign,
        straight between powers of two, compand_frac fraction bits.
    Normaliser
        feature_shift: bits dropped from (sum - mean) for each distinct window length. aligned_means: these bits are 0 in every mean, so
        that hardware does without them; one shift for every length then.
    Network
        cell; reset (GRU only); gate_activation; hidden; class_names; decision: the global one by ``vote``, by the ``last`` step, or
        ``early``: by the first step at which the last early_steps local decisions agree, each with a margin of at least early_margin
        (logit LSBs); by the last step where that never comes;
        margin_threshold: a global decision of a smaller margin is not confident; 0 = every one is.
    Formats
        weight_format (input weights), recurrent_format, dense_format, bias_format, dense_bias_format, feature_format, state_format,
        gate_frac (gate codes are 0..2**gate_frac), logit_format, table_entries (over +-8).
    Hardware
        lanes; lane_type; loadable (weights and constants written over the host bus; False: ROM); clock_hz; checksum (memories and
        registers are checked as they are used, a fault raises a flag); watchdog (a chain that hangs goes back to idle).

    Raises
    ------
    InputError
        One sentence that names the field and the fix.
    """

    name: str = "custom"
    taxels: int = 16
    sample_rate_hz: float = 3000.0
    sample_bits: int = 16
    sample_signed: bool = False
    volt_per_code: float = 0.0
    masked_taxels: tuple[int, ...] = ()

    rest: Literal["none", "tracked", "initial"] = "none"
    rest_frames: int = 0
    clip: int = 0

    onset: Literal["band", "baseline", "immediate"] = "band"
    band_low: int = 0
    band_high: int = 0
    onset_mean_frames: int = 64
    onset_check_frames: int = 16
    onset_threshold: int = 12
    rearm_frames: int = 320
    onset_hits: int = 1
    onset_span: int = 1

    fault_frames: int = 0
    fault_activity: int = 0

    window_mode: Literal["touch", "free"] = "touch"
    pretrigger_frames: int = 50
    touch_frames: int = 6144
    hop: int = 307
    window: int = 615
    steps: int = 20

    compand: Literal["none", "log"] = "none"
    compand_knee: int = 11
    compand_frac: int = 8

    feature_shift: tuple[int, ...] = ()
    aligned_means: bool = False

    cell: Literal["gru", "lstm"] = "gru"
    reset: Literal["before", "after"] = "before"
    gate_activation: Literal["sigmoid", "hard_sigmoid"] = "sigmoid"
    hidden: int = 12
    class_names: tuple[str, ...] = ("brush", "roll", "slide")
    decision: Literal["vote", "last", "early"] = "vote"
    early_margin: int = 0
    early_steps: int = 1
    margin_threshold: int = 0

    weight_format: QFormat = QFormat(3, 5)
    recurrent_format: QFormat = QFormat(3, 5)
    dense_format: QFormat = QFormat(3, 5)
    bias_format: QFormat = QFormat(5, 11)
    dense_bias_format: QFormat = QFormat(5, 11)
    feature_format: QFormat = QFormat(4, 8)
    state_format: QFormat = QFormat(2, 12)
    gate_frac: int = 13
    logit_format: QFormat = QFormat(6, 10)
    table_entries: int = 512

    lanes: int = 4
    lane_type: Literal["plain", "dsp", "serial"] = "plain"
    loadable: bool = True
    checksum: bool = False
    watchdog: bool = False
    clock_hz: float = 12e6

    # ------------------------------------------------------------------ checks
    def __post_init__(self) -> None:
        def refuse(field: str, why: str) -> None:
            raise InputError(f"configuration '{self.name}', field {field}: {why}")

        hints = AcceleratorConfig.__annotations__
        for field in dataclasses.fields(self):
            value, hint = getattr(self, field.name), hints[field.name]
            if hint == "int" and (not isinstance(value, int) or isinstance(value, bool)):
                refuse(field.name, f"is {value!r}; give a whole number")
            if hint == "float" and (not isinstance(value, (int, float)) or not math.isfinite(value)):
                refuse(field.name, f"is {value!r}; give a finite number")
            if hint == "bool" and not isinstance(value, bool):
                refuse(field.name, f"is {value!r}; give true or false")
            if hint.startswith("Literal["):
                allowed = [word.strip().strip("\"'") for word in hint[8:-1].split(",")]
                if value not in allowed:
                    refuse(field.name, f"is {value!r}; give one of {', '.join(allowed)}")
        limits = {
            "taxels": (4, 160), "sample_bits": (1, 16), "steps": (1, 256), "hidden": (4, 32), "lanes": (1, 64),
            "gate_frac": (4, 14), "clip": (0, 65535), "hop": (1, 65535), "touch_frames": (1, 65535), "rest_frames": (0, 4096),
            "pretrigger_frames": (0, 1024), "onset_threshold": (1, 65535), "rearm_frames": (1, 65535), "onset_span": (1, 16),
            "onset_hits": (1, self.onset_span), "fault_frames": (0, 4096), "fault_activity": (0, 65535), "margin_threshold": (0, 65535),
            "compand_knee": (0, 30), "compand_frac": (1, 12), "early_margin": (0, 65535), "early_steps": (1, 256),
        }
        for field_name, (low, high) in limits.items():
            if not low <= getattr(self, field_name) <= high:
                refuse(field_name, f"is {getattr(self, field_name)}; it must lie in {low}..{high}")
        for field_name in ("sample_rate_hz", "clock_hz"):
            if getattr(self, field_name) <= 0:
                refuse(field_name, f"is {getattr(self, field_name)}; it must be above 0")
        if not 2 <= len(self.class_names) <= 32:
            refuse("class_names", f"has {len(self.class_names)} names; a classifier has 2 to 32")
        if any(not isinstance(name, str) for name in self.class_names):
            refuse("class_names", "has a name that is no text")
        if len(set(self.class_names)) != len(self.class_names):
            refuse("class_names", "has a name twice; names must differ")
        if any(not 0 <= taxel < self.taxels for taxel in self.masked_taxels):
            refuse("masked_taxels", f"names a taxel outside 0..{self.taxels - 1}")
        if self.decision == "early" and self.early_steps > self.steps:
            refuse("early_steps", f"is {self.early_steps} in a touch of {self.steps} steps; give at most as many")
        # rest level
        if (self.rest == "none") != (self.rest_frames == 0):
            refuse("rest_frames", f"is {self.rest_frames} with rest '{self.rest}'; rest none has 0 frames, the others at least 1")
        if self.rest == "tracked" and self.onset == "immediate":
            refuse("rest", "is 'tracked' with onset 'immediate', where the gate is never closed; use 'initial' or 'none'")
        # onset
        if self.onset == "band" and not 0 <= self.band_low - self.sample_format.min_code <= self.band_high - self.sample_format.min_code:
            refuse("band_low", f"is {self.band_low} with band_high {self.band_high}; give sample codes, low below high")
        if self.onset == "baseline":
            blocks, rest = divmod(self.onset_mean_frames, self.onset_check_frames)
            if self.onset_check_frames < 1 or rest or blocks not in (1, 2, 4, 8):
                refuse("onset_mean_frames", f"is {self.onset_mean_frames}; it must be 1, 2, 4 or 8 times onset_check_frames")
            if self.onset_check_frames & (self.onset_check_frames - 1):
                refuse("onset_check_frames", f"is {self.onset_check_frames}; it must be a power of two")
            if self.rest == "none":
                refuse("rest", "is 'none' with onset 'baseline', which needs a rest level; use 'tracked'")
        if self.fault_frames & (self.fault_frames - 1) or self.fault_frames == 1:
            refuse("fault_frames", f"is {self.fault_frames}; it must be 0 or a power of two from 2 on")
        if self.fault_frames and self.sample_bits < 4:
            refuse("fault_frames", f"is {self.fault_frames} with samples of {self.sample_bits} bits; a fault detector needs 4: give 0")
        if self.onset == "immediate" and self.window_mode == "touch" and self.pretrigger_frames:
            refuse("pretrigger_frames", "must be 0 when the gate opens at once")
        # windows
        if self.window not in (2 * self.hop, 2 * self.hop + 1):
            refuse("window", f"is {self.window} at hop {self.hop}; a window is 2 hop or 2 hop + 1 frames")
        if self.window_mode == "free":
            if self.window != 2 * self.hop:
                refuse("window", f"is {self.window}; free-running windows are 2 hop = {2 * self.hop} frames")
            if self.pretrigger_frames:
                refuse("pretrigger_frames", "must be 0 with free-running windows, which keep no raw frames")
        elif self.hop * (self.steps - 1) + 1 > self.touch_frames:
            refuse("steps", f"is {self.steps}: window {self.steps} would begin after frame {self.touch_frames}; lower steps or hop")
        if self.window_mode == "touch" and not self.opens_at_once and self.rearm_frames < self.ring_frames:
            refuse("rearm_frames", f"is {self.rearm_frames}; it must be at least {self.ring_frames}, the frames the pre-trigger ring holds")
        if self.window_mode == "touch" and self.last_frame < self.pretrigger_frames + 2:
            refuse("pretrigger_frames", f"is {self.pretrigger_frames}, but a touch ends with its frame {self.last_frame}, which must come "
                   "after the onset; lower pretrigger_frames or raise steps or hop")
        if self.compand == "log":
            if self.compand_knee > self.sum_bits - 2:
                refuse("compand_knee", f"is {self.compand_knee} for sums of {self.sum_bits} bits; give at most {self.sum_bits - 2}")
            if (self.sum_bits - self.compand_knee) << self.compand_frac > 1 << self.sum_bits - 1:
                refuse("compand_frac", f"is {self.compand_frac}; lower it: companded sums have the {self.sum_bits} bits of sums at most")
        if len(self.feature_shift) not in (0, len(self.window_lengths)):
            refuse("feature_shift", f"has {len(self.feature_shift)} values for {len(self.window_lengths)} distinct window lengths")
        if any(not 0 <= shift <= self.sum_bits for shift in self.feature_shift):
            refuse("feature_shift", f"must lie in 0..{self.sum_bits}")
        if self.aligned_means and len(set(self.feature_shift)) > 1:
            refuse("aligned_means", f"needs one feature_shift for every window length, not {self.feature_shift}")
        # formats
        if self.table_entries not in (64, 128, 256, 512, 1024):
            refuse("table_entries", f"is {self.table_entries}; use 64, 128, 256, 512 or 1024")
        for field_name, low, high in (
            ("weight_format", 2, 16), ("recurrent_format", 2, 16), ("dense_format", 2, 16), ("bias_format", 2, 16),
            ("dense_bias_format", 2, 16), ("feature_format", 4, 16), ("state_format", 6, 16), ("logit_format", 6, 16),
        ):
            fmt = getattr(self, field_name)
            if not isinstance(fmt, QFormat) or not fmt.signed or not low <= fmt.width <= high:
                refuse(field_name, f"is {fmt}; use a signed format of {low} to {high} bits")
        if self.feature_align < 0:
            refuse("feature_format", f"{self.feature_format} has {-self.feature_align} fraction bits too many: input products must not be "
                   "finer than recurrent ones (state + recurrent weight fraction bits)")
        if self.operand_bits > 16:
            refuse("feature_format", f"{self.feature_format} needs {self.operand_bits} bits on the lanes' scale; 16 are there: raise the "
                   "fraction bits of weight_format or lower those of recurrent_format or state_format")
        for what, shift in (("sigmoid", self.sigmoid_shift), ("tanh", self.tanh_shift), ("value", self.value_shift)):
            if shift < 1:
                refuse("table_entries" if what != "value" else "recurrent_format",
                       f"the {what} narrowing would be {shift} bits; products need more fraction bits than their result")
        if self.logit_shift < 1:
            refuse("logit_format", f"{self.logit_format} is finer than the dense products; lower its fraction bits")
        if (self.cell == "lstm" or self.reset == "after") and self.state_format.frac_bits < self.tanh_frac + 1:
            refuse("state_format", f"{self.state_format} needs at least {self.tanh_frac + 1} fraction bits to address the tanh table")
        if self.cell == "gru" and self.state_format.frac_bits > 14:
            refuse("state_format", f"{self.state_format} has too many fraction bits; a GRU takes differences of states, "
                   "which leave room for 14 in 16-bit operands")
        if self.bias_shift < 0:
            refuse("bias_format", f"{self.bias_format} is finer than the products; it has at most {self.product_frac} fraction bits")
        if self.dense_bias_shift < 0:
            refuse("dense_bias_format", f"{self.dense_bias_format} is finer than the dense products")
        if self.accumulator_bits > 32:
            needed = f"{self.accumulator_bits}-bit accumulator and there are 32 bits"
            refuse("weight_format", f"the worst case needs a {needed}: narrow the weights")
        if self.checksum and self.lane_type == "serial" and self.lanes == 1:
            refuse("checksum", "is not built for one bit-serial lane; leave it out, or take another lane_type or more lanes")
        cycles_per_frame = self.clock_hz / self.sample_rate_hz
        if cycles_per_frame < 2 * self.taxels:
            refuse("clock_hz", f"is {self.clock_hz:g}: {cycles_per_frame:.3g} cycles a frame cannot take {self.taxels} taxels; "
                   f"use at least {2 * self.taxels * self.sample_rate_hz:g}")

    # ------------------------------------------------------------------ sensor and windows
    @property
    def sample_format(self) -> QFormat:
        """Format of one A/D code."""
        return QFormat(self.sample_bits, 0, self.sample_signed)

    @property
    def classes(self) -> int:
        """Number of classes C."""
        return len(self.class_names)

    @property
    def fault_bits(self) -> int:
        """Lowest bits of a sample that the fault detector looks at."""
        return min(self.sample_bits, 8)

    @property
    def opens_at_once(self) -> bool:
        """True when the gate is open from frame 1 and one touch ends the recording."""
        return self.onset == "immediate"

    @cached_property
    def deviation_bits(self) -> int:
        """Bits of the signed deviation (sample - rest, clipped): the value that windows add up."""
        return signed_bits(self.deviation_bound)

    @property
    def deviation_bound(self) -> int:
        """Largest absolute deviation, codes."""
        span = self.sample_format.magnitude if self.rest == "none" else self.sample_format.max_code - self.sample_format.min_code
        return min(self.clip, span) if self.clip else span

    @property
    def ring_frames(self) -> int:
        """Frames the pre-trigger ring holds: history, the frame of the onset, and slack."""
        return self.pretrigger_frames + 1 + RING_SLACK_FRAMES

    @cached_property
    def window_spans(self) -> tuple[tuple[int, int], ...]:
        """First and last frame (1-based from the start of the touch's first window) of windows 1..steps.

        Free: ``hop (k-1) + 1 .. hop (k-1) + 2 hop``. Touch: the same with ``window`` frames, clipped at touch_frames.
        """
        limit = self.touch_frames if self.window_mode == "touch" else 1 << 62
        return tuple((self.hop * k + 1, min(self.hop * k + self.window, limit)) for k in range(self.steps))

    @cached_property
    def window_lengths(self) -> tuple[int, ...]:
        """Distinct window lengths, frames, in order of first appearance: one mean and scale constant each."""
        return tuple(dict.fromkeys(last - first + 1 for first, last in self.window_spans))

    @cached_property
    def length_index(self) -> tuple[int, ...]:
        """For each window, the index of its length in window_lengths."""
        return tuple(self.window_lengths.index(last - first + 1) for first, last in self.window_spans)

    @property
    def last_frame(self) -> int:
        """Frame (1-based from the first window's start) that completes the last window: the end of the touch."""
        return self.window_spans[-1][1]

    @cached_property
    def sum_bits(self) -> int:
        """Bits of a window sum: the bound is window times deviation_bound."""
        return signed_bits(self.window * self.deviation_bound)

    @property
    def feature_units(self) -> tuple[float, ...]:
        """For each of window_lengths what the normaliser's input is divided by to give what the network learns from: the frames of the
        window (a mean, codes), or companded 2**compand_frac."""
        return tuple(float(length) if self.compand == "none" else 2.0**self.compand_frac for length in self.window_lengths)

    @property
    def mean_words(self) -> int:
        """16-bit words in which the host loads one mean constant, low word first; with ``checksum`` the highest bit is a parity bit."""
        return -(-(self.sum_bits + self.checksum) // 16)

    # ------------------------------------------------------------------ network sizes
    @property
    def gates(self) -> tuple[str, ...]:
        """Names of the gate rows in program order (the order of the integer archive's arrays is free)."""
        return ("i", "f", "g", "o") if self.cell == "lstm" else ("z", "r", "n")

    @property
    def parameter_count(self) -> int:
        """Trainable parameters: G (H (D+H) + H) + C (H+1), torch's second bias row added for reset after."""
        rows = len(self.gates) * self.hidden
        extra = rows if self.cell == "gru" and self.reset == "after" else 0
        return rows * (self.taxels + self.hidden + 1) + extra + self.classes * (self.hidden + 1)

    @property
    def multiplies(self) -> int:
        """Multiplies a step as design.md section 6 counts them: GRU 3H(D+H) + 2H + CH, LSTM 4H(D+H) + 3H + CH."""
        h, d = self.hidden, self.taxels
        elementwise = 3 if self.cell == "lstm" else 2
        return len(self.gates) * h * (d + h) + elementwise * h + self.classes * h

    # ------------------------------------------------------------------ formats that follow
    @property
    def gate_one(self) -> int:
        """The gate code of 1.0."""
        return 1 << self.gate_frac

    @property
    def gate_format(self) -> QFormat:
        """Format of gate codes 0..2**gate_frac, as a signed operand of the element-wise lane."""
        return QFormat(2, self.gate_frac)

    @property
    def product_frac(self) -> int:
        """Fraction bits of gate-row products and accumulators."""
        return self.recurrent_format.frac_bits + self.state_format.frac_bits

    @property
    def dense_product_frac(self) -> int:
        """Fraction bits of dense products."""
        return self.dense_format.frac_bits + self.state_format.frac_bits

    @property
    def feature_align(self) -> int:
        """Zeros appended to a feature code so that W x and U h products share one scale (exact, no narrowing)."""
        return self.product_frac - self.weight_format.frac_bits - self.feature_format.frac_bits

    @property
    def operand_bits(self) -> int:
        """Bits of a vector operand on the lanes: the wider of the state and the aligned feature."""
        return max(self.state_format.width, self.feature_format.width + self.feature_align)

    @property
    def weight_bits(self) -> int:
        """Bits of a weight word: the widest of the three weight formats."""
        return max(self.weight_format.width, self.recurrent_format.width, self.dense_format.width)

    @property
    def index_bits(self) -> int:
        """Bits of an activation table index."""
        return self.table_entries.bit_length() - 1

    @property
    def index_format(self) -> QFormat:
        """Signed table index, an integer."""
        return QFormat(self.index_bits, 0)

    @property
    def sigmoid_frac(self) -> int:
        """Fraction bits of a sigmoid index (step 16 / table_entries)."""
        return self.index_bits - 4

    @property
    def tanh_frac(self) -> int:
        """Fraction bits of a tanh index (step 8 / table_entries)."""
        return self.index_bits - 3

    @property
    def sigmoid_shift(self) -> int:
        """Bits rounded away from a gate accumulator to a sigmoid index."""
        return self.product_frac - self.sigmoid_frac

    @property
    def tanh_shift(self) -> int:
        """Bits rounded away from an accumulator to a tanh index."""
        return self.product_frac - self.tanh_frac

    @property
    def value_shift(self) -> int:
        """Bits rounded away from an accumulator to a state-format value (reset after: U h and W x)."""
        return self.product_frac - self.state_format.frac_bits

    @property
    def state_index_shift(self) -> int:
        """Bits rounded away from a state-format value to a tanh index (reset after, LSTM cell state)."""
        return self.state_format.frac_bits - self.tanh_frac

    @property
    def logit_shift(self) -> int:
        """Bits rounded away from a dense accumulator to a logit."""
        return self.dense_product_frac - self.logit_format.frac_bits

    @property
    def bias_shift(self) -> int:
        """Left shift that brings a bias code to product scale."""
        return self.product_frac - self.bias_format.frac_bits

    @property
    def dense_bias_shift(self) -> int:
        """Left shift that brings a dense bias code to product scale."""
        return self.dense_product_frac - self.dense_bias_format.frac_bits

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
        """Largest absolute value any row accumulator, addend and rounding half included, can reach under the formats."""
        state, feature = self.state_format.magnitude, self.feature_format.magnitude << self.feature_align
        gate_row = (
            self.taxels * self.weight_format.magnitude * feature
            + self.hidden * self.recurrent_format.magnitude * state
            + (self.bias_format.magnitude << self.bias_shift)
            + (1 << max(self.sigmoid_shift, self.tanh_shift, self.value_shift) - 1)
        )
        return max(gate_row, self.dense_bound)

    @cached_property
    def dense_bound(self) -> int:
        """Largest absolute value that a dense row's accumulator, addend and rounding half included, can reach under the formats."""
        products = self.hidden * self.dense_format.magnitude * self.state_format.magnitude
        return products + (self.dense_bias_format.magnitude << self.dense_bias_shift) + (1 << self.logit_shift - 1)

    @property
    def logit_proven(self) -> bool:
        """No weights that the formats can hold make a logit saturate."""
        return self.dense_bound >> self.logit_shift <= self.logit_format.max_code

    @cached_property
    def accumulator_bits(self) -> int:
        """Bits of a row accumulator: proven, no reachable overflow. At least 18, so that an addend is always two words of the host's."""
        return max(18, signed_bits(self.accumulator_bound))

    @cached_property
    def elementwise_bits(self) -> int:
        """Bits of the element-wise accumulator: two products of 16-bit operands and gates or scales, and a rounding half."""
        operand = max(self.state_format.magnitude, self.centred_format.magnitude)
        return signed_bits(max(2 * self.state_format.magnitude * self.gate_one, operand * self.scale_format.magnitude) + self.gate_one)

    @property
    def step_ideal(self) -> int:
        """ceil(multiplies / lanes), cycles."""
        return -(-self.multiplies // self.lanes)

    # ------------------------------------------------------------------ files
    def with_lanes(self, lanes: int | None = None, lane_type: str | None = None) -> AcceleratorConfig:
        """A copy on other lanes; None keeps what is there."""
        wanted = {"lanes": lanes, "lane_type": None if lane_type is None else str(lane_type)}
        return self.replace(**{key: value for key, value in wanted.items() if value is not None})

    def replace(self, **changes: Any) -> AcceleratorConfig:
        """A copy with ``changes``, checked again."""
        return dataclasses.replace(self, **changes)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; formats as ``SQ(int,frac)``."""
        plain = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return {key: str(value) if isinstance(value, QFormat) else value for key, value in plain.items()}

    @classmethod
    def from_dict(cls, values: dict[str, Any], source: str = "configuration") -> AcceleratorConfig:
        """The configuration in ``values``; ``source`` names the file in errors."""
        if not isinstance(values, dict):
            raise InputError(f"{source}: holds no configuration; it must be a JSON object of fields")
        known = {field.name: field for field in dataclasses.fields(cls)}
        unknown = sorted(set(values) - set(known))
        if unknown:
            raise InputError(f"{source}: unknown field {unknown[0]}; known fields are {', '.join(known)}")
        parsed: dict[str, Any] = {}
        for key, value in values.items():
            hint = cls.__annotations__[key]
            try:
                if hint == "QFormat":
                    parsed[key] = QFormat.parse(value)
                elif hint.startswith("tuple"):
                    parsed[key] = tuple(value)
                else:
                    parsed[key] = value
            except (TypeError, ValueError, AttributeError) as error:
                raise InputError(f"{source}, field {key}: {error}") from None
        try:
            return cls(**parsed)
        except InputError as error:
            raise InputError(f"{source}: {error}") from None
        except (TypeError, AttributeError) as error:
            raise InputError(f"{source}: a field has a value of the wrong type ({error})") from None

    def to_json(self) -> str:
        """The text of a config.json."""
        return json.dumps(self.to_dict(), indent=2) + "\n"

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
                f"configuration '{path}': {error.strerror}; give a preset ({', '.join(PRESETS)}) or a JSON file"
            ) from None
        except (ValueError, RecursionError) as error:
            raise InputError(f"configuration '{path}': is not JSON ({error})") from None
        return cls.from_dict(values, str(path))


_THESIS_WINDOWS: dict[str, Any] = dict(
    taxels=16, sample_rate_hz=3000.0, sample_bits=16, volt_per_code=4.096 / 65536,
    window_mode="touch", pretrigger_frames=50, touch_frames=6144, hop=307, window=615, steps=20,
    hidden=12, class_names=("brush", "roll", "slide"),
)  # fmt: skip

PRESETS: dict[str, AcceleratorConfig] = {
    "thesis": AcceleratorConfig(
        name="thesis", onset="band", band_low=25920, band_high=26880, rest="none", decision="last", **_THESIS_WINDOWS
    ),
    "synthetic": AcceleratorConfig(
        name="synthetic", onset="baseline", rest="tracked", rest_frames=64, onset_threshold=120, **_THESIS_WINDOWS
    ),
    "pvdf": AcceleratorConfig(
        name="pvdf", taxels=8, sample_rate_hz=2000.0, sample_bits=16, volt_per_code=62.40939955748836e-6,
        rest="tracked", rest_frames=64, clip=300, onset="baseline", onset_threshold=12,
        window_mode="free", pretrigger_frames=0, hop=96, window=192, steps=20,
        hidden=12, class_names=("Cube3", "Cube5", "Cube7", "Cube10", "Cube11"),
    ),
    "fabric": AcceleratorConfig(
        name="fabric", taxels=16, sample_rate_hz=35.6, sample_bits=16, sample_signed=True,
        rest="initial", rest_frames=5, onset="immediate", decision="last",
        window_mode="free", pretrigger_frames=0, hop=6, window=12, steps=20,
        hidden=12, class_names=("BeigeCotton", "BrownCotton", "Canvas", "Denim", "DenimFlex", "Linen", "WovenFabric"),
    ),
}  # fmt: skip
"""The named configurations of design.md, section 1."""
