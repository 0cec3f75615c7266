"""Harmonics fitted to a model's own pictures.

What a Gaussian would show alone is no guide where pixels are lit: the shader sees blended normals and latents, and no
single Gaussian has them. So the harmonics go through the pictures that they are for.
"""

from collections.abc import Sequence

import torch
from torch import nn

from ringlight.color.harmonics import SphericalHarmonics
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import COLUMNS, dense
from ringlight.core.randomness import generator
from ringlight.core.stages import counted
from ringlight.core.want import Want
from ringlight.models.splats import SplatModel
from ringlight.shade.passthrough import PassThrough

RATES = {"sh_dc": 3e-2, "sh_rest": 3e-3}
"""Adam's at the start. On family_24 a third of them has 30.4 dB after 200 of 400 pictures where these have 31.8. Where
harmonics fit already, as those of light per Gaussian, they are worse for the first hundred pictures."""

OPACITIES, OPACITY_RATE = "opacity_logits", 3e-2
"""Where opacities change with the view their mean is only a first guess of what shows one picture."""

LAST_RATE = 0.1
"""At the end, as a share."""

LONGEST_SIDE = 640
"""Pixels: larger pictures are drawn smaller, for harmonics have no detail of their own."""


def with_harmonics(model: SplatModel, gaussians: Gaussians) -> SplatModel:
    """These Gaussians, which emit their harmonics, drawn as the model is."""
    return SplatModel(gaussians, SphericalHarmonics(), PassThrough(), model.rasterize, model.options)


def fitted_to_pictures(
    model: SplatModel, harmonics: Gaussians, cameras: Sequence[Camera], steps: int, opacities: bool = False
) -> Gaussians:
    """The same Gaussians with harmonics that show more of what ``model`` shows from ``cameras``, over white.

    One camera a step, in an order drawn anew for each round. Mean squared differences of display-referred colours;
    nothing but the harmonics moves, and ``opacities`` if they are asked for. The same bits at every call.
    """
    own = Gaussians.from_columns({name: column.clone() for name, column in harmonics.columns().items()})
    baked, white = with_harmonics(model, own), torch.ones(3)
    columns = baked.columns
    assert isinstance(columns, nn.ParameterDict)
    rates = RATES | ({OPACITIES: OPACITY_RATE} if opacities else {})
    groups = [{"params": [columns[name]], "lr": rate} for name, rate in rates.items()]
    optimizer = torch.optim.Adam(groups, eps=1e-15)
    decay = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda step: LAST_RATE ** (step / steps))
    for camera in counted("fitting colours to the model's pictures", _rounds(cameras, steps)):
        wanted = model.render(camera, white).color.clamp(0, 1)
        shown = baked.render(camera, white, Want.GRADIENTS)
        gradients = shown.backward((shown.color - wanted) * (2 / wanted.numel()), {})
        for name in rates:
            columns[name].grad = dense(gradients[COLUMNS + name])
        optimizer.step()
        decay.step()
    moved = {name: columns[name].detach() for name in rates}
    return Gaussians.from_columns(harmonics.columns() | moved)


def _rounds(cameras: Sequence[Camera], steps: int) -> list[Camera]:
    small = [_small(camera) for camera in cameras]
    order = [
        index
        for number in range(-(-steps // len(small)))
        for index in torch.randperm(len(small), generator=generator(0, number, "pictures")).tolist()
    ]
    return [small[index] for index in order[:steps]]


def _small(camera: Camera) -> Camera:
    share = min(1.0, LONGEST_SIDE / max(camera.width, camera.height))
    return camera.resized(*(max(1, round(side * share)) for side in (camera.width, camera.height)))
