"""Payloads of the streams between the stages of the chain, in the order in which a frame meets them."""

from amaranth.hdl import Cat, Const, Mux, Value, signed, unsigned
from amaranth.lib import data
from amaranth.utils import ceil_log2

from eskin.golden.core import SUMMED, AcceleratorConfig
from eskin.rtl.common.fixed import shape_of
from eskin.rtl.common.ports import struct

MARGIN_SHIFT = 2
"""Bits of a logit that are one unit of the margin in the decision word."""


def sample_layout(config: AcceleratorConfig) -> data.StructLayout:
    """One A/D code as it comes in; ``first`` and ``last`` mark taxels 0 and taxels-1 of a frame."""
    return struct(sample=shape_of(config.sample_format), first=1, last=1)


def _marked(config: AcceleratorConfig, *flags: str) -> data.StructLayout:
    masked = ("masked",) * bool(config.faults.fault_frames)
    return data.StructLayout(
        {"complement": signed(config.deviation_bits)} | dict.fromkeys((*flags, *masked), 1)
    )


def frame_layout(config: AcceleratorConfig) -> data.StructLayout:
    """One deviation e on its way to the windows, as complement ~e = -e - 1, with the detector's marks of its
    frame.

    Complements spare every later subtraction its inverters: ``a - b = ~(~a + b)``. Flags belong to the
    frame, on each of its beats. ``window_mode`` touch: ``touch`` = the gate is open; ``onset`` (with the last
    taxel only) = the rule was met, this is frame f. ``window_mode`` free: ``hop_last`` = last frame of a hop;
    ``emit`` = a window of the open touch ends with this frame; ``end`` = it is the touch's last. With a fault
    detector ``masked`` = this taxel is out of use in this frame, by mask or by a flag. ``window_mode`` whole: ``touch``;
    with the last taxel only ``loud`` = the rule was met, ``end`` = the touch ends, ``longest`` = having had
    ``touch_frames`` frames.
    """
    if config.windows.window_mode == "touch":
        return _marked(config, "touch", "onset")
    return window_layout(config)


def touch_layout(config: AcceleratorConfig) -> data.StructLayout:
    """One deviation of a frame that belongs to a touch, as complement; ``masked`` as of ``frame_layout``."""
    return _marked(config)


def has_door(config: AcceleratorConfig) -> bool:
    """True where frames come from outside and not all are taken; a converter makes none but those."""
    return config.sensor.scan_every > 1 and config.interface.converter.name == "none"


def expands(config: AcceleratorConfig) -> bool:
    """True if windows add up more than the deviations. Only then is there a feature expander."""
    return config.features.feature_kinds != ("mean",)


def stored(config: AcceleratorConfig) -> AcceleratorConfig:
    """``config`` with the kinds of feature that the store of ``window_mode`` whole adds up: an integral is made of
    means, extremes lie beside them, and a mean comes in every frame."""
    kinds = tuple(kind for kind in SUMMED if kind in ("mean", *config.features.feature_kinds))
    return config.replace(feature_kinds=kinds, feature_shift=(), aligned_means=False)


def window_layout(config: AcceleratorConfig) -> data.StructLayout:
    """One deviation of a frame that windows see, as complement, with the marks of its frame.

    ``hop_last`` = the last frame of a hop, or of the touch; ``emit`` = a window of the touch ends with this
    frame; ``end`` = it is the touch's last. ``window_mode`` free, whole: the same as ``frame_layout``.
    """
    whole = "touch", "loud", "end", "longest"
    return _marked(config, *(whole if config.follows_touch else ("hop_last", "emit", "end")))


def beat_layout(config: AcceleratorConfig) -> data.StructLayout:
    """Payload of the window averager's input: ``window_layout``, whose complement has the bits of any kind of
    feature.

    Each taxel sends the kinds that have a value in this frame, in order: the mean in every frame,
    activity where a block ends (``block_last``), an integral or an extreme with ``emit``. So they are the first of
    ``feature_kinds``: a window consists of whole blocks.
    """
    members = {name: field.shape for name, field in window_layout(config)}
    if expands(config):
        members |= {"complement": signed(config.beat_bits), "block_last": 1}
    return data.StructLayout(members)


def comes(kind: str, marks) -> Value:
    """True if a beat of ``kind`` comes in a frame with these marks of `beat_layout`."""
    return Const(1, 1) if kind == "mean" else marks.block_last if kind == "activity" else marks.emit


def sum_layout(config: AcceleratorConfig) -> data.StructLayout:
    """One window sum, as complement ~d.

    ``kind`` is there with several kinds of feature. ``length`` is an index into ``window_lengths``; ``final``
    marks the touch's last window. With a fault detector ``masked`` marks a taxel that is out of use in the
    window's last frame. ``window_mode`` whole: ``partial``, the touch was the longest.
    """
    lengths = unsigned(max(1, ceil_log2(len(config.window_lengths))))
    return data.StructLayout(
        {"complement": signed(config.sum_bits), "taxel": range(config.sensor.taxels)}
        | ({"kind": range(config.kinds)} if config.kinds > 1 else {})
        | {"length": lengths, "final": 1}
        | ({"partial": 1} if config.follows_touch else {})
        | ({"masked": 1} if config.faults.fault_frames else {})
    )


def centred_layout(config: AcceleratorConfig) -> data.StructLayout:
    """One centred sum, with the window's length index, first and last input, last window of the touch."""
    length = sum_layout(config)["length"].shape
    marks = dict.fromkeys(("first", "last", "final", *(("partial",) if config.follows_touch else ())), 1)
    return struct(value=shape_of(config.centred_format), length=length, **marks)


def decision_layout(config: AcceleratorConfig) -> data.StructLayout:
    """A decision, 32 bits: class index, margin (logit LSBs; votes for a global vote), step (0-based), global
    or local, partial touch, global with a margin below ``margin_threshold``. With more than 32 classes the
    margin is in `margin_units`; the layout is the decision word's."""
    flags = {"is_global": 1, "partial": 1, "unsure": 1}
    if config.wide_decisions:
        return data.StructLayout({"class": 7, "step": 8, "margin": 16 - MARGIN_SHIFT} | flags)
    return data.StructLayout({"class": 5, "margin": 16, "step": 8} | flags)


def margin_units(config: AcceleratorConfig, margin: Value, is_global: Value) -> Value:
    """The margin in the decision word: in units of 4 logit LSBs, of a global vote in votes; 14 bits.

    No margin of 16 bits saturates in these units, and votes are few: above their bits a vote's margin is 0,
    shifted or not.
    """
    votes = 0
    if len(margin) < 16:
        margin = Cat(margin, Const(0, 16 - len(margin)))
    if config.network.decision == "vote":
        votes = config.windows.steps.bit_length()
    return Cat(
        Mux(is_global, margin[bit], margin[bit + MARGIN_SHIFT]) if bit < votes else margin[bit + MARGIN_SHIFT]
        for bit in range(len(margin) - MARGIN_SHIFT)
    )
