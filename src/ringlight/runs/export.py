"""A trained model in the form that other programs open; the suffix of the file says which."""

from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean

import torch
from jaxtyping import Float
from torch import Tensor

import ringlight
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.want import Want
from ringlight.errors import ModelFileError, OutputError
from ringlight.files.bake import bake_to_sh
from ringlight.files.ply import write_gaussian_ply
from ringlight.measure import metrics
from ringlight.methods.store import StoredModel
from ringlight.models.splats import SplatModel
from ringlight.runs.picture_fit import fitted_to_pictures, with_harmonics

SUFFIXES = (".ply",)
"""What can be written."""

HARMONICS = ("sh_dc", "sh_rest")
"""Columns that are spherical harmonics already, as viewers use them."""

MOST_PICTURES = 5
"""Training cameras from which baked colours are checked in pictures: well under a second each."""

FAINTEST_FACTOR = 1e-6
"""Rows whose opacity is multiplied by less are left out: their logit would be infinite."""


@dataclass(frozen=True)
class Exported:
    """What was written. The errors are those of baking a neural colour, None where the colour was exact.

    ``rmse`` is over all Gaussians and the training cameras that see them, display-referred colour in [0, 1], before
    harmonics are fitted to pictures; ``psnr`` is the same in dB, ``worst`` the rmse of the worst Gaussian.
    ``picture_psnr`` compares pictures of what was written with pictures of the model, dB, mean over ``pictures`` of the
    training cameras; ``fitted`` counts the steps of fitting, 0 where it did not help, ``unfitted_picture_psnr`` is that
    before it.
    """

    file: str
    n_gaussians: int
    bytes_file: int
    baked: bool
    cameras: int
    rmse: float | None
    psnr: float | None
    worst: float | None
    pictures: int
    picture_psnr: float | None
    fitted: int
    unfitted_picture_psnr: float | None


def check_target(path: Path, overwrite: bool) -> None:
    """Raises OutputError for a suffix that cannot be written, or a file that exists and may not be replaced."""
    if path.suffix.lower() not in SUFFIXES:
        raise OutputError(f"{path}: cannot be written: unknown kind of model; end its name in {' or '.join(SUFFIXES)}")
    if path.exists() and not overwrite:
        raise OutputError(f"{path}: exists already; give another name, or --overwrite to replace it")


FIT_STEPS = 200
"""Pictures that baked harmonics are fitted to: 8.7 dB on family_24 lit per pixel, where 200 more are worth 0.3."""


def export_ply(stored: StoredModel, path: Path, fit_steps: int = FIT_STEPS) -> Exported:
    """Write the PLY of 3D Gaussian Splatting; harmonics as they are, any other colour baked to degree 3.

    Baked harmonics are fitted to ``fit_steps`` of the model's own pictures, unless that does not help. Rows that the
    model does not show are left out, and opacity factors become part of the opacity. Raises OutputError where the file
    cannot be written, ModelFileError if a neural colour comes without cameras to bake it from.
    """
    model, cameras = stored.model, stored.cameras
    with torch.no_grad():
        gaussians = _folded(model, cameras)
    exact = all(name in gaussians.appearance for name in HARMONICS)
    fitted = 0
    if exact:
        sh_dc, sh_rest = (gaussians.appearance[name] for name in HARMONICS)
        rmse = psnr = worst = picture_psnr = unfitted = None
    elif not cameras:
        raise ModelFileError(f"{path}: cannot be made: the model holds no training cameras; train it again")
    else:
        with torch.no_grad():
            baked = bake_to_sh(gaussians, cameras, model.emitted)
        rmse, psnr, worst = baked.rmse, baked.psnr, baked.worst
        harmonics = replace(gaussians, appearance={"sh_dc": baked.sh_dc, "sh_rest": baked.sh_rest})
        picture_psnr = unfitted = _picture_psnr(model, harmonics, _spread(cameras))
        if fit_steps:
            better = fitted_to_pictures(model, harmonics, cameras, fit_steps)
            psnr_of_better = _picture_psnr(model, better, _spread(cameras))
            if psnr_of_better > unfitted:
                harmonics, picture_psnr, fitted = better, psnr_of_better, fit_steps
        sh_dc, sh_rest = (harmonics.appearance[name] for name in HARMONICS)
    note = f"ringlight {ringlight.__version__}, {stored.header.preset}, {stored.header.scene.name}"
    write_gaussian_ply(path, gaussians, sh_dc, sh_rest, model.options.antialiased, [note])
    return Exported(
        file=str(path),
        n_gaussians=len(gaussians),
        bytes_file=path.stat().st_size,
        baked=not exact,
        cameras=0 if exact else len(cameras),
        rmse=rmse,
        psnr=psnr,
        worst=worst,
        pictures=0 if exact else len(_spread(cameras)),
        picture_psnr=picture_psnr,
        fitted=fitted,
        unfitted_picture_psnr=unfitted,
    )


def _spread(cameras: tuple[Camera, ...]) -> tuple[Camera, ...]:
    """A few of the cameras, evenly spread over their order."""
    count = min(len(cameras), MOST_PICTURES)
    return tuple(cameras[index * len(cameras) // count] for index in range(count))


@torch.no_grad()
def _picture_psnr(model: SplatModel, harmonics: Gaussians, cameras: tuple[Camera, ...]) -> float:
    """Mean PSNR of pictures of the harmonics against pictures of the model, dB, over white."""
    white, baked = torch.ones(3), with_harmonics(model, harmonics)
    pairs = ((baked.render(camera, white).color, model.render(camera, white).color) for camera in cameras)
    return fmean(metrics.psnr(ours.clamp(0, 1), truth.clamp(0, 1)) for ours, truth in pairs)


def _folded(model: SplatModel, cameras: tuple[Camera, ...]) -> Gaussians:
    """The rows that are shown, with their opacity factor, averaged over the cameras, inside the logit."""
    gaussians = model.gaussians
    gaussians = gaussians.rows(model.color.wanted(gaussians))
    factor = _mean_factor(model, gaussians, cameras)
    if factor is None:
        return gaussians
    shown = factor > FAINTEST_FACTOR
    gaussians, factor = gaussians.rows(shown), factor[shown]
    return replace(gaussians, opacity_logits=(gaussians.opacities * factor).clamp(max=1 - FAINTEST_FACTOR).logit())


def _mean_factor(model: SplatModel, gaussians: Gaussians, cameras: tuple[Camera, ...]) -> Float[Tensor, "N"] | None:
    found = (model.color.emit(gaussians, camera, ("rgb",), Want.EXACT).opacity_factor for camera in cameras)
    total = torch.zeros(len(gaussians))
    for factor in found:
        # A model that has no factor for one camera has none for any.
        if factor is None:
            return None
        total += factor
    return total / len(cameras) if cameras else None
