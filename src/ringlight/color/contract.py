"""The socket: what each Gaussian emits towards a camera."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from jaxtyping import Bool, Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.light_features import LightFeatures
from ringlight.core.rendering import Channels, Emission
from ringlight.core.scene import PointCloud
from ringlight.core.want import Want


@dataclass(frozen=True)
class Harmonics:
    """Spherical harmonics as 3DGS stores them: the constant coefficient, and the K = 0, 3, 8 or 15 others."""

    sh_dc: Float[Tensor, "N 3"]
    sh_rest: Float[Tensor, "N K 3"]


@runtime_checkable
class ColorModel(Protocol):
    """An ``nn.Module`` with shared parameters, named ``color.…``; what belongs to one Gaussian is a column."""

    emits: Mapping[str, int]
    """Every channel that it can emit, by name and width; "rgb" 3 is among them."""
    training_columns: tuple[str, ...]
    """Columns that rendering does not need once the rows that are not ``wanted`` are gone."""
    opacity_columns: tuple[str, ...]
    """Columns in units of opacity, which add to the table's: who makes a row fainter makes them fainter alike."""
    axes_are_normals: bool
    """Whether colours depend on which axis of a Gaussian is the shortest, and on its sign: packing keeps both then."""

    def new_columns(self, points: PointCloud) -> dict[str, Tensor]:
        """Per-Gaussian parameters to start from, P rows each."""
        ...

    def emit(self, gaussians: Gaussians, camera: Camera, names: Sequence[str], want: Want) -> Emission:
        """At least the channels ``names``, in any order, and the opacity factor if the model has one."""
        ...

    def layers(self, gaussians: Gaussians, camera: Camera) -> Channels:
        """Parts of the colour worth looking at ("base", "residual", "modulation"), [N c]; may be empty."""
        ...

    def features(self, gaussians: Gaussians, camera: Camera) -> LightFeatures | None:
        """What its neural light gives to Gaussians that the camera may see; None without one, or before it is on."""
        ...

    def wanted(self, gaussians: Gaussians) -> Bool[Tensor, "N"]:
        """Rows that this colour model still shows; densifiers remove the others."""
        ...

    def harmonics(self, gaussians: Gaussians) -> Harmonics | None:
        """The colours as harmonics, exactly; None where they are anything else."""
        ...
