"""The groups of a configuration's fields. Each checks itself; config.py checks conditions between groups.

The annotations hold types, ranges and permitted words; pydantic checks them.
"""

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args

from annotated_types import Ge, Gt, Interval
from pydantic import AfterValidator, BeforeValidator, InstanceOf, StrictBool, StrictInt, StrictStr

from eskin.golden.core.converters import Converter, NoConverter, converter_of
from eskin.golden.core.formats import QFormat
from eskin.golden.core.group import Code, Group, Only, Real, Refusal
from eskin.golden.core.images import Stage, layer_stages, parse_layer

Rest = Literal["none", "tracked", "initial"]
OnsetRule = Literal["band", "baseline", "immediate"]
WindowMode = Literal["touch", "free", "whole"]
FeatureKind = Literal["mean", "activity", "integral", "highest", "lowest"]
ActivityRule = Literal["sum", "change"]
FeatureScale = Literal["array", "taxel"]

FEATURE_KINDS: tuple[str, ...] = get_args(FeatureKind)
"""Kinds of value that a window gives per taxel, in the order of the features."""
SUMMED: tuple[str, ...] = ("mean", "activity")
"""Kinds that a window adds up; a value of the others goes back to the touch's first frame."""
EXTREMES: tuple[str, ...] = ("highest", "lowest")
MOST_CLASSES = 128
"""Highest number of classes of a classifier."""
MOST_NODES = 8192
"""Highest number of comparisons of all trees: each has up to eight words of the host, whose address has 16 bits."""
Cell = Literal["gru", "lstm", "linear", "trees", "image"]
WeightSets = Literal["window", "one"]
Reset = Literal["before", "after"]
GateActivation = Literal["sigmoid", "hard_sigmoid"]
Decision = Literal["vote", "last", "early"]
Readout = Literal["dense", "prototypes"]
LaneType = Literal["plain", "dsp"]
Stimulator = Literal["none", "decisions", "positions"]


def _format(allowed: Callable[[QFormat], bool], words: str) -> AfterValidator:
    """Formats of one kind; ``words``: the advice for any other format."""

    def check(fmt: QFormat) -> QFormat:
        if not allowed(fmt):
            raise ValueError(words)
        return fmt

    return AfterValidator(check)


def _signed(low: int) -> AfterValidator:
    words = f"use a signed format of {low} to 16 bits"
    return _format(lambda fmt: fmt.signed and low <= fmt.width <= 16, words)


_Format = Annotated[
    InstanceOf[QFormat],
    BeforeValidator(lambda value: QFormat.parse(value) if isinstance(value, str) else value),
]
Weight = Annotated[_Format, _signed(2)]
Feature = Annotated[_Format, _signed(4)]
State = Annotated[_Format, _signed(6)]
ImageWeight = Annotated[
    _Format, _format(lambda fmt: fmt.signed and fmt.width in (4, 8), "use signed formats of 4 or 8 bits")
]
ImageMap = Annotated[
    _Format,
    _format(
        lambda fmt: not fmt.signed and fmt.width == 8, "use unsigned formats of 8 bits, for example UQ(3,5)"
    ),
]
LayerText = Annotated[StrictStr, AfterValidator(lambda text: str(parse_layer(text)))]

_RECURRENT = Only("cell", ("gru", "lstm"))
_EARLY = Only("decision", ("early",))
_PROTOTYPES = Only("readout", ("prototypes",))
_POSITION = Only("position", (True,))


