"""Harmonics of a shared basis: the kernels equal the torch reference, and both equal harmonics that are written out."""

import pytest
import torch
from torch import Tensor

from ringlight.color.contract import ColorModel
from ringlight.color.harmonics import SphericalHarmonics
from ringlight.color.shared_basis import SharedBasis, mixed_harmonics
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import Gradients, dense
from ringlight.core.kernel_limits import SH_MAX_BASIS
from ringlight.core.scene import PointCloud
from ringlight.core.want import Want
from ringlight.errors import RecipeError

COUNTS = (16, 37, 3, 2500, 9000, 0)
"""One full block of 16 lanes, a tail, less than a block, several pieces, several shards, nothing."""

TOLERANCE = 2e-5
"""Of the largest number: float32 rounding of sums of 45 terms of order one, over thousands of rows."""


@pytest.fixture
def kernels():
    return pytest.importorskip("ringlight._kernels", reason="needs the compiled module")


def camera() -> Camera:
    matrix = torch.eye(4)
    matrix[:3, 3] = torch.tensor([-0.3, 1.2, -0.7])
    return Camera(matrix, (100.0, 100.0), (50.0, 50.0), 100, 100)


def table_of(count: int, size: int) -> Gaussians:
    generator = torch.Generator().manual_seed(count)
    draw = lambda *shape: torch.randn(*shape, generator=generator)  # noqa: E731
    # Of this size about a tenth of the colours is clamped at black.
    appearance = {"sh_dc": draw(count, 3), "basis_weights": 0.5 * draw(count, size)}
    return Gaussians(2 * draw(count, 3), draw(count, 3), draw(count, 4), draw(count), appearance)


def model_of(size: int, degree: int = 3, dtype: torch.dtype = torch.float32) -> SharedBasis:
    model = SharedBasis(size, seed=5).to(dtype)
    model.active_degree.fill_(degree)
    return model


def as_double(table: Gaussians) -> Gaussians:
    return Gaussians.from_columns({name: column.double() for name, column in table.columns().items()})


def colors_and_gradients(model: SharedBasis, table: Gaussians, upstream: Tensor) -> dict[str, Tensor]:
    emission = model.emit(table, camera(), ("rgb",), Want.GRADIENTS)
    into = Gradients()
    emission.backward(upstream, None, into)
    return {"rgb": emission.channels} | {name: dense(gradient) for name, gradient in into.items()}


def upstream_of(count: int) -> Tensor:
    """As a picture's: whole blocks that nobody sees, and single rows."""
    upstream = torch.randn(count, 3, generator=torch.Generator().manual_seed(1))
    upstream[100:700] = 0
    upstream[::3] = 0
    return upstream


def sure_rows(table: Gaussians, model: SharedBasis) -> Tensor:
    """A colour within rounding of black may be clamped by one and not by the other."""
    lifted = table.columns() | {"sh_dc": table.appearance["sh_dc"] + 100}
    shown = model.emit(Gaussians.from_columns(lifted), camera(), ("rgb",), Want.EXACT).channels
    return ((shown - 100 * 0.2820948).abs() > 1e-4).all(1)


def test_it_is_a_colour_model():
    assert isinstance(SharedBasis(8), ColorModel)


def test_many_rows_are_summed_in_all_shards(kernels):
    count = 70_000
    table, model, upstream = table_of(count, 2), model_of(2), upstream_of(count)
    upstream[~sure_rows(table, model)] = 0
    exact = colors_and_gradients(model_of(2, dtype=torch.float64), as_double(table), upstream.double())["color.basis"]
    found = colors_and_gradients(model, table, upstream)["color.basis"].double()
    torch.testing.assert_close(found, exact, rtol=0, atol=TOLERANCE * float(exact.abs().max()))


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
@pytest.mark.parametrize("size", [1, 2, 3, 4, 5, 8, SH_MAX_BASIS])
@pytest.mark.parametrize("count", COUNTS)
def test_native_equals_the_reference_in_value_and_gradient(kernels, count: int, size: int, degree: int):
    table, upstream, model = table_of(count, size), upstream_of(count), model_of(size, degree)
    upstream[~sure_rows(table, model)] = 0
    native = colors_and_gradients(model, table, upstream)
    exact = colors_and_gradients(model_of(size, degree, torch.float64), as_double(table), upstream.double())
    assert native.keys() == {"rgb", "columns.means", "columns.sh_dc", "columns.basis_weights", "color.basis"}
    for name, found in native.items():
        expected = exact.get(name, torch.zeros_like(found, dtype=torch.float64))
        scale = float(expected.abs().max()) if expected.numel() else 1.0
        torch.testing.assert_close(found.double(), expected, rtol=0, atol=TOLERANCE * max(scale, 1.0), msg=name)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_it_shows_what_written_out_harmonics_show(degree: int):
    table, model = table_of(300, 6), model_of(6, degree)
    written = model.harmonics(table)
    appearance = {"sh_dc": written.sh_dc, "sh_rest": written.sh_rest.contiguous()}
    other = Gaussians(table.means, table.log_scales, table.quats, table.opacity_logits, appearance)
    shown = SphericalHarmonics().emit(other, camera(), ("rgb",), Want.EXACT).channels
    ours = model.emit(table, camera(), ("rgb",), Want.EXACT).channels
    torch.testing.assert_close(ours, shown, rtol=0, atol=1e-5)


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_harmonics_above_the_degree_are_not_shown_and_get_zero_gradient(kernels, degree: int):
    table, model, used = table_of(37, 8), model_of(8, degree), (degree + 1) ** 2 - 1
    with torch.no_grad():
        model.basis[:, used:] = float("nan")
    found = colors_and_gradients(model, table, torch.ones(37, 3))
    assert (found.pop("color.basis")[:, used:] == 0).all()
    assert all(tensor.isfinite().all() for tensor in found.values())


