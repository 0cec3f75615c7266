"""The surface that pixels show: what was blended, undone of its opacity, and the ray that looks at it."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.rendering import Channels
from ringlight.core.rows import rows_at

# Pixels with less opacity are not shaded: the network could add a fiftieth of a colour at most, and the division by
# opacity would hand on noise fifty times over.
FAINTEST_SHADED = 0.02

# Blended normals that cancel have no direction: what is shorter than this is not stretched to a unit vector any more,
# so that a gradient grows a thousandfold at most.
SHORTEST_NORMAL = 1e-3


@dataclass(frozen=True)
class CoveredPixels:
    """P pixels and their surface. ``directions`` are the rays' unit directions, ``points`` where they meet it."""

    index: Int[Tensor, "P"]
    alpha: Float[Tensor, "P 1"]
    base: Float[Tensor, "P 3"]
    latents: Float[Tensor, "P L"]
    normals: Float[Tensor, "P 3"]
    directions: Float[Tensor, "P 3"]
    points: Float[Tensor, "P 3"]

    def chosen(self, rows: Int[Tensor, "S"]) -> "CoveredPixels":
        """Some of them."""
        return CoveredPixels(**{name: values[rows] for name, values in vars(self).items()})


def covered_pixels(
    buffers: Channels, camera: Camera, background: Float[Tensor, "3"], depth_gradient: bool
) -> CoveredPixels:
    """The pixels opaque enough to be shaded; ``index`` counts row by row. ``points`` are in world units.

    Without "depth" they mean nothing, which is well where reflections have neither parallax nor factors of the place.
    """
    flat = {name: values.flatten(0, 1) for name, values in buffers.items()}
    index = (flat["alpha"].detach()[:, 0] > FAINTEST_SHADED).nonzero()[:, 0]
    alpha = rows_at(flat["alpha"], index)
    rays = _rays(index, camera).to(alpha)
    depth = rows_at(flat["depth"], index) / alpha if "depth" in flat else torch.zeros_like(alpha)
    return CoveredPixels(
        index=index,
        alpha=alpha,
        base=(rows_at(flat["rgb"], index) - (1 - alpha) * background.to(alpha)) / alpha,
        latents=rows_at(flat["latents"], index) / alpha if "latents" in flat else alpha.new_empty(len(index), 0),
        normals=_unit(rows_at(flat["normal"], index)),
        directions=rays * (rays * rays).sum(-1, keepdim=True).rsqrt(),
        points=camera.position.to(alpha) + rays * (depth if depth_gradient else depth.detach()),
    )


def _rays(index: Int[Tensor, "P"], camera: Camera) -> Float[Tensor, "P 3"]:
    """World directions through the pixels' centres, one unit deep along the camera's axis."""
    rows, columns = index // camera.width, index % camera.width
    x = (columns + 0.5 - camera.center[0]) / camera.focal[0]
    y = (rows + 0.5 - camera.center[1]) / camera.focal[1]
    rotation = camera.world_to_camera[:3, :3].to(x.device, torch.float64)
    return torch.stack([x, y, torch.ones_like(x)], -1).to(torch.float64) @ rotation


def _unit(normals: Float[Tensor, "P 3"]) -> Float[Tensor, "P 3"]:
    return normals * (normals * normals).sum(-1, keepdim=True).clamp_min(SHORTEST_NORMAL**2).rsqrt()
