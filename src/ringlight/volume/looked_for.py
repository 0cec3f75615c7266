"""Which rays meet anything that is not known to be empty."""

import torch
from jaxtyping import Bool

from ringlight.data.rays import Rays
from ringlight.volume.marching import Space, samples_of

AT_ONCE = 8192
"""Rays whose samples are made together."""


def meets_something(rays: Rays, space: Space) -> Bool[torch.Tensor, "R"]:
    """Whether a sample of a ray lies in a cell that is not empty."""
    found = torch.zeros(len(rays), dtype=torch.bool)
    for begin in range(0, len(rays), AT_ONCE):
        part = rays.part(begin, begin + AT_ONCE)
        found[begin + samples_of(part, space).ray.cpu()] = True
    return found
