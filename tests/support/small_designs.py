"""A small design whose touches last 200 frames, which others vary."""

from __future__ import annotations

from eskin.golden.core.config import AcceleratorConfig

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
