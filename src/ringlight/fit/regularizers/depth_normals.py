"""Blended normals that agree with the surface that blended depths make (GaussianShader, Jiang et al. 2024).

A pixel shows the point depth / alpha along its ray; the surface's normal is the cross product of the differences of the
points below and above it, and to its right and left. All four must be covered, so that no silhouette has a normal.
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.by_autograd import ByAutograd
from ringlight.core.camera import Camera
from ringlight.core.directions import normalize
from ringlight.core.rendering import Rendering
from ringlight.fit.regularizers.contract import Term
from ringlight.models.contract import Model

COVERED = 0.9
"""Alpha of a pixel that shows a surface, and hardly what lies behind."""

SHORTEST_PRODUCT = 1e-30
"""Squared length of a cross product of differences, world units to the fourth, from which on it has a direction."""

NEIGHBOURS = ("right", "left", "below", "above")

WINDOW = {"itself": (0, 0), "right": (0, 1), "left": (0, -1), "below": (1, 0), "above": (-1, 0)}
"""Rows down and columns to the right."""

Places = tuple[slice, slice]


class DepthNormals:
    """``weight`` times the mean of 1 - cosine between blended normal and depth's normal over pixels within a surface.

    It looks at ``steps``, by default all; where these are every K-th it counts K times. There it looks at every
    ``stride``-th row and column, another of them each time. A pixel whose cosine is not above ``least_cosine`` adds
    nothing, though the mean counts it: its neighbours lie on surfaces one behind the other. Predictions without a
    camera, and without a pixel within a surface, give nothing.
    """

    buffers: tuple[str, ...] = ("normal", "depth", "alpha")

    def __init__(self, weight: float, stride: int = 1, steps: range | None = None, least_cosine: float = -math.inf):
        self.steps, self.every = steps, 1 if steps is None else steps.step
        self.weight, self.stride, self.least_cosine = weight * self.every, stride, least_cosine

    def looks(self, step: int) -> bool:
        """See :class:`ringlight.fit.regularizers.contract.Regularizer`."""
        return self.steps is None or step in self.steps

    def term(self, step: int, model: Model, prediction: Rendering) -> Term:
        """See :class:`ringlight.fit.regularizers.contract.Regularizer`."""
        camera, buffers = prediction.camera, {name: prediction.buffers[name] for name in self.buffers}
        height, width = buffers["alpha"].shape[:2]
        if camera is None or min(height, width) < 2 + self.stride:
            return Term(buffers["alpha"].new_zeros(()))
        look = step // self.every
        first = look // self.stride % self.stride, look % self.stride
        places = {name: self._places(first, offset, (height, width)) for name, offset in WINDOW.items()}
        covered = torch.stack([buffers["alpha"][at][..., 0] > COVERED for at in places.values()]).all(0)
        count = int(covered.sum())
        if not count:
            return Term(buffers["alpha"].new_zeros(()))

        def disagreement(of: dict[str, Tensor]) -> dict[str, Tensor]:
            points = {name: surface_points(of[f"depth {name}"], places[name], camera) for name in NEIGHBOURS}
            normals = normalize(of["normal"] @ camera.world_to_camera[:3, :3].to(of["normal"]).T)
            made = _unit(torch.linalg.cross(points["below"] - points["above"], points["right"] - points["left"]))
            cosines = (normals * made).sum(-1)
            cosines = torch.where(covered & (cosines.detach() > self.least_cosine), cosines, 1.0)
            return {"term": self.weight / count * (1 - cosines).sum()}

        # The leaves are pictures of few pixels, and the division by alpha is done here: autograd would fill a whole
        # picture for each neighbour.
        alphas = {name: buffers["alpha"][places[name]].clamp_min(COVERED) for name in NEIGHBOURS}
        depths = {f"depth {name}": buffers["depth"][places[name]] / alphas[name] for name in NEIGHBOURS}
        recorded = ByAutograd(disagreement, depths | {"normal": buffers["normal"][places["itself"]]})
        value = recorded.outputs["term"]
        found = recorded.backward({"term": torch.ones_like(value)})
        gradients = {name: torch.zeros_like(buffer) for name, buffer in buffers.items()}
        gradients["normal"][places["itself"]] = found["normal"]
        for name, alpha in alphas.items():
            of_depth = found[f"depth {name}"] / alpha
            gradients["depth"][places[name]] += of_depth
            gradients["alpha"][places[name]] -= of_depth * depths[f"depth {name}"]
        return Term(value, gradients)

    def _places(self, first: tuple[int, int], moved: tuple[int, int], sizes: tuple[int, int]) -> Places:
        rows, columns = (
            slice(1 + begin + offset, size - 1 + offset, self.stride)
            for begin, offset, size in zip(first, moved, sizes, strict=True)
        )
        return rows, columns


def surface_points(depths: Float[Tensor, "h w 1"], at: Places, camera: Camera) -> Float[Tensor, "h w 3"]:
    """Where the rays of these pixels meet the surface, in the camera's frame."""
    rows, columns = torch.arange(camera.height)[at[0]], torch.arange(camera.width)[at[1]]
    x = ((columns + 0.5 - camera.center[0]) / camera.focal[0]).to(depths)
    y = ((rows + 0.5 - camera.center[1]) / camera.focal[1]).to(depths)
    depth = depths[..., 0]
    return torch.stack([depth * x, depth * y[:, None], depth], -1)


def _unit(products: Float[Tensor, "h w 3"]) -> Float[Tensor, "h w 3"]:
    """Of lengths far below those that ``normalize`` stretches: points a pixel apart."""
    return products * (products * products).sum(-1, keepdim=True).clamp_min(SHORTEST_PRODUCT).rsqrt()
