"""Studies of a model: stability, energy, other methods."""
