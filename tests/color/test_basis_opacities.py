"""Opacities that a shared basis moves: the kernels equal the torch reference, which has the gradients of its values."""

import pytest
import torch
from torch import Tensor

from finite_differences import assert_gradients
from ringlight.color.basis_opacities import LEAST_MEAN, BasisOpacities, factors_reference
from ringlight.color.contract import ColorModel
from ringlight.color.shared_basis import SharedBasis
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import Gradients, dense
from ringlight.core.kernel_limits import SH_MAX_BASIS
from ringlight.core.want import Want

COUNTS = (16, 37, 3, 2500, 9000, 0)
"""One full block of 16 lanes, a tail, less than a block, several pieces, several shards, nothing."""

TOLERANCE = 2e-5
"""Of the largest number: float32 rounding of sums over thousands of rows."""


@pytest.fixture
def kernels():
    return pytest.importorskip("ringlight._kernels", reason="needs the compiled module")


def camera() -> Camera:
    matrix = torch.eye(4)
    matrix[:3, 3] = torch.tensor([-0.3, 1.2, -0.7])
    return Camera(matrix, (100.0, 100.0), (50.0, 50.0), 100, 100)


def table_of(count: int, size: int, dtype: torch.dtype = torch.float32) -> Gaussians:
    generator = torch.Generator().manual_seed(count)
    draw = lambda *shape: torch.randn(*shape, generator=generator).to(dtype)  # noqa: E731
    # Colours far from black, so that none is clamped by one and not by the other.
    appearance = {"sh_dc": 40 + draw(count, 3), "basis_weights": 0.3 * draw(count, size)}
    return Gaussians(2 * draw(count, 3), draw(count, 3), draw(count, 4), 2 * draw(count), appearance)


def model_of(size: int, degree: int = 3, dtype: torch.dtype = torch.float32) -> BasisOpacities:
    model = BasisOpacities(size, seed=5).to(dtype)
    model.active_degree.fill_(degree)
    return model


def found_by(model: BasisOpacities, table: Gaussians, by_colors: Tensor, by_factors: Tensor) -> dict[str, Tensor]:
    emission, into = model.emit(table, camera(), ("rgb",), Want.GRADIENTS), Gradients()
    assert emission.opacity_factor is not None
    emission.backward(by_colors.to(table.means), by_factors.to(table.means), into)
    found = {name: dense(gradient) for name, gradient in into.items()}
    return found | {"rgb": emission.channels, "factor": emission.opacity_factor}


def upstream_of(count: int) -> tuple[Tensor, Tensor]:
    """As a picture's: whole blocks that nobody sees, and single rows."""
    drawn = torch.Generator().manual_seed(1)
    both = torch.randn(count, 3, generator=drawn), torch.randn(count, generator=drawn)
    for upstream in both:
        upstream[100:700] = 0
        upstream[::3] = 0
    return both


def test_it_is_a_colour_model():
    assert isinstance(BasisOpacities(8), ColorModel)


@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize("size", [1, 2, 3, 4, 8, SH_MAX_BASIS])
@pytest.mark.parametrize("count", COUNTS)
def test_native_equals_the_reference_in_value_and_gradient(kernels, count: int, size: int, degree: int):
    upstream = upstream_of(count)
    native = found_by(model_of(size, degree), table_of(count, size), *upstream)
    exact = found_by(model_of(size, degree, torch.float64), table_of(count, size, torch.float64), *upstream)
    assert native.keys() == exact.keys()
    for name, found in native.items():
        expected = exact[name]
        scale = float(expected.abs().max()) if expected.numel() else 1.0
        torch.testing.assert_close(found.double(), expected, rtol=0, atol=TOLERANCE * max(scale, 1.0), msg=name)


@pytest.mark.parametrize("degree", [1, 3])
def test_the_reference_has_the_gradients_of_its_values(degree: int):
    table, shared = table_of(6, 4, torch.float64), model_of(4, dtype=torch.float64).opacity_basis.detach()
    leaves = [table.means, table.opacity_logits, table.appearance["basis_weights"], shared]
    assert_gradients(
        lambda *of: factors_reference(*of, camera().position, degree), [leaf.requires_grad_() for leaf in leaves]
    )


def test_the_factor_is_the_opacity_towards_the_camera_over_that_of_the_logit(kernels):
    table, model = table_of(300, 6), model_of(6)
    factor = model.emit(table, camera(), ("rgb",), Want.EXACT).opacity_factor
    assert factor is not None
    opacities = table.opacities * factor
    assert ((opacities > 0) & (opacities < 1)).all()
    assert opacities.std() > 0.1
    lowered = Gaussians.from_columns(table.columns() | {"opacity_logits": table.opacity_logits - 8})
    low = model.emit(lowered, camera(), ("rgb",), Want.EXACT).opacity_factor
    assert (lowered.opacities * low < opacities).all(), "who lowers a logit lowers the opacity from every side"


def test_what_cannot_be_seen_has_a_factor_that_is_a_number(kernels):
    table, model = table_of(50, 4), model_of(4)
    unseen = Gaussians.from_columns(table.columns() | {"opacity_logits": torch.full((50,), -200.0)})
    found = found_by(model, unseen, torch.ones(50, 3), torch.ones(50))
    assert all(tensor.isfinite().all() for tensor in found.values())
    assert (found["factor"] * LEAST_MEAN < 1e-9).all()


def test_colours_are_those_of_the_basis_alone(kernels):
    table, model = table_of(300, 6), model_of(6)
    alone = SharedBasis(6, seed=5)
    shown, expected = (of.emit(table, camera(), ("rgb",), Want.EXACT) for of in (model, alone))
    assert torch.equal(shown.channels, expected.channels)
    assert expected.opacity_factor is None


