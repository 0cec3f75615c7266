"""A plug without Gaussians: a dense grid of density and colour, rendered along rays.

Emission and absorption with linear interpolation (Max 1995; Mildenhall et al. 2020, equation 3). It learns from lots of
rays of several photographs.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ringlight.core.by_autograd import ByAutograd
from ringlight.core.camera import Camera
from ringlight.core.directions import normalize
from ringlight.core.gradients import Gradients
from ringlight.core.randomness import generator
from ringlight.core.raw_bytes import raw_bytes
from ringlight.core.rendering import Channels, Rendering
from ringlight.core.scene import Scene
from ringlight.core.want import Want
from ringlight.errors import RecipeError
from ringlight.fit.losses.contract import Compared
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.rates import Adam, Rate
from ringlight.fit.train import Training
from ringlight.methods.recipe import Recipe
from ringlight.models.contract import Count, Model

if TYPE_CHECKING:
    from ringlight.rasterize.contract import Rasterizer

SAMPLES = 48
"""Of each ray, evenly through the box."""
CHUNK = 4096
"""Rays of a picture that are rendered at once."""
BUFFERS = ("alpha", "depth")


@dataclass(frozen=True)
class RayBatch:
    """R rays of any photographs; ``colors`` are those of their pixels over the background."""

    origins: Float[Tensor, "R 3"]
    directions: Float[Tensor, "R 3"]
    colors: Float[Tensor, "R 3"]
    background: Float[Tensor, "3"]

    @property
    def label(self) -> str:
        return f"a lot of {len(self.origins)} rays"


class RayBatches:
    """Pixels drawn anew at each step from all photographs."""

    def __init__(self, scene: Scene, count: int, seed: int):
        self.background, self.count, self.seed = scene.background_color, count, seed
        rays = [_rays(view.camera) for view in scene.train]
        self._origins = torch.cat([origins for origins, _ in rays])
        self._directions = torch.cat([directions for _, directions in rays])
        images = (view.image(self.background).permute(1, 2, 0).reshape(-1, 3) for view in scene.train)
        self._colors = torch.cat(list(images))

    def at(self, step: int) -> RayBatch:
        index = torch.randint(len(self._colors), (self.count,), generator=generator(self.seed, step, "rays"))
        return RayBatch(self._origins[index], self._directions[index], self._colors[index], self.background)


class RayLoss:
    """Mean squared error."""

    bytes_kept = 0
    buffers: tuple[str, ...] = ()

    def compare(self, prediction: Rendering, batch: RayBatch, model: Model) -> Compared:
        difference = prediction.color - batch.colors
        return Compared(difference.square().mean(), difference * (2 / difference.numel()), batch.colors)


class VoxelGrid(nn.Module):
    """``density`` [1 D H W] before softplus, per box's longest side; ``colors`` [3 D H W] before the sigmoid."""

    box: Tensor
    row_prefixes: tuple[str, ...] = ()
    resized_prefixes: tuple[str, ...] = ()
    renderer = "ray marcher"
    note: str | None = None

    def __init__(self, side: int, box: Float[Tensor, "2 3"]):
        super().__init__()
        self.density = nn.Parameter(torch.full((1, side, side, side), -2.0))
        self.colors = nn.Parameter(torch.zeros(3, side, side, side))
        self.register_buffer("box", box.clone().float())

    @property
    def device(self) -> torch.device:
        return self.density.device

    def predict(self, batch: RayBatch, want: Want, buffers: Sequence[str] = ()) -> Rendering:
        return self._rendered(batch.origins, batch.directions, batch.background, want)

    def render(
        self, camera: Camera, background: Float[Tensor, "3"], want: Want = Want.EXACT, buffers: Sequence[str] = ()
    ) -> Rendering:
        origins, directions = _rays(camera)
        shape = (camera.height, camera.width, -1)
        if want is Want.GRADIENTS:
            whole = self._rendered(origins, directions, background, want)
            named = {name: values.view(shape) for name, values in whole.buffers.items()}

            def backward(grad_color: Tensor, grad_buffers: Mapping[str, Tensor]) -> Gradients:
                return whole.backward(grad_color.reshape(-1, 3), {n: g.reshape(-1, 1) for n, g in grad_buffers.items()})

            return Rendering(whole.color.view(shape), whole.alpha.view(shape), named, backward=backward)
        chunks = zip(origins.split(CHUNK), directions.split(CHUNK), strict=True)
        parts = [self._rendered(o, d, background, want) for o, d in chunks]
        found = {name: torch.cat([part.buffers[name] for part in parts]).view(shape) for name in BUFFERS}
        return Rendering(torch.cat([part.color for part in parts]).view(shape), found["alpha"], found)

    @torch.no_grad()
    def layers(self, camera: Camera) -> Channels:
        shown = self.render(camera, torch.zeros(3))
        alpha, depth = shown.buffers["alpha"], shown.buffers["depth"]
        surface = alpha > 1e-3
        mean_depth = torch.where(surface, depth / alpha.clamp_min(1e-3), 0)
        normal = torch.where(surface, -camera.forward.expand(*alpha.shape[:2], 3), 0)
        nothing = torch.zeros_like(shown.color)
        return {"base": shown.color, "residual": nothing, "alpha": alpha, "depth": mean_depth, "normal": normal}

    def features(self, camera: Camera, background: Tensor) -> None:
        """None: it has no network."""

    def refuse_unblended(self, buffers: Sequence[str], who: str) -> None:
        for name in buffers:
            if name not in BUFFERS:
                raise RecipeError(f"{who} looks at {name!r}, which this model does not blend; it blends alpha, depth")

    def counted(self) -> Count:
        return Count(self.density.numel(), "voxels")

    def bytes_each(self) -> int:
        return 4 * 4

    def rendering_tensors(self) -> dict[str, Tensor]:
        return dict(self.state_dict())

    def rendering_size(self) -> tuple[Count, int]:
        return self.counted(), sum(raw_bytes(tensor) for tensor in self.state_dict().values())

    def load_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        self.load_state_dict(dict(tensors))

    def splats(self) -> None:
        """None: nothing is splatted."""

    def solid(self) -> None:
        """None: nobody asked for its surface yet."""

    def _rendered(self, origins: Tensor, directions: Tensor, background: Tensor, want: Want) -> Rendering:
        parameters = {"density": self.density, "colors": self.colors}
        recorded = ByAutograd(lambda _: self._marched(origins, directions, background), {}, parameters)
        outputs = recorded.outputs
        buffers = {name: outputs[name] for name in BUFFERS}

        def backward(grad_color: Tensor, grad_buffers: Mapping[str, Tensor]) -> Gradients:
            return Gradients(recorded.backward({"color": grad_color, **grad_buffers}))

        if want is not Want.GRADIENTS:
            return Rendering(outputs["color"], outputs["alpha"], buffers)
        return Rendering(outputs["color"], outputs["alpha"], buffers, backward=backward)

    def _marched(self, origins: Tensor, directions: Tensor, background: Tensor) -> Channels:
        low, high = self.box.to(origins)
        side = (high - low).max()
        middle = 0.5 * (low + high)
        near = (middle - origins).norm(dim=-1) - 0.9 * side
        t = near.clamp_min(0)[:, None] + (torch.arange(SAMPLES).to(origins) + 0.5) * (1.8 * side / SAMPLES)
        unit = (origins[:, None] + t[..., None] * directions[:, None] - middle) * (2 / side)
        grid = unit.view(1, 1, 1, -1, 3)
        values = torch.cat([self.density, self.colors])[None].to(origins)
        found = nn.functional.grid_sample(values, grid, align_corners=True)[0, :, 0, 0].T.view(*t.shape, 4)
        inside = (unit.abs() <= 1).all(-1)
        thickness = nn.functional.softplus(found[..., 0]) * inside * (1.8 * 20 / SAMPLES)
        passed = torch.exp(-torch.cat([thickness.new_zeros(len(t), 1), thickness], -1).cumsum(-1))
        weights = passed[:, :-1] - passed[:, 1:]
        alpha = weights.sum(-1, keepdim=True)
        color = (weights[..., None] * found[..., 1:].sigmoid()).sum(1) + (1 - alpha) * background.to(origins)
        return {"color": color, "alpha": alpha, "depth": (weights * t).sum(-1, keepdim=True)}


