"""Frame rates that a film can have."""

SLOWEST, FASTEST = 1e-3, 1000.0
"""Frames a second. A film's rate is a fraction of whole numbers up to a thousand, which a slower one is not."""
