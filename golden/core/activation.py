"""Integer activation tables for a configuration; the same numbers fill the hardware's ROM
(docs/specification.md, section 6).

The index is the pre-activation rounded to the table's step, so entry ``i`` (from -T/2 to T/2 - 1) is the
function at the centre of the interval that rounds to ``i``. Sigmoid spans +-8 with step 16/T, tanh +-4 with
step 8/T (tanh is flat where sigmoid(2x) is).
"""

import numpy as np

from eskin.golden.core.config import AcceleratorConfig


def sigmoid_table(config: AcceleratorConfig) -> np.ndarray:
    """Gate codes of ``sigmoid(i * 16 / T)``, index ``i + T/2``, in ``config.gate_format``; shape (T,), int64.

    ``hard_sigmoid`` gives ``clip(0.2 x + 0.5, 0, 1)`` instead (Keras 1). Both halves are built from the upper
    one, so that ``s(-x) + s(x) = 1`` holds exactly in codes for every pair of entries.
    """
    half = config.formats.table_entries // 2
    x = np.arange(half + 1) * 16.0 / config.formats.table_entries
    real = (
        1.0 / (1.0 + np.exp(-x))
        if config.network.gate_activation == "sigmoid"
        else np.clip(0.2 * x + 0.5, 0.0, 1.0)
    )
    upper = config.gate_format.quantise(real)
    # upper has one entry more than half of the table: entry -T/2 is computed from +T/2, which is not in the
    # table
    lower = config.gate_one - upper[1:]
    return np.concatenate([lower[::-1], upper[:half]])


def tanh_table(config: AcceleratorConfig) -> np.ndarray:
    """State codes of ``tanh(i * 8 / T)``, index ``i + T/2``, in ``config.formats.state_format``; odd; shape
    (T,), int64."""
    half = config.formats.table_entries // 2
    upper = config.formats.state_format.quantise(
        np.tanh(np.arange(half + 1) * 8.0 / config.formats.table_entries)
    )
    return np.concatenate([-upper[1:][::-1], upper[:half]])