def _rays(camera: Camera) -> tuple[Float[Tensor, "P 3"], Float[Tensor, "P 3"]]:
    directions = normalize(camera.ray_directions().reshape(-1, 3))
    return camera.position.expand(len(directions), 3), directions


@dataclass(frozen=True)
class VoxelRecipe:
    """A dense grid of density and colour."""

    steps: int = 2000
    side: int = 32
    """Voxels along each axis of the scene's box."""
    rays: int = 1024
    """In a step."""
    rate: float = 0.1
    """Learning rate of density and colour."""

    most: int | None = None
    random_points: int = 0
    packings: ClassVar[tuple[tuple[str, str], ...]] = ()

    def settled(self, scene: Scene, rasterize: "Rasterizer", seed: int) -> "tuple[VoxelRecipe, None]":
        return self, None

    def may_settle_on(self, other: Recipe) -> bool:
        return self == other

    @property
    def start(self) -> None:
        """It starts from no points."""

    def ending_with(self, most: int | None, dropping: bool = True) -> "VoxelRecipe":
        return self

    def never_above(self, most: int) -> "VoxelRecipe":
        return self

    def without_effect(self) -> dict[str, str]:
        return {}

    def as_stored(self, shapes: Mapping[str, tuple[int, ...]]) -> "VoxelRecipe":
        return self

    def model(self, box: Float[Tensor, "2 3"], rasterize: "Rasterizer") -> VoxelGrid:
        return VoxelGrid(self.side, box)

    def build(self, scene: Scene, rasterize: "Rasterizer", seed: int) -> Training:
        model = VoxelGrid(self.side, scene.box)
        group = Adam(Rate(self.rate, self.rate / 10))
        return Training(
            model=model,
            batches=RayBatches(scene, self.rays, seed),
            loss=RayLoss(),
            optimizer=Optimizer(model, {"density": group, "colors": group}, self.steps),
            strategies=(),
            steps=self.steps,
        )
