"""Types that results, models and long work share."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

Progress = Callable[[str, int, int], None]
"""Callback for progress, with (name of the work, done, total; 0: not known, and both 0: it has no count)."""
Record = dict[str, Any]
"""Named values that JSON can hold: a result, a row of a result, options."""
Arrays = Mapping[str, np.ndarray]
"""Arrays by name, as a model has them."""
