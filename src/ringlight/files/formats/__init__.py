"""Forms of a model that other programs open, one file each."""
