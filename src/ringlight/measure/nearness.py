"""Held-out views by how near they are to the training cameras: some fields do not carry over to the far ones."""

from collections.abc import Sequence
from itertools import pairwise
from statistics import fmean

import torch

from ringlight.core.camera import Camera

THIRDS = 3


def distances(cameras: Sequence[Camera], training: Sequence[Camera]) -> list[float]:
    """From each camera's centre to that of the nearest of ``training`` (at least one), world units."""
    here, there = (torch.stack([camera.position for camera in of]).double().cpu() for of in (cameras, training))
    nearest: list[float] = torch.cdist(here, there).amin(1).tolist()
    return nearest


def means_of_thirds(values: Sequence[float], distances: Sequence[float]) -> tuple[float, ...] | None:
    """Means of ``values`` over the third with the smallest distances, the middle third and the third with the largest;
    of equal distances the first comes first. None for fewer than three values."""
    if len(values) < THIRDS:
        return None
    order = sorted(range(len(values)), key=lambda index: (distances[index], index))
    ends = [len(values) * third // THIRDS for third in range(THIRDS + 1)]
    return tuple(fmean(values[i] for i in order[begin:end]) for begin, end in pairwise(ends))
