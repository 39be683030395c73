"""A forest of scikit-learn as skl2onnx writes it."""

from pathlib import Path
from typing import Any

import numpy as np
from onnx import TensorProto, helper

BY_LABEL = {"U": (TensorProto.STRING, "strings"), "i": (TensorProto.INT64, "int64s")}


def forest_file(fitted: Any, path: Path, **changes: Any) -> Path:
    """One TreeEnsembleClassifier and a ZipMap. A leaf has the shares of its classes over the number of trees; of two classes
    the share of the second, as one of class 0. A threshold is the next lower number of single precision. ``changes``:
    other attributes, None for none."""
    trees = [estimator.tree_ for estimator in getattr(fitted, "estimators_", [fitted])]
    every = lambda name: np.concatenate([getattr(tree, name) for tree in trees])
    counts, threshold, classes = [tree.node_count for tree in trees], every("threshold"), fitted.classes_
    tree, node = np.repeat(range(len(trees)), counts), np.concatenate([*map(np.arange, counts)])
    leaf, single = every("children_left") < 0, threshold.astype(np.float32)
    single = np.where(single > threshold, np.nextafter(single, np.float32(-np.inf)), single)
    shares = every("value")[:, 0] / len(trees)
    of_leaves = np.repeat(np.flatnonzero(leaf), 1 if len(classes) == 2 else len(classes))
    if len(classes) == 2:
        shares = shares[:, 1:]
    kind, ending = BY_LABEL[classes.dtype.kind]
    labels = {f"classlabels_{ending}": classes.tolist()}
    attributes = {
        "nodes_treeids": tree.tolist(),
        "nodes_nodeids": node.tolist(),
        "nodes_featureids": every("feature").clip(0).tolist(),
        "nodes_values": np.where(leaf, 0, single).tolist(),
        "nodes_modes": np.where(leaf, "LEAF", "BRANCH_LEQ").tolist(),
        "nodes_truenodeids": every("children_left").clip(0).tolist(),
        "nodes_falsenodeids": every("children_right").clip(0).tolist(),
        "nodes_missing_value_tracks_true": every("missing_go_to_left").tolist(),
        "class_treeids": tree[of_leaves].tolist(),
        "class_nodeids": node[of_leaves].tolist(),
        "class_ids": (np.arange(len(of_leaves)) % shares.shape[1]).tolist(),
        "class_weights": shares[leaf].ravel().tolist(),
        "post_transform": "NONE",
    }
    given_attributes = {
        name: value for name, value in (attributes | labels | changes).items() if value is not None
    }
    ml = {"domain": "ai.onnx.ml"}
    nodes = [
        helper.make_node(
            "TreeEnsembleClassifier", ["X"], ["label", "shares"], "trees", **ml, **given_attributes
        ),
        helper.make_node("ZipMap", ["shares"], ["by_label"], "by_label", **ml, **labels),
    ]
    maps = helper.make_map_type_proto(kind, helper.make_tensor_type_proto(TensorProto.FLOAT, []))
    outputs = [
        helper.make_tensor_value_info("label", kind, [None]),
        helper.make_value_info("by_label", helper.make_sequence_type_proto(maps)),
    ]
    given = helper.make_tensor_value_info("X", TensorProto.FLOAT, [None, fitted.n_features_in_])
    opsets = [helper.make_opsetid("", 17), helper.make_opsetid("ai.onnx.ml", 1)]
    made = helper.make_model(
        helper.make_graph(nodes, "forest", [given], outputs), opset_imports=opsets, ir_version=8
    )
    path.write_bytes(made.SerializeToString())
    return path
