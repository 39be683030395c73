"""Test for a tie of two networks or front ends, from their decisions on the same recordings.

``correct`` is (recordings), the share of networks that decided each correctly.
"""

import numpy as np

TIE = 1.0
"""Standard errors of the paired difference up to which two candidates are tied."""


def least_error(count: int) -> float:
    """Standard error of an accuracy of 100 % over ``count`` recordings.

    It is the standard error of (count + 1) / (count + 2), by Laplace's rule of succession: recordings without
    an error do not prove that the next one will have none.
    """
    return float(np.sqrt((count + 1) / (count + 2) ** 2 / count))


def paired_shortfall(best: np.ndarray, other: np.ndarray) -> tuple[float, float]:
    """(shortfall of ``other``, standard error of the paired difference over recordings), both of ``correct``."""
    difference = best.astype(float) - other
    return float(difference.mean()), float(difference.std(ddof=1) / np.sqrt(len(difference)))


def is_level(best: np.ndarray, other: np.ndarray, errors: float = TIE) -> bool:
    """True if the shortfall is 0 or at most ``errors`` standard errors of the paired difference."""
    shortfall, error = paired_shortfall(best, other)
    return shortfall <= errors * error * (1 + 1e-9)  # one recording lost and none won: one error
