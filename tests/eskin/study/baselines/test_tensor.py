"""eskin/study/baselines/tensor.py: the kernel against a direct computation, its invariances, its counts, and what
it learns."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.study.baselines import tensor
from eskin.study.baselines.scene import Scene
from eskin.study.baselines.tensor import (
    TENSOR,
    distances,
    kernel,
    ranks_of,
    rls_weights,
    stored_values,
    subspaces,
    tensors_of,
)
from tests.support.touch_scenes import SMALL, scene

SHAPES = st.tuples(st.integers(1, 3), st.integers(1, 4), st.integers(2, 6))
SEEDS = st.integers(0, 2**32 - 1)


def tensors(shape, seed, count=4):
    return np.random.default_rng(seed).normal(size=(count, *shape))


def direct(x: np.ndarray, y: np.ndarray, mode: int, rank: int) -> float:
    """|V V' - W W'|^2 from the eigenvectors of X(n)' X(n), index by index: neither the unfolding nor the SVD
    of the module."""

    def projector(t):
        others = [axis for axis in range(3) if axis != mode]
        columns = [index for index in np.ndindex(*(t.shape[axis] for axis in others))]
        matrix = np.empty((t.shape[mode], len(columns)))
        for row in range(t.shape[mode]):
            for number, index in enumerate(columns):
                where = [0, 0, 0]
                where[mode] = row
                for axis, value in zip(others, index, strict=True):
                    where[axis] = value
                matrix[row, number] = t[tuple(where)]
        _, vectors = np.linalg.eigh(matrix.T @ matrix)
        leading = vectors[:, ::-1][:, :rank]
        return leading @ leading.T

    return float(((projector(x) - projector(y)) ** 2).sum())


@settings(max_examples=25, deadline=None)
@given(SHAPES, SEEDS)
def test_distances_are_those_of_the_projectors(shape, seed):
    some = tensors(shape, seed)
    ranks = ranks_of(shape)
    apart = distances(subspaces(some), subspaces(some[:3]))
    for a in range(4):
        for b in range(3):
            assert apart[a, b] == pytest.approx(
                sum(direct(some[a], some[b], n, r) for n, r in enumerate(ranks)), abs=1e-8
            )
    product = np.prod([np.exp(-direct(some[0], some[1], n, r) / (2 * 0.7**2)) for n, r in enumerate(ranks)])
    assert kernel(apart, 2 * 0.7**2)[0, 1] == pytest.approx(product, abs=1e-9)


def test_blocks_change_nothing(monkeypatch):
    some = subspaces(tensors((2, 3, 5), 1, 7))
    whole = distances(some, some)
    monkeypatch.setattr(tensor, "BLOCK", 10)
    assert np.allclose(distances(some, some), whole)


def test_rls_is_the_minimum_of_its_loss():
    x = tensors((2, 2, 4), 3, 9)
    labels, own = np.arange(9) % 3, kernel(distances(subspaces(x), subspaces(x)), 2.0)
    weights = rls_weights(own, labels, 3, 10.0)
    targets = np.where(labels[:, None] == np.arange(3), 1.0, -1.0)
    assert np.allclose(own @ (own @ weights - targets) + own @ weights / 10.0, 0, atol=1e-9)  # the gradient


def test_the_thesis_count_of_67200():
    """Table 3.1 gives 67 200 for the tensor-SVM and does not say of what. All singular vectors of the
    unfoldings of a 4 x 4 x 20 tensor are 320 + 320 + 256 = 896 numbers, and 67 200 are those of 75 tensors to
    the last digit (and 210 tensors of 320 samples): a number of support tensors, so not a property of the
    method. Ours counts the support tensors there are."""
    shape = (4, 4, 20)
    assert stored_values(shape, ranks_of(shape, 1.0)) == 896 and 75 * 896 == 67_200 == 210 * 4 * 4 * 20
    assert stored_values(shape, ranks_of(shape)) == 2 * 80 + 2 * 80 + 8 * 16


@pytest.mark.parametrize("method", TENSOR, ids=lambda method: method.name)
def test_alone_and_together_decide_alike_and_are_counted(method):
    touches = Scene.of(scene(40, seed=3), SMALL)
    part = np.arange(25)
    fitted = method.fit(touches, part, 0)
    rows = np.arange(25, len(touches.labels))
    assert fitted.alone is not None
    assert [int(fitted.alone(row)[0]) for row in rows] == fitted.decide(rows).tolist()
    held = tensors_of(touches)
    assert held.shape == (2, 2, 20) and stored_values(held.shape, held.ranks) == 40 + 40 + 2 * 4
    if method.name == "tensor-rls":
        assert fitted.parameters == 25 * 88 + 25 * 3
    else:
        vectors = (fitted.parameters - 3) / (88 + 2)
        assert vectors == int(vectors) and 3 <= vectors <= 25
