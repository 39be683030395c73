"""A trained network learns a new mounting, person or place from a few touches."""
