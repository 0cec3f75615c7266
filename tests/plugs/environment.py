"""A plug: deferred shading by an environment cubemap over harmonics, after 3DGS-DR (Ye et al. 2024)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from ringlight.color.by_torch import emitted_by_torch
from ringlight.color.contract import ColorModel, Harmonics
from ringlight.color.harmonics import SH_COLUMNS, SphericalHarmonics, sh_colors_reference
from ringlight.core.camera import Camera
from ringlight.core.directions import reflect, shortest_axes, view_directions
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import SHADER
from ringlight.core.randomness import generator
from ringlight.core.rendering import Channels, Emission, Shaded
from ringlight.core.scene import PointCloud, Scene
from ringlight.core.sh_basis import MAX_DEGREE
from ringlight.core.want import Want
from ringlight.fit.photometric import PhotometricLoss
from ringlight.fit.rates import Adam, GaussianRates, Rate
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.methods.assembly import Course
from ringlight.methods.splat_recipe import SplatRecipe
from ringlight.shade.by_torch import shaded_by_torch
from ringlight.shade.contract import Shader
from ringlight.shade.covered import covered_pixels

AXES = 3


class HarmonicsWithNormals(nn.Module):
    """Harmonics, and the shortest axis of each Gaussian as its normal."""

    emits: Mapping[str, int] = {"rgb": 3, "normal": 3}
    training_columns: tuple[str, ...] = ()
    opacity_columns: tuple[str, ...] = ()
    axes_are_normals: bool = True

    def new_columns(self, points: PointCloud) -> dict[str, Tensor]:
        return SphericalHarmonics().new_columns(points)

    def emit(self, gaussians: Gaussians, camera: Camera, names: Sequence[str], want: Want) -> Emission:
        def channels(columns: dict[str, Tensor]) -> Channels:
            dc, rest, means = (columns[name] for name in (*SH_COLUMNS, "means"))
            color = sh_colors_reference(means, dc, rest, camera.position, MAX_DEGREE)
            table = Gaussians.from_columns(columns)
            return {"rgb": color, "normal": shortest_axes(table, camera.position.to(means))}

        return emitted_by_torch(channels, gaussians.columns(), {}, want)

    def layers(self, gaussians: Gaussians, camera: Camera) -> Channels:
        return {}

    def features(self, gaussians: Gaussians, camera: Camera) -> None:
        """None: it has no network."""

    def wanted(self, gaussians: Gaussians) -> Bool[Tensor, "N"]:
        return torch.ones(len(gaussians), dtype=torch.bool, device=gaussians.means.device)

    def harmonics(self, gaussians: Gaussians) -> Harmonics:
        """What every Gaussian emits is harmonics; whether it is what is seen, the shader knows."""
        return Harmonics(*(gaussians.appearance[name] for name in SH_COLUMNS))


class Environment(nn.Module):
    """color = rgb + alpha * cubemap(reflected direction). ``faces`` [6 R R 3]: +x, -x, +y, -y, +z, -z.

    It reads normals before colours: the model puts the channels in this order.
    """

    adds_light = True
    needs: Mapping[str, int] = {"normal": 3, "rgb": 3}

    def __init__(self, side: int, seed: int = 0):
        super().__init__()
        noise = torch.randn(2 * AXES, side, side, 3, generator=generator(seed, 0, "environment"))
        self.faces = nn.Parameter(0.05 * noise)

    def tiles(self, camera: Camera, background: Tensor, want: Want) -> None:
        """None: no kernel knows it."""

    def shade(
        self,
        image: Float[Tensor, "H W 6"],
        alpha: Float[Tensor, "H W 1"],
        camera: Camera,
        background: Float[Tensor, "3"],
        want: Want,
        shaded: None = None,
    ) -> Shaded:
        def color(image: Tensor, alpha: Tensor) -> Tensor:
            normal, rgb = image.split(3, -1)
            buffers = {"rgb": rgb, "normal": normal, "alpha": alpha}
            pixels = covered_pixels(buffers, camera, background, depth_gradient=False)
            added = pixels.alpha * self.seen(reflect(pixels.directions, pixels.normals))
            whole = rgb.new_zeros(rgb[..., 0].numel(), 3).index_copy(0, pixels.index, added)
            return rgb + whole.view_as(rgb)

        return shaded_by_torch(color, image, alpha, {SHADER + "faces": self.faces}, want)

    def features(self, buffers: Channels, camera: Camera, background: Tensor) -> None:
        """None: its map has no network behind it."""

    def emitted(self, channels: Channels, points: Float[Tensor, "N 3"], camera: Camera) -> Float[Tensor, "N 3"]:
        directions = view_directions(points, camera.position.to(points))
        return (channels["rgb"] + self.seen(reflect(directions, channels["normal"]))).clamp(0, 1)

    def seen(self, directions: Float[Tensor, "P 3"]) -> Float[Tensor, "P 3"]:
        """The cubemap in these directions, linear between texels."""
        major = directions.detach().abs().argmax(-1)
        along = directions.gather(-1, major[:, None])
        others = torch.tensor([[1, 2], [0, 2], [0, 1]], device=directions.device)[major]
        places = directions.gather(-1, others) / along.abs()
        face = 2 * major + (along[:, 0] < 0)
        colors = directions.new_zeros(len(directions), 3)
        for number, texels in enumerate(self.faces.to(directions)):
            rows = (face == number).nonzero()[:, 0]
            grid = places[rows][None, None]
            found = nn.functional.grid_sample(texels.permute(2, 0, 1)[None], grid, align_corners=True)
            colors = colors.index_copy(0, rows, found[0, :, 0].T)
        return colors


@dataclass(frozen=True)
class EnvironmentRecipe(SplatRecipe):
    """Harmonics and what an environment reflects on them."""

    steps: int = 3000
    side: int = 16
    """Texels on a side of each face."""
    rates: GaussianRates = field(default_factory=GaussianRates)
    densify: DensifySettings = field(default_factory=DensifySettings)
    loss: PhotometricLoss = field(default_factory=PhotometricLoss)

    def parts(self, box: Float[Tensor, "2 3"], seed: int = 0) -> tuple[ColorModel, Shader]:
        return HarmonicsWithNormals(), Environment(self.side, seed)

    def course(self, scene: Scene) -> Course:
        of_colors = {"columns.sh_dc": 2.5e-3, "columns.sh_rest": 1.25e-4, "shader.faces": 1e-2}
        return Course(groups={name: Adam(Rate.constant(rate)) for name, rate in of_colors.items()})