@dataclass(frozen=True, kw_only=True)
class Sensor(Group):
    """The sensor, which delivers frames.

    - taxels: number of taxels.
    - sample_rate_hz: frames per second of the source.
    - scan_every: the chain takes the first of every N frames of the source; all other fields in frames count the frames
      that it takes.
    - sample_bits, sample_signed: format of an A/D code.
    - volt_per_code: volt, or another unit of the samples, per code; one value for each taxel if taxels are of
      different kinds; 0 if it is not known.
    - masked_taxels: indices (from 0) of taxels that are out of use after a reset.
    """

    taxels: Annotated[StrictInt, Interval(ge=1, le=256)] = 16
    sample_rate_hz: Annotated[Real, Gt(0)] = 3000.0
    scan_every: Literal[1, 2, 4, 8, 16] = 1
    sample_bits: Annotated[StrictInt, Interval(ge=1, le=16)] = 16
    sample_signed: StrictBool = False
    volt_per_code: Annotated[Real, Ge(0)] | tuple[Annotated[Real, Gt(0)], ...] = 0.0
    masked_taxels: tuple[StrictInt, ...] = ()

    @property
    def scan_rate_hz(self) -> float:
        """Frames a second that the chain takes."""
        return self.sample_rate_hz / self.scan_every

    def source_frame(self, frame: int) -> int:
        """Number of the source's frame that the chain counts as ``frame``, both from 1; 0 (none) stays 0."""
        return (frame - 1) * self.scan_every + 1 if frame else 0

    @property
    def live(self) -> list[int]:
        """Taxels that are not masked."""
        return [taxel for taxel in range(self.taxels) if taxel not in self.masked_taxels]

    def refusals(self) -> Iterator[Refusal]:
        if any(not 0 <= taxel < self.taxels for taxel in self.masked_taxels):
            yield "masked_taxels", f"names a taxel outside 0..{self.taxels - 1}"
        if len(set(self.masked_taxels)) != len(self.masked_taxels):
            yield "masked_taxels", "names a taxel twice; name each once"
        if isinstance(self.volt_per_code, tuple) and len(self.volt_per_code) != self.taxels:
            yield (
                "volt_per_code",
                f"has {len(self.volt_per_code)} values for {self.taxels} taxels; give one for each",
            )


@dataclass(frozen=True, kw_only=True)
class RestLevel(Group):
    """The level from which deviations are counted.

    - rest: ``none`` (0), ``tracked`` (the mean of the first rest_frames frames, then 1/16 code per frame towards the sample,
      frozen during a touch) or ``initial`` (the mean of the first rest_frames frames, then frozen).
    - rest_frames: frames of that mean.
    - clip: codes; a deviation is clipped to +-clip. 0: no clip.
    """

    rest: Rest = "none"
    rest_frames: Annotated[StrictInt, Interval(ge=0, le=4096), Only("rest", ("tracked", "initial"))] = 0
    clip: Code = 0

    def refusals(self) -> Iterator[Refusal]:
        if self.rest != "none" and not self.rest_frames:
            yield "rest_frames", f"is 0 with rest '{self.rest}'; give at least 1"


@dataclass(frozen=True, kw_only=True)
class Onset(Group):
    """The rule that detects the start of a touch.

    - onset: ``band`` (any taxel outside band_low..band_high, codes), ``baseline`` (checked every onset_check_frames frames:
      any taxel whose mean deviation over onset_mean_frames exceeds onset_threshold codes) or ``immediate`` (open from
      frame 1, one touch).
    - rearm_frames: quiet frames before the next touch may start.
    - onset_hits, onset_span: the rule must hold in onset_hits of the last onset_span checks.
    """

    onset: OnsetRule = "band"
    band_low: Annotated[StrictInt, Only("onset", ("band",))] = 0
    band_high: Annotated[StrictInt, Only("onset", ("band",))] = 0
    onset_mean_frames: StrictInt = 64
    onset_check_frames: StrictInt = 16
    onset_threshold: Annotated[StrictInt, Interval(ge=1, le=65535)] = 12
    rearm_frames: Annotated[StrictInt, Interval(ge=1, le=65535)] = 320
    onset_hits: Annotated[StrictInt, Ge(1)] = 1
    onset_span: Annotated[StrictInt, Interval(ge=1, le=16)] = 1

    def refusals(self) -> Iterator[Refusal]:
        if self.onset_hits > self.onset_span:
            yield "onset_hits", f"is {self.onset_hits}; it must lie in 1..{self.onset_span}"
        if self.onset == "baseline":
            blocks, remainder = (
                divmod(self.onset_mean_frames, self.onset_check_frames)
                if self.onset_check_frames > 0
                else (0, 1)
            )
            if remainder or blocks not in (1, 2, 4, 8):
                yield (
                    "onset_mean_frames",
                    f"is {self.onset_mean_frames}; it must be 1, 2, 4 or 8 times onset_check_frames",
                )
            # x & (x - 1) is 0 for powers of two (and for 0, which the check above has refused)
            if self.onset_check_frames & (self.onset_check_frames - 1):
                yield "onset_check_frames", f"is {self.onset_check_frames}; it must be a power of two"


