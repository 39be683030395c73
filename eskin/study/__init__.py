"""Studies of a model: sweep, stability, energy, other methods."""
