"""Touches on an array with their truth: a bump of force that moves from one place to another while it is
pressed."""

import numpy as np

REST, TOP = 5, 255


def touches(rows: int, columns: int, *, count: int, seed: int, width: float = 0.9, frames: int = 12):
    """(samples (frames, taxels), truth: for every frame None or (x, y) in cells, ways: for every touch (dx,
    dy) in cells)."""
    rng = np.random.default_rng(seed)
    down, across = np.mgrid[:rows, :columns]
    samples, truth, ways = [], [], []
    for number in range(count):
        begin = rng.uniform([0, 0], [columns - 1, rows - 1])
        end = begin if number % 2 else rng.uniform([0, 0], [columns - 1, rows - 1])
        ways.append(tuple(end - begin))
        force = rng.uniform(60, 240)
        for step in range(frames):
            x, y = begin + (end - begin) * step / (frames - 1)
            bump = force * np.exp(-((across - x) ** 2 + (down - y) ** 2) / (2 * width**2))
            samples.append(REST + bump + rng.normal(0, 0.7, bump.shape))
            truth.append((x, y))
        for _ in range(3):
            samples.append(REST + rng.normal(0, 0.7, (rows, columns)))
            truth.append(None)
    return np.clip(np.rint(samples), 0, TOP).astype(np.int32).reshape(len(samples), -1), truth, ways
