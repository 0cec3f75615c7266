"""Held-out views by how near they are to the training cameras: some fields do not carry over to the far ones."""

import math
from collections.abc import Sequence
from itertools import pairwise
from statistics import fmean

import torch

from ringlight.core.camera import Camera

THIRDS = 3


def distances(cameras: Sequence[Camera], training: Sequence[Camera]) -> list[float]:
    """From each camera's centre to that of the nearest of ``training``, world units; infinite where there is none.

    Exactly zero for a camera at the same place.
    """
    if not cameras or not training:
        return [math.inf] * len(cameras)
    here, there = (torch.stack([camera.position for camera in of]).double().cpu() for of in (cameras, training))
    # By differences: from the matrix product that torch takes for many cameras equal distances come out unequal.
    nearest: list[float] = torch.cdist(here, there, compute_mode="donot_use_mm_for_euclid_dist").amin(1).tolist()
    return nearest


def means_of_thirds(values: Sequence[float], distances: Sequence[float]) -> tuple[float, ...] | None:
    """Means of ``values`` over the third with the smallest distances, the middle third and the third with the largest;
    of equal distances the first comes first. None for fewer than three values."""
    if len(values) < THIRDS:
        return None
    order = sorted(range(len(values)), key=lambda index: (distances[index], index))
    ends = [len(values) * third // THIRDS for third in range(THIRDS + 1)]
    return tuple(fmean(values[i] for i in order[begin:end]) for begin, end in pairwise(ends))