def test_it_begins_with_the_same_opacity_from_every_side(kernels):
    table, model = table_of(50, 8), model_of(8)
    start = Gaussians.from_columns(table.columns() | {"basis_weights": torch.zeros(50, 8)})
    factor = model.emit(start, camera(), ("rgb",), Want.EXACT).opacity_factor
    torch.testing.assert_close(factor, torch.ones(50))
    model.active_degree.fill_(0)
    assert model.emit(table, camera(), ("rgb",), Want.EXACT).opacity_factor is None


@pytest.mark.parametrize("degree", [1, 2])
def test_harmonics_above_the_degree_are_not_shown_and_get_zero_gradient(kernels, degree: int):
    table, model, used = table_of(37, 8), model_of(8, degree), (degree + 1) ** 2 - 1
    with torch.no_grad():
        model.opacity_basis[:, used:] = float("nan")
    found = found_by(model, table, torch.ones(37, 3), torch.ones(37))
    assert (found.pop("color.opacity_basis")[:, used:] == 0).all()
    assert all(tensor.isfinite().all() for tensor in found.values())


def test_harmonics_of_degree_0_move_no_mean(kernels):
    """Nor does what a call before them left in memory, where that is still there."""
    drawn = torch.Generator().manual_seed(0)
    means, logits, weights, shared = (
        torch.randn(shape, generator=drawn) for shape in ((40, 3), (40,), (40, 2), (2, 15))
    )
    for degree in (3, 0):
        by_means = torch.zeros(40, 3)
        kernels.sh_basis_opacity_gradient(
            means, logits, weights, shared, camera().native, degree, LEAST_MEAN, torch.ones(40), by_means,
            torch.zeros(40), torch.zeros(40, 2), torch.empty(2, 15),
        )  # fmt: skip
    assert not by_means.any()


def test_the_same_bits_for_any_number_of_threads(kernels):
    results = []
    for threads in (1, 2, 3):
        kernels.set_threads(threads)
        results.append(found_by(model_of(8), table_of(9000, 8), *upstream_of(9000)))
    kernels.set_threads(0)
    for other in results[1:]:
        assert all(torch.equal(tensor, other[name]) for name, tensor in results[0].items())


@pytest.mark.parametrize("column", ["means", "basis_weights"])
def test_an_unseen_row_that_is_not_a_number_does_not_reach_what_all_share(kernels, column: str):
    table, model = table_of(50, 4), model_of(4)
    by_colors, by_factors = torch.ones(50, 3), torch.ones(50)
    by_colors[20], by_factors[20] = 0, 0
    table.columns()[column][20] = float("nan")
    found = found_by(model, table, by_colors, by_factors)
    assert found["color.basis"].isfinite().all()
    assert found["color.opacity_basis"].isfinite().all()


@pytest.mark.parametrize("column", ["means", "opacity_logits", "basis_weights"])
def test_a_seen_row_that_is_not_a_number_stays_in_its_row(kernels, column: str):
    table, model = table_of(50, 8), model_of(8)
    table.columns()[column][20] = float("nan")
    by_colors = torch.ones(50, 3)
    by_colors[20] = 0
    found = found_by(model, table, by_colors, torch.ones(50))
    assert found["color.opacity_basis"].isfinite().all()
    others = torch.arange(50) != 20
    for name in ("columns.means", "columns.opacity_logits", "columns.basis_weights"):
        assert found[name][others].isfinite().all(), name


def test_many_rows_are_summed_in_all_shards(kernels):
    count, upstream = 70_000, upstream_of(70_000)
    found = found_by(model_of(4), table_of(count, 4), *upstream)["color.opacity_basis"].double()
    exact = found_by(model_of(4, dtype=torch.float64), table_of(count, 4, torch.float64), *upstream)
    torch.testing.assert_close(
        found, exact["color.opacity_basis"], rtol=0, atol=TOLERANCE * float(exact["color.opacity_basis"].abs().max())
    )


def test_both_bases_are_drawn_by_the_seed():
    same, other = BasisOpacities(8, seed=3), BasisOpacities(8, seed=4)
    assert torch.equal(BasisOpacities(8, seed=3).opacity_basis, same.opacity_basis)
    assert not torch.equal(other.opacity_basis, same.opacity_basis)
    assert torch.equal(SharedBasis(8, seed=3).basis, same.basis)


def test_the_kernels_refuse_what_does_not_fit(kernels):
    means, logits, weights, shared = torch.rand(4, 3), torch.rand(4), torch.rand(4, 2), torch.rand(2, 15)
    native, out = camera().native, torch.empty(4)
    for wrong in (
        (means, logits[:3], weights, shared, native, 3, 1e-6, out),
        (means, logits, weights[:3], shared, native, 3, 1e-6, out),
        (means, logits, weights, shared[:1], native, 3, 1e-6, out),
        (means, logits, weights, shared[:, :8].contiguous(), native, 3, 1e-6, out),
        (means, logits, weights, shared, native, 4, 1e-6, out),
        (means, logits, weights, shared, native, 3, 0.0, out),
        (means, logits, weights, shared, native, 3, 1e-6, out[:3]),
    ):
        with pytest.raises(ValueError, match="sh"):
            kernels.sh_basis_opacity_factors(*wrong)
    with pytest.raises(ValueError, match="by_weights"):
        kernels.sh_basis_opacity_gradient(
            means, logits, weights, shared, native, 3, 1e-6, logits, means, logits, weights[:3], shared
        )
