"""Tensor trains with entries about one, and ways to look at all of them."""

from itertools import pairwise

import torch

from ringlight.volume.tt_ranks import OCTANTS, ranks_of


def drawn_cores(
    payload: int, levels: int, most: int, seed: int = 0, dtype: torch.dtype = torch.float64, first: int = OCTANTS
):
    """Independent normal numbers, so scaled that the entries' variance is one."""
    ranks = ranks_of(payload, levels, most, first)
    drawn = torch.Generator().manual_seed(seed)
    cores = []
    for k, (left, right) in enumerate(pairwise(ranks)):
        scale, octants = (left**-0.5, OCTANTS) if k else (1.0, first)
        cores.append(scale * torch.randn(left, octants, right, generator=drawn, dtype=dtype))
    return cores


def smooth_grid(side: int, payload: int, seed: int = 0) -> torch.Tensor:
    """[side side side payload] of waves that a train of small ranks holds nearly."""
    drawn = torch.Generator().manual_seed(seed)
    axis = torch.arange(side, dtype=torch.float64) / side
    total = torch.zeros(side, side, side, payload, dtype=torch.float64)
    for _ in range(12):
        rate, shift = 12 * torch.rand(3, generator=drawn), 6 * torch.rand(payload, generator=drawn)
        wave = rate[0] * axis[:, None, None] + rate[1] * axis[:, None] + rate[2] * axis
        total += torch.sin(wave[..., None] + shift)
    return total
