"""Speed of the photometric loss, value and gradient: our kernel beside its slow reference, in turns."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight import _kernels
from ringlight.bench.record import Circumstances
from ringlight.bench.timing import SHORTEST_MS, Budget, Contestant, Timing, interleaved
from ringlight.core.randomness import generator
from ringlight.errors import RecipeError
from ringlight.fit.losses.photometric_gradient import Target, photometric_gradient, photometric_reference
from ringlight.fit.photometric import PhotometricLoss

MOST_PIXELS = 8192
"""On a side."""

KERNEL, STEP, REFERENCE = "kernel", "step", "reference"


@dataclass(frozen=True)
class LossRow:
    """One square image of three channels. ``kernel`` is the compiled function alone, ``step`` what training calls;
    ``reference`` the same in torch, written to be read, which blurs the photograph as well: no measure of the best that
    torch can do. Ratios are the reference's time over the step's."""

    pixels: int
    kernel: Timing
    step: Timing
    reference: Timing
    wall_ratio: float
    cpu_ratio: float
    largest_difference: float
    """Between the gradients, as a share of the largest."""


@dataclass(frozen=True)
class LossBench:
    """What ``ringlight bench loss`` measured."""

    circumstances: Circumstances
    rows: tuple[LossRow, ...]


def bench_loss(sizes: Sequence[int], budget: Budget, seed: int = 0) -> tuple[LossRow, ...]:
    """Time images of these many pixels on a side. Raises RecipeError for a size out of range."""
    wrong = [pixels for pixels in sizes if not 1 <= pixels <= MOST_PIXELS]
    if wrong:
        raise RecipeError(f"an image of {wrong[0]} pixels a side cannot be compared; give 1 to {MOST_PIXELS}")
    return tuple(_row(pixels, budget, seed) for pixels in sizes)


class LossKernel:
    """Value and gradient of the photometric loss of one image; ``gradient`` is overwritten each time."""

    def __init__(
        self,
        image: Float[Tensor, "3 H W"],
        target: Target,
        settings: PhotometricLoss,
    ):
        _, height, width = image.shape
        self.gradient = torch.empty_like(image)
        workspace = image.new_empty(_kernels.photometric_workspace(height, width, _kernels.threads()))
        weights = (settings.scale * (1 - settings.ssim_weight), settings.scale * settings.ssim_weight)
        blurs = (target.blur, target.square_blur)
        self._arguments = (image, target.image, *blurs, self.gradient, workspace, *weights, settings.pixel == "l2")

    def run(self) -> float:
        return _kernels.photometric(*self._arguments)


class _Compared:
    """A rendering and its photograph, and the gradient that each way leaves."""

    def __init__(self, pixels: int, seed: int):
        draw = generator(seed, pixels, "loss")
        self.image = torch.rand(3, pixels, pixels, generator=draw)
        self.target = Target((self.image + 0.1 * torch.randn(3, pixels, pixels, generator=draw)).clamp(0, 1))
        self.settings = PhotometricLoss()

    def step(self) -> Float[Tensor, "3 H W"]:
        return photometric_gradient(self.image.permute(1, 2, 0), self.target, self.settings)[1].permute(2, 0, 1)

    def reference(self) -> Float[Tensor, "3 H W"]:
        leaf = self.image.detach().requires_grad_()
        value = photometric_reference(leaf, self.target.image, self.settings)
        return torch.autograd.grad(value, leaf)[0]


def _row(pixels: int, budget: Budget, seed: int) -> LossRow:
    compared = _Compared(pixels, seed)
    kernel = LossKernel(compared.image, compared.target, compared.settings)
    stages = {KERNEL: kernel.run, STEP: compared.step, REFERENCE: compared.reference}
    timings = interleaved({name: Contestant({name: stage}) for name, stage in stages.items()}, budget)
    ours, theirs = timings[STEP][STEP], timings[REFERENCE][REFERENCE]
    expected = compared.reference()
    return LossRow(
        pixels=pixels,
        kernel=timings[KERNEL][KERNEL],
        step=ours,
        reference=theirs,
        wall_ratio=theirs.wall_ms / max(ours.wall_ms, SHORTEST_MS),
        cpu_ratio=theirs.cpu_ms / max(ours.cpu_ms, SHORTEST_MS),
        largest_difference=float((compared.step() - expected).abs().max() / expected.abs().max()),
    )
