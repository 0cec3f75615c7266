"""Masks of photographs that bring none, where they show their subject before one even colour.

Scenes rendered over white or black are often handed on as RGB. What has the background's colour and hangs together
with the picture's border is then background. Two things go wrong in single photographs, and the others mend them: a
highlight of that colour on the silhouette tears the subject open, and a hole through it is cut off from the border. So
photographs vote on voxels first, and each mask is corrected by what stands after that.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from scipy import ndimage
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.scene import View
from ringlight.core.stages import counted
from ringlight.data.hull import SEEN_SHARE, Mask, VoxelGrid, evenly_chosen

TOLERANCE = 4 / 255
"""Difference from the background's colour, in the channel where it is largest, that compression and noise may make."""

BORDER_SHARE = 0.9
"""Share of the pixels on photographs' borders that must have the background's colour. Subjects may reach the border;
an overexposed sky takes one side or two of each."""

PROBES = 8
"""Photographs that are looked at before all others are decoded."""

CELLS = 96
"""Voxels along the longest side of the scene's box while photographs vote."""

OUTSIDE_VOTES = 0.06
"""A voxel is empty when it lies on background in this share of the photographs: a highlight is white in fewer."""

HOLE_VOTES = 0.1
"""And this share, where it lies on the background's colour but cut off from the border: a hole shows in many
photographs, a white thing in front of it as well, but from one side."""

FEWEST_VOTES = 2
"""One photograph decides nothing alone."""

LEAST_CONTRAST = 0.05
"""Distance of the subject's colour from the background's below which a silhouette pixel's cover cannot be told."""

AROUND = np.ones((3, 3), bool)
"""Pixels that touch, by edges or corners."""


@dataclass(frozen=True)
class _Photograph:
    """Its pixels; which have the background's colour, and which of them hang together with the border."""

    camera: Camera
    pixels: UInt8[np.ndarray, "H W C"]
    like: Bool[np.ndarray, "H W"]
    reached: Bool[np.ndarray, "H W"]

    @staticmethod
    def of(view: View, background: Float[np.ndarray, "3"]) -> "_Photograph":
        pixels = view.load()
        like = _like(pixels, background)
        labels, _ = ndimage.label(like)
        outer = np.unique(_border(labels))
        return _Photograph(view.camera, pixels, like, np.isin(labels, outer[outer > 0]))

    def at(self, points: Float[Tensor, "P 3"]) -> tuple[Bool[Tensor, "P"], Bool[Tensor, "P"], Bool[Tensor, "P"]]:
        """Of each point whether it is in the picture, on background, and on the background's colour elsewhere."""
        column, row, inside = self.camera.pixels(points)
        pixel = torch.where(inside, row * self.camera.width + column, 0)
        reached = torch.from_numpy(self.reached).flatten()[pixel] & inside
        return inside, reached, torch.from_numpy(self.like).flatten()[pixel] & inside & ~reached

    def shown(self, points: Float[Tensor, "P 3"], pitch: float) -> Bool[np.ndarray, "H W"]:
        """The pixels that voxels with these centres cover."""
        column, row, inside = self.camera.pixels(points)
        covered = np.zeros(self.like.shape, bool)
        if not bool(inside.any()):
            return covered
        covered[row[inside].numpy(), column[inside].numpy()] = True
        half = 0.5 * pitch * max(self.camera.focal) / float(self.camera.depths(points[inside]).median())
        return ndimage.binary_dilation(covered, AROUND, iterations=max(round(half), 1))


def on_even_background(views: Sequence[View], background: Float[Tensor, "3"]) -> bool:
    """Whether the borders of some of the photographs have the colour ``background``, sRGB in [0, 1]."""
    color = background.numpy().astype(np.float32)
    probes = [_like(view.load(), color) for view in evenly_chosen(views, PROBES)]
    return bool(probes) and float(np.mean([_border(like).mean() for like in probes])) >= BORDER_SHARE


def border_masks(views: Sequence[View], box: Float[Tensor, "2 3"], background: Float[Tensor, "3"]) -> list[Mask]:
    """Masks of at most as many views as carve; none where the photographs' borders are not of colour ``background``.

    ``box`` holds the subject, world units; ``background`` is sRGB in [0, 1].
    """
    if not on_even_background(views, background):
        return []
    color = background.numpy().astype(np.float32)
    chosen = evenly_chosen(views)
    photographs = [_Photograph.of(view, color) for view in counted("cutting the subject out", chosen)]
    grid = VoxelGrid.over(box, CELLS)
    solid = _solid(grid, photographs)
    centers = grid.centers()
    whole = centers[torch.from_numpy(solid).flatten()]
    core = centers[torch.from_numpy(ndimage.binary_erosion(solid, np.ones((3, 3, 3)))).flatten()]
    masks = []
    for one in photographs:
        holes = one.like & ~one.reached & ~one.shown(whole, grid.pitch)
        behind = (one.reached & ~one.shown(core, grid.pitch)) | holes
        masks.append(Mask.from_alpha(one.camera, cover(_colors(one.pixels), color, behind)))
    return masks


def cover(
    picture: Float[np.ndarray, "H W 3"], background: Float[np.ndarray, "3"], behind: Bool[np.ndarray, "H W"]
) -> Float[np.ndarray, "H W"]:
    """How much of each pixel the subject covers, in [0, 1]: 0 where ``behind``, and beside that by the pixel's colour
    between the background's and the nearest one that is all subject."""
    edge = ndimage.binary_dilation(behind, AROUND) & ~behind
    inner = ~behind & ~edge
    alpha = (~behind).astype(np.float32)
    if inner.any() and edge.any():
        rows, columns = ndimage.distance_transform_edt(~inner, return_distances=False, return_indices=True)
        subject = picture[rows[edge], columns[edge]] - background
        contrast = (subject**2).sum(-1)
        share = ((picture[edge] - background) * subject).sum(-1) / np.maximum(contrast, LEAST_CONTRAST**2)
        alpha[edge] = np.where(contrast > LEAST_CONTRAST**2, share.clip(0, 1), 1)
    return alpha


def _solid(grid: VoxelGrid, photographs: Sequence[_Photograph]) -> Bool[np.ndarray, "X Y Z"]:
    """Voxels that too few photographs call empty, of those that lie in enough of them."""
    centers = grid.centers()
    seen, outside, holes = torch.zeros(3, len(centers))
    for one in photographs:
        for votes, here in zip((seen, outside, holes), one.at(centers), strict=True):
            votes += here
    solid = (seen >= SEEN_SHARE * len(photographs)) & (outside < (OUTSIDE_VOTES * seen).clamp_min(FEWEST_VOTES))
    solid &= holes < (HOLE_VOTES * seen).clamp_min(FEWEST_VOTES)
    return solid.view(grid.shape).numpy()


def _like(pixels: UInt8[np.ndarray, "H W C"], background: Float[np.ndarray, "3"]) -> Bool[np.ndarray, "H W"]:
    """Which pixels have the background's colour."""
    near: Bool[np.ndarray, "H W"] = np.abs(_colors(pixels) - background).max(-1) <= TOLERANCE
    return near


def _colors(pixels: UInt8[np.ndarray, "H W C"]) -> Float[np.ndarray, "H W 3"]:
    """In [0, 1]."""
    return pixels[..., :3].astype(np.float32) / 255


def _border(pixels: np.ndarray) -> np.ndarray:
    """The outermost pixels, in a row."""
    return np.concatenate([pixels[0], pixels[-1], pixels[1:-1, 0], pixels[1:-1, -1]])
