"""Tensor-SVM and tensor-RLS: a kernel on taxel x taxel x time tensors (P. Gastaldo et al. 2014, after M.
Signoretto et al. 2011).

The unfolding of a tensor X along mode n is the matrix X(n) whose rows are its slices along n. With V(n) the
leading right singular vectors of X(n), columns of an orthonormal matrix, two tensors are compared by the
subspaces that these span:

    k(X, Y) = product over n of exp(-d_n(X, Y) / (2 sigma^2)),   d_n = |V V' - W W'|^2 = r + s - 2 |V' W|^2

(Frobenius norms), with V (r columns) of X and W (s columns) of Y. The amplitude of a tensor, and a change of
orthonormal basis along a mode that all tensors share, leave it as it is. Of each unfolding the leading half
of the singular vectors is taken (one at least): all of them would span the whole space where the unfolding is
higher than it is wide, and then say nothing.

sigma, as a share of the median distance, and the penalty are chosen by folds inside the training part.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from baselines import Fitted, Method, Scene
from frames import frames_of, shape_of
from sklearn.kernel_ridge import KernelRidge
from sklearn.model_selection import StratifiedKFold
from sklearn.svm import SVC

STEPS = 20
"""Points in time of a tensor, means of equal parts of the touch."""
WIDTHS = (0.1, 0.25, 0.5, 1.0, 2.0)
"""2 sigma^2, in medians of the distances within the training part."""
PENALTIES = (1.0, 10.0, 100.0)
"""Inverse penalties: C of the SVM, 1 / lambda of the RLS."""


def ranks_of(shape: Sequence[int], share: float = 0.5) -> tuple[int, ...]:
    """Singular vectors of each mode that are taken: ``share`` of those there are, one at least."""
    return tuple(max(1, int(share * min(size, math.prod(shape) // size))) for size in shape)


def subspaces(tensors: np.ndarray) -> list[np.ndarray]:
    """For each mode (n, ranks, product of the other sizes): leading right singular vectors of the unfolding,
    as rows."""
    bases = []
    for mode, rank in enumerate(ranks_of(tensors.shape[1:])):
        unfolded = np.moveaxis(tensors, mode + 1, 1).reshape(len(tensors), tensors.shape[mode + 1], -1)
        bases.append(np.linalg.svd(unfolded.astype(np.float64), full_matrices=False)[2][:, :rank])
    return bases


def distances(first: Sequence[np.ndarray], second: Sequence[np.ndarray]) -> np.ndarray:
    """(n, m): d_n summed over the modes, between tensors of these ``subspaces``."""
    total = np.zeros((len(first[0]), len(second[0])))
    for basis, against in zip(first, second, strict=True):
        for row, vectors in enumerate(basis):
            products = np.einsum("rk,msk->mrs", vectors, against, optimize=True)
            total[row] += len(vectors) + against.shape[1] - 2 * (products**2).sum(axis=(1, 2))
    return np.maximum(total, 0.0)


def stored_values(shape: Sequence[int]) -> int:
    """Numbers that a stored tensor needs: its singular vectors."""
    return sum(rank * math.prod(shape) // size for size, rank in zip(shape, ranks_of(shape), strict=True))


def multiplies(shape: Sequence[int], rows: int) -> int:
    """From a tensor to its values of the kernel with ``rows`` stored ones.

    Of each unfolding the products of its shorter side (m x m), eigenvectors of these (about 9 m^3 operations
    by the symmetric QR algorithm, Golub and Van Loan, half multiplies), and the singular vectors from them.
    """
    count = 0.0
    for size, rank in zip(shape, ranks_of(shape), strict=True):
        short, long = sorted((size, math.prod(shape) // size))
        count += short * (short + 1) / 2 * long + 4.5 * short**3
        count += rank * size * long if short == size else 0  # else the eigenvectors are the singular vectors
        count += rows * rank * rank * (math.prod(shape) // size + 1)
    return round(count) + rows


class Svm:
    """Support tensors, one class against one."""

    def __init__(self, within: np.ndarray, labels: np.ndarray, classes: int, penalty: float) -> None:
        self._model = SVC(C=penalty, kernel="precomputed").fit(within, labels)
        self.support = self._model.support_
        self.weights = len(self.support) * (classes - 1)

    def decide(self, values: np.ndarray) -> np.ndarray:
        return self._model.predict(values)


class Rls:
    """Least squares on all tensors of the training part, one class against the others."""

    def __init__(self, within: np.ndarray, labels: np.ndarray, classes: int, penalty: float) -> None:
        targets = np.where(labels[:, None] == np.arange(classes), 1.0, -1.0)
        self._model = KernelRidge(alpha=1 / penalty, kernel="precomputed").fit(within, targets)
        self.support = np.arange(len(labels))
        self.weights = len(labels) * classes

    def decide(self, values: np.ndarray) -> np.ndarray:
        return self._model.predict(values).argmax(axis=1)


@dataclass(frozen=True)
class TensorMethod(Method):
    """A classifier on the kernel: `Svm` or `Rls`."""

    classifier: Any

    def fit(self, scene: Scene, parts: Sequence[np.ndarray], seed: int) -> list[Fitted]:
        if "subspaces" not in scene.known:  # no label is in them
            frames = frames_of(scene, STEPS)
            tensors = frames.reshape(len(frames), STEPS, *shape_of(scene.config)).transpose(0, 2, 3, 1)
            bases = subspaces(tensors)
            scene.known.update(tensors=tensors, subspaces=bases, distances=distances(bases, bases))
        return [self._fit(scene, part, seed) for part in parts]

    def _fit(self, scene: Scene, part: np.ndarray, seed: int) -> Fitted:
        tensors, bases, between = (scene.known[name] for name in ("tensors", "subspaces", "distances"))
        labels, distance = scene.labels[part], between[np.ix_(part, part)]
        width, penalty = self._best(distance, labels, scene.classes, seed)
        model = self.classifier(np.exp(-distance / width), labels, scene.classes, penalty)
        support, shape = len(model.support), tensors.shape[1:]

        def single(row: int) -> np.ndarray:
            values = np.zeros((1, len(part)))
            stored = [basis[part[model.support]] for basis in bases]
            values[:, model.support] = np.exp(-distances(subspaces(tensors[row : row + 1]), stored) / width)
            return model.decide(values)

        return Fitted(
            lambda rows: model.decide(np.exp(-between[np.ix_(rows, part)] / width)),
            support * stored_values(shape) + model.weights,
            multiplies(shape, support) + model.weights,
            alone=single,
        )

    def _best(self, distance: np.ndarray, labels: np.ndarray, classes: int, seed: int) -> tuple[float, float]:
        """(width, inverse penalty) that do best on folds of the training part."""
        apart = distance[np.triu_indices(len(distance), 1)]
        median = float(np.median(apart)) if len(apart) and np.median(apart) > 0 else 1.0
        smallest = int(np.bincount(labels)[np.unique(labels)].min())
        if smallest < 2:
            return median, PENALTIES[1]
        scores = dict.fromkeys(((width * median, p) for width, p in itertools.product(WIDTHS, PENALTIES)), 0)
        inner = StratifiedKFold(min(3, smallest), shuffle=True, random_state=seed)
        for (train, fold), (width, penalty) in itertools.product(inner.split(distance, labels), scores):
            whole = np.exp(-distance / width)
            model = self.classifier(whole[np.ix_(train, train)], labels[train], classes, penalty)
            decided = model.decide(whole[np.ix_(fold, train)])
            scores[width, penalty] += int((decided == labels[fold]).sum())
        return max(scores, key=lambda pair: scores[pair])


TENSOR = (
    TensorMethod("tensor-svm", "tensor-SVM, taxel x taxel x time", Svm),
    TensorMethod("tensor-rls", "tensor-RLS, taxel x taxel x time", Rls),
)
