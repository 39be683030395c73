"""Choice of front end and network by evidence, and the doubts about it."""