@dataclass(frozen=True, kw_only=True)
class Faults(Group):
    """The fault detector.

    - fault_frames: length of the blocks in which every taxel is judged stuck, silent or saturated, and then masked. 0: no
      detector.
    - fault_activity: codes; a taxel whose samples change by no more than this in total during a whole block has failed.
    """

    fault_frames: Annotated[StrictInt, Interval(ge=0, le=4096)] = 0
    fault_activity: Code = 0

    def refusals(self) -> Iterator[Refusal]:
        if self.fault_frames & (self.fault_frames - 1) or self.fault_frames == 1:
            yield "fault_frames", f"is {self.fault_frames}; it must be 0 or a power of two from 2 on"


@dataclass(frozen=True, kw_only=True)
class Windows(Group):
    """The position and the number of windows in a touch.

    - window_mode: ``touch`` (hops start pretrigger_frames before the onset, and windows end at touch_frames at the latest),
      ``free`` (hops run from arm) or ``whole`` (the windows divide the whole touch once it has ended: by rearm_frames quiet
      frames, by the end of the recording, or after touch_frames).
    - hop, window: lengths in frames. ``whole``: the first hop, which doubles as the touch goes on.
    - steps: windows per touch, which are steps of the network.
    - store_per_window: ``whole`` only: the most hops of a window; steps times as many sums are stored.
    """

    window_mode: WindowMode = "touch"
    pretrigger_frames: Annotated[
        StrictInt, Interval(ge=0, le=1024), Only("window_mode", ("touch",), absent=0)
    ] = 50
    touch_frames: Annotated[StrictInt, Interval(ge=1, le=65535)] = 6144
    hop: Annotated[StrictInt, Interval(ge=1, le=65535)] = 307
    window: StrictInt = 615
    steps: Annotated[StrictInt, Interval(ge=1, le=256)] = 20
    store_per_window: Annotated[StrictInt, Interval(ge=2, le=8), Only("window_mode", ("whole",))] = 8

    def refusals(self) -> Iterator[Refusal]:
        if self.window not in (2 * self.hop, 2 * self.hop + 1):
            yield "window", f"is {self.window} at hop {self.hop}; a window is 2 hop or 2 hop + 1 frames"
        if self.window_mode != "touch":
            mode = f"with window_mode '{self.window_mode}'"
            if self.window != 2 * self.hop:
                yield "window", f"is {self.window}; {mode} it is 2 hop = {2 * self.hop} frames"
        if self.window_mode == "touch" and self.hop * (self.steps - 1) + 1 > self.touch_frames:
            yield (
                "steps",
                f"is {self.steps}: window {self.steps} would begin after frame {self.touch_frames}; lower "
                "steps or hop",
            )
        if self.window_mode == "whole" and self.steps * self.store_per_window % 2:
            yield (
                "store_per_window",
                f"is {self.store_per_window} with {self.steps} steps; sums are added in pairs, so make one of them even",
            )
        if self.window_mode == "whole" and self.hop * self.steps > self.touch_frames:
            yield (
                "touch_frames",
                f"is {self.touch_frames}; the longest touch takes at least {self.steps} hops of {self.hop} frames",
            )


def _both_extremes(kinds: Any) -> Any:
    """Kinds with ``peak`` as the two extremes that it stands for."""
    if not isinstance(kinds, (list, tuple)):
        return kinds
    return tuple(kind for name in kinds for kind in (EXTREMES if name == "peak" else [name]))


