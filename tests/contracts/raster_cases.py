"""Random scenes for the rasterizer contract, judged in float64, and the pixels where rounding may decide."""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.gaussians import GEOMETRY, Gaussians
from ringlight.core.rendering import Raster
from ringlight.rasterize import convention
from ringlight.rasterize.contract import Rasterizer, RasterOptions
from ringlight.rasterize.projection import project
from ringlight.rasterize.reference import ReferenceRasterizer
from torch_graph import drawn


@dataclass(frozen=True)
class Case:
    """One call of a rasterizer, float32."""

    gaussians: Gaussians
    channels: Tensor
    camera: Camera
    background: Tensor
    options: RasterOptions = RasterOptions()
    opacity_factor: Tensor | None = None

    def to(self, dtype: torch.dtype) -> "Case":
        """The same numbers in another precision."""
        factor = None if self.opacity_factor is None else self.opacity_factor.to(dtype)
        columns = {name: column.to(dtype) for name, column in self.gaussians.columns().items()}
        channels, background = self.channels.to(dtype), self.background.to(dtype)
        return replace(
            self,
            gaussians=Gaussians.from_columns(columns),
            channels=channels,
            background=background,
            opacity_factor=factor,
        )


@dataclass
class Outcome:
    raster: Raster
    gradients: dict[str, Tensor]


def random_case(
    seed: int,
    count: int = 80,
    channels: int = 3,
    size: tuple[int, int] = (37, 29),
    antialiased: bool = False,
    with_factor: bool = False,
) -> Case:
    """Gaussians in front of, beside and behind an off-centre camera, from faint to opaque, thin ones among them."""
    generator = torch.Generator().manual_seed(seed)
    draw = lambda *shape: torch.randn(*shape, generator=generator)  # noqa: E731
    width, height = size
    focal = 0.9 * max(width, height)
    # Evenly spaced depths in random order: rounding cannot swap two of them. A tenth lies behind the camera.
    depths = torch.linspace(-0.6, 6, count)[torch.randperm(count, generator=generator)]
    points = torch.cat([draw(count, 2) * (0.5 * depths.abs() + 0.1)[:, None], depths[:, None]], 1)
    rotation = torch.linalg.qr(draw(3, 3))[0]
    rotation = rotation * torch.linalg.det(rotation)
    matrix = torch.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, draw(3)
    means = (points - matrix[:3, 3]) @ rotation
    gaussians = Gaussians(means, draw(count, 3) * 0.8 - 1.8, draw(count, 4), 3 * draw(count))
    camera = Camera(matrix, (focal, 1.1 * focal), (0.4 * width, 0.6 * height), width, height)
    options = RasterOptions(antialiased=antialiased, absgrad=True)
    factor = torch.rand(count, generator=generator) if with_factor else None
    return Case(gaussians, draw(count, channels), camera, draw(channels), options, factor)


def run(rasterizer: Rasterizer, case: Case, grad_image: Tensor, grad_alpha: Tensor) -> Outcome:
    """Forward, then backward under the given cotangents; gradients by column name, "channels", "opacity_factor"."""
    inputs = {name: case.gaussians.columns()[name] for name in GEOMETRY} | {"channels": case.channels}
    if case.opacity_factor is not None:
        inputs["opacity_factor"] = case.opacity_factor
    leaves = {name: tensor.detach().clone().requires_grad_() for name, tensor in inputs.items()}
    raster = drawn(
        rasterizer,
        Gaussians(*(leaves[name] for name in GEOMETRY)),
        leaves["channels"],
        case.camera,
        case.background,
        case.options,
        leaves.get("opacity_factor"),
    )
    dtype = raster.image.dtype
    torch.autograd.backward([raster.image, raster.alpha], [grad_image.to(dtype), grad_alpha.to(dtype)])
    return Outcome(raster, {name: leaf.grad for name, leaf in leaves.items()})


def judge(case: Case, grad_image: Tensor, grad_alpha: Tensor) -> Outcome:
    """What is right: the reference in float64."""
    return run(ReferenceRasterizer(), case.to(torch.float64), grad_image, grad_alpha)


def random_cotangents(case: Case, seed: int) -> tuple[Tensor, Tensor]:
    """Random upstream gradients for image and alpha, zero where rounding may decide."""
    generator = torch.Generator().manual_seed(seed)
    camera, sure = case.camera, certain_pixels(case)[..., None]
    grad_image = torch.randn(camera.height, camera.width, case.channels.shape[1], generator=generator)
    grad_alpha = torch.randn(camera.height, camera.width, 1, generator=generator)
    return grad_image * sure, grad_alpha * sure


# Relative distance from a threshold within which float32 may fall on the other side. Alphas and transmittances agree
# to about 1e-5; the rest is for thin Gaussians, whose conics lose digits.
ALPHA_DOUBT, TRANSMITTANCE_DOUBT = 1e-3, 1e-2


def certain_pixels(case: Case) -> Bool[Tensor, "H W"]:
    """Pixels at which no pair lies near the skip, clamp or stop threshold."""
    exact, camera = case.to(torch.float64), case.camera
    splats = project(exact.gaussians, camera, case.options, exact.opacity_factor)
    drawn = splats.on_image(camera, case.options.near).nonzero()[:, 0]
    splats = splats.rows(drawn[splats.depths[drawn].argsort()])
    y, x = torch.meshgrid(torch.arange(camera.height) + 0.5, torch.arange(camera.width) + 0.5, indexing="ij")
    dx, dy = x[..., None] - splats.means2d[:, 0], y[..., None] - splats.means2d[:, 1]
    xx, xy, yy = splats.conics.unbind(-1)
    alphas = splats.opacities * (-0.5 * (xx * dx * dx + yy * dy * dy) - xy * dx * dy).exp()
    doubtful = torch.zeros_like(alphas, dtype=torch.bool)
    for threshold in (convention.MIN_ALPHA, case.options.max_alpha):
        doubtful |= (alphas / threshold - 1).abs() < ALPHA_DOUBT
    blended = torch.where(alphas < convention.MIN_ALPHA, 0, alphas.clamp_max(case.options.max_alpha))
    transmittances = (1 - blended).cumprod(-1)
    doubtful |= (transmittances / convention.MIN_TRANSMITTANCE - 1).abs() < TRANSMITTANCE_DOUBT
    return ~doubtful.any(-1)
