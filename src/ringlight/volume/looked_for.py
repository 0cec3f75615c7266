"""How many samples rays have in what is not known to be empty, in torch; compared with the kernels."""

import torch
from jaxtyping import Int

from ringlight.data.rays import Rays
from ringlight.volume.marching import Space, samples_of

AT_ONCE = 8192
"""Rays whose samples are made together."""


def samples_in(space: Space, rays: Rays) -> Int[torch.Tensor, "R"]:
    """How many of each ray lie in cells that are not empty."""
    found = torch.zeros(len(rays), dtype=torch.int32)
    for begin in range(0, len(rays), AT_ONCE):
        part = rays.part(begin, begin + AT_ONCE)
        found[begin : begin + len(part)] = samples_of(part, space).ray.cpu().bincount(minlength=len(part))
    return found
