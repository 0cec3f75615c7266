"""Opacities that are harmonics of the direction: kernels equal the torch reference, and nothing negative blends."""

import pytest
import torch
from torch import Tensor

from ringlight.color.glossy_harmonics import LEAST_MEAN, OPACITY_REST, GlossyHarmonics, opacity_factors_reference
from ringlight.color.harmonics import SphericalHarmonics
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import COLUMNS, Gradients, dense
from ringlight.core.want import Want
from ringlight.errors import RecipeError

COUNTS = (16, 37, 3, 2500, 0)
"""One full block of 16 lanes, a tail, less than a block, several pieces, nothing."""

TOLERANCE = 1e-5
"""Of the largest number: float32 rounding of sums of 16 terms of order one, over an opacity of a hundredth at least."""


@pytest.fixture
def kernels():
    return pytest.importorskip("ringlight._kernels", reason="needs the compiled module")


def camera() -> Camera:
    matrix = torch.eye(4)
    matrix[:3, 3] = torch.tensor([-0.3, 1.2, -0.7])
    return Camera(matrix, (100.0, 100.0), (50.0, 50.0), 100, 100)


def table_of(count: int, spread: float = 0.3, stored: int = 15) -> Gaussians:
    """With this ``spread`` of the coefficients about a third of the opacities are clamped."""
    drawn = torch.Generator().manual_seed(count)
    draw = lambda *shape: torch.randn(*shape, generator=drawn)  # noqa: E731
    appearance = {
        "sh_dc": draw(count, 3),
        "sh_rest": 0.5 * draw(count, 15, 3),
        OPACITY_REST: spread * draw(count, stored),
    }
    return Gaussians(2 * draw(count, 3), draw(count, 3), draw(count, 4), 1.5 * draw(count), appearance)


def exactly(table: Gaussians) -> Gaussians:
    return Gaussians.from_columns({name: column.double() for name, column in table.columns().items()})


def free_opacities(table: Gaussians, degree: int) -> Tensor:
    """Before they are clamped, in double precision: the harmonics around a mean so high that nothing is clamped."""
    rows = exactly(table)
    halves = torch.zeros_like(rows.opacity_logits)
    tiny = 1e-3
    rest = opacity_factors_reference(
        rows.means, halves, tiny * rows.appearance[OPACITY_REST], camera().position, degree
    )
    return rows.opacities + (0.5 * rest - 0.5) / tiny


def found_by(table: Gaussians, upstream: tuple[Tensor, Tensor], degree: int = 3) -> dict[str, Tensor]:
    stored = table.appearance[OPACITY_REST].shape[1]
    model = GlossyHarmonics(opacity_degree=int((stored + 1) ** 0.5) - 1)
    model.active_opacity_degree.fill_(degree)
    emission, into = model.emit(table, camera(), ("rgb",), Want.GRADIENTS), Gradients()
    emission.backward(upstream[0].to(table.means), upstream[1].to(table.means), into)
    assert emission.opacity_factor is not None
    found = {name: dense(gradient) for name, gradient in into.items()}
    return found | {"rgb": emission.channels, "factor": emission.opacity_factor}


def upstream_of(count: int) -> tuple[Tensor, Tensor]:
    drawn = torch.Generator().manual_seed(1)
    return torch.randn(count, 3, generator=drawn), torch.randn(count, generator=drawn)


@pytest.mark.parametrize(("degree", "stored"), [(1, 3), (2, 8), (3, 15), (1, 15), (2, 15)])
@pytest.mark.parametrize("count", COUNTS)
def test_native_equals_the_reference_in_value_and_gradient(kernels, count: int, degree: int, stored: int):
    table, upstream = table_of(count, stored=stored), upstream_of(count)
    native, exact = found_by(table, upstream, degree), found_by(exactly(table), upstream, degree)
    assert native.keys() == exact.keys()
    free = free_opacities(table, degree)
    clear = torch.minimum(free.abs(), (free - 1).abs()) > 1e-4  # on the edge either may clamp, and the other not
    clear &= (exact["rgb"] > 1e-4).all(1) | (exact["rgb"] == 0).any(1)
    for name, values in exact.items():
        largest = float(values.abs().max()) if values.numel() else 1.0
        error = (native[name].double() - values)[clear]
        assert not error.numel() or error.abs().max() <= TOLERANCE * max(largest, 1.0), name


def test_the_cases_have_opacities_of_all_kinds():
    free = free_opacities(table_of(2500), 3)
    assert min(((free < 0).sum(), (free > 1).sum(), ((free > 0) & (free < 1)).sum())) > 200


