"""The socket: what says density and appearance at points of a box, and changes its resolution while it trains."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from jaxtyping import Float
from torch import Tensor

if TYPE_CHECKING:
    from ringlight.volume.native_march import FieldSource
    from ringlight.volume.shading import FeatureShading

Sides = tuple[int, int, int]
"""Nodes of a grid along x, y and z."""


@runtime_checkable
class VolumeField(Protocol):
    """An ``nn.Module``. Points are in [0, 1]^3, the box's lowest corner at 0."""

    @property
    def sides(self) -> Sides:
        """Its resolution now."""
        ...

    @property
    def intervals(self) -> Sides:
        """Along each axis, how often the distance from a node to the next fits into the box: node i lies at i of them.
        One less than :attr:`sides` where the last node lies on the box."""
        ...

    def density(self, points: Float[Tensor, "N 3"]) -> Float[Tensor, "N"]:
        """What softplus makes density of."""
        ...

    def appearance(self, points: Float[Tensor, "N 3"]) -> Float[Tensor, "N F"]:
        """Features that a network makes colour of."""
        ...

    def kernels(self, shading: "FeatureShading") -> "FieldSource | None":
        """What marches rays through it and this network by kernels of its own; None where it has none for them as they
        are, and torch is asked. Both are float32 and on the CPU."""
        ...

    def outline(self, sides: Sides) -> Mapping[str, Tensor]:
        """Parameters as they are at another resolution, by name; asked on torch's meta device for their shapes."""
        ...

    def named_parameters(self) -> Iterator[tuple[str, Any]]:
        """What is trained, with names."""
        ...

    def fitting(self, box: Float[Tensor, "2 3"], voxels: float) -> Sides:
        """The resolution that it can have whose voxels in this box, world units, are nearest to so many."""
        ...

    def resize(self, sides: Sides) -> None:
        """Take another resolution, showing the same as well as it can."""
        ...

    def cuttable(self, first: Sides, last: Sides) -> tuple[Sides, Sides]:
        """The least part that it can be cut to with the nodes from ``first`` to ``last`` in it, both included."""
        ...

    def crop(self, first: Sides, last: Sides) -> None:
        """Keep this part alone, one of those that :meth:`cuttable` gives; the box is then its nodes'."""
        ...
