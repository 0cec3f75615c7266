"""The parts of a training step, each ready to be timed alone: colour models, a shader, a loss, the optimizer."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ringlight.bench.timing import TOTAL
from ringlight.bench.workload import Size, workload
from ringlight.color.basis_opacities import BasisOpacities
from ringlight.color.contract import ColorModel
from ringlight.color.harmonics import SphericalHarmonics
from ringlight.color.ringlight import RingLight
from ringlight.color.varying_mirror import VaryingMirror
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import Gradients
from ringlight.core.randomness import generator
from ringlight.core.rendering import Emission, Shaded
from ringlight.core.scene import PointCloud
from ringlight.core.want import Want
from ringlight.fit.adam import Update, adam_
from ringlight.fit.losses.photometric_gradient import Target, photometric_gradient, photometric_reference
from ringlight.fit.photometric import PhotometricLoss
from ringlight.methods.ringlight_basis import RingLightBasisRecipe
from ringlight.methods.ringlight_mirror import RingLightMirrorRecipe
from ringlight.methods.ringlight_ring import OURS, PAPER
from ringlight.models.splats import move
from ringlight.shade.reflection import ReflectionShader
from ringlight.shade.reflection_settings import ReflectionSettings

BOX = torch.tensor([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])
BALL_RADIUS = 0.315
"""Of the reflecting ball, as a share of the image's side: it covers 31 % of the pixels, as a subject does."""
BALL_DISTANCE = 4.0
"""From the camera to the ball's centre, world units; the ball's box has sides of 2."""
MIRROR = RingLightMirrorRecipe()
SHADER = MIRROR.shader
WIDE = 64
"""Width of the hidden layers that ringlight-mirror leaves to those who want more."""
TABLE_WIDTHS = (3, 3, 4, 1, 3, 45)
"""Floats a row of the columns of ``3dgs``: centres, scales, rotations, opacities, constant and other harmonics."""
WARM = 1000
"""The update that is repeated: far into a run, where both moments are warm."""
RATE, BETAS, EPSILON = 1e-3, (0.9, 0.999), 1e-15

FORWARD, BACKWARD = "forward", "backward"

Record = TypeVar("Record")
Stages = Mapping[str, Callable[[], object]]


@dataclass(frozen=True)
class Part:
    """One part at one size, ready to run: the stages of a step, and what is timed in turns with them."""

    items: int
    stages: Stages
    show: Callable[[], object] | None = None
    beside: Mapping[str, Stages] = field(default_factory=dict)
    results: Callable[[], tuple[Tensor, Tensor]] | None = None
    """The part's result and its reference's, which shall be equal."""


Maker = Callable[[Size, int, torch.device], Part]
"""From size and seed to a part on that device."""


def there_and_back(forward: Callable[[], Record], backward: Callable[[Record], object]) -> Stages:
    """A record, and in the next stage its way back, which goes once."""
    made: list[Record] = []
    return {FORWARD: lambda: made.append(forward()), BACKWARD: lambda: backward(made.pop())}


def color_part(model: Callable[[], ColorModel]) -> Maker:
    """What each Gaussian of the standard workload emits towards its camera, all channels."""

    def make(size: Size, seed: int, device: torch.device) -> Part:
        color, work = model(), workload(size, seed)
        assert isinstance(color, nn.Module)
        move(color, device)
        columns = work.gaussians.columns() | color.new_columns(PointCloud(work.gaussians.means, work.channels))
        gaussians = Gaussians.from_columns({name: column.to(device) for name, column in columns.items()})
        shape = size.gaussians, sum(color.emits.values())
        upstream = torch.randn(shape, generator=generator(seed, 0, "colour gradient")).to(device)
        of_opacity = torch.zeros_like(gaussians.opacity_logits)

        def emitted(want: Want) -> Emission:
            emission = color.emit(gaussians, work.camera, tuple(color.emits), want)
            assert len(emission.channels)  # so that lazy colours are worked out
            return emission

        def backward(emission: Emission) -> None:
            emission.backward(upstream, None if emission.opacity_factor is None else of_opacity, Gradients())

        stages = there_and_back(lambda: emitted(Want.GRADIENTS), backward)
        return Part(size.gaussians, stages, show=lambda: emitted(Want.EXACT))

    return make


def reflection_part(settings: ReflectionSettings) -> Maker:
    """The deferred shader on a ball in the middle of the image. Beside it is its reference in torch, which hands on the
    gradients of all pixels, and where training takes a share of them the shader "whole", which does too."""

    def make(size: Size, seed: int, device: torch.device) -> Part:
        pixels = size.pixels
        focal, middle = float(pixels), pixels / 2
        camera = Camera(torch.eye(4), (focal, focal), (middle, middle), pixels, pixels)
        box = BOX + torch.tensor([0.0, 0.0, BALL_DISTANCE])
        shader, whole = (
            ReflectionShader(each, box, seed) for each in (settings, replace(settings, gradient_share=1.0))
        )
        move(shader, device)
        move(whole, device)
        planes = {name: plane.to(device) for name, plane in ball(pixels, settings.latents, seed).items()}
        image = torch.cat([planes[name] for name in shader.needs]).permute(1, 2, 0)
        alpha, background = planes["alpha"].permute(1, 2, 0), torch.ones(3, device=device)
        upstream = torch.randn(3, pixels, pixels, generator=generator(seed, 0, "upstream")).to(device).permute(1, 2, 0)

        def shaded(want: Want, by: ReflectionShader = shader) -> Shaded:
            return by.shade(image, alpha, camera, background, want)

        def by_torch() -> Shaded:
            return shader.shaded_by_torch(image, alpha, camera, background, Want.GRADIENTS)

        def backward(record: Shaded) -> None:
            record.backward(upstream, Gradients())

        def stages(by: ReflectionShader) -> Stages:
            return there_and_back(lambda: shaded(Want.GRADIENTS, by), backward)

        return Part(
            int((alpha > 0).sum()),
            stages(shader),
            show=lambda: shaded(Want.EXACT),
            beside={
                **({"whole": stages(whole)} if settings.gradient_share < 1 else {}),
                "reference": there_and_back(by_torch, backward),
            },
            results=lambda: (shaded(Want.EXACT).color, by_torch().color),
        )

    return make