@dataclass(frozen=True, kw_only=True)
class Features(Group):
    """The features that the network reads.

    - feature_kinds: the values of each taxel in a window, any of ``mean`` (sum of its deviations), ``activity`` (how much they
      move in the window), and since the start of the touch's first window ``integral`` (their sum, companded), ``highest`` and
      ``lowest`` (the largest and the least of them), in this order. ``peak`` stands for both extremes.
    - activity_rule: activity is the sum over blocks of activity_block frames of the absolute block ``sum``, or of the absolute
      ``change`` from the block before.
    - integral_knee, integral_frac: the integral is companded to log2(1 + |d| / 2**integral_knee) with its sign, linear between
      powers of two, with integral_frac fraction bits.
    - feature_scale: one mean and scale per kind for the whole ``array``, or for each ``taxel``.
    - feature_shift: bits dropped from (sum - mean), for each distinct window length and, within it, each kind. A negative
      shift gives the means that many fraction bits and drops nothing.
    - aligned_means: the dropped bits are 0 in every mean, so the hardware needs no cells for them; all
      lengths then share one shift.
    """

    feature_kinds: Annotated[tuple[FeatureKind, ...], BeforeValidator(_both_extremes)] = ("mean",)
    activity_rule: ActivityRule = "sum"
    activity_block: Annotated[StrictInt, Interval(ge=1, le=64)] = 1
    integral_knee: Annotated[StrictInt, Interval(ge=0, le=30)] = 8
    integral_frac: Annotated[StrictInt, Interval(ge=1, le=12)] = 8
    feature_scale: FeatureScale = "array"
    feature_shift: tuple[StrictInt, ...] = ()
    aligned_means: StrictBool = False

    def refusals(self) -> Iterator[Refusal]:
        if not self.feature_kinds:
            yield "feature_kinds", f"is empty; name one or more of {', '.join(FEATURE_KINDS)}"
        if self.feature_kinds != tuple(kind for kind in FEATURE_KINDS if kind in self.feature_kinds):
            yield (
                "feature_kinds",
                f"is {', '.join(self.feature_kinds)}; name each kind once, in the order "
                f"{', '.join(FEATURE_KINDS)}",
            )
        if self.aligned_means and (len(self.feature_kinds) > 1 or self.feature_scale == "taxel"):
            yield (
                "aligned_means",
                "needs one mean per window length; leave it out with several kinds of feature or one scale per "
                "taxel",
            )
        if self.aligned_means and len(set(self.feature_shift)) > 1:
            yield (
                "aligned_means",
                f"needs one feature_shift for every window length, not {self.feature_shift}",
            )


@dataclass(frozen=True, kw_only=True)
class Network(Group):
    """The classifier, and how it decides.

    - cell: ``image`` uses the layers of the group image, ``trees`` the group forest.
    - weight_sets: linear only: weights for every ``window``, or ``one`` set for all windows.
    - reset: GRU only: the side of the reset gate.
    - hidden, gate_activation: GRU and LSTM.
    - class_names: names of the classes.
    - decision: the touch's decision is the ``vote`` of all steps, the decision of the ``last`` step, or
      ``early``: the decision of the first step at which the last early_steps local decisions agree, each with
      a margin of at least early_margin (logit LSBs), or of the last step if there is none.
    - margin_threshold: a touch's decision with a smaller margin is flagged unsure. 0: never.
    """

    cell: Cell = "gru"
    weight_sets: Annotated[WeightSets, Only("cell", ("linear",))] = "window"
    reset: Annotated[Reset, Only("cell", ("gru",))] = "before"
    gate_activation: Annotated[GateActivation, _RECURRENT] = "sigmoid"
    hidden: Annotated[StrictInt, Interval(ge=4, le=32), _RECURRENT] = 12
    class_names: tuple[StrictStr, ...] = ("brush", "roll", "slide")
    decision: Decision = "vote"
    early_margin: Annotated[Code, _EARLY] = 0
    early_steps: Annotated[StrictInt, Interval(ge=1, le=256), _EARLY] = 1
    margin_threshold: Code = 0

    def refusals(self) -> Iterator[Refusal]:
        if not 2 <= len(self.class_names) <= MOST_CLASSES:
            yield "class_names", f"has {len(self.class_names)} names; a classifier has 2 to {MOST_CLASSES}"
        if len(set(self.class_names)) != len(self.class_names):
            yield "class_names", "has a name twice; names must differ"


