"""Frame rates that a film can have."""

SLOWEST, FASTEST = 1e-3, 1000.0
"""Frames a second. A film's rate is a fraction of small whole numbers, to which a slower one is zero."""
