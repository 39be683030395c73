"""Training of networks: folds, fit, quantisation, evaluation."""

LEARNING = ("golden", "data", "training", "choose", "teach", "study")
"""Folders whose code affects the content of a trained network; it is part of the key of every cached
result."""
