"""Errors: bad input by the user, and a simulation that fails."""

import re
from typing import Any

import numpy as np


class InputError(ValueError):
    """Bad input or usage: one plain sentence that names the file, the field and the fix.

    A sentence names fields of a request in back quotes, where the command line puts its options. It ends with status 2
    and never shows a traceback for it.
    """

    @property
    def field(self) -> str | None:
        """The field that is wrong: the sentence begins with it, if it names one."""
        found = re.match(r"`(\w+)`", str(self))
        return found and found[1]


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
