"""A model without Gaussians, as small as one can be: what runs, files and reports ask of any model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from ringlight.core.camera import Camera
from ringlight.core.rendering import Channels, Rendering
from ringlight.core.want import Want
from ringlight.data.batches import ImageBatch
from ringlight.errors import RecipeError
from ringlight.models.contract import Count


class VoxelGrid(nn.Module):
    """Shows the mean of its colours wherever one looks."""

    row_prefixes: tuple[str, ...] = ()
    resized_prefixes: tuple[str, ...] = ()
    renderer, note = "mean of all voxels", None
    device = torch.device("cpu")

    def __init__(self, side: int):
        super().__init__()
        self.colors = nn.Parameter(torch.zeros(side, side, side, 3))
        self.register_buffer("lit", torch.tensor(True))

    def predict(self, batch: ImageBatch, want: Want, buffers: Sequence[str] = ()) -> Rendering:
        return self.render(batch.camera, batch.background, want, buffers)

    def render(
        self, camera: Camera, background: Tensor, want: Want = Want.EXACT, buffers: Sequence[str] = ()
    ) -> Rendering:
        color = self.colors.mean((0, 1, 2)).expand(camera.height, camera.width, 3)
        return Rendering(color, torch.ones(camera.height, camera.width, 1))

    def layers(self, camera: Camera) -> Channels:
        return {"alpha": torch.ones(camera.height, camera.width, 1)}

    def features(self, camera: Camera, background: Tensor) -> None:
        """None: it has no network."""

    def refuse_unblended(self, buffers: Sequence[str], who: str) -> None:
        """It blends nothing."""

    def counted(self) -> Count:
        return Count(self.colors[..., 0].numel(), "voxels")

    def bytes_each(self) -> int:
        return 12

    def rendering_tensors(self) -> dict[str, Tensor]:
        return self.state_dict()

    def rendering_size(self) -> tuple[Count, int]:
        return self.counted(), 12 * self.counted().number + 1

    def load_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        self.load_state_dict(dict(tensors))

    def splats(self) -> None:
        return None

    def solid(self) -> None:
        return None


@dataclass(frozen=True)
class VoxelRecipe:
    """Nothing grows, and nothing starts from points."""

    steps: int = 10
    side: int = 4
    most = None
    random_points = 0
    start = None
    packings = ()

    def settled(self, scene, rasterize, seed):
        return self, None

    def may_settle_on(self, other):
        return self == other

    def build(self, scene, rasterize, seed):
        raise RecipeError("this recipe is of files alone")

    def model(self, box, rasterize):
        return VoxelGrid(self.side)

    def ending_with(self, most, dropping=True):
        return self

    def never_above(self, most):
        return self

    def without_effect(self):
        return {}

    def as_stored(self, shapes):
        return self
