"""The one exception that a user's mistake becomes."""


class InputError(ValueError):
    """Bad input or usage: one plain sentence that names the file, the field and the fix.

    The command line prints the sentence and ends with status 2; it never shows a traceback for it.
    """
