"""Numbers and pictures that compare."""