def test_the_same_bits_for_any_number_of_threads(kernels):
    table, model, upstream = table_of(9000, 8), model_of(8), upstream_of(9000)
    results = []
    for threads in (1, 2, 3):
        kernels.set_threads(threads)
        results.append(colors_and_gradients(model, table, upstream))
    kernels.set_threads(0)
    for other in results[1:]:
        assert all(torch.equal(tensor, other[name]) for name, tensor in results[0].items())


@pytest.mark.parametrize("column", ["means", "basis_weights"])
def test_an_unseen_row_that_is_not_a_number_does_not_reach_what_all_share(kernels, column: str):
    table, model, upstream = table_of(50, 4), model_of(4), torch.ones(50, 3)
    upstream[20] = 0
    table.columns()[column][20] = float("nan")
    assert colors_and_gradients(model, table, upstream)["color.basis"].isfinite().all()


def test_what_is_not_a_number_stays_in_its_row_and_is_not_hidden(kernels):
    table, model = table_of(50, 4), model_of(4)
    table.appearance["basis_weights"][20] = float("nan")
    found = colors_and_gradients(model, table, torch.ones(50, 3))
    others = torch.arange(50) != 20
    assert found["rgb"][20].isnan().all()
    assert found["color.basis"].isfinite().all()
    for name in ("rgb", "columns.means", "columns.sh_dc", "columns.basis_weights"):
        assert found[name][others].isfinite().all(), name


def test_it_begins_with_the_points_own_colours():
    points = PointCloud(torch.zeros(4, 3), torch.rand(4, 3, generator=torch.Generator().manual_seed(0)))
    model = SharedBasis(8)
    columns = model.new_columns(points)
    table = table_of(4, 8)
    start = Gaussians(table.means, table.log_scales, table.quats, table.opacity_logits, columns)
    torch.testing.assert_close(model.emit(start, camera(), ("rgb",), Want.EXACT).channels, points.colors)
    layers = model.layers(start, camera())
    torch.testing.assert_close(layers["residual"], torch.zeros(4, 3), rtol=0, atol=1e-6)


@pytest.mark.parametrize("degree", [-1, 4, 9])
def test_a_degree_that_is_not_there_is_refused(degree: int):
    state = SharedBasis(8).state_dict() | {"active_degree": torch.tensor(degree)}
    with pytest.raises(ValueError, match=f"active_degree is {degree}"):
        SharedBasis(8).load_state_dict(state)


def test_the_basis_is_drawn_by_the_seed():
    assert torch.equal(SharedBasis(8, seed=3).basis, SharedBasis(8, seed=3).basis)
    assert not torch.equal(SharedBasis(8, seed=3).basis, SharedBasis(8, seed=4).basis)


@pytest.mark.parametrize("size", [0, SH_MAX_BASIS + 1])
def test_sizes_that_the_kernels_do_not_take_are_refused(size: int):
    with pytest.raises(RecipeError, match=f"give 1 to {SH_MAX_BASIS}"):
        SharedBasis(size)


def test_mixed_harmonics_are_a_matrix_product():
    weights, basis = torch.rand(5, 3), torch.rand(3, 15, 3)
    expected = torch.einsum("nk,kjc->njc", weights, basis)
    torch.testing.assert_close(mixed_harmonics(weights, basis), expected)


def test_the_kernels_refuse_what_does_not_fit(kernels):
    means, dc, weights, basis = torch.rand(4, 3), torch.rand(4, 3), torch.rand(4, 2), torch.rand(2, 15, 3)
    out, native = torch.empty(4, 3), camera().native
    for wrong in (
        (means, dc, weights[:3], basis, native, 3, out),
        (means, dc, weights, basis[:1], native, 3, out),
        (means, dc, weights, basis[:, :8].contiguous(), native, 3, out),
        (means, dc, weights, basis, native, 4, out),
        (means, dc[:3], weights, basis, native, 3, out),
    ):
        with pytest.raises(ValueError, match="sh"):
            kernels.sh_basis_colors(*wrong)
    with pytest.raises(ValueError, match="by_weights"):
        kernels.sh_basis_gradient(means, native, 3, dc, weights, basis, torch.empty(4, 3), torch.empty(2, 15, 3))
