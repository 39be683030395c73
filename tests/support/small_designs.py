"""Designs that many tests vary: a small one whose touches last 200 frames; one that tracks its rest level; the
thesis's with any cell."""

from eskin.golden.core import PRESETS, AcceleratorConfig, QFormat

SMALL = AcceleratorConfig.of(
    taxels=4,
    hidden=4,
    band_low=25920,
    band_high=26880,
    hop=20,
    window=41,
    touch_frames=200,
    steps=8,
    pretrigger_frames=10,
    rearm_frames=20,
    decision="vote",
    lanes=2,
)
WIDE = SMALL.replace(
    taxels=6,
    hidden=5,
    weight_format=QFormat(3, 13),
    recurrent_format=QFormat(4, 12),
    dense_format=QFormat(3, 13),
    feature_format=QFormat(3, 11),
    state_format=QFormat(2, 14),
    logit_format=QFormat(6, 10),
)
"""With weights of 16 bits."""
TRACKED = AcceleratorConfig.of(
    taxels=4,
    hidden=4,
    sample_rate_hz=500.0,
    rest="tracked",
    rest_frames=8,
    onset="baseline",
    onset_mean_frames=4,
    onset_check_frames=4,
    onset_threshold=20,
    rearm_frames=16,
    window_mode="free",
    hop=8,
    window=16,
    steps=5,
    class_names=("press", "stroke"),
)
CELLS = [("gru", "before"), ("gru", "after"), ("lstm", "before")]


def reference(cell: str = "gru", reset: str = "before", lanes: int = 4, **changes) -> AcceleratorConfig:
    """The thesis's sizes and formats; states with room for an LSTM's."""
    wide = {"state_format": QFormat(4, 12)}
    return PRESETS["thesis"].replace(cell=cell, reset=reset, lanes=lanes, **wide | changes)


def with_converter(converter: str, **fields) -> dict:
    """Fields of a configuration; those that `HARDWARE` lacks are the converter's."""
    hardware = {name: fields.pop(name) for name in HARDWARE & {*fields}}
    return hardware | {"converter": dict(name=converter, **fields)}


HARDWARE = {"taxels", "sample_rate_hz", "clock_hz", "rows", "columns", "scan_every"}