def ball(pixels: int, latents: int, seed: int) -> dict[str, Float[Tensor, "C H W"]]:
    """Blended buffers of an opaque ball in the middle of a square image."""
    axis = (torch.arange(pixels) + 0.5) / pixels - 0.5
    rows, columns = torch.meshgrid(axis / BALL_RADIUS, axis / BALL_RADIUS, indexing="ij")
    squared = rows.square() + columns.square()
    height = (1 - squared).clamp_min(0).sqrt()
    drawn = generator(seed, 0, "ball")
    planes = {
        "rgb": torch.rand(3, pixels, pixels, generator=drawn),
        "normal": torch.stack([columns, rows, -height]),
        "latents": torch.randn(latents, pixels, pixels, generator=drawn),
        "depth": (BALL_DISTANCE - height)[None],
        "alpha": torch.ones(1, pixels, pixels),
    }
    return {name: plane * (squared < 1) for name, plane in planes.items()}


def photometric_part(size: Size, seed: int, device: torch.device) -> Part:
    """Loss and gradient of a rendering near its photograph, as training calls it, beside the reference in torch.

    That is written to be read, and blurs the photograph as well: no measure of the best that torch can do.
    """
    draw, shape = generator(seed, size.pixels, "loss"), (3, size.pixels, size.pixels)
    image = torch.rand(shape, generator=draw)
    target = Target((image + 0.1 * torch.randn(shape, generator=draw)).clamp(0, 1).to(device))
    image, settings = image.to(device), PhotometricLoss()

    def ours() -> Float[Tensor, "3 H W"]:
        return photometric_gradient(image.permute(1, 2, 0), target, settings)[1].permute(2, 0, 1)

    def by_torch() -> Float[Tensor, "3 H W"]:
        leaf = image.detach().requires_grad_()
        return torch.autograd.grad(photometric_reference(leaf, target.image, settings), leaf)[0]

    beside = {"reference": {TOTAL: by_torch}}
    return Part(size.pixels**2, {TOTAL: ours}, beside=beside, results=lambda: (ours(), by_torch()))


def adam_part(size: Size, seed: int, device: torch.device) -> Part:
    """One update of a whole 3dgs table, beside torch's fused and foreach Adam on the same numbers."""
    draw = generator(seed, size.gaussians, "adam")
    columns = [torch.randn(size.gaussians, width, generator=draw).to(device) for width in TABLE_WIDTHS]
    gradients = [torch.randn(size.gaussians, width, generator=draw).to(device) for width in TABLE_WIDTHS]
    updates = []
    for column, gradient in zip(columns, gradients, strict=True):
        mean, square = torch.zeros_like(column), torch.zeros_like(column)
        updates.append(Update(column.clone(), gradient, mean, square, (RATE, *BETAS, EPSILON, WARM)))
    beside = {
        "torch fused": {TOTAL: torch_step(columns, gradients, fused=True)},
        "torch foreach": {TOTAL: torch_step(columns, gradients, fused=False)},
    }
    return Part(size.gaussians, {TOTAL: lambda: adam_(updates)}, beside=beside)


def torch_step(columns: Sequence[Tensor], gradients: Sequence[Tensor], *, fused: bool) -> Callable[[], object]:
    """One update by torch, fused or foreach, of copies of the columns."""
    copies = [column.clone().requires_grad_() for column in columns]
    for copy, gradient in zip(copies, gradients, strict=True):
        copy.grad = gradient
    return torch.optim.Adam(copies, RATE, BETAS, EPSILON, fused=fused, foreach=not fused).step


PARTS: dict[str, Maker] = {
    "harmonics": color_part(SphericalHarmonics),
    "basis": color_part(lambda: BasisOpacities(RingLightBasisRecipe().basis_size)),
    "ring": color_part(lambda: RingLight(OURS, BOX)),
    "ring-paper": color_part(lambda: RingLight(PAPER.light, BOX)),
    "ring-exact": color_part(lambda: RingLight(replace(PAPER.light, evaluation="exact"), BOX)),
    "mirror": color_part(lambda: VaryingMirror(SHADER.latents, MIRROR.basis_size, opacities=MIRROR.varying_opacity)),
    "reflection": reflection_part(SHADER),
    "reflection-wide": reflection_part(replace(SHADER, hidden=WIDE)),
    "photometric": photometric_part,
    "adam": adam_part,
}
"""As the recipes of their methods set them; light and shader are switched on."""
