"""What a user's mistake becomes, and what a simulation that breaks."""


class InputError(ValueError):
    """Bad input or usage: one plain sentence that names the file, the field and the fix.

    The command line prints the sentence and ends with status 2; it never shows a traceback for it.
    """


class SimulationError(RuntimeError):
    """A simulator could not be built, failed, or ran out of time; the message holds the end of its log."""
