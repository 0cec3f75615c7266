"""Spherical-harmonic colour: the native kernels equal the torch reference, and that its finite differences."""

import pytest
import torch
from torch import Tensor

from ringlight.color import harmonics
from ringlight.color.contract import ColorModel
from ringlight.color.harmonics import RestGradient, SphericalHarmonics, sh_colors_reference
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import Gradients, dense
from ringlight.core.scene import PointCloud
from ringlight.core.want import Want
from ringlight.fit.adam import Update, adam_
from torch_graph import channels

DEGREES = (0, 1, 2, 3)
# One full block of 16 lanes, a tail, less than a block, several pieces for several threads, nothing.
COUNTS = (16, 37, 3, 2500, 0)


@pytest.fixture
def kernels():
    return pytest.importorskip("ringlight._kernels", reason="needs the compiled module")


def random_table(count: int, dtype: torch.dtype = torch.float32, stored: int = 15) -> Gaussians:
    generator = torch.Generator().manual_seed(count)
    draw = lambda *shape: torch.randn(*shape, generator=generator, dtype=torch.float64).to(dtype)  # noqa: E731
    # Coefficients of order one clamp about a third of the colours at black.
    appearance = {"sh_dc": draw(count, 3), "sh_rest": 0.5 * draw(count, stored, 3)}
    return Gaussians(2 * draw(count, 3), draw(count, 3), draw(count, 4), draw(count), appearance)


def camera_at(position: Tensor) -> Camera:
    matrix = torch.eye(4)
    matrix[:3, 3] = -position
    return Camera(matrix, (100.0, 100.0), (50.0, 50.0), 100, 100)


CAMERA = camera_at(torch.tensor([0.3, -1.2, 0.7]))


def colors_and_gradients(table: Gaussians, camera: Camera, degree: int, upstream: Tensor) -> list[Tensor]:
    """Colours, and gradients to means, dc and rest, by whatever path the dtype chooses."""
    leaves = [
        leaf.detach().clone().requires_grad_()
        for leaf in (table.means, table.appearance["sh_dc"], table.appearance["sh_rest"])
    ]
    means, dc, rest = leaves
    moved = Gaussians(means, table.log_scales, table.quats, table.opacity_logits, {"sh_dc": dc, "sh_rest": rest})
    rgb = channels(SphericalHarmonics(degree), moved, camera)["rgb"]
    rgb.backward(upstream)
    # At degree 0 the reference does not touch all columns; the native kernel writes zeros.
    return [rgb.detach(), *(torch.zeros_like(leaf) if leaf.grad is None else leaf.grad for leaf in leaves)]


def as_double(table: Gaussians) -> Gaussians:
    return Gaussians.from_columns({name: column.double() for name, column in table.columns().items()})


def harmonics_of(degree: int) -> int:
    return (degree + 1) ** 2 - 1


STORED = [(degree, harmonics_of(held)) for degree in DEGREES for held in DEGREES if held >= degree]


