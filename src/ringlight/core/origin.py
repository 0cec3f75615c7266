"""Where the points come from on which a run starts. Torch-free."""

from typing import Literal

Origin = Literal["scene", "random", "hull", "in hull"]
"""The scene's files, a generator of random numbers, the surface of the visual hull, or all that this encloses."""
