"""Forests of scikit-learn as the arrays of the cell ``trees`` (docs/specification.md, section 5)."""

from typing import Any

import numpy as np

from eskin.golden.core import AcceleratorConfig, Arrays, InputError, QFormat
from eskin.golden.core.config import VOTE_BITS, WIDEST_SCORE
from eskin.golden.core.groups import MOST_NODES


def forest_arrays(config: AcceleratorConfig, fitted: Any) -> tuple[AcceleratorConfig, dict[str, np.ndarray]]:
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
    if nodes > MOST_NODES:
        raise InputError(
            f"configuration '{config.name}', field nodes: is {nodes} in the fitted trees, above the limit of {MOST_NODES}; give "
            "fewer trees or a smaller depth"
        )
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


def fit_forest(
    config: AcceleratorConfig, features: np.ndarray, counts: np.ndarray, labels: np.ndarray, seed: int
) -> tuple[AcceleratorConfig, dict[str, np.ndarray]]:
    """A random forest of ``trees`` trees, of at most ``depth`` comparisons each: `forest_arrays` of scikit-learn's.

    Parameters
    ----------
    features, counts:
        (touches, K, D), and which steps a touch has (touches, K); a step that it does not have gets the features of its last
        one.

    Each tree grows where it gains most, up to its part of MOST_NODES.
    """
    from sklearn.ensemble import RandomForestClassifier

    last = np.maximum(counts.sum(axis=1).astype(int) - 1, 0)
    windows = np.minimum(np.arange(features.shape[1]), last[:, None])
    inputs = features[np.arange(len(features))[:, None], windows].reshape(len(features), -1)
    forest = config.forest
    fitted = RandomForestClassifier(
        forest.trees,
        max_depth=forest.depth,
        max_leaf_nodes=MOST_NODES // forest.trees + 1,
        random_state=seed % (1 << 32),
    )
    return forest_arrays(config, fitted.fit(inputs, labels))


def forest_codes(
    config: AcceleratorConfig, arrays: Arrays
) -> tuple[AcceleratorConfig, dict[str, np.ndarray]]:
    """Integers of trees, and the configuration with the format of their logits: the finest in which the votes have VOTE_BITS
    bits. A threshold is rounded down, because a feature's code was rounded to the nearest."""
    feature, largest = config.formats.feature_format, max(float(np.abs(arrays["vote"]).max()), 2.0**-8)
    frac = int(np.floor(np.log2(((1 << VOTE_BITS - 1) - 0.5) / largest)))
    threshold = np.floor(arrays["threshold"] * 2.0**feature.frac_bits)
    codes = dict(arrays) | {
        "threshold": threshold.clip(feature.min_code, feature.max_code),
        "vote": np.rint(arrays["vote"] * 2.0**frac),
    }
    sized = config.replace(logit_format=QFormat(WIDEST_SCORE - frac, frac))
    return sized, {name: code.astype(np.int64) for name, code in codes.items()}
