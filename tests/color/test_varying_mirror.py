"""A mirror's base colours that change with the view: values and gradients against torch's, and what they start as."""

import pytest
import torch
from torch import Tensor

from ringlight.color.basis_opacities import factors_reference
from ringlight.color.mirror import Mirror
from ringlight.color.varying_mirror import VaryingMirror, varying_channels_reference
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import Gradients, dense
from ringlight.core.scene import PointCloud
from ringlight.core.want import Want
from ringlight.errors import RecipeError
from ringlight.models.initial import gaussians_from_points
from torch_graph import channels

CAMERA = Camera(torch.eye(4), (30.0, 30.0), (12.5, 8.5), 24, 16)
ALL = ("rgb", "normal", "latents", "depth")


def drawn(count: int = 60, size: int = 3, opacities: bool = False) -> tuple[VaryingMirror, Gaussians]:
    """Rows before the camera whose weights are large: some sums are below black, some above white."""
    random = torch.Generator().manual_seed(count)
    positions = torch.randn(count, 3, generator=random) + torch.tensor([0.0, 0.0, 6.0])
    color = VaryingMirror(4, size, seed=1, opacities=opacities)
    gaussians = gaussians_from_points(PointCloud(positions, torch.rand(count, 3, generator=random)), color)
    gaussians.appearance["basis_weights"].copy_(torch.randn(count, size, generator=random))
    return color, gaussians


@pytest.mark.parametrize("degree", [0, 1, 3])
@pytest.mark.parametrize("names", [("rgb",), ALL])
def test_equals_the_reference_in_value_and_gradient(degree: int, names: tuple[str, ...]):
    color, gaussians = drawn()
    color.varying.active_degree.fill_(degree)
    doubles = {name: column.double().requires_grad_() for name, column in gaussians.columns().items()}
    basis = color.varying.basis.detach().double().requires_grad_()
    expected = varying_channels_reference(doubles, basis, CAMERA, degree)
    leaves = {name: column.clone().requires_grad_() for name, column in gaussians.columns().items()}
    found = channels(color, Gaussians.from_columns(leaves), CAMERA, names)
    upstream = {name: torch.randn(found[name].shape, generator=torch.Generator().manual_seed(1)) for name in names}
    for name in names:
        torch.testing.assert_close(found[name].double(), expected[name], rtol=1e-5, atol=1e-5)
    torch.autograd.backward([found[name] for name in names], [upstream[name] for name in names])
    torch.autograd.backward([expected[name] for name in names], [upstream[name].double() for name in names])
    grads = {name: leaf.grad for name, leaf in leaves.items()} | {"basis": color.varying.basis.grad}
    wanted: dict[str, Tensor | None] = {name: leaf.grad for name, leaf in doubles.items()} | {"basis": basis.grad}
    for name in ("means", "base", "basis_weights", "basis", *(("normals", "latents") if len(names) > 1 else ())):
        want = wanted[name]
        if want is None:
            assert grads[name] is None or not grads[name].any()
            continue
        largest = want.abs().max().item()
        torch.testing.assert_close(grads[name].double(), want, rtol=1e-4, atol=1e-5 * max(largest, 1), msg=name)


def found_by(color: VaryingMirror, table: Gaussians, names: tuple[str, ...], upstream: Tensor) -> dict[str, Tensor]:
    emission, into = color.emit(table, CAMERA, names, Want.GRADIENTS), Gradients()
    assert emission.opacity_factor is not None
    width = emission.channels.shape[1]
    by_channels, by_factors = upstream[:, :width].contiguous(), upstream[:, -1].contiguous()
    emission.backward(by_channels.to(table.means), by_factors.to(table.means), into)
    found = {name: dense(gradient) for name, gradient in into.items()}
    return found | {"channels": emission.channels, "factor": emission.opacity_factor}


@pytest.mark.parametrize("degree", [1, 3])
@pytest.mark.parametrize("names", [("rgb",), ALL])
def test_opacities_that_change_with_the_view_equal_the_reference(degree: int, names: tuple[str, ...]):
    upstream = torch.randn(60, 12, generator=torch.Generator().manual_seed(2))
    color, table = drawn(opacities=True)
    color.varying.active_degree.fill_(degree)
    native = found_by(color, table, names, upstream)
    doubles = Gaussians.from_columns({name: column.double() for name, column in table.columns().items()})
    exact = found_by(color.double(), doubles, names, upstream)
    assert native.keys() == exact.keys() >= {"columns.opacity_logits", "color.varying.opacity_basis"}
    for name, found in native.items():
        largest = float(exact[name].abs().max())
        torch.testing.assert_close(found.double(), exact[name], rtol=0, atol=2e-5 * max(largest, 1), msg=name)
    logits, weights = doubles.opacity_logits, doubles.appearance["basis_weights"]
    factor = factors_reference(doubles.means, logits, weights, color.varying.opacity_basis, CAMERA.position, degree)
    torch.testing.assert_close(exact["factor"], factor.detach())


def test_opacities_are_constant_until_harmonics_are_shown():
    color, table = drawn(opacities=True)
    color.varying.active_degree.fill_(0)
    assert color.emit(table, CAMERA, ALL, Want.EXACT).opacity_factor is None
    color.varying.active_degree.fill_(1)
    assert color.emit(table, CAMERA, ALL, Want.EXACT).opacity_factor is not None


@pytest.mark.parametrize("want", Want)
def test_colours_start_as_a_mirror_s(want: Want):
    points = PointCloud(torch.randn(30, 3) + torch.tensor([0.0, 0.0, 5.0]), torch.rand(30, 3))
    plain, varying = Mirror(4, seed=2), VaryingMirror(4, 8, seed=2)
    first, second = (color.emit(gaussians_from_points(points, color), CAMERA, ALL, want) for color in (plain, varying))
    assert first.widths == second.widths
    torch.testing.assert_close(first.channels, second.channels, rtol=0, atol=1e-6)


def test_a_colour_below_black_is_black_and_moves_no_base_colour():
    color, gaussians = drawn()
    leaves = {name: column.clone().requires_grad_() for name, column in gaussians.columns().items()}
    rgb = channels(color, Gaussians.from_columns(leaves), CAMERA, ("rgb",))["rgb"]
    black = rgb == 0
    assert black.any(), "else this tests nothing"
    rgb.sum().backward()
    grad = leaves["base"].grad
    assert grad is not None
    assert not grad[black].any()
    assert grad[~black].all()


def test_the_base_layer_has_no_view():
    color, gaussians = drawn()
    assert torch.equal(color.layers(gaussians, CAMERA)["base"], gaussians.appearance["base"].sigmoid())


@pytest.mark.parametrize("size", [0, 17])
def test_sizes_that_no_kernel_takes_are_refused(size: int):
    with pytest.raises(RecipeError, match="basis_size"):
        VaryingMirror(4, size)
