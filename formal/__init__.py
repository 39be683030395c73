"""Formal proofs of the hardware: one file of properties per block, run by `make formal` (formal/run.py)."""
