"""Prices that a test can work out in its head, without any hardware: multiplies of a touch and frames."""

from typing import Any

from eskin.choose.cost import Cost, CostModel
from eskin.golden.core import AcceleratorConfig


def cost_by_size(config: AcceleratorConfig) -> Cost:
    """A nanojoule a multiply of a touch and a taxel of a frame and kind, a cell a multiply of a step, a
    microsecond a class."""
    work = config.windows.steps * config.multiplies + config.last_frame * config.inputs
    return Cost(
        energy_touch_j=1e-9 * work,
        cells=config.multiplies,
        latency_s=1e-6 * config.classes,
        touch_s=config.touch_s,
        average_w=1e-6 * config.sensor.scan_rate_hz,
    )


def priced(**changes: Any) -> CostModel:
    """A prices of `cost_by_size`, in which every board holds everything."""
    true: dict[str, Any] = {"blocks_of": bool, "fits": bool}  # another process gets them
    return CostModel(**{"cost_of": cost_by_size, "board": "icebreaker", **true, **changes})
