"""A tensor ring on fixed nodes, and what it gives in between: the form that every ring comes down to, and the kernel
reads.

a_c(x, y, z, v) = Trace(H_x(x) H_y(y) H_z(z) H_v(v) G_c)
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jaxtyping import Float
from torch import Tensor

from ringlight.core.directions import octahedral_from_directions
from ringlight.core.rendering import no_way_back
from ringlight.core.triton_kernels import runs_triton
from ringlight.core.want import Want
from ringlight.fields.tables import between_map_nodes, between_nodes

if TYPE_CHECKING:
    from ringlight.fields.contract import LightField


@dataclass(frozen=True)
class RingTables:
    """The heads at their nodes, and the channel core as the linear map that follows the product.

    ``axes`` row k of axis d is H_d at node k; ``view`` row j * side + i is H_v at node (i, j) of the octahedral
    map; ``core`` row c is the transpose of G_c, rows first, so that a = core . vec(H_x H_y H_z H_v). D = R^2.
    """

    axes: Float[Tensor, "3 K D"]
    view: Float[Tensor, "V D"]
    core: Float[Tensor, "C D"]
    diagonal: bool = False
    """Whether rows are the D components of diagonal matrices instead, whose product is taken one by one."""
    backward: Callable[["RingTables"], dict[str, Tensor]] = no_way_back
    """From the gradients of these tables to those of the field's parameters, by name; with ``Want.GRADIENTS`` only."""


def way_back(want: Want, gradients: Callable[[RingTables], dict[str, Tensor]]) -> Callable[..., dict[str, Tensor]]:
    """What tables hold as their ``backward``: ``gradients`` where these are wanted."""
    return gradients if want is Want.GRADIENTS else no_way_back


WIDEST_RANK = 32
"""Of Triton's kernels: a matrix of each Gaussian must fit into registers."""


def _fits_triton(tables: RingTables, points: Tensor) -> bool:
    small = not tables.diagonal and tables.axes.shape[2] <= WIDEST_RANK**2
    return small and not points.requires_grad and runs_triton(points, tables.axes, tables.view, tables.core)


def linear_core(core: Float[Tensor, "C R R"]) -> Float[Tensor, "C D"]:
    """The channel core G as the linear map that follows the product."""
    return core.transpose(1, 2).flatten(1)


def core_gradient(grad_linear: Float[Tensor, "C D"]) -> Float[Tensor, "C R R"]:
    """The way back of :func:`linear_core`."""
    rank = round(grad_linear.shape[1] ** 0.5)
    return grad_linear.unflatten(1, (rank, rank)).transpose(1, 2).contiguous()


def contracted(
    x: Float[Tensor, "N D"],
    y: Float[Tensor, "N D"],
    z: Float[Tensor, "N D"],
    view: Float[Tensor, "N D"],
    core: Float[Tensor, "C D"],
    diagonal: bool = False,
) -> Float[Tensor, "N C"]:
    """The trace, by one product of matrices after the other, or of diagonals; arguments as in :class:`RingTables`."""
    if diagonal:
        return (x * y * z * view) @ core.T
    rank = round(x.shape[-1] ** 0.5)
    x, y, z, view = (matrix.unflatten(-1, (rank, rank)) for matrix in (x, y, z, view))
    return (x @ y @ z @ view).flatten(1) @ core.T


def ring_features(
    tables: RingTables, points: Float[Tensor, "N 3"], directions: Float[Tensor, "N 3"]
) -> Float[Tensor, "N C"]:
    """Features at points in [-1, 1]^3 and unit directions: the reference of what the kernels make of the tables.

    On a GPU by Triton's, whose gradient reaches the tables only.
    """
    if _fits_triton(tables, points):
        from ringlight.fields.ring_triton import ring_features_by_triton

        uv = octahedral_from_directions(directions)
        return ring_features_by_triton(points, uv, tables.axes, tables.view, tables.core)
    x, y, z = (between_nodes(table, at) for table, at in zip(tables.axes, points.unbind(-1), strict=True))
    view = between_map_nodes(tables.view, octahedral_from_directions(directions))
    return contracted(x, y, z, view, tables.core, tables.diagonal)


def tabulated_features(
    field: "LightField",
    points: Float[Tensor, "N 3"],
    directions: Float[Tensor, "N 3"],
    tables: RingTables | None = None,
) -> Float[Tensor, "N C"]:
    """A field's features by way of tables, made earlier or anew and then differentiable by autograd; without tables its
    exact ones."""
    tables = tables or field.differentiable_tables()
    return field.exact(points, directions) if tables is None else ring_features(tables, points, directions)
