"""What the first cores of a train make of some of its blocks: a matrix each."""

from collections.abc import Iterator
from functools import partial
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.autograd.function import once_differentiable

from ringlight.core.shared_pieces import do_all, each_of
from ringlight.volume.halves import even_rows
from ringlight.volume.tensor_train import Cores
from ringlight.volume.tt_ranks import AXES, OCTANTS


def some_prefixes(cores: Cores, paths: Int[Tensor, "B"]) -> Float[Tensor, "B C s"]:
    """Products of the matrices along these paths, which rise, through all of these cores."""
    if len(cores) == 1:
        # Of axes without a bit here a node behind the last one may be asked for, whose share is zero.
        return cores[0][:, paths.long() & (cores[0].shape[1] - 1)].transpose(0, 1)
    parents, place = torch.unique_consecutive(paths >> AXES, return_inverse=True)
    found: Tensor = _Children.apply(some_prefixes(cores[:-1], parents), cores[-1], place, paths & (OCTANTS - 1))
    return found


class _Children(torch.autograd.Function):
    """Matrix ``place[b]`` of those above, times the core's at octant ``octants[b]``. One node of the graph: autograd
    would copy all matrices three times more."""

    @staticmethod
    def forward(ctx: Any, above: Tensor, core: Tensor, place: Tensor, octants: Tensor) -> Tensor:
        ctx.save_for_backward(above, core, place, octants)
        found = above.new_empty(len(place), above.shape[1], core.shape[-1])

        def make(octant: int, rows: Tensor) -> None:
            products = _gathered(above, place[rows]) @ core[:, octant]
            found.index_copy_(0, rows, _matrices(products, len(rows), found))

        do_all([partial(make, *each) for each in _by_octant(octants)], above.device)
        return found

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, Tensor, None, None]:
        above, core, place, octants = ctx.saved_tensors
        of_above, of_core = torch.zeros_like(above), torch.zeros_like(core)

        def go_back(octant: int, rows: Tensor) -> tuple[Tensor, Tensor]:
            parents = place[rows]
            gradient = _gathered(gradients[0], rows)
            of_core[:, octant] = _gathered(above, parents).T @ gradient
            return parents, _matrices(gradient @ core[:, octant].T, len(rows), above)

        # Children of different octants have the same parents: these are summed in their order.
        pieces = [partial(go_back, *each) for each in _by_octant(octants)]
        for parents, of_parents in each_of(pieces, above.device):
            of_above.index_add_(0, parents, of_parents)
        return of_above, of_core, None, None


def _by_octant(octants: Int[Tensor, "B"]) -> Iterator[tuple[int, Int[Tensor, "N"]]]:
    """Each octant with the numbers of its blocks."""
    for octant in range(OCTANTS):
        yield octant, (octants == octant).nonzero()[:, 0]


def _gathered(matrices: Float[Tensor, "A C r"], numbers: Int[Tensor, "N"]) -> Float[Tensor, "R r"]:
    """Rows of those of these numbers, and perhaps zeros after them."""
    count = len(numbers) * matrices.shape[1]
    rows = matrices.new_empty(even_rows(count, matrices.dtype), matrices.shape[2])
    torch.index_select(matrices, 0, numbers, out=_matrices(rows, len(numbers), matrices))
    rows[count:] = 0
    return rows


def _matrices(rows: Float[Tensor, "R s"], count: int, like: Float[Tensor, "_ C s"]) -> Float[Tensor, "N C s"]:
    """The first ``count`` of them."""
    return rows[: count * like.shape[1]].view(count, *like.shape[1:])
