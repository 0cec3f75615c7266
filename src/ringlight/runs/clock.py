"""What a run's time went into."""

from dataclasses import dataclass


@dataclass
class Clock:
    """Seconds spent in training steps, without loading and evaluation, and apart from them in saving; runs add up."""

    wall: float = 0.0
    cpu: float = 0.0
    saving: float = 0.0
    """Wall clock; a checkpoint knows of those before it."""
    choosing: float = 0.0
    """CPU seconds before the first step, in which photographs are decoded, the method is chosen and the first surface
    carved; not in ``cpu``."""
