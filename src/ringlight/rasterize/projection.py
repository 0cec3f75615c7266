"""3-D Gaussians to ellipses on the image: the executable specification of every back end's projection.

EWA splatting (Zwicker et al. 2001) as 3DGS uses it (Kerbl et al. 2023, section 4), with gsplat's cut-offs.
"""

from dataclasses import dataclass, fields

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.rasterize import convention
from ringlight.rasterize.contract import RasterOptions


@dataclass(frozen=True)
class Projection:
    """N ellipses. ``means2d`` and ``radii`` (half-extents x, y) are in pixels, ``depths`` is camera z in world units.

    ``conics`` are the inverse blurred 2-D covariances (xx, xy, yy) in 1/pixels²; ``opacities`` are what gets
    blended: after the opacity factor and the antialiasing compensation. ``radii`` carry no gradient.
    """

    means2d: Float[Tensor, "N 2"]
    conics: Float[Tensor, "N 3"]
    depths: Float[Tensor, "N"]
    opacities: Float[Tensor, "N"]
    radii: Float[Tensor, "N 2"]

    def rows(self, index: Int[Tensor, "K"] | Bool[Tensor, "N"]) -> "Projection":
        """The chosen ellipses, in the order of ``index``."""
        return Projection(*(getattr(self, field.name)[index] for field in fields(self)))

    def on_image(self, camera: Camera, near: float) -> Bool[Tensor, "N"]:
        """Ellipses to draw: in front of the near plane, visibly opaque, overlapping the image, finite."""
        size = self.means2d.new_tensor([camera.width, camera.height])
        overlaps = (self.means2d + self.radii > 0) & (self.means2d - self.radii < size)
        finite = torch.cat([self.means2d, self.conics, self.radii], 1).isfinite().all(1)
        opaque = (self.opacities >= convention.MIN_ALPHA) & (self.radii > 0).all(1)
        return (self.depths >= near) & opaque & overlaps.all(1) & finite


def project(
    gaussians: Gaussians,
    camera: Camera,
    options: RasterOptions = RasterOptions(),
    opacity_factor: Float[Tensor, "N"] | None = None,
) -> Projection:
    """Project every row, in the dtype of the table; rows that :meth:`Projection.on_image` rejects hold any value."""
    to_camera = camera.world_to_camera.to(gaussians.means)
    points = gaussians.means @ to_camera[:3, :3].T + to_camera[:3, 3]
    depths = points[:, 2]
    focal, center = points.new_tensor(camera.focal), points.new_tensor(camera.center)
    means2d = focal * points[:, :2] / depths[:, None] + center

    axes = to_camera[:3, :3] @ gaussians.rotations * gaussians.scales[:, None, :]
    half_ellipse = _jacobians(points, camera) @ axes
    sharp = half_ellipse @ half_ellipse.mT
    blurred = sharp + options.eps2d * torch.eye(2).to(sharp)
    xx, xy, yy = blurred[:, 0, 0], blurred[:, 0, 1], blurred[:, 1, 1]
    determinants = xx * yy - xy * xy
    conics = torch.stack([yy, -xy, xx], -1) / determinants[:, None]

    opacities = gaussians.opacities if opacity_factor is None else gaussians.opacities * opacity_factor
    if options.antialiased:
        sharp_determinants = sharp[:, 0, 0] * sharp[:, 1, 1] - sharp[:, 0, 1] ** 2
        opacities = opacities * (sharp_determinants / determinants).clamp_min(0).sqrt()
    with torch.no_grad():
        # Where opacity * exp(-sigmas² / 2) falls below MIN_ALPHA, the Gaussian is skipped: nothing lies beyond.
        sigmas = (2 * (opacities / convention.MIN_ALPHA).clamp_min(1).log()).sqrt().clamp_max(convention.MAX_SIGMAS)
        radii = (sigmas[:, None] * torch.stack([xx, yy], -1).sqrt()).ceil()
    return Projection(means2d, conics, depths, opacities, radii)


def _jacobians(points: Float[Tensor, "N 3"], camera: Camera) -> Float[Tensor, "N 2 3"]:
    """Derivative of pixel by camera-space point, taken where x/z and y/z are clamped to just outside the image."""
    depths = points[:, 2]
    slopes = []
    for axis, extent in enumerate((camera.width, camera.height)):
        focal, center = camera.focal[axis], camera.center[axis]
        margin = convention.FRUSTUM_MARGIN * 0.5 * extent / focal
        low, high = -(center / focal + margin), (extent - center) / focal + margin
        slopes.append((points[:, axis] / depths).clamp(low, high))
    focal_x, focal_y = camera.focal
    zero = torch.zeros_like(depths)
    by_x = torch.stack([focal_x / depths, zero, -focal_x * slopes[0] / depths], -1)
    by_y = torch.stack([zero, focal_y / depths, -focal_y * slopes[1] / depths], -1)
    return torch.stack([by_x, by_y], 1)
