"""The socket: a field that gives features to a point and a direction, whatever it is made of."""

from typing import Protocol, runtime_checkable

from jaxtyping import Float
from torch import Tensor

from ringlight.core.want import Want
from ringlight.fields.ring_tables import RingTables


@runtime_checkable
class LightField(Protocol):
    """An ``nn.Module`` from points in [-1, 1]^3 and unit directions to features; knows nothing of colour."""

    def exact(self, points: Float[Tensor, "N 3"], directions: Float[Tensor, "N 3"]) -> Float[Tensor, "N C"]:
        """The features, every network run at every point."""
        ...

    def tables(self, want: Want) -> RingTables | None:
        """The field as a tensor ring's tables, which a kernel reads; None for what is no such ring."""
        ...

    def differentiable_tables(self) -> RingTables | None:
        """The same with torch's graph, in any precision."""
        ...
