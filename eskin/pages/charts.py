"""What the charts have in common."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def share_bars(shares: Sequence[float], spreads: Sequence[float | None]) -> np.ndarray:
    """Error bars (2, n), down and up, of shares between 0 and 1: no bar leaves that range. A spread of None
    has none."""
    share, spread = np.asarray(shares, dtype=float), np.array([value or 0.0 for value in spreads])
    return np.array([np.minimum(spread, share), np.minimum(spread, 1.0 - share)])
