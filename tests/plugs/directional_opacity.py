"""A plug: opacity that depends on the direction from which a Gaussian is seen, by sixteen harmonics of its own."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from ringlight.color.by_torch import OPACITY_FACTOR, emitted_by_torch
from ringlight.color.contract import ColorModel, Harmonics
from ringlight.color.harmonics import SphericalHarmonics, sh_colors_reference
from ringlight.core.camera import Camera
from ringlight.core.directions import view_directions
from ringlight.core.gaussians import Gaussians
from ringlight.core.rendering import Channels, Emission
from ringlight.core.scene import PointCloud, Scene
from ringlight.core.sh_basis import MAX_DEGREE, basis_count, sh_basis
from ringlight.core.want import Want
from ringlight.fit.photometric import PhotometricLoss
from ringlight.fit.rates import Adam, GaussianRates, Rate
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.methods.assembly import Course
from ringlight.methods.splat_recipe import SplatRecipe
from ringlight.shade.contract import Shader
from ringlight.shade.passthrough import PassThrough

FIRST_FACTOR = 3.0
"""The constant harmonic's coefficient times its value, at the start: the factor is sigmoid(3 C0), seven tenths."""


class DirectionalOpacity(nn.Module):
    """Colours are harmonics; ``opacity_sh`` [N 16] are the logits' harmonics of the factor on the opacity."""

    emits: Mapping[str, int] = {"rgb": 3}
    training_columns: tuple[str, ...] = ()
    opacity_columns: tuple[str, ...] = ()
    axes_are_normals: bool = False

    def new_columns(self, points: PointCloud) -> dict[str, Tensor]:
        columns = SphericalHarmonics().new_columns(points)
        logits = points.colors.new_zeros(len(points.colors), basis_count(MAX_DEGREE))
        logits[:, 0] = FIRST_FACTOR
        return columns | {"opacity_sh": logits}

    def emit(self, gaussians: Gaussians, camera: Camera, names: Sequence[str], want: Want) -> Emission:
        def channels(columns: dict[str, Tensor]) -> Channels:
            means, logits = columns["means"], columns["opacity_sh"]
            basis = sh_basis(view_directions(means, camera.position.to(means)), MAX_DEGREE)
            color = sh_colors_reference(means, columns["sh_dc"], columns["sh_rest"], camera.position, MAX_DEGREE)
            return {"rgb": color, OPACITY_FACTOR: (basis * logits).sum(-1, keepdim=True).sigmoid()}

        return emitted_by_torch(channels, {"means": gaussians.means, **gaussians.appearance}, {}, want)

    def layers(self, gaussians: Gaussians, camera: Camera) -> Channels:
        return {}

    def features(self, gaussians: Gaussians, camera: Camera) -> None:
        """None: it has no network."""

    def wanted(self, gaussians: Gaussians) -> Bool[Tensor, "N"]:
        return torch.ones(len(gaussians), dtype=torch.bool, device=gaussians.means.device)

    def harmonics(self, gaussians: Gaussians) -> Harmonics:
        """Of the colours; whoever exports sees that the opacity depends on the camera."""
        return Harmonics(gaussians.appearance["sh_dc"], gaussians.appearance["sh_rest"])


@dataclass(frozen=True)
class DirectionalOpacityRecipe(SplatRecipe):
    """3DGS with an opacity that depends on the direction."""

    steps: int = 3000
    rates: GaussianRates = field(default_factory=GaussianRates)
    densify: DensifySettings = field(default_factory=DensifySettings)
    loss: PhotometricLoss = field(default_factory=PhotometricLoss)

    def parts(self, box: Float[Tensor, "2 3"], seed: int = 0) -> tuple[ColorModel, Shader]:
        return DirectionalOpacity(), PassThrough()

    def course(self, scene: Scene) -> Course:
        of_colors = {"columns.sh_dc": 2.5e-3, "columns.sh_rest": 1.25e-4, "columns.opacity_sh": 1e-2}
        return Course(groups={name: Adam(Rate.constant(rate)) for name, rate in of_colors.items()})
