"""Errors: bad input by the user, and a simulation that fails."""

from typing import Any

import numpy as np


class InputError(ValueError):
    """Bad input or usage: one plain sentence that names the file, the field and the fix.

    The command line prints the sentence and ends with status 2; it never shows a traceback for it.
    """


class SimulationError(RuntimeError):
    """A simulator could not be built, failed, or ran out of time; the message holds the end of its log."""


def array_of(values: Any, name: str, fix: str = "give rows of one length") -> np.ndarray:
    """``values`` as an array.

    Raises
    ------
    InputError
        ``values`` has rows of several lengths. The sentence names them by ``name`` and gives ``fix`` as the
        remedy.
    """
    try:
        return np.asarray(values)
    except (TypeError, ValueError, KeyError):
        raise InputError(f"{name}: {type(values).__name__} is not an array of numbers; {fix}") from None
