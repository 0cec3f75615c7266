"""The measures of a model on held-out views: every image, their means, and the pooled PSNR."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from statistics import fmean
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera, picture_sizes
from ringlight.core.rendering import Rendering
from ringlight.core.scene import View
from ringlight.errors import FallbackWarning, SceneError
from ringlight.measure import metrics
from ringlight.measure.lpips import SMALLEST, Lpips, Net, weights_damaged, weights_fault, weights_path, weights_status
from ringlight.measure.report import ImageScore

Distance = Callable[..., float]
Keep = Callable[[View, Float[Tensor, "H W 3"], Float[Tensor, "H W 3"]], None]

NO_VIEWS = "no test views to measure on; load the scene with a split that holds some out"


@dataclass(frozen=True, kw_only=True)
class Scores:
    """Means over the test views, field by field those of a ``Report``: ``Report(**vars(scores), ...)``."""

    resolution: str
    psnr: float | None
    psnr_u8: float | None
    psnr_pooled: float | None
    ssim_same: float | None
    ssim_valid: float | None
    lpips_alex: float | None
    lpips_vgg: float | None
    lpips_vgg_01: float | None
    lpips_note: str
    images: tuple[ImageScore, ...]


def evaluate(
    render: Callable[[Camera], Rendering],
    views: Sequence[View],
    background: Float[Tensor, "3"],
    *,
    lpips_nets: Sequence[Net] = ("alex",),
    keep_images: Keep | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Scores:
    """Render every view once, without gradients, and compare it with its photograph.

    Renders are clamped to [0, 1]. ``keep_images`` gets each view with its render and truth, [H W 3] on the CPU.
    ``progress`` gets (views done, views in all). A LPIPS net without weights leaves its field None and its remedy in
    ``lpips_note``; damaged ones are warned of besides.

    Raises:
        SceneError: there are no views.
    """
    if not views:
        raise SceneError(NO_VIEWS)
    nets, note = _available_nets(lpips_nets, views)
    images, squared_errors = [], []
    for done, view in enumerate(views, 1):
        with torch.no_grad():
            image = render(view.camera).color.detach().cpu().float().clamp(0, 1)
            truth = view.image(background).permute(1, 2, 0)
            images.append(_score(view.name, image, truth, nets))
            squared_errors.append(metrics.mean_squared_error(image, truth))
        if keep_images is not None:
            keep_images(view, image, truth)
        if progress is not None:
            progress(done, len(views))
    size = picture_sizes([view.camera for view in views], "..")
    return _means(tuple(images), metrics.psnr_pooled(squared_errors), size, note)


def scores_without_views(training: Sequence[View]) -> Scores:
    """Of a scene that holds no view out: nothing is measured."""
    unmeasured = {field.name: None for field in fields(ImageScore)[1:]}
    size = picture_sizes([view.camera for view in training], "..")
    return Scores(resolution=size, psnr_pooled=None, lpips_note="", images=(), **unmeasured)


def mean_psnr(
    render: Callable[[Camera], Rendering],
    views: Sequence[View],
    background: Float[Tensor, "3"],
    progress: Callable[[int, int], None] | None = None,
) -> float:
    """Of these views, dB, as the field ``psnr`` of a report; ``progress`` as for :func:`evaluate`.

    Raises:
        SceneError: there are no views, or a photograph cannot be read.
    """
    if not views:
        raise SceneError(NO_VIEWS)
    values = []
    for done, view in enumerate(views, 1):
        with torch.no_grad():
            image = render(view.camera).color.detach().cpu().float()
            values.append(metrics.psnr(image, view.image(background).permute(1, 2, 0)))
        if progress is not None:
            progress(done, len(views))
    return fmean(values)


def _score(
    name: str, image: Float[Tensor, "H W 3"], truth: Float[Tensor, "H W 3"], nets: Mapping[Net, Distance]
) -> ImageScore:
    same, valid = metrics.ssim_same_and_valid(image, truth)
    distances = {f"lpips_{net}": distance(image, truth) for net, distance in nets.items()}
    if "vgg" in nets:
        distances["lpips_vgg_01"] = nets["vgg"](image, truth, rescale=False)
    psnr, rounded = metrics.psnr(image, truth), metrics.psnr_u8(image, truth)
    return ImageScore(name, psnr, rounded, same, valid, **distances)


def _available_nets(wanted: Sequence[Net], views: Sequence[View]) -> tuple[dict[Net, Distance], str]:
    """The nets that can be used on this machine and these views, and the reason and remedy for the others."""
    for net in wanted:
        if weights_status(net) == weights_damaged(net):
            told = f"{weights_path(net)}: {weights_fault(net)}; LPIPS with {net} is left out, "
            warnings.warn(f"{told}get its weights again with 'ringlight fetch-lpips'", FallbackWarning, stacklevel=3)
    smallest = min(min(view.camera.width, view.camera.height) for view in views)
    reasons = {net: weights_status(net) or _too_small(net, smallest) for net in wanted}
    return {net: Lpips(net) for net in wanted if not reasons[net]}, " ".join(filter(None, reasons.values()))


def _too_small(net: Net, side: int) -> str:
    if side >= SMALLEST[net]:
        return ""
    return f"LPIPS with {net} is unavailable: it needs images of {SMALLEST[net]} pixels a side, these have {side}."


def _means(images: tuple[ImageScore, ...], pooled: float, size: str, note: str) -> Scores:
    means: dict[str, Any] = {}
    for field in fields(ImageScore)[1:]:  # all but the name
        values = [getattr(image, field.name) for image in images]
        means[field.name] = None if None in values else fmean(values)
    return Scores(resolution=size, psnr_pooled=pooled, lpips_note=note, images=images, **means)
