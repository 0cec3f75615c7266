"""The one table of Gaussians, in stored form (before activation)."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

GEOMETRY = ("means", "log_scales", "quats", "opacity_logits")
"""Column names of the geometry; all other columns belong to the colour model."""


@dataclass(frozen=True)
class Gaussians:
    """N rows. Stored form is what the optimizer and the back ends see; the active form is a property.

    ``means`` world units; ``log_scales`` natural log of standard deviations in world units; ``quats`` wxyz of
    any length; ``opacity_logits`` before the sigmoid; ``appearance`` holds the colour model's columns, N rows each.
    """

    means: Float[Tensor, "N 3"]
    log_scales: Float[Tensor, "N 3"]
    quats: Float[Tensor, "N 4"]
    opacity_logits: Float[Tensor, "N"]
    appearance: dict[str, Tensor] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.means)

    @property
    def scales(self) -> Float[Tensor, "N 3"]:
        """Standard deviations along the principal axes, world units."""
        return self.log_scales.exp()

    @property
    def opacities(self) -> Float[Tensor, "N"]:
        """Peak opacity in (0, 1)."""
        return self.opacity_logits.sigmoid()

    @property
    def rotations(self) -> Float[Tensor, "N 3 3"]:
        """Rotation matrices; columns are the principal axes in world coordinates."""
        w, x, y, z = torch.nn.functional.normalize(self.quats, dim=-1).unbind(-1)
        rows = [
            1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
            2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
            2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
        ]  # fmt: skip
        return torch.stack(rows, -1).unflatten(-1, (3, 3))

    def columns(self) -> dict[str, Tensor]:
        """All columns by name, geometry first."""
        return {name: getattr(self, name) for name in GEOMETRY} | self.appearance

    @staticmethod
    def from_columns(columns: Mapping[str, Tensor]) -> "Gaussians":
        """Inverse of :meth:`columns`."""
        appearance = {name: tensor for name, tensor in columns.items() if name not in GEOMETRY}
        means, log_scales, quats, opacity_logits = (columns[name] for name in GEOMETRY)
        return Gaussians(means, log_scales, quats, opacity_logits, appearance)

    def rows(self, index: Int[Tensor, "K"] | Bool[Tensor, "N"]) -> "Gaussians":
        """The chosen rows, in the order of ``index``."""
        return Gaussians.from_columns({name: tensor[index] for name, tensor in self.columns().items()})
