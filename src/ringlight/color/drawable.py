"""Which Gaussians a rasterizer could draw, so that a costly colour is evaluated for those only."""

import math

import torch
from jaxtyping import Bool, Int32
from torch import Tensor

from ringlight import _kernels
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.triton_kernels import runs_triton

# Standard deviations beyond which no rasterizer draws: more than the 3.33 that all of ours cut at.
REACH_SIGMAS = 3.5
# Pixels beyond the Gaussian's own reach, for the low-pass filter: 3.33 sqrt(0.3) is 1.8.
REACH_PIXELS = 4.0
# Rasterizers clamp x/z and y/z to 1.3 times the half field of view in the affine approximation; 1.5 bounds it.
SLOPE_MARGIN = 1.5


# Logit of the opacity 1/256: every rasterizer skips what is weaker than 1/255, a step of an 8-bit picture.
FAINTEST_LOGIT = math.log(1 / 255)


@torch.no_grad()
def drawable_rows(gaussians: Gaussians, camera: Camera) -> Int32[Tensor, "V"]:
    """Numbers of the rows that :func:`drawable` marks, ascending; by kernels for float32 on the CPU and on a GPU."""
    columns = (gaussians.means, gaussians.log_scales, gaussians.opacity_logits)
    if runs_triton(*columns):
        from ringlight.color.drawable_triton import drawable_by_triton

        return drawable_by_triton(*columns, view_numbers(camera)).nonzero()[:, 0].int()
    if any(column.dtype != torch.float32 or column.device.type != "cpu" for column in columns):
        return drawable(gaussians, camera).nonzero()[:, 0].int()
    rows = torch.empty(len(gaussians), dtype=torch.int32)
    means, log_scales, opacity_logits = (column.detach().contiguous() for column in columns)
    found = _kernels.drawable_rows(
        means,
        log_scales,
        opacity_logits,
        camera.native,
        rows,
        reach_sigmas=REACH_SIGMAS,
        reach_pixels=REACH_PIXELS,
        slope_margin=SLOPE_MARGIN,
        faintest_logit=FAINTEST_LOGIT,
    )
    return rows[:found]


def view_numbers(camera: Camera) -> list[float]:
    """What Triton's kernel is told of a camera."""
    half = (camera.width / 2, camera.height / 2)
    (fx, fy), (cx, cy) = camera.focal, camera.center
    steepest = [SLOPE_MARGIN * max(cx, camera.width - cx) / fx, SLOPE_MARGIN * max(cy, camera.height - cy) / fy]
    middle = [cx - half[0], cy - half[1]]
    return [*camera.pose_numbers, fx, fy, *half, *middle, *steepest, REACH_SIGMAS, REACH_PIXELS, FAINTEST_LOGIT]


@torch.no_grad()
def drawable(gaussians: Gaussians, camera: Camera) -> Bool[Tensor, "N"]:
    """False only for rows off the image, behind the camera, or too faint, whatever their orientation.

    The reference of :func:`drawable_rows`. The projected standard deviation is at most the largest scale times the
    Frobenius norm of the projection's Jacobian. Rows with a non-finite centre are False.
    """
    matrix = camera.world_to_camera.to(gaussians.means)
    x, y, z = torch.addmm(matrix[:3, 3], gaussians.means, matrix[:3, :3].T).unbind(-1)
    inverse = 1 / z
    slope_x, slope_y = x * inverse, y * inverse
    (fx, fy), (cx, cy) = camera.focal, camera.center
    steepest_x = SLOPE_MARGIN * max(cx, camera.width - cx) / fx
    steepest_y = SLOPE_MARGIN * max(cy, camera.height - cy) / fy
    clamped_x = slope_x.clamp(-steepest_x, steepest_x)
    clamped_y = slope_y.clamp(-steepest_y, steepest_y)
    jacobian = inverse * (fx * fx * (1 + clamped_x * clamped_x) + fy * fy * (1 + clamped_y * clamped_y)).sqrt()
    reach = REACH_SIGMAS * gaussians.log_scales.amax(-1).exp() * jacobian + REACH_PIXELS
    off_x = (fx * slope_x + cx - camera.width / 2).abs() - camera.width / 2
    off_y = (fy * slope_y + cy - camera.height / 2).abs() - camera.height / 2
    strong = gaussians.opacity_logits >= FAINTEST_LOGIT
    return strong & (z > 0) & (off_x <= reach) & (off_y <= reach)
