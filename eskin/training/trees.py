"""Forests of scikit-learn as the arrays of the cell ``trees`` (docs/specification.md, section 5)."""

from typing import Any

import numpy as np

from eskin.golden.core import AcceleratorConfig, Arrays


def forest_arrays(config: AcceleratorConfig, fitted: Any) -> tuple[AcceleratorConfig, Arrays]:
    """The configuration with the forest's sizes, and its arrays, real.

    The roots come first, then each tree's other nodes in scikit-learn's order, parents before children. A leaf votes for its
    most frequent class, by that class's share; a tree of one leaf compares, and votes the same on both sides.

    Parameters
    ----------
    fitted:
        A ``RandomForestClassifier`` or ``ExtraTreesClassifier``, fitted on (touches, steps * inputs), inputs of window 0
        first, and labels that are class indices.
    """
    trees = [estimator.tree_ for estimator in fitted.estimators_]
    inner = [np.flatnonzero(tree.children_left >= 0)[1:] for tree in trees]  # without the root
    first = len(trees) + np.cumsum([0, *map(len, inner)])
    nodes = int(first[-1])
    arrays: dict[str, Any] = {name: np.zeros(nodes) for name in ("tree_input", "threshold")}
    arrays |= {name: np.zeros((nodes, 2)) for name in ("child", "vote")}
    for number, (tree, others) in enumerate(zip(trees, inner, strict=True)):
        places = dict(zip(others, range(first[number], nodes), strict=False)) | {0: number}
        for node, place in places.items():
            if tree.children_left[node] >= 0:
                arrays["tree_input"][place], arrays["threshold"][place] = (
                    tree.feature[node],
                    tree.threshold[node],
                )
            for side, child in enumerate((tree.children_left[node], tree.children_right[node])):
                shares = tree.value[max(child, 0), 0] / tree.value[max(child, 0), 0].sum()
                ends = child not in places
                arrays["child"][place, side] = (
                    -1 - fitted.classes_[shares.argmax()] if ends else places[child]
                )
                arrays["vote"][place, side] = shares.max() if ends else 0.0
    depth = max(1, *(tree.max_depth for tree in trees))
    return config.replace(trees=len(trees), nodes=nodes, depth=depth), arrays