@dataclass(frozen=True, kw_only=True)
class ReadoutRule(Group):
    """The decision rule of a step. ``eskin quantise --readout`` sets it; training does not use it.

    - readout: ``dense`` (the logits) or ``prototypes`` (the nearest stored trajectory of the hidden state; of a linear cell, of
      the logits). The other fields belong to ``prototypes``.
    - prototypes: trajectories per class from training.
    - taught: slots per class for touches that are taught in use.
    - state_code_bits, state_code_shift: a stored value is a state (linear cell: logit) without its state_code_shift lowest
      bits, rounded to state_code_bits.
    - unknown_above: a touch is unsure if its distance per step from the nearest prototype is larger. 0: never.
    - spare_classes: the last N classes have no prototype from training; they are recognised once they are taught.
    - taught_shift: the distance of a taught touch counts without its lowest N bits; 1 halves it.
    """

    readout: Readout = "dense"
    prototypes: Annotated[StrictInt, Interval(ge=1, le=16), _PROTOTYPES] = 1
    taught: Annotated[StrictInt, Interval(ge=0, le=16), _PROTOTYPES] = 0
    state_code_bits: Annotated[StrictInt, Interval(ge=3, le=8), _PROTOTYPES] = 4
    state_code_shift: Annotated[StrictInt, Interval(ge=0, le=15), _PROTOTYPES] = 0
    unknown_above: Annotated[Code, _PROTOTYPES] = 0
    spare_classes: Annotated[StrictInt, Interval(ge=0, le=30), _PROTOTYPES] = 0
    taught_shift: Annotated[StrictInt, Interval(ge=0, le=3), _PROTOTYPES] = 0

    def refusals(self) -> Iterator[Refusal]:
        if self.taught_shift and not self.taught:
            yield (
                "taught_shift",
                f"is {self.taught_shift}, but there are no slots for taught touches; set taught",
            )
        if self.spare_classes and not self.taught:
            yield (
                "spare_classes",
                f"is {self.spare_classes}, but there are no slots to teach them; set taught",
            )


@dataclass(frozen=True, kw_only=True)
class Forest(Group):
    """The decision trees of the cell ``trees``. The fit writes them.

    - trees: number of trees.
    - depth: the most comparisons from a tree's first node to its vote.
    - nodes: comparisons of all trees together; the first one of tree t is node t.
    """

    trees: Annotated[StrictInt, Interval(ge=1, le=255)] = 16
    depth: Annotated[StrictInt, Interval(ge=1, le=16)] = 10
    nodes: Annotated[StrictInt, Interval(ge=1, le=MOST_NODES)] = 1024

    def refusals(self) -> Iterator[Refusal]:
        if self.nodes < self.trees:
            yield "nodes", f"is {self.nodes} for {self.trees} trees; each tree has at least one"


