"""From the table as stored to what gsplat takes: scales, unit-able quaternions and opacities, safe to project.

Rows that could not be projected in float32 get an opacity of zero, with which gsplat culls them before any of their
numbers is used: what is finite in the table gives a finite image and finite gradients.
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.triton_kernels import runs_triton

WIDEST_PIXELS = 1e9
"""Standard deviation on the image, pixels: its fourth power, which the determinant holds, is still a float32."""

FARTHEST = 1e18
"""World units: a squared distance is still a float32."""

SHORTEST_QUAT_SQUARED = 1e-24
"""A quaternion this short has no direction; it turns nothing and gets no gradient."""


ActiveForm = tuple[Float[Tensor, "N 4"], Float[Tensor, "N 3"], Float[Tensor, "N"]]
"""Quaternions, wxyz, of any length but zero; scales, world units; opacities, factor included."""


def active_form(
    gaussians: Gaussians, camera: Camera, near: float, opacity_factor: Float[Tensor, "N"] | None
) -> ActiveForm:
    """Differentiable in the columns and the factor; by one kernel where Triton serves."""
    geometry = (gaussians.means, gaussians.log_scales, gaussians.quats, gaussians.opacity_logits)
    if not runs_triton(*geometry):
        return active_form_reference(gaussians, camera, near, opacity_factor)
    from ringlight.rasterize.stored_form_triton import activated_by_triton

    plane = camera.world_to_camera[2].to(gaussians.means).contiguous()
    bounds = (near, log_reach(camera), FARTHEST, SHORTEST_QUAT_SQUARED)
    return activated_by_triton(*geometry, opacity_factor, plane, bounds)


def log_reach(camera: Camera) -> float:
    """The logarithm of the widest scale that can be projected at depth one."""
    return math.log(WIDEST_PIXELS / max(camera.focal))


def active_form_reference(
    gaussians: Gaussians, camera: Camera, near: float, opacity_factor: Float[Tensor, "N"] | None
) -> ActiveForm:
    """The same in torch operations, on any device."""
    with torch.no_grad():
        depths = camera.depths(gaussians.means).clamp_min(near)
        widest = log_reach(camera) + depths.log()
        # Written so that what is not a number fails.
        fine = (gaussians.log_scales.amax(1) < widest) & (gaussians.means.abs().amax(1) < FARTHEST)
        turns = gaussians.quats.square().sum(1) > SHORTEST_QUAT_SQUARED
        identity = gaussians.quats.new_zeros(4)
        identity[0] = 1
    opacities = gaussians.opacity_logits.sigmoid()
    if opacity_factor is not None:
        opacities = opacities * opacity_factor
    quats = torch.where(turns[:, None], gaussians.quats, identity)
    scales = torch.where(fine[:, None], gaussians.log_scales, 0).exp()
    return quats, scales, torch.where(fine, opacities, 0)
