"""The kernels' gradients against finite differences of the float64 specification: no autograd on the other side."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from contracts.raster_cases import Case, random_case, random_cotangents
from ringlight.core.camera import Camera
from ringlight.core.gaussians import GEOMETRY, Gaussians
from ringlight.rasterize.contract import Rasterizer, RasterOptions
from ringlight.rasterize.reference import ReferenceRasterizer
from torch_graph import drawn

cpu = pytest.importorskip("ringlight.rasterize.cpu", reason="needs the compiled module")

Inputs = dict[str, Tensor]
Loss = Callable[[Rasterizer, Inputs], Tensor]

STEP = 1e-6  # of a central difference in float64: its error is some 1e-10
# Of a column's largest gradient: float32 rounds at 6e-8, and a pixel blends up to eighty alphas of 3e-6.
TOLERANCE = 1e-4


def inputs_of(case: Case) -> Inputs:
    """What the gradients are taken by; depth, the last channel, follows from the means."""
    inputs = {name: case.gaussians.columns()[name] for name in GEOMETRY} | {"channels": case.channels}
    return inputs if case.opacity_factor is None else inputs | {"opacity_factor": case.opacity_factor}


def loss_of(case: Case) -> Loss:
    """A random linear form of image, depth and alpha, zero at pixels where a threshold is near."""
    depths = torch.zeros(len(case.channels), 1)
    with_depth = replace(
        case, channels=torch.cat([case.channels, depths], 1), background=torch.cat([case.background, torch.zeros(1)])
    )
    grad_image, grad_alpha = random_cotangents(with_depth, 0)

    def loss(rasterizer: Rasterizer, inputs: Inputs) -> Tensor:
        means = inputs["means"]
        depths = case.camera.depths(means)[:, None]
        raster = drawn(
            rasterizer, Gaussians(*(inputs[name] for name in GEOMETRY)),
            torch.cat([inputs["channels"], depths], 1), case.camera,
            with_depth.background.to(means), case.options, inputs.get("opacity_factor"),
        )  # fmt: skip
        return (raster.image * grad_image.to(means)).sum() + (raster.alpha * grad_alpha.to(means)).sum()

    return loss


def kernels_gradients(case: Case, loss: Loss) -> Inputs:
    leaves = {name: tensor.clone().requires_grad_() for name, tensor in inputs_of(case).items()}
    loss(cpu.CpuRasterizer(), leaves).backward()
    return {name: leaf.grad.double() for name, leaf in leaves.items()}


@torch.no_grad()
def difference(loss: Loss, inputs: Inputs, name: str, direction: Tensor) -> float:
    """Central difference of the float64 reference along ``direction`` in one column."""
    ends = [loss(ReferenceRasterizer(), inputs | {name: inputs[name] + s * STEP * direction}) for s in (1, -1)]
    return ((ends[0] - ends[1]) / (2 * STEP)).item()


def coordinates(like: Tensor) -> Iterator[tuple[tuple[int, ...], Tensor]]:
    for index in torch.cartesian_prod(*(torch.arange(size) for size in like.shape)).reshape(-1, like.dim()).tolist():
        direction = torch.zeros_like(like)
        direction[tuple(index)] = 1
        yield tuple(index), direction


def overlapping_case(antialiased: bool, channels: int) -> Case:
    """Seven Gaussians on 14 x 11 pixels, from needles to discs, faint to opaque."""
    generator = torch.Generator().manual_seed(channels)
    draw = lambda *shape: torch.randn(*shape, generator=generator)  # noqa: E731
    means = draw(7, 3) * 0.4
    means[:, 2] = torch.linspace(2, 5, 7)
    table = Gaussians(means, draw(7, 3) * 0.8 - 1.2, draw(7, 4), 1.5 * draw(7))
    camera = Camera(torch.eye(4), (13.0, 15.0), (7.4, 5.1), 14, 11)
    factor = 0.3 + 0.7 * torch.rand(7, generator=generator)
    return Case(table, draw(7, channels), camera, draw(channels), RasterOptions(antialiased=antialiased), factor)


@pytest.mark.parametrize("antialiased", [False, True])
@pytest.mark.parametrize("channels", [1, 3])
def test_every_single_derivative(antialiased: bool, channels: int):
    case = overlapping_case(antialiased, channels)
    loss, exact = loss_of(case), inputs_of(case.to(torch.float64))
    for name, gradient in kernels_gradients(case, loss).items():
        largest = gradient.abs().max().item()
        assert largest > 0
        for index, direction in coordinates(exact[name]):
            expected = difference(loss, exact, name, direction)
            assert abs(gradient[index].item() - expected) < TOLERANCE * largest, f"{name}[{index}]"


@pytest.mark.parametrize("antialiased", [False, True])
@pytest.mark.parametrize("with_factor", [False, True])
@pytest.mark.parametrize("channels", [2, 3, 7, 15, 20])
def test_derivatives_along_random_directions(antialiased: bool, with_factor: bool, channels: int):
    """A crowd with Gaussians behind and beside the camera; four directions in each column."""
    case = random_case(100 + channels, 80, channels, (45, 35), antialiased, with_factor)
    loss, exact = loss_of(case), inputs_of(case.to(torch.float64))
    generator = torch.Generator().manual_seed(1)
    for name, gradient in kernels_gradients(case, loss).items():
        for _ in range(4):
            direction = torch.randn(gradient.shape, generator=generator).double()
            expected = difference(loss, exact, name, direction)
            assert abs((gradient * direction).sum().item() - expected) < TOLERANCE * gradient.norm().item(), name