@pytest.mark.parametrize(("degree", "stored"), STORED)
@pytest.mark.parametrize("count", COUNTS)
def test_native_equals_the_reference_in_value_and_gradient(kernels, degree: int, stored: int, count: int):
    table = random_table(count, stored=stored)
    upstream = torch.randn(count, 3, generator=torch.Generator().manual_seed(1))
    native = colors_and_gradients(table, CAMERA, degree, upstream)
    exact = colors_and_gradients(as_double(table), CAMERA, degree, upstream.double())
    # A colour within rounding of black may be clamped by one and not by the other: leave such rows out.
    unclamped = sh_colors_reference(
        *(c.double() for c in (table.means, table.appearance["sh_dc"] + 100, table.appearance["sh_rest"])),
        CAMERA.position,
        degree,
    )
    sure = ((unclamped - 100 * harmonics.C0).abs() > 1e-5).all(1)
    for found, expected in zip(native, exact, strict=True):
        # 1e-5: float32 rounding of sums of 16 terms of order one; gradients to the means grow as 1/distance.
        torch.testing.assert_close(found[sure].double(), expected[sure], rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize(("degree", "stored"), STORED)
def test_harmonics_above_the_degree_are_not_read_and_get_zero_gradient(degree: int, stored: int):
    table, used = random_table(37, stored=stored), harmonics_of(degree)
    table.appearance["sh_rest"][:, used:] = float("nan")
    rgb, by_means, by_dc, by_rest = colors_and_gradients(table, CAMERA, degree, torch.ones(37, 3))
    assert all(tensor.isfinite().all() for tensor in (rgb, by_means, by_dc))
    assert (by_rest[:, used:] == 0).all()


def test_the_same_bits_for_any_number_of_threads(kernels):
    table = random_table(2500)
    upstream = torch.randn(2500, 3, generator=torch.Generator().manual_seed(1))
    results = []
    for threads in (1, 2, 3):
        kernels.set_threads(threads)
        results.append(colors_and_gradients(table, CAMERA, 3, upstream))
    kernels.set_threads(0)
    for other in results[1:]:
        assert all(torch.equal(a, b) for a, b in zip(results[0], other, strict=True))


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_a_camera_at_the_gaussians_centre_sees_finite_values(dtype: torch.dtype):
    table = random_table(20, dtype)
    camera = camera_at(table.means[5].float())
    table.means[5] = camera.position.to(dtype)
    results = colors_and_gradients(table, camera, 3, torch.ones(20, 3, dtype=dtype))
    assert all(tensor.isfinite().all() for tensor in results)
    base = SphericalHarmonics(3).layers(table, camera)["base"]
    torch.testing.assert_close(results[0][5], base[5])


def test_base_colour_and_residual_are_the_colour_where_the_constant_is_below_black():
    table = random_table(20)
    table.appearance["sh_dc"].fill_(-2.5)
    model, camera = SphericalHarmonics(3), camera_at(torch.zeros(3))
    layers, shown = model.layers(table, camera), model.emit(table, camera, ("rgb",), Want.EXACT).channels
    assert shown.any()
    torch.testing.assert_close(layers["base"] + layers["residual"], shown)


def test_gradients_of_the_reference_equal_finite_differences():
    table = random_table(6, torch.float64)
    # Far enough from black that a difference step never reaches the clamp.
    dc = 0.1 * table.appearance["sh_dc"] + 8
    leaves = [leaf.requires_grad_() for leaf in (table.means, dc, table.appearance["sh_rest"])]
    for degree in DEGREES:
        assert torch.autograd.gradcheck(
            lambda *columns, degree=degree: sh_colors_reference(*columns, CAMERA.position, degree), leaves
        )


def test_upstream_gradients_of_any_stride_are_read(kernels):
    table, wide = random_table(37), torch.randn(37, 5, generator=torch.Generator().manual_seed(1))
    expected = colors_and_gradients(table, CAMERA, 3, wide[:, 1:4].contiguous())
    for upstream in (wide[:, 1:4], wide[:, 1:4].T.contiguous().T):
        found = colors_and_gradients(table, CAMERA, 3, upstream)
        assert all(torch.equal(a, b) for a, b in zip(found, expected, strict=True))
    single = torch.tensor([[2.0, 2.0, 2.0]])
    everywhere = colors_and_gradients(table, CAMERA, 3, single.repeat(37, 1))
    broadcast = colors_and_gradients(table, CAMERA, 3, single.expand(37, 3))
    assert all(torch.equal(a, b) for a, b in zip(broadcast, everywhere, strict=True))


def test_new_columns_show_the_points_colors_from_every_side():
    points = PointCloud(torch.randn(5, 3), torch.rand(5, 3))
    model = SphericalHarmonics()
    table = Gaussians(points.positions, torch.zeros(5, 3), torch.ones(5, 4), torch.zeros(5), model.new_columns(points))
    torch.testing.assert_close(channels(model, table, CAMERA)["rgb"], points.colors)
    assert model.layers(table, CAMERA)["residual"].abs().max() < 1e-6
    assert model.wanted(table).all()


@pytest.mark.parametrize("degree", DEGREES)
def test_a_row_holds_the_harmonics_of_its_degree_and_no_more(degree: int):
    points = PointCloud(torch.randn(5, 3), torch.rand(5, 3))
    assert SphericalHarmonics(degree).new_columns(points)["sh_rest"].shape == (5, harmonics_of(degree), 3)


def test_kernels_refuse_rows_without_the_degrees_harmonics(kernels):
    table, missing = random_table(5, stored=3), random_table(5, stored=4)
    with pytest.raises(ValueError, match="all harmonics up to the degree"):
        SphericalHarmonics(2).emit(table, CAMERA, ("rgb",), Want.EXACT)
    with pytest.raises(ValueError, match="0, 3, 8 or 15"):
        SphericalHarmonics(1).emit(missing, CAMERA, ("rgb",), Want.EXACT)


def test_is_a_color_model_whose_degree_is_saved():
    model = SphericalHarmonics()
    assert isinstance(model, ColorModel)
    model.active_degree.fill_(2)
    again = SphericalHarmonics()
    again.load_state_dict(model.state_dict())
    assert int(again.active_degree) == 2


def test_a_degree_that_is_not_stored_is_refused():
    with pytest.raises(ValueError, match="active_degree is 3, not 0 to 2"):
        SphericalHarmonics(2).load_state_dict(SphericalHarmonics(3).state_dict())


@pytest.mark.parametrize("count", COUNTS)
def test_any_wish_gives_the_same_bits(count: int):
    for table in (random_table(count), as_double(random_table(count))):
        colors = [SphericalHarmonics().emit(table, CAMERA, ("rgb",), want).channels for want in Want]
        assert all(torch.equal(other, colors[0]) for other in colors[1:])


def test_columns_that_the_kernel_cannot_read_are_the_references():
    table = random_table(7)
    table.appearance["sh_dc"] = table.appearance["sh_dc"].T.contiguous().T
    columns = table.means, table.appearance["sh_dc"], table.appearance["sh_rest"]
    for want in Want:
        rgb = SphericalHarmonics().emit(table, CAMERA, ("rgb",), want).channels
        assert torch.equal(rgb, sh_colors_reference(*columns, CAMERA.position, 3))


@pytest.mark.parametrize(("degree", "stored"), STORED)
@pytest.mark.parametrize("count", COUNTS)
def test_adam_by_factors_equals_adam_by_the_gradient_written_down(kernels, degree: int, stored: int, count: int):
    table = random_table(count, stored=stored)
    upstream = torch.randn(count, 3, generator=torch.Generator().manual_seed(1))
    factors = rest_gradient(table, degree, upstream)
    used = harmonics_of(degree)
    moments = torch.rand(2, count, stored, 3, generator=torch.Generator().manual_seed(2))
    moments[:, :, used:] = 0  # as they are for harmonics that were never in use
    rest = table.appearance["sh_rest"]
    ends = []
    for gradient in (factors, factors.dense()):
        value, mean, square = rest.clone(), moments[0].clone(), moments[1].clone()
        adam_([Update(value, gradient, mean, square, (0.01, 0.9, 0.999, 1e-15, 7))])
        ends.append((value, mean, square))
    assert all(torch.equal(a, b) for a, b in zip(*ends, strict=True))
    assert count == 0 or used == 0 or not torch.equal(ends[0][0], rest)


@pytest.mark.parametrize("degree", DEGREES)
def test_the_way_back_adds_to_the_gradient_of_the_means(kernels, degree: int):
    table, upstream = random_table(37), torch.randn(37, 3, generator=torch.Generator().manual_seed(1))
    _, by_means, *others = colors_and_gradients(table, CAMERA, degree, upstream)
    into = Gradients({"columns.means": torch.ones(37, 3)})
    SphericalHarmonics(degree).emit(table, CAMERA, ("rgb",), Want.GRADIENTS).backward(upstream, None, into)
    assert into.keys() == {"columns.means", "columns.sh_dc", "columns.sh_rest"}
    assert torch.equal(into["columns.means"], 1 + by_means)
    assert isinstance(into["columns.sh_rest"], RestGradient)
    for name, expected in zip(("columns.sh_dc", "columns.sh_rest"), others, strict=True):
        assert torch.equal(dense(into[name]), expected)


def rest_gradient(table: Gaussians, degree: int, upstream: Tensor) -> RestGradient:
    into = Gradients()
    SphericalHarmonics(degree).emit(table, CAMERA, ("rgb",), Want.GRADIENTS).backward(upstream, None, into)
    found = into["columns.sh_rest"]
    assert isinstance(found, RestGradient)
    return found
