"""What each Gaussian's removal would change in the photographs' pictures: a measure of what may be dropped."""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.randomness import generator
from ringlight.models.splats import SplatModel


def removal_effects(
    model: SplatModel, cameras: Sequence[Camera], background: Float[Tensor, "3"], seed: int, step: int
) -> Float[Tensor, "N"]:
    """Each row's squared change of all colours if it alone were gone, summed over all ``cameras``; an estimate.

    A pixel's colour C is linear in one Gaussian's alpha there, so that without it C changes by alpha dC/dalpha. The
    square is summed by the trace estimator of Hutchinson ("A stochastic estimator of the trace of the influence matrix
    for Laplacian smoothing splines", Communications in Statistics, 1990), one draw a picture: with signs +1 and -1
    drawn for each pixel and colour, the picture's gradient along them is a sum of changes with these signs, and the
    mean of its square is the sum of their squares. A row's deviation is at most sqrt(2) of its effect, where one
    picture shows it, and sqrt(2 / n) where n pictures change alike. Where a shader adds light the picture's gradient
    stands for the change. What a clamped alpha adds is left out.
    """
    total = torch.zeros(len(model), device=model.device)
    for index, camera in enumerate(cameras):
        picture = torch.empty(camera.height, camera.width, 3, device=model.device)
        signs = drawn_signs(picture, generator(seed, step, f"removal effects {index}"))
        total += model.by_opacity(camera, background, signs).square()
    return total


def drawn_signs(like: Float[Tensor, "*shape"], drawn: torch.Generator) -> Float[Tensor, "*shape"]:
    """+1 or -1 with equal chances."""
    return torch.randint(0, 2, like.shape, generator=drawn, device="cpu").to(like) * 2 - 1
