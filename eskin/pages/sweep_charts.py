"""The chart of a sweep, from what sweep.json holds: accuracy against cost."""

from collections.abc import Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from eskin.golden.core import Record
from eskin.pages.charts import STYLE, draw_costs

COSTS = {
    "latency_s": "last features or pixel to decision (µs)",
    "energy_j": "energy of a touch or an image (µJ, estimate, iCE40UP5K)",
}
"""Costs that accuracy is set against: key of a point, label."""


def split_name(groups: Sequence[str]) -> str:
    """Name of the groups that a split leaves out."""
    return " and ".join(groups) or "recordings"


def accuracy_chart(result: Record) -> Figure:
    """A row a split: accuracy, with its deviation over seeds, against latency and energy."""
    splits = result["points"][0]["splits"]
    with rc_context(STYLE | {"axes.grid": True}):
        figure = Figure(figsize=(14, 1 + 3.8 * len(splits)), layout="constrained")
        figure.suptitle(f"{result['data']}: {result['sentence']}; grey: the best at each cost", fontsize=10)
        panels = figure.subplots(len(splits), len(COSTS), squeeze=False)
        for number, split in enumerate(splits):
            rows = [
                point
                | {
                    "accuracy": point["splits"][number]["integer_accuracy"],
                    "standard_error": float(np.std(point["splits"][number]["integer_by_seed"])),
                    "chosen": place == result["recommended"],
                    "fits": True,
                }
                for place, point in enumerate(result["points"])
            ]
            for axes, (cost, label) in zip(panels[number], COSTS.items(), strict=True):
                draw_costs(axes, rows, cost, label)
                axes.set_title(f"left out: {split_name(split['groups'])}")
    return figure
