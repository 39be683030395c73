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
from collections.abc import Callable, Sequence

import numpy as np

from eskin.choose.yardsticks import stratified
from eskin.study.baselines.method import Fitted, Method
from eskin.study.baselines.scene import Scene

STEPS = 20
"""Points in time of a tensor, means of equal parts of the touch."""

WIDTHS = (0.1, 0.25, 0.5, 1.0, 2.0)
"""2 sigma^2, in medians of the distances within the training part."""

PENALTIES = (1.0, 10.0, 100.0)
"""Inverse penalties: C of the SVM, 1 / lambda of the RLS."""

BLOCK = 1 << 24
"""Products of singular vectors held at once."""


def unfolding(tensors: np.ndarray, mode: int) -> np.ndarray:
    """(n, size of the mode, product of the others) of tensors (n, ...)."""
    return np.moveaxis(tensors, mode + 1, 1).reshape(len(tensors), tensors.shape[mode + 1], -1)


def ranks_of(shape: Sequence[int], share: float = 0.5) -> tuple[int, ...]:
    """Singular vectors of each mode that are taken: ``share`` of those there are, one at least."""
    return tuple(max(1, int(share * min(size, math.prod(shape) // size))) for size in shape)


def subspaces(tensors: np.ndarray, ranks: Sequence[int] | None = None) -> list[np.ndarray]:
    """For each mode (n, ranks, product of the other sizes): leading right singular vectors of the unfolding,
    as rows."""
    ranks = ranks or ranks_of(tensors.shape[1:])
    bases = []
    for mode, rank in enumerate(ranks):
        _, _, right = np.linalg.svd(unfolding(tensors, mode).astype(np.float64), full_matrices=False)
        bases.append(right[:, :rank])
    return bases


def distances(first: Sequence[np.ndarray], second: Sequence[np.ndarray]) -> np.ndarray:
    """(n, m): d_n summed over the modes, between tensors of these ``subspaces``."""
    total = np.zeros((len(first[0]), len(second[0])))
    for basis, against in zip(first, second, strict=True):
        (n, r, size), (m, s, _) = basis.shape, against.shape
        columns = against.reshape(m * s, size).T
        step = max(1, BLOCK // (m * s * r))
        for begin in range(0, n, step):
            rows = basis[begin : begin + step]
            products = (rows.reshape(-1, size) @ columns).reshape(len(rows), r, m, s)
            total[begin : begin + step] += r + s - 2 * (products**2).sum(axis=(1, 3))
    return np.maximum(total, 0.0)


def kernel(distance: np.ndarray, width: float) -> np.ndarray:
    """exp(-distance / width); width is 2 sigma^2."""
    return np.exp(-distance / width)


def stored_values(shape: Sequence[int], ranks: Sequence[int]) -> int:
    """Numbers that a stored tensor needs: its singular vectors."""
    return sum(rank * math.prod(shape) // size for size, rank in zip(shape, ranks, strict=True))


def subspace_multiplies(shape: Sequence[int], ranks: Sequence[int]) -> int:
    """Multiplies from a tensor to its subspaces: of each unfolding the products of its shorter side (m x m),
    eigenvectors of these (about 9 m^3 operations by the symmetric QR algorithm, Golub and Van Loan, half
    multiplies), and the singular vectors from them."""
    count = 0.0
    for size, rank in zip(shape, ranks, strict=True):
        short, long = sorted((size, math.prod(shape) // size))
        count += short * (short + 1) / 2 * long + 4.5 * short**3
        if short == size:  # of an unfolding higher than wide, the eigenvectors are the right singular vectors
            count += rank * size * long
    return round(count)


def compare_multiplies(shape: Sequence[int], ranks: Sequence[int]) -> int:
    """Multiplies of one value of the kernel, from the subspaces of both."""
    return 1 + sum(
        rank * rank * (math.prod(shape) // size + 1) for size, rank in zip(shape, ranks, strict=True)
    )


class Tensors:
    """Subspaces and distances of all touches of a scene, which know no label."""

    def __init__(self, scene: Scene) -> None:
        tensors = scene.tensors(STEPS)
        self._tensors, self.shape = tensors, tensors.shape[1:]
        self.ranks = ranks_of(self.shape)
        self._subspaces = subspaces(tensors)
        self.distance = distances(self._subspaces, self._subspaces)

    def alone(self, row: int, rows: np.ndarray) -> np.ndarray:
        """(1, kept): the distances of one touch, from its tensor on."""
        return distances(subspaces(self._tensors[row : row + 1]), [basis[rows] for basis in self._subspaces])

    def multiplies(self, count: int) -> int:
        """From the tensor to ``kept`` values of the kernel."""
        return subspace_multiplies(self.shape, self.ranks) + count * compare_multiplies(
            self.shape, self.ranks
        )

    def values(self, count: int) -> int:
        """Numbers that ``kept`` tensors need."""
        return count * stored_values(self.shape, self.ranks)


_known: dict[int, tuple[Scene, Tensors]] = {}


def tensors_of(scene: Scene) -> Tensors:
    """The tensors of a scene, found once."""
    if id(scene) not in _known:
        _known.clear()
        _known[id(scene)] = (scene, Tensors(scene))
    return _known[id(scene)][1]


def _best(
    distance: np.ndarray,
    labels: np.ndarray,
    seed: int,
    decide: Callable[[np.ndarray, np.ndarray, np.ndarray, float], np.ndarray],
) -> tuple[float, float]:
    """(width, inverse penalty) that do best on folds of the training part; ``decide(kernel of the rest,
    labels of the rest, kernel of fold against rest, inverse penalty)``."""
    apart = distance[np.triu_indices(len(distance), 1)]
    median = float(np.median(apart)) if len(apart) and np.median(apart) > 0 else 1.0
    inner = stratified(labels, seed)
    if inner is None:
        return median, PENALTIES[1]
    scores: dict[tuple[float, float], int] = dict.fromkeys(
        ((w * median, p) for w, p in itertools.product(WIDTHS, PENALTIES)), 0
    )
    for train, fold in inner.split(distance, labels):
        for width in WIDTHS:
            whole = kernel(distance, width * median)
            for penalty in PENALTIES:
                decided = decide(
                    whole[np.ix_(train, train)], labels[train], whole[np.ix_(fold, train)], penalty
                )
                scores[width * median, penalty] += int((decided == labels[fold]).sum())
    return max(scores, key=lambda pair: scores[pair])


def _svm(within: np.ndarray, labels: np.ndarray, between: np.ndarray, penalty: float) -> np.ndarray:
    from sklearn.svm import SVC

    return SVC(C=penalty, kernel="precomputed").fit(within, labels).predict(between)


def rls_weights(within: np.ndarray, labels: np.ndarray, classes: int, penalty: float) -> np.ndarray:
    """(n, classes): (K + I / penalty)^-1 Y with Y = +1 for the class, -1 for the others."""
    from sklearn.kernel_ridge import KernelRidge

    targets = np.where(labels[:, None] == np.arange(classes), 1.0, -1.0)
    return KernelRidge(alpha=1 / penalty, kernel="precomputed").fit(within, targets).dual_coef_


def fit_svm(scene: Scene, part: np.ndarray, seed: int) -> Fitted:
    """Support tensors, one class against one."""
    from sklearn.svm import SVC

    tensors, labels = tensors_of(scene), scene.labels[part]
    distance = tensors.distance[np.ix_(part, part)]
    width, penalty = _best(distance, labels, seed, _svm)
    model = SVC(C=penalty, kernel="precomputed").fit(kernel(distance, width), labels)
    vectors, sums = len(model.support_), scene.classes - 1

    def alone(row: int) -> np.ndarray:
        values = np.zeros((1, len(part)))
        values[:, model.support_] = kernel(tensors.alone(row, part[model.support_]), width)
        return model.predict(values)

    parameters = tensors.values(vectors) + vectors * sums + scene.classes * sums // 2
    return Fitted(
        lambda rows: model.predict(kernel(tensors.distance[np.ix_(rows, part)], width)),
        parameters,
        tensors.multiplies(vectors) + vectors * sums,
        alone=alone,
    )


def fit_rls(scene: Scene, part: np.ndarray, seed: int) -> Fitted:
    """Least squares on all tensors of the training part, one class against the others."""
    tensors, labels, classes = tensors_of(scene), scene.labels[part], scene.classes

    def decide(within: np.ndarray, of_part: np.ndarray, between: np.ndarray, penalty: float) -> np.ndarray:
        return (between @ rls_weights(within, of_part, classes, penalty)).argmax(axis=1)

    distance = tensors.distance[np.ix_(part, part)]
    width, penalty = _best(distance, labels, seed, decide)
    weights = rls_weights(kernel(distance, width), labels, classes, penalty)
    return Fitted(
        lambda rows: (kernel(tensors.distance[np.ix_(rows, part)], width) @ weights).argmax(axis=1),
        tensors.values(len(part)) + weights.size,
        tensors.multiplies(len(part)) + weights.size,
        alone=lambda row: (kernel(tensors.alone(row, part), width) @ weights).argmax(axis=1),
    )


TENSOR = (
    Method("tensor-svm", "tensor-SVM, taxel x taxel x time", "tensor", fit_svm),
    Method("tensor-rls", "tensor-RLS, taxel x taxel x time", "tensor", fit_rls),
)
