"""A tensor train at twice the resolution: linear interpolation as a product of small matrices along the train.

Lubasch, Moinier, Jaksch: Multigrid renormalization, 2018, section 2; PuTT (Loeschcke et al. 2024), section 3.2.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.volume.tensor_train import Cores, axes_of
from ringlight.volume.tt_ranks import AXES
from ringlight.volume.tt_rounding import rounded

STAYS, MOVES, LAST = range(3)
"""What is still to be done with the bits of coarser levels: nothing; add one, for the node after this one; or see to it
that all are ones, for the last node of a row is its own neighbour."""

STATES = 3

GROWTH = 2.5**0.5
"""Interpolation along an axis makes a grid's Euclidean norm at most so many times as large: the square of a node counts
once for itself and by half in each of two means; that of the last node once in the second of these."""


def along_axis(cores: Cores, axis: int) -> list[Tensor]:
    """Twice as many nodes along one axis, exactly; ranks are three times as large.

    Node 2 i is node i, and node 2 i + 1 the mean of i and i + 1. The first axis adds a core of two entries, 0 and 1;
    the others double the entries of that core, which come in the order of their axes.
    """
    *levels, last = [*cores, torch.ones(1, 1, 1).to(cores[0])] if axis == 0 else cores
    wide = [_with_states(core, axis) for core in levels]
    accepted = torch.tensor([1.0, 0.0, 1.0]).to(last)  # no node comes after the last one
    wide[0] = torch.einsum("l,lrost->rost", accepted, wide[0]).flatten(2)
    wide[1:] = [core.permute(1, 0, 2, 3, 4).flatten(3).flatten(0, 1) for core in wide[1:]]
    even = torch.tensor([1.0, 0.0, 0.0]).to(last)
    odd = torch.tensor([0.5, 0.5, 0.5]).to(last)
    ends = torch.stack([even, odd])  # [bit state]
    finest = torch.einsum("bt,rms->rtmbs", ends, last).flatten(2, 3).flatten(0, 1)
    return [*wide, finest]


def _with_states(core: Float[Tensor, "r o s"], axis: int) -> Float[Tensor, "T r o s T"]:
    """By the state to the left and to the right: those on the right say what a core does with its bit, if any."""
    if axis not in axes_of(core):
        return core[None, ..., None] * torch.eye(STATES).to(core)[:, None, None, None]
    place = 1 << (AXES - 1 - axis)
    octants = torch.arange(core.shape[1], device=core.device)
    is_one = (octants & place > 0).to(core)[:, None]
    flipped = core[:, octants ^ place]
    wide = core.new_zeros(STATES, *core.shape, STATES)
    wide[STAYS, ..., STAYS] = core
    wide[STAYS, ..., MOVES] = flipped * (1 - is_one)
    wide[MOVES, ..., MOVES] = flipped * is_one
    wide[LAST, ..., LAST] = core * is_one
    return wide


def prolonged(cores: Cores, most: int) -> tuple[list[Tensor], float]:
    """Twice as many nodes along all axes, by ranks up to ``most``; and a bound of what rounding lost, the Euclidean
    distance of all entries from those of exact interpolation.

    Rounded after each axis: all three at once would have ranks 27 times as large.
    """
    lost = 0.0
    for axis in range(AXES):
        wide = along_axis(cores, axis)
        cores, error = rounded(wide, most)
        lost += error * GROWTH ** (AXES - 1 - axis)
    return list(cores), lost
