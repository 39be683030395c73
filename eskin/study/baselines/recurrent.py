"""Networks that eskin puts into hardware: its own recipe, and GRU and LSTM under the thesis's protocol.

The protocol (M. Alameh, chapter 3): N windows, each overlapping the next by half, over the whole touch; their
means alone, one mean and one scale for all taxels; a loss on the last step, which decides; Adam, 96 epochs of
batches of 48. Two things are not the thesis's: the resting level is removed, since it tells the session
(docs/results.md), and mean and scale come from the training part alone.

All folds and seeds of a network train at once. Accuracy is that of the integer network, quantised after
training to 8-bit weights; ``float_accuracy`` stands beside it.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from eskin.choose.choose_network import network
from eskin.golden.core import AcceleratorConfig, InputError
from eskin.golden.model import with_network
from eskin.training.recipe import AS_RECORDED, RECIPES, Recipe, choose_recipe

THESIS_STEPS = (20, 50, 100, 200, 256)
"""Windows of a touch that the thesis tries."""


@dataclass(frozen=True)
class NetworkMethod:
    """A network of a cell and hidden units; steps: windows under the thesis's protocol, 0: our front end and
    recipe; recipe: what differs from it."""

    name: str
    label: str
    family: str
    cell: str
    hidden: int | None
    steps: int = 0
    recipe: tuple[tuple[str, Any], ...] = ()
    one_seed: bool = False

    def network(self, config: AcceleratorConfig) -> tuple[AcceleratorConfig, Recipe]:
        """Configuration and recipe on the front end of ``config``.

        Raises
        ------
        InputError
            The touch has too few frames for the windows, or the network fits no accelerator.
        """
        if not self.steps:
            changed = network(config, self.cell, self.hidden)
            return changed, dataclasses.replace(choose_recipe(changed), **dict(self.recipe))
        return thesis_network(config, self.cell, self.hidden or 12, self.steps), RECIPES["thesis"]


def thesis_network(config: AcceleratorConfig, cell: str, hidden: int, steps: int) -> AcceleratorConfig:
    """``config`` with the windows, features and decision of the thesis over the same touch.

    Raises
    ------
    InputError
        As ``NetworkMethod.network``.
    """
    plain = config.replace(
        feature_kinds=("mean",), compand="none", feature_scale="array", feature_shift=(), decision="last"
    )
    if config.windows.window_mode == "touch":
        return with_network(plain, cell=cell, hidden=hidden, steps=steps)
    hop = config.last_frame // (steps + 1)
    if not hop:
        raise InputError(
            f"{steps} windows: a touch has {config.last_frame} frames; take fewer windows or a front end of "
            "longer touches"
        )
    return with_network(plain.replace(hop=hop, window=2 * hop, steps=steps), cell=cell, hidden=hidden)


def _thesis(cell: str, hidden: int, steps: int) -> NetworkMethod:
    called = f"{cell.upper()}{steps}, {hidden} neurons, thesis's protocol"
    return NetworkMethod(f"{cell}{hidden}-n{steps}", called, "thesis", cell, hidden, steps)


OURS = (
    NetworkMethod("linear", "linear cell, our recipe", "ours", "linear", None),
    NetworkMethod(
        "least-squares",
        "linear cell, least squares",
        "ours",
        "linear",
        None,
        recipe=(*AS_RECORDED.items(), ("squares", True)),
        one_seed=True,
    ),
    NetworkMethod("gru4", "GRU 4, our recipe", "ours", "gru", 4),
    NetworkMethod("gru12", "GRU 12, our recipe", "ours", "gru", 12),
)
THESIS: Sequence[NetworkMethod] = tuple(
    _thesis(cell, hidden, steps)
    for steps in THESIS_STEPS
    for cell, hidden in (("gru", 12), ("gru", 10), ("lstm", 10))
)