@dataclass(frozen=True, kw_only=True)
class Image(Group):
    """A network for images instead of a cell that reads windows. It exists if layers is not empty.

    - height, width: pixels of an image, which arrives as height frames of width samples.
    - layers: from the image on, each ``conv K N`` (kernel K x K of 1, 3 or 5, N channels, ReLU), ``pool`` (2 x 2, after a
      convolution) or ``dense N``; the last is ``dense`` with one output per class.
    - weight_formats: formats of the layers that have weights, 4 or 8 bits.
    - map_formats: output formats of all these layers but the last, 8 bits unsigned. The last layer's logits have
      ``logit_format``. Both lists are empty until the model is quantised.
    """

    height: Annotated[StrictInt, Interval(ge=0, le=256)] = 0
    width: Annotated[StrictInt, Interval(ge=0, le=160)] = 0
    layers: tuple[LayerText, ...] = ()
    weight_formats: tuple[ImageWeight, ...] = ()
    map_formats: tuple[ImageMap, ...] = ()

    def refusals(self) -> Iterator[Refusal]:
        if not self.layers:
            for field in ("height", "width", "weight_formats", "map_formats"):
                if getattr(self, field):
                    yield field, "is given without layers; name the layers, or leave it out"
            return
        for field in ("height", "width"):
            if getattr(self, field) < 4:
                yield field, f"is {getattr(self, field)}; an image has at least 4 x 4 pixels"
        try:
            weighted = sum(1 for stage in self.stages() if stage.weights)
        except ValueError as error:
            yield "layers", str(error)
        for field, needed in (("weight_formats", weighted), ("map_formats", weighted - 1)):
            count = len(getattr(self, field))
            if count != (needed if self.weight_formats else 0):
                yield (field, f"has {count} formats and {needed} layers need one; quantise the model again")

    def stages(self) -> tuple[Stage, ...]:
        """Every layer with the shapes of its maps."""
        return (
            layer_stages(self.height, self.width, tuple(map(parse_layer, self.layers))) if self.layers else ()
        )


@dataclass(frozen=True, kw_only=True)
class Formats(Group):
    """Number formats. ``eskin quantise`` writes them.

    - weight_format, recurrent_format, dense_format: weights of inputs, of the hidden state and of the dense layer.
    - bias_format, dense_bias_format: their biases.
    - feature_format, state_format, logit_format: values.
    - gate_frac: gate codes are 0..2**gate_frac.
    - table_entries: entries of an activation table, over +-8.

    A linear cell uses dense_format, dense_bias_format, feature_format, gate_frac (of the normaliser) and logit_format;
    trees use the last three.
    """

    weight_format: Weight = QFormat(3, 5)
    recurrent_format: Weight = QFormat(3, 5)
    dense_format: Weight = QFormat(3, 5)
    bias_format: Weight = QFormat(5, 11)
    dense_bias_format: Weight = QFormat(5, 11)
    feature_format: Feature = QFormat(4, 8)
    state_format: State = QFormat(2, 12)
    gate_frac: Annotated[StrictInt, Interval(ge=4, le=14)] = 13
    logit_format: State = QFormat(6, 10)
    table_entries: Literal[64, 128, 256, 512, 1024] = 512


@dataclass(frozen=True, kw_only=True)
class Hardware(Group):
    """The hardware's structure.

    - lanes, lane_type: multipliers that work in parallel, and their type.
    - loadable: weights and constants are written over the host bus; otherwise they are ROM.
    - clock_hz: frequency of the clock.
    - decide_within_s: latency budget from a window's last sample to its decision; 0: one frame (images: one image).
    - checksum: memories and registers are checked when they are used, and a fault sets a flag.
    - watchdog: a chain that hangs returns to idle.
    - one_port: no memory of the pre-trigger ring is read and written in the same cycle, as macros with one port require.
    - one_phase: all rows of a recurrent cell are computed after the features arrive. This saves the memory of partial sums and
      delays decisions; dsp lanes always work like this.
    - clock_gate: the clock stops while nothing is under way; for chips, not with dsp lanes.
    - spare_blocks: weights of dsp lanes lie in the large memories of an iCE40 UP5K, which saves block memories; ``eskin build``
      sets it where block memories run out.
    """

    lanes: Annotated[StrictInt, Interval(ge=1, le=64)] = 4
    lane_type: LaneType = "plain"
    loadable: StrictBool = True
    checksum: StrictBool = False
    watchdog: StrictBool = False
    one_port: StrictBool = False
    one_phase: StrictBool = False
    clock_gate: StrictBool = False
    spare_blocks: StrictBool = False
    clock_hz: Annotated[Real, Gt(0)] = 12e6
    decide_within_s: Annotated[Real, Ge(0)] = 0.0

    def refusals(self) -> Iterator[Refusal]:
        if self.lane_type == "dsp" and self.clock_gate:
            yield (
                "clock_gate",
                "is for chips, and lane_type 'dsp' is for FPGAs; use plain lanes or leave it out",
            )