def test_nothing_negative_blends_and_nothing_is_more_than_opaque(kernels):
    table = table_of(2500, spread=2.0)
    factor = found_by(table, upstream_of(2500))["factor"]
    opacities = table.opacities * factor
    assert (factor >= 0).all()
    assert (factor == 0).any(), "negative ones"
    assert (opacities <= 1 + 1e-6).all()
    assert (opacities > 0.9999).any(), "those above one"
    torch.testing.assert_close(opacities.double(), free_opacities(table, 3).clamp(0, 1), atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("native", [True, False])
def test_without_harmonics_of_the_opacity_it_is_3dgs(native: bool):
    table = table_of(50, spread=0.0)
    table = table if native else exactly(table)
    colors = SphericalHarmonics().emit(table, camera(), ("rgb",), Want.EXACT)
    emission = GlossyHarmonics().emit(table, camera(), ("rgb",), Want.EXACT)
    assert torch.equal(emission.channels, colors.channels)
    assert emission.opacity_factor is not None
    torch.testing.assert_close(emission.opacity_factor, torch.ones_like(table.opacity_logits), rtol=1e-6, atol=0)
    none = GlossyHarmonics(opacity_degree=0)
    bare = table_of(50, stored=0)
    assert none.emit(bare, camera(), ("rgb",), Want.EXACT).opacity_factor is None


def test_the_same_bits_for_any_number_of_threads_and_in_any_order_of_rows(kernels):
    table, upstream = table_of(5000), upstream_of(5000)
    results = []
    for threads in (1, 2, 4):
        kernels.set_threads(threads)
        results.append(found_by(table, upstream))
    kernels.set_threads(0)
    for other in results[1:]:
        assert all(torch.equal(values, other[name]) for name, values in results[0].items())
    order = torch.randperm(5000, generator=torch.Generator().manual_seed(4))
    turned = found_by(table.rows(order), tuple(values[order] for values in upstream))  # type: ignore[arg-type]
    assert all(torch.equal(values[order], turned[name]) for name, values in results[0].items())


def test_rows_that_nobody_sees_move_by_nothing(kernels):
    table, (of_rgb, of_factor) = table_of(64), upstream_of(64)
    of_rgb[16:48], of_factor[16:48] = 0, 0
    found = found_by(table, (of_rgb, of_factor))
    for name in ("means", "opacity_logits", OPACITY_REST, "sh_dc"):
        assert not found[COLUMNS + name][16:48].any(), name
        assert found[COLUMNS + name][:16].any(), name


@pytest.mark.parametrize("logit", [-100.0, -30.0, 100.0])
def test_any_mean_gives_numbers(kernels, logit: float):
    table = table_of(40)
    table.opacity_logits.fill_(logit)
    found = found_by(table, upstream_of(40))
    assert all(values.isfinite().all() for values in found.values())
    assert (table.opacities * found["factor"] <= 1 + 1e-6).all()
    if logit == -30.0:
        assert float(table.opacities[0]) < LEAST_MEAN, "the mean itself is next to nothing"


def test_an_opacity_of_exactly_one_learns(kernels):
    """As every one of a large logit is, before its harmonics have learned anything."""
    table, upstream = table_of(40, spread=0.0), upstream_of(40)
    table.opacity_logits.fill_(20.0)
    native = found_by(table, upstream)[COLUMNS + OPACITY_REST]
    rest = torch.zeros(40, 15, requires_grad=True)
    factors = opacity_factors_reference(table.means, table.opacity_logits, rest, camera().position, 3)
    factors.backward(upstream[1])
    assert rest.grad.any()
    torch.testing.assert_close(native, rest.grad)


def test_harmonics_of_degree_0_move_no_mean(kernels):
    """Nor does what a call before them left in memory, where that is still there."""
    table, native = table_of(40), camera().native
    for degree in (3, 0):
        by_means = torch.zeros(40, 3)
        kernels.sh_opacity_gradient(
            table.means, table.opacity_logits, table.appearance[OPACITY_REST], native, degree, LEAST_MEAN,
            torch.ones(40), by_means, torch.zeros(40), torch.empty(40, 15),
        )  # fmt: skip
    assert not by_means.any()


def test_what_is_not_a_number_stays_in_its_row_and_is_not_hidden(kernels):
    table = table_of(50)
    table.appearance[OPACITY_REST][20, 3] = float("nan")
    factor = found_by(table, upstream_of(50))["factor"]
    assert factor[20].isnan()
    assert factor[torch.arange(50) != 20].isfinite().all()


@pytest.mark.parametrize("degree", [-1, 4])
def test_a_degree_that_is_not_there_is_refused(degree: int):
    with pytest.raises(RecipeError, match="give 0 to 3"):
        GlossyHarmonics(opacity_degree=degree)
    state = GlossyHarmonics().state_dict() | {"active_opacity_degree": torch.tensor(degree)}
    with pytest.raises(ValueError, match="active_opacity_degree"):
        GlossyHarmonics().load_state_dict(state)


def test_the_kernels_refuse_what_does_not_fit(kernels):
    means, logits, rest, out = torch.rand(4, 3), torch.rand(4), torch.rand(4, 15), torch.empty(4)
    native = camera().native
    for wrong in (
        (means, logits[:3], rest, native, 3, LEAST_MEAN, out),
        (means, logits, rest[:3], native, 3, LEAST_MEAN, out),
        (means, logits, rest[:, :8].contiguous(), native, 3, LEAST_MEAN, out),
        (means, logits, rest, native, 4, LEAST_MEAN, out),
        (means, logits, rest, native, 3, 0.0, out),
        (means, logits, rest, native, 3, LEAST_MEAN, out[:3]),
    ):
        with pytest.raises(ValueError, match="sh"):
            kernels.sh_opacity_factors(*wrong)
    with pytest.raises(ValueError, match="by_rest"):
        kernels.sh_opacity_gradient(
            means, logits, rest, native, 3, LEAST_MEAN, out, torch.rand(4, 3), out.clone(), torch.rand(4, 8)
        )
