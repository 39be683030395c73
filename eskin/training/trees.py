"""Forests of scikit-learn as the arrays of the cell ``trees`` (docs/specification.md, section 5)."""

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from eskin.golden.core import AcceleratorConfig, Arrays, InputError, QFormat
from eskin.golden.core.config import VOTE_BITS, WIDEST_SCORE
from eskin.golden.core.groups import MOST_NODES

MOST_PAIRS = 256
"""Most pairs of taxels whose differences trees are fitted to."""


@dataclass(frozen=True)
class Trees:
    """Nodes, parents before children: the rows of the ``roots``; of each node ``feature``, ``subtrahend`` (the feature that is
    subtracted; nothing is if both are the same), ``threshold``, ``children`` (two rows, the left one up to the threshold; of
    a leaf its row) and ``shares`` of the classes (C)."""

    roots: np.ndarray
    feature: np.ndarray
    subtrahend: np.ndarray
    threshold: np.ndarray
    children: np.ndarray
    shares: np.ndarray

    @classmethod
    def of(cls, fitted: Any) -> Self:
        """scikit-learn's ``RandomForestClassifier``, ``ExtraTreesClassifier`` or ``DecisionTreeClassifier``, fitted on
        (touches, steps * inputs), inputs of window 0 first, and labels that are class indices."""
        trees = [estimator.tree_ for estimator in getattr(fitted, "estimators_", [fitted])]
        roots = np.cumsum([0, *(tree.node_count for tree in trees)])
        every = lambda name: np.concatenate([getattr(tree, name) for tree in trees])
        rows, child = (
            np.arange(roots[-1]),
            np.stack([every("children_left"), every("children_right")], axis=1),
        )
        within = np.repeat(roots[:-1], np.diff(roots))[:, None]
        shares = np.zeros((len(rows), fitted.classes_[-1] + 1))
        shares[:, fitted.classes_] = every("value")[:, 0]
        children = np.where(child < 0, rows[:, None], child + within)
        feature = every("feature")
        return cls(roots[:-1], feature, feature, every("threshold"), children, shares)


def forest_arrays(config: AcceleratorConfig, trees: Trees) -> tuple[AcceleratorConfig, dict[str, np.ndarray]]:
    """The configuration with the forest's sizes, and its arrays, real.

    The roots come first, then the other nodes in their order. A leaf votes for its most frequent class, by how far that is
    above the mean of the others: of two classes the sums of votes decide as the sums of shares. A tree of one leaf compares, and
    votes the same on both sides.

    Raises
    ------
    InputError
        There are more trees, comparisons or levels than the accelerator takes.
    """
    rows, level = np.arange(len(trees.feature)), np.zeros(len(trees.feature), dtype=int)
    compares = trees.children[:, 0] != rows
    for row in rows[compares]:
        level[trees.children[row]] = np.maximum(level[trees.children[row]], level[row] + 1)
    order = np.r_[trees.roots, np.setdiff1d(rows[compares], trees.roots)]
    sizes = {"trees": len(trees.roots), "nodes": len(order), "depth": max(1, int(level.max()))}
    try:
        config = config.replace(**sizes)
    except InputError as error:
        raise InputError(f"{error}, so fit fewer trees or smaller ones (max_depth, max_leaf_nodes)") from None
    children, place = trees.children[order], np.argsort(np.r_[order, np.setdiff1d(rows, order)])
    ends, shares = ~compares[children], trees.shares[children]
    most = shares.max(axis=-1) / shares.sum(axis=-1)
    lead = most - (1 - most) / max(1, shares.shape[-1] - 1)
    return config, {
        "tree_input": np.where(compares, trees.feature, 0)[order],
        "subtrahend": np.where(compares, trees.subtrahend, 0)[order],
        "threshold": np.where(compares, trees.threshold, 0)[order],
        "child": np.where(ends, -1 - shares.argmax(axis=-1), place[children]),
        "vote": np.where(ends, lead, 0),
    }


def pairs_of_taxels(config: AcceleratorConfig, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Inputs of the first and of the second taxel of each pair, of one window and one kind of feature: of all pairs, or of
    MOST_PAIRS at random."""
    live = np.setdiff1d(np.arange(config.sensor.taxels), config.sensor.masked_taxels)
    pairs = np.array(np.triu_indices(len(live), 1))
    count = pairs.shape[1] * config.windows.steps * config.kinds
    drawn = np.random.default_rng(seed).permutation(count)[:MOST_PAIRS]
    place, pair = np.divmod(drawn, pairs.shape[1])
    window, kind = np.divmod(place, config.kinds)
    first, second = window * config.inputs + config.kinds * live[pairs[:, pair]] + kind
    return first, second


def fit_forest(
    config: AcceleratorConfig, features: np.ndarray, counts: np.ndarray, labels: np.ndarray, seed: int
) -> tuple[AcceleratorConfig, dict[str, np.ndarray]]:
    """A random forest of ``trees`` trees, of at most ``depth`` comparisons each: `forest_arrays` of scikit-learn's.

    It is fitted to the features and to their differences between two taxels, which an offset of both does not change
    (`pairs_of_taxels`).

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
    forest, seed = config.forest, seed % (1 << 32)
    first, second = pairs_of_taxels(config, seed)
    columns = np.arange(inputs.shape[1])
    inputs = np.concatenate([inputs, inputs[:, first] - inputs[:, second]], axis=1)
    fitted = RandomForestClassifier(
        forest.trees,
        max_depth=forest.depth,
        max_leaf_nodes=MOST_NODES // forest.trees + 1,
        random_state=seed,
        n_jobs=-1,
    )
    trees = Trees.of(fitted.fit(inputs, labels))
    operands = np.concatenate([columns, first]), np.concatenate([columns, second])
    feature, subtrahend = (operand[np.maximum(trees.feature, 0)] for operand in operands)
    return forest_arrays(config, replace(trees, feature=feature, subtrahend=subtrahend))


def forest_codes(
    config: AcceleratorConfig, arrays: Arrays
) -> tuple[AcceleratorConfig, dict[str, np.ndarray]]:
    """Integers of trees, and the configuration with the format of their logits: the finest in which the votes have VOTE_BITS
    bits. A threshold is rounded down: a feature that is a code is not above the threshold's floor exactly if it is not above
    the threshold. A threshold beyond all codes becomes the last one."""
    feature, largest = config.threshold_format, max(float(np.abs(arrays["vote"]).max()), 2.0**-8)
    frac = int(np.floor(np.log2(((1 << VOTE_BITS - 1) - 0.5) / largest)))
    threshold = np.floor(arrays["threshold"] * 2.0**feature.frac_bits)
    codes = dict(arrays) | {
        "threshold": threshold.clip(feature.min_code, feature.max_code),
        "vote": np.rint(arrays["vote"] * 2.0**frac),
    }
    sized = config.replace(logit_format=QFormat(WIDEST_SCORE - frac, frac))
    return sized, {name: code.astype(np.int64) for name, code in codes.items()}