@dataclass(frozen=True, kw_only=True)
class Interface(Group):
    """Hardware on the pins in front of the chain. With ``none`` nothing of it is built.

    - converter: ``none``, a name from golden/core/converters, or an object of the name and the converter's fields:
      ``{"name": "ddc232", "bits": 16}``.
    - rows, columns: size of the array (taxel = row x columns + column), for ``matrix``, ``mpr121`` and position.
    - send_frames: the host may ask for the converter's frames over the serial link.
    - position: compute where the array is touched. position_rest: sample of an untouched cell. position_threshold: codes above
      it from which a cell is touched. slide_least: sixteenths of a cell between first and last position, along the longer
      axis, from which a touch is a slide.
    - stimulator: electrodes on the skin are driven by ``decisions`` (class to electrode) or ``positions`` (array to electrodes).
    - electrodes: one of 1..24 for each class, row by row; 0: none. Empty: class k has electrode k + 1.
    - stim_amplitude, stim_delay, stim_frequency, stim_width: settings after a reset, in the stimulator's units.
    - amplitude_limit, delay_limit, frequency_limit, width_limit: limits that no host can exceed.
    - hold_s: seconds for which a decision or position holds. on_limit_s: longest time that an electrode is on.
    """

    converter: Annotated[InstanceOf[Converter], BeforeValidator(converter_of)] = NoConverter()
    send_frames: StrictBool = False
    position: StrictBool = False
    rows: Annotated[StrictInt, Interval(ge=1, le=16)] = 4
    columns: Annotated[StrictInt, Interval(ge=1, le=16)] = 4
    position_rest: Annotated[StrictInt, _POSITION] = 0
    position_threshold: Annotated[StrictInt, Ge(0), _POSITION] = 1
    slide_least: Annotated[StrictInt, Interval(ge=1, le=255), _POSITION] = 16
    stimulator: Stimulator = "none"
    electrodes: tuple[StrictInt, ...] = ()
    stim_amplitude: Annotated[StrictInt, Interval(ge=0, le=255)] = 12
    stim_delay: Code = 5000
    stim_frequency: Code = 50
    stim_width: Code = 200
    amplitude_limit: Annotated[StrictInt, Interval(ge=0, le=255)] = 30
    delay_limit: Code = 5000
    frequency_limit: Code = 50
    width_limit: Code = 256
    hold_s: Annotated[Real, Gt(0)] = 0.25
    on_limit_s: Annotated[Real, Gt(0)] = 2.0

    def refusals(self) -> Iterator[Refusal]:
        for name in ("amplitude", "delay", "frequency", "width"):
            value, limit = getattr(self, f"stim_{name}"), getattr(self, f"{name}_limit")
            if value > limit:
                yield f"stim_{name}", f"is {value} and {name}_limit is {limit}; give at most that"
        if any(not 0 <= electrode <= 24 for electrode in self.electrodes):
            yield "electrodes", "has a value outside 0..24; give 1 to 24, or 0 for none"


GROUPS: dict[str, type[Group]] = {
    "sensor": Sensor,
    "rest_level": RestLevel,
    "onset_rule": Onset,
    "faults": Faults,
    "windows": Windows,
    "features": Features,
    "network": Network,
    "readout_rule": ReadoutRule,
    "forest": Forest,
    "image": Image,
    "formats": Formats,
    "hardware": Hardware,
    "interface": Interface,
}
"""The groups by their names in a configuration and its file, in the order in which a frame passes them; the
interface, which most configurations do not use, is last."""

GROUP_OF: dict[str, str] = {
    field.name: group
    for group, kind in GROUPS.items()
    for field in dataclasses.fields(kind)  # type: ignore[arg-type]
}
"""The group of each field. No two groups have a field of the same name."""
