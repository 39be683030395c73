"""Decision trees over the features of all windows of a touch (docs/specification.md, section 5)."""

import numpy as np

from eskin.golden.core import AcceleratorConfig, Arrays, InputError


def check_forest(config: AcceleratorConfig, arrays: Arrays, source: str) -> None:
    """Refuse arrays that are no forest of the configuration's sizes; other cells pass.

    Raises
    ------
    InputError
        A node compares or subtracts an input that does not exist or is of another window, has a child that is neither a
        later node nor a class, or a tree is deeper than ``depth``.
    """
    if not config.is_forest:
        return
    forest, inputs, child = config.forest, arrays["tree_input"], arrays["child"].astype(int)
    number = np.arange(forest.nodes)[:, None]

    def refuse(name: str, why: str) -> InputError:
        return InputError(
            f"{source}, array {name}: {why}; fit the trees again, or give arrays and config.json of one fit"
        )

    if (inputs < 0).any() or (inputs >= config.windows.steps * config.inputs).any() or (inputs % 1).any():
        raise refuse("tree_input", f"names an input outside 0..{config.windows.steps * config.inputs - 1}")
    less = arrays["subtrahend"]
    if (less // config.inputs != inputs // config.inputs).any() or (less % 1).any():
        raise refuse("subtrahend", "names no input of the window of tree_input")
    leaf = child < 0
    if (
        (leaf & (child < -config.classes)).any()
        or (~leaf & (child <= number)).any()
        or (child >= forest.nodes).any()
    ):
        raise refuse(
            "child", f"names neither a later node below {forest.nodes} nor a class, -1 to -{config.classes}"
        )
    level = np.ones(forest.nodes, dtype=int)
    for node in range(forest.nodes):  # children come later than their parents
        for following in child[node][~leaf[node]]:
            level[following] = max(level[following], level[node] + 1)
    if level.max() > forest.depth:
        raise refuse("child", f"makes a tree of {level.max()} comparisons, above depth {forest.depth}")


def run_forest(
    config: AcceleratorConfig, arrays: Arrays, features: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(nothing (n, K, 0), logits (n, K, C)) of features (n, K, D): the sums of the trees' votes after every step,
    where a window that is not there yet has the features of the last one."""
    touches, steps, inputs = features.shape
    window, column = np.divmod(arrays["tree_input"].astype(int), inputs)
    less = arrays["subtrahend"].astype(int) % inputs
    single = less == column
    child, vote, threshold = arrays["child"].astype(int), arrays["vote"], arrays["threshold"]
    touch, step = np.indices((touches, steps)).reshape(2, -1)
    logits = np.zeros((touches, steps, config.classes))
    for root in range(config.forest.trees):
        rows, node = np.arange(len(touch)), np.full(len(touch), root)  # walks under way
        while len(rows):
            compared = features[touch[rows], np.minimum(window[node], step[rows])]
            row = np.arange(len(rows))
            value = compared[row, column[node]] - np.where(single[node], 0, compared[row, less[node]])
            side = (value > threshold[node]).astype(int)
            following = child[node, side]
            ends = following < 0
            to = rows[ends]
            logits[touch[to], step[to], -1 - following[ends]] += vote[node, side][ends]
            rows, node = rows[~ends], following[~ends]
    return features[..., :0], logits
