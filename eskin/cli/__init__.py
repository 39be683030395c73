INTERRUPTED = 130
"""Exit status after an interrupt."""
STOPPED = "stopped by the user; files that were being written are as they were before"
