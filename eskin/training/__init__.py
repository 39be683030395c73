"""Training of networks: folds, fit, quantisation, evaluation."""

LEARNING = ("golden", "data", "training", "choose", "teach", "study")
"""Folders whose code decides the content of a trained network: part of the key of every kept result."""
