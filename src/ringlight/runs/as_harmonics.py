"""A model's Gaussians with harmonics for colours: exact ones where it has them, else baked and fitted to pictures."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import fmean

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.want import Want
from ringlight.files.bake import bake_to_sh
from ringlight.measure import metrics
from ringlight.models.splats import SplatModel
from ringlight.runs.picture_fit import fitted_to_pictures, with_harmonics

MOST_PICTURES = 5
"""Training cameras from which baked colours are checked in pictures: well under a second each."""

FAINTEST_FACTOR = 1e-6
"""Rows whose opacity is multiplied by less are left out: their logit would be infinite."""


def _camera_at(z: float) -> Camera:
    pose = torch.eye(4)
    pose[2, 3] = -z
    return Camera(pose, (1.0, 1.0), (0.5, 0.5), 1, 1)


OPPOSITE = (_camera_at(-1.0), _camera_at(1.0))
"""Asked where a file brings fewer than two cameras: an opacity that depends on the direction differs between them."""


@dataclass(frozen=True)
class BakingLoss:
    """What fitted harmonics miss.

    ``rmse`` is over all Gaussians and the ``cameras`` that see them, display-referred colour in [0, 1], before
    harmonics are fitted to pictures; ``psnr`` is the same in dB, ``worst`` the rmse of the worst Gaussian.
    ``picture_psnr`` compares pictures of the harmonics with pictures of the model, dB, mean over ``pictures`` of the
    cameras; ``fitted`` counts the steps of fitting, 0 where it did not help, ``unfitted_picture_psnr`` is that before.
    ``opacities_vary`` with the view in the model, and do not in the file.
    """

    cameras: int
    rmse: float
    psnr: float
    worst: float
    pictures: int
    picture_psnr: float
    fitted: int
    unfitted_picture_psnr: float
    opacities_vary: bool


@torch.no_grad()
def exact_harmonics(model: SplatModel, cameras: Sequence[Camera]) -> Gaussians | None:
    """The Gaussians that are shown, with columns "sh_dc" and "sh_rest"; None where their colours are no
    harmonics, or their opacity depends on the camera."""
    gaussians, is_exact = shown(model, cameras)
    harmonics = model.harmonics(gaussians) if is_exact else None
    return None if harmonics is None else replace(gaussians, appearance=dict(vars(harmonics)))


def fitted_harmonics(model: SplatModel, cameras: Sequence[Camera], fit_steps: int) -> tuple[Gaussians, BakingLoss]:
    """The same of any model: harmonics of degree 3 of what each Gaussian shows to the ``cameras``, at least one, then
    fitted to ``fit_steps`` of the model's own pictures unless that does not help, with their opacities where these
    depend on the camera."""
    gaussians, is_same = shown(model, cameras)
    with torch.no_grad():
        baked = bake_to_sh(gaussians, cameras, model.emitted)
    harmonics = replace(gaussians, appearance={"sh_dc": baked.sh_dc, "sh_rest": baked.sh_rest})
    spread = _spread(cameras)
    picture_psnr = unfitted = _picture_psnr(model, harmonics, spread)
    fitted = 0
    if fit_steps:
        better = fitted_to_pictures(model, harmonics, cameras, fit_steps, opacities=not is_same)
        psnr_of_better = _picture_psnr(model, better, spread)
        if psnr_of_better > unfitted:
            harmonics, picture_psnr, fitted = better, psnr_of_better, fit_steps
    of_colors = (len(cameras), baked.rmse, baked.psnr, baked.worst)
    return harmonics, BakingLoss(*of_colors, len(spread), picture_psnr, fitted, unfitted, opacities_vary=not is_same)


@torch.no_grad()
def shown(model: SplatModel, cameras: Sequence[Camera]) -> tuple[Gaussians, bool]:
    """The rows that are shown, with their opacity factor, averaged over the cameras, inside the logit; and whether it
    is the same for all cameras."""
    gaussians = model.gaussians
    gaussians = gaussians.rows(model.color.wanted(gaussians))
    factor, is_exact = _mean_factor(model, gaussians, cameras or OPPOSITE)
    if len(cameras) == 1 and is_exact:
        is_exact = _mean_factor(model, gaussians, OPPOSITE)[1]
    if factor is None:
        return gaussians, True
    kept = factor > FAINTEST_FACTOR
    gaussians, factor = gaussians.rows(kept), factor[kept]
    logits = (gaussians.opacities * factor).clamp(max=1 - FAINTEST_FACTOR).logit()
    return replace(gaussians, opacity_logits=logits), is_exact


def _mean_factor(
    model: SplatModel, gaussians: Gaussians, cameras: Sequence[Camera]
) -> tuple[Float[Tensor, "N"] | None, bool]:
    total, first, is_same = torch.zeros(len(gaussians)), None, True
    for camera in cameras:
        factor = model.color.emit(gaussians, camera, ("rgb",), Want.EXACT).opacity_factor
        # A model that has no factor for one camera has none for any.
        if factor is None:
            return None, True
        first = factor if first is None else first
        is_same = is_same and torch.equal(factor, first)
        total += factor
    return total / len(cameras), is_same


def _spread(cameras: Sequence[Camera]) -> tuple[Camera, ...]:
    """A few of the cameras, evenly spread over their order."""
    count = min(len(cameras), MOST_PICTURES)
    return tuple(cameras[index * len(cameras) // count] for index in range(count))


@torch.no_grad()
def _picture_psnr(model: SplatModel, harmonics: Gaussians, cameras: Sequence[Camera]) -> float:
    """Mean PSNR of pictures of the harmonics against pictures of the model, dB, over white."""
    white, baked = torch.ones(3), with_harmonics(model, harmonics)
    pairs = ((baked.render(camera, white).color, model.render(camera, white).color) for camera in cameras)
    return fmean(metrics.psnr(ours.clamp(0, 1), truth.clamp(0, 1)) for ours, truth in pairs)
